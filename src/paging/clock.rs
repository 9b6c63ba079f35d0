//! The pool's bookkeeping: which brick is in which slot, and whose slot is reused next.

use std::cmp::Reverse;
use std::collections::{BinaryHeap, HashMap};
use std::sync::Arc;

/// Passes of the hand that a brick in use a while ago survives.
const CREDIT_USED: u8 = 1;
/// Passes of the hand that a brick survives that was loaded ahead and not used yet.
const CREDIT_AHEAD: u8 = 2;

/// Turns that are noted for each slot, at most on average.
const TURNS_PER_SLOT: usize = 2;

/// Where a brick is.
pub(super) enum Found<B> {
    Ready(Arc<B>),
    Loading,
    Absent,
}

/// A slot's brick is away while it is being filled.
struct Slot<B> {
    key: Option<u64>,
    brick: Option<Arc<B>>,
    credit: u8,
    /// The last turn that needs it.
    last_turn: u64,
}

impl<B> Slot<B> {
    /// Its brick, if nobody holds it. Pins are made under the lock that guards the clock: who is alone
    /// now stays alone.
    fn alone(&mut self) -> Option<&mut B> {
        self.brick.as_mut().and_then(Arc::get_mut)
    }
}

/// A slot that has been taken, and its brick, to be filled.
pub(super) struct Claim<B> {
    /// The slot's number.
    pub(super) place: usize,
    /// Its brick, which nobody else holds.
    pub(super) brick: Arc<B>,
}

/// When a slot's brick is needed last, and which slot that is.
type LastTurn = (u64, usize);

/// The slots and the hand that goes around them. Slots whose bricks no turn to come needs are reused
/// first, before new ones are made: memory that has been touched is faster than any other. Where there
/// are none, a slot is reused when nobody holds its brick and its credit is used up; each pass of the
/// hand costs one.
pub(super) struct Clock<B> {
    slots: Vec<Slot<B>>,
    limit: usize,
    places: HashMap<u64, usize>,
    hand: usize,
    /// Last turns of bricks that have been filled, the earliest on top, each with its slot. Notes
    /// are not taken back: one counts only while its slot still has that last turn.
    turns: BinaryHeap<Reverse<LastTurn>>,
    /// The first turn that is not over.
    turn: u64,
}

impl<B> Clock<B> {
    /// A clock without slots, which makes up to `limit`.
    pub(super) fn new(limit: usize) -> Self {
        let (slots, turns) = Default::default();
        Self { slots, limit, places: HashMap::new(), hand: 0, turns, turn: 0 }
    }

    /// Bytes per slot beside the brick: the slot, its place in the map and its turns, each twice
    /// (vectors and maps grow by doubling, and copy), and what the allocator adds.
    pub(super) const fn slot_bytes() -> u64 {
        let turns = TURNS_PER_SLOT * size_of::<Reverse<LastTurn>>();
        let slot = size_of::<Slot<B>>() + size_of::<(u64, usize)>() + 1;
        4 * (slot + turns) as u64 + 64
    }

    /// Nothing is known any more of when bricks are needed.
    pub(super) fn forget_turns(&mut self) {
        self.turns.clear();
        self.slots.iter_mut().for_each(|slot| slot.last_turn = u64::MAX);
        self.turn = 0;
    }

    /// All turns before `turn` are over.
    pub(super) fn turns_are_over(&mut self, turn: u64) {
        self.turn = self.turn.max(turn);
    }

    /// Whether no turn to come needs what is needed last in `last_turn`.
    pub(super) fn is_over(&self, last_turn: u64) -> bool {
        last_turn < self.turn
    }

    /// Notes when the brick in a slot is needed last.
    fn note_turn(&mut self, place: usize, last_turn: u64) {
        let Some(slot) = self.slots.get_mut(place) else { return };
        if slot.last_turn == last_turn {
            return;
        }
        slot.last_turn = last_turn;
        if self.turns.len() >= TURNS_PER_SLOT * self.slots.len() {
            let turns = self.slots.iter().enumerate();
            self.turns.clear();
            self.turns.extend(turns.map(|(place, slot)| Reverse((slot.last_turn, place))));
        } else {
            self.turns.push(Reverse((last_turn, place)));
        }
    }

    /// Whether a slot is taken for `key`, its brick filled or not yet.
    pub(super) fn holds(&self, key: u64) -> bool {
        self.places.contains_key(&key)
    }

    /// Looks the brick up for use.
    pub(super) fn find(&mut self, key: u64, last_turn: u64) -> Found<B> {
        let Some(&place) = self.places.get(&key) else { return Found::Absent };
        let Some(slot) = self.slots.get_mut(place) else { return Found::Absent };
        let Some(brick) = &slot.brick else { return Found::Loading };
        let brick = Arc::clone(brick);
        slot.credit = CREDIT_USED;
        self.note_turn(place, last_turn);
        Found::Ready(brick)
    }

    /// How many turns are noted.
    #[cfg(test)]
    pub(super) fn notes(&self) -> usize {
        self.turns.len()
    }

    /// Takes a slot for `key`, whose brick then is the caller's alone until it is published or
    /// released. None when every slot is in use.
    pub(super) fn claim(&mut self, key: u64, new: impl FnOnce() -> B) -> Option<Claim<B>> {
        let passes = usize::from(CREDIT_AHEAD) + 1;
        self.claim_within(key, passes.saturating_mul(self.limit), new)
    }

    /// Takes a slot for `key` as [`Self::claim`] does, but leaves slots alone that have credit
    /// left: one pass of the hand at most.
    pub(super) fn claim_idle(&mut self, key: u64, new: impl FnOnce() -> B) -> Option<Claim<B>> {
        self.claim_within(key, self.limit, new)
    }

    fn claim_within(
        &mut self,
        key: u64,
        steps: usize,
        new: impl FnOnce() -> B,
    ) -> Option<Claim<B>> {
        let claim = if let Some(found) = self.take_over() {
            found
        } else if self.slots.len() < self.limit {
            self.slots.push(Slot { key: None, brick: None, credit: 0, last_turn: u64::MAX });
            Claim { place: self.slots.len() - 1, brick: Arc::new(new()) }
        } else {
            self.take_unused(steps)?
        };
        self.slots[claim.place].key = Some(key);
        self.places.insert(key, claim.place);
        Some(claim)
    }

    /// A slot whose brick no turn to come needs; notes of those that are still in use are kept.
    fn take_over(&mut self) -> Option<Claim<B>> {
        let (mut over, mut in_use) = (None, Vec::new());
        while let Some(&Reverse((last_turn, place))) = self.turns.peek() {
            if over.is_some() || !self.is_over(last_turn) {
                break;
            }
            self.turns.pop();
            let slot = self.slots.get_mut(place).filter(|slot| slot.last_turn == last_turn);
            match slot.map(|slot| slot.alone().is_some()) {
                Some(true) => over = Some(place),
                Some(false) => in_use.push(Reverse((last_turn, place))),
                None => {}
            }
        }
        self.turns.extend(in_use);
        self.empty(over?)
    }

    fn take_unused(&mut self, steps: usize) -> Option<Claim<B>> {
        for _ in 0..steps {
            let place = self.hand;
            self.hand = (place + 1) % self.slots.len();
            let slot = &mut self.slots[place];
            if slot.alone().is_none() {
                continue;
            }
            if slot.credit > 0 {
                slot.credit -= 1;
                continue;
            }
            return self.empty(place);
        }
        None
    }

    /// Takes the brick out of a slot.
    fn empty(&mut self, place: usize) -> Option<Claim<B>> {
        let slot = self.slots.get_mut(place)?;
        slot.last_turn = u64::MAX;
        if let Some(old) = slot.key.take() {
            self.places.remove(&old);
        }
        slot.brick.take().map(|brick| Claim { place, brick })
    }

    /// Puts a filled brick into its slot.
    pub(super) fn publish(&mut self, place: usize, brick: Arc<B>, used: bool, last_turn: u64) {
        if let Some(slot) = self.slots.get_mut(place) {
            slot.credit = if used { CREDIT_USED } else { CREDIT_AHEAD };
            slot.brick = Some(brick);
        }
        self.note_turn(place, last_turn);
    }

    /// Gives a slot back whose brick could not be filled.
    pub(super) fn release(&mut self, place: usize, key: u64, brick: Arc<B>) {
        self.places.remove(&key);
        if let Some(slot) = self.slots.get_mut(place) {
            *slot = Slot { key: None, brick: Some(brick), credit: 0, last_turn: u64::MAX };
        }
    }
}
