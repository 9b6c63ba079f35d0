//! The pool's bookkeeping: which brick is in which slot, and whose slot is reused next.

use std::collections::HashMap;
use std::sync::Arc;

/// Passes of the hand that a brick in use a while ago survives.
const CREDIT_USED: u8 = 1;
/// Passes of the hand that a brick survives that was loaded ahead and not used yet.
const CREDIT_AHEAD: u8 = 2;

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
}

/// The slots and the hand that goes around them. A slot is reused when nobody holds its brick
/// and its credit is used up; each pass of the hand costs one.
pub(super) struct Clock<B> {
    slots: Vec<Slot<B>>,
    limit: usize,
    places: HashMap<u64, usize>,
    hand: usize,
}

impl<B> Clock<B> {
    pub(super) fn new(limit: usize) -> Self {
        Self { slots: Vec::new(), limit, places: HashMap::new(), hand: 0 }
    }

    /// Bytes per slot beside the brick: the slot and its place in the map, each twice (vectors
    /// and maps grow by doubling, and copy), and what the allocator adds.
    pub(super) const fn slot_bytes() -> u64 {
        let slot = size_of::<Slot<B>>() + size_of::<(u64, usize)>() + 1;
        4 * slot as u64 + 64
    }

    pub(super) fn holds(&self, key: u64) -> bool {
        self.places.contains_key(&key)
    }

    /// Looks the brick up for use.
    pub(super) fn find(&mut self, key: u64) -> Found<B> {
        let Some(slot) = self.places.get(&key).and_then(|&place| self.slots.get_mut(place)) else {
            return Found::Absent;
        };
        let Some(brick) = &slot.brick else { return Found::Loading };
        slot.credit = CREDIT_USED;
        Found::Ready(Arc::clone(brick))
    }

    /// Takes a slot for `key`, whose brick then is the caller's alone until it is published or
    /// released. None when every slot is in use.
    pub(super) fn claim(&mut self, key: u64, new: impl FnOnce() -> B) -> Option<(usize, Arc<B>)> {
        let passes = usize::from(CREDIT_AHEAD) + 1;
        self.claim_within(key, passes.saturating_mul(self.limit), new)
    }

    /// As [`Self::claim`], but leaves slots alone that have credit left: one pass at most.
    pub(super) fn claim_idle(
        &mut self,
        key: u64,
        new: impl FnOnce() -> B,
    ) -> Option<(usize, Arc<B>)> {
        self.claim_within(key, self.limit, new)
    }

    fn claim_within(
        &mut self,
        key: u64,
        steps: usize,
        new: impl FnOnce() -> B,
    ) -> Option<(usize, Arc<B>)> {
        let (place, brick) = if self.slots.len() < self.limit {
            self.slots.push(Slot { key: None, brick: None, credit: 0 });
            (self.slots.len() - 1, Arc::new(new()))
        } else {
            self.take_unused(steps)?
        };
        self.slots[place].key = Some(key);
        self.places.insert(key, place);
        Some((place, brick))
    }

    fn take_unused(&mut self, steps: usize) -> Option<(usize, Arc<B>)> {
        for _ in 0..steps {
            let place = self.hand;
            self.hand = (place + 1) % self.slots.len();
            let slot = &mut self.slots[place];
            let Some(brick) = slot.brick.as_mut() else { continue };
            // Pins are made under the lock that guards the clock: who is alone now stays alone.
            if Arc::get_mut(brick).is_none() {
                continue;
            }
            if slot.credit > 0 {
                slot.credit -= 1;
                continue;
            }
            if let Some(old) = slot.key.take() {
                self.places.remove(&old);
            }
            return slot.brick.take().map(|brick| (place, brick));
        }
        None
    }

    /// Puts a filled brick into its slot.
    pub(super) fn publish(&mut self, place: usize, brick: Arc<B>, used: bool) {
        if let Some(slot) = self.slots.get_mut(place) {
            slot.credit = if used { CREDIT_USED } else { CREDIT_AHEAD };
            slot.brick = Some(brick);
        }
    }

    /// Gives a slot back whose brick could not be filled.
    pub(super) fn release(&mut self, place: usize, key: u64, brick: Arc<B>) {
        self.places.remove(&key);
        if let Some(slot) = self.slots.get_mut(place) {
            *slot = Slot { key: None, brick: Some(brick), credit: 0 };
        }
    }
}
