//! Squares of pixels that wait for more rays.

use std::cmp::Reverse;

use super::unevenness::Unevenness;
use crate::render::bounds::grade::Care;
use crate::render::bounds::shares::{ErrorShares, RayShares};
use crate::render::camera::rays::{BATCH_RAYS, Square};
use crate::render::plan::cut::Cut;

/// Pixels that are refined together, those whose squares are off by most first. The fewer, the
/// fewer squares wait; the more, the more rays are marched together.
pub(super) const GROUP_PIXELS: usize = 256;
/// Squares that wait, at most, and those of them that wait to be quartered for rays that stand for
/// themselves: the bounds of a group's other squares are not to go to waste for want of room. Nor are
/// these to leave no room for whole pixels of which only one ray is known.
const MOST_WAITING: usize = 32 << 10;
const MOST_SQUARES_ALONE: usize = MOST_WAITING / 2;
const MOST_OTHERS: usize = MOST_WAITING - 2 * BATCH_RAYS;
/// Once more have waited for rays that stand for themselves, pixels of a tile are finished a few at a
/// time: all of a group at once would not find room.
const CROWD: usize = MOST_SQUARES_ALONE / 2;
pub(super) const FEW_PIXELS: usize = 8;
/// Squares that are put off until all others are finished, at most.
const MOST_LAST: usize = MOST_SQUARES_ALONE / 4;
/// In place of their group's number.
const LAST: usize = usize::MAX;

/// What a ray has found.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Found {
    /// The square whose ray it is.
    pub(super) square: Square,
    /// Radiance and opacity.
    pub(super) value: [f64; 4],
    /// What they may be off by.
    pub(super) shares: RayShares,
    /// How its square's mean may differ from it, if that has been seen.
    pub(super) uneven: Option<Unevenness>,
}

impl Found {
    /// What its ray may be off by, by cause.
    pub(super) fn shares(&self) -> ErrorShares {
        self.shares.into()
    }

    /// What its ray is likely to be off by itself.
    pub(super) fn own(&self) -> f64 {
        self.shares().likely_beside_area()
    }
}

/// What is to be done with squares.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ToDo {
    /// Whether they are quartered first; else they are marched as they are.
    pub(super) quartered: bool,
    /// Which bricks are opened for them.
    pub(super) cut: Cut,
    /// How they have been marched.
    pub(super) before: Care,
    /// How they are to be marched.
    pub(super) care: Care,
    /// Whether their rays stand for themselves: what their squares' mean is, their differences
    /// tell.
    pub(super) alone: bool,
}

/// When squares' turn comes: those of lower groups first, and of these such as do most harm; in a crowd
/// those of the first few pixels.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Urgency {
    group: usize,
    few: usize,
    harm: i32,
}

impl Urgency {
    /// The urgency of squares in a group that may add `error` to their pixels' errors; that is told
    /// apart in powers of four.
    pub(super) fn new(group: usize, error: f64) -> Self {
        Self { group, few: 0, harm: harm(error, 0.5) }
    }

    /// The same, where pixels of the group may be finished a few at a time: for a square of `pixel`.
    pub(super) fn among_few(self, pixel: usize) -> Self {
        Self { few: pixel / FEW_PIXELS, ..self }
    }

    /// The same of squares that wait until all others are finished. What they add is told apart more finely:
    /// there is room for few of them.
    pub(super) fn put_off(error: f64) -> Self {
        Self { group: LAST, few: 0, harm: harm(error, 4.0) }
    }

    /// Whether the number of a group says that it is these.
    pub(super) fn is_last(group: usize) -> bool {
        group == LAST
    }

    /// Whether both are alike but for the few pixels of a group that they are of.
    fn is_like(&self, other: &Self) -> bool {
        (self.group, self.harm) == (other.group, other.harm)
    }
}

/// What squares may add to their pixels' errors, in so many steps for each power of two.
fn harm(error: f64, steps: f64) -> i32 {
    if error.is_finite() { (steps * error.log2()).floor() as i32 } else { i32::MAX }
}

/// Squares alike in what is to be done with them and in the harm that they do.
struct Alike {
    found: Vec<Found>,
    to_do: ToDo,
    urgency: Urgency,
}

/// All squares of a tile that wait.
#[derive(Default)]
pub(super) struct Waiting {
    alike: Vec<Alike>,
    count: usize,
    /// How many of them are for rays that stand for themselves.
    alone: usize,
    /// How many wait until all others are finished.
    last: usize,
    /// Whether so many of these have waited that pixels are finished a few at a time.
    is_crowded: bool,
}

impl Waiting {
    /// Bytes at most: vectors have room for a quarter more than they hold.
    pub(super) const BYTES: u64 = (5 * MOST_WAITING / 4 * size_of::<Found>()) as u64;

    /// Forgets all squares.
    pub(super) fn clear(&mut self) {
        self.alike.clear();
        (self.count, self.alone, self.last, self.is_crowded) = (0, 0, 0, false);
    }

    /// Takes those out of the first group of pixels that harm these most, in a crowd those of its first
    /// few pixels; the group's number with them.
    pub(super) fn pop(&mut self) -> Option<(usize, Vec<Found>, ToDo)> {
        let number = self.next()?;
        let is_crowded = self.is_crowded;
        let Alike { mut found, to_do, urgency } = self.take(number);
        let mut others = 0;
        while let (Some(alike), false) = (self.alike.get(others), is_crowded) {
            let is_like = alike.urgency.is_like(&urgency) && alike.to_do == to_do;
            if is_like && found.len() + alike.found.len() <= most_alike(&to_do) {
                found.append(&mut self.take(others).found);
            } else {
                others += 1;
            }
        }
        Some((urgency.group, found, to_do))
    }

    /// Whether pixels are finished a few at a time.
    pub(super) fn is_crowded(&self) -> bool {
        self.is_crowded
    }

    /// Takes out the squares that [`Self::pop`] would, if these are to be dealt with as `to_do`
    /// says and `is_like` holds for all of them, and they were not put off; else none.
    pub(super) fn pop_like(
        &mut self,
        to_do: &ToDo,
        is_like: impl Fn(&Found) -> bool,
    ) -> Option<Vec<Found>> {
        let number = self.next()?;
        let next = &self.alike[number];
        let is_alike = next.to_do == *to_do && next.found.iter().all(is_like);
        let is_like = is_alike && next.urgency.group != LAST;
        is_like.then(|| self.take(number).found)
    }

    /// Whose turn it is.
    fn next(&self) -> Option<usize> {
        let is_crowded = self.is_crowded;
        let order = |number: &usize| {
            let Urgency { group, few, harm } = self.alike[*number].urgency;
            (Reverse(group), Reverse(if is_crowded { few } else { 0 }), harm)
        };
        (0..self.alike.len()).max_by_key(order)
    }

    fn take(&mut self, number: usize) -> Alike {
        let alike = self.alike.swap_remove(number);
        self.count -= alike.found.len();
        if alike.to_do.alone {
            self.alone -= alike.found.len();
        }
        if alike.urgency.group == LAST {
            self.last -= alike.found.len();
        }
        alike
    }

    /// Takes those out that do least harm among those for rays that stand for themselves, of the first
    /// group: that is in hand, and others are not to make up for what it takes. Those whose harm knows
    /// no limit come last, whatever their group.
    pub(super) fn pop_least_alone(&mut self) -> Vec<Found> {
        let alone = (0..self.alike.len()).filter(|n| self.alike[*n].to_do.alone);
        let order = |number: &usize| {
            let Urgency { group, harm, .. } = self.alike[*number].urgency;
            (harm == i32::MAX, group, harm)
        };
        alone.min_by_key(order).map_or(Vec::new(), |number| self.take(number).found)
    }

    /// Takes those out that do least harm among those that were put off, if that is less than what
    /// squares of this urgency do.
    pub(super) fn pop_less_urgent_last(&mut self, than: &Urgency) -> Vec<Found> {
        let harm = |number: &usize| self.alike[*number].urgency.harm;
        let last = (0..self.alike.len()).filter(|n| self.alike[*n].urgency.group == LAST);
        let least = last.filter(|number| harm(number) < than.harm).min_by_key(harm);
        least.map_or(Vec::new(), |number| self.take(number).found)
    }

    /// What waits of a group of pixels.
    pub(super) fn of_group(&self, group: usize) -> impl Iterator<Item = &Found> {
        let of_group = self.alike.iter().filter(move |alike| alike.urgency.group == group);
        of_group.flat_map(|alike| &alike.found)
    }

    /// Adds a square; false where there is no room.
    pub(super) fn push(&mut self, found: Found, urgency: Urgency, to_do: &ToDo) -> bool {
        let has_room = if to_do.alone {
            self.count < MOST_WAITING && self.alone < MOST_SQUARES_ALONE
        } else {
            self.count < MOST_WAITING && self.count - self.alone < MOST_OTHERS
        };
        let is_last = urgency.group == LAST;
        if !has_room || is_last && self.last >= MOST_LAST {
            return false;
        }
        self.count += 1;
        self.last += usize::from(is_last);
        self.alone += usize::from(to_do.alone);
        self.is_crowded |= self.alone > CROWD;
        let most = most_alike(to_do);
        let is_alike = |alike: &&mut Alike| {
            alike.urgency == urgency && alike.to_do == *to_do && alike.found.len() < most
        };
        match self.alike.iter_mut().find(is_alike) {
            Some(Alike { found: others, .. }) => {
                if others.len() == others.capacity() {
                    others.reserve_exact((others.len() / 4).max(1));
                }
                others.push(found);
            }
            None => {
                let (found, to_do) = (vec![found], to_do.clone());
                self.alike.push(Alike { found, to_do, urgency });
            }
        }
        true
    }
}

/// Squares whose rays fill a batch.
fn most_alike(to_do: &ToDo) -> usize {
    if to_do.quartered { BATCH_RAYS / 4 } else { BATCH_RAYS }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn to_do(quartered: bool) -> ToDo {
        ToDo {
            quartered,
            cut: Cut::FullDepth,
            before: Care::Exact,
            care: Care::Exact,
            alone: false,
        }
    }

    fn found(pixel: u16, error: f64) -> Found {
        let square = Square { centre: [0.5; 2], offset: [0; 2], pixel, halvings: 0 };
        let shares = ErrorShares { pixel_area: error, ..ErrorShares::default() }.into();
        Found { square, value: [0.0; 4], shares, uneven: None }
    }

    #[test]
    fn the_first_groups_worst_squares_come_first() {
        let mut waiting = Waiting::default();
        let to_do = to_do(true);
        let far = GROUP_PIXELS as u16;
        for (pixel, error) in [(1, 0.01), (far, 9.0), (2, f64::NAN), (3, 0.0), (0, 0.011), (4, 1.0)]
        {
            let urgency = Urgency::new(usize::from(pixel) / GROUP_PIXELS, error);
            assert!(waiting.push(found(pixel, error), urgency, &to_do));
        }
        assert_eq!(waiting.of_group(0).count(), 5);
        let mut pixels = Vec::new();
        while let Some((group, found, _)) = waiting.pop() {
            assert!(found.iter().all(|f| usize::from(f.square.pixel) / GROUP_PIXELS == group));
            pixels.extend(found.iter().map(|f| f.square.pixel));
        }
        assert_eq!(pixels, [2, 4, 1, 0, 3, far]);
    }

    #[test]
    fn in_a_crowd_the_first_few_pixels_come_first() {
        let mut waiting = Waiting::default();
        let alone = ToDo { alone: true, ..to_do(true) };
        let urgency = |pixel: u16, error| Urgency::new(0, error).among_few(usize::from(pixel));
        let last = GROUP_PIXELS as u16 - 1;
        let mut push = |pixel: u16, error: f64| {
            assert!(waiting.push(found(pixel, error), urgency(pixel, error), &alone));
        };
        // Alike but for where they are.
        [last, 0, 100].into_iter().for_each(|pixel| push(pixel, 1.0));
        push(1, 0.1);
        let (_, first, _) = waiting.pop().unwrap();
        assert_eq!(first.len(), 3);
        for n in 0..CROWD as u16 {
            assert!(waiting.push(found(last, 1.0), urgency(last, 1.0), &alone), "{n}");
        }
        assert!(waiting.is_crowded());
        let (_, first, _) = waiting.pop().unwrap();
        assert_eq!(first.len(), 1);
        assert_eq!(first[0].square.pixel, 1);
        while waiting.pop().is_some() {}
        assert!(waiting.is_crowded());
        waiting.clear();
        assert!(!waiting.is_crowded());
    }

    #[test]
    fn what_is_put_off_comes_last_and_the_least_of_it_makes_room() {
        let mut waiting = Waiting::default();
        let last = |error| Urgency::put_off(error);
        let alone = ToDo { alone: true, ..to_do(true) };
        for n in 0..MOST_LAST {
            assert!(waiting.push(found(n as u16, 1.0), last(4f64.powi(n as i32 % 3)), &alone));
        }
        assert!(!waiting.push(found(0, 1.0), last(64.0), &alone));
        assert!(waiting.push(found(7, 1.0), Urgency::new(9, 1e-9), &alone));
        // None that is put off is taken with others.
        assert!(waiting.pop_like(&alone, |_| true).is_some());
        assert!(waiting.pop_like(&alone, |_| true).is_none());
        assert!(waiting.pop_less_urgent_last(&last(1.0)).is_empty());
        let least = waiting.pop_less_urgent_last(&last(4.0));
        assert!(!least.is_empty() && least.iter().all(|found| found.square.pixel % 3 == 0));
        assert!(waiting.push(found(1, 1.0), last(64.0), &alone));
        let (group, first, _) = waiting.pop().unwrap();
        assert!(Urgency::is_last(group) && first.len() == 1);
    }

    #[test]
    fn no_more_wait_than_there_is_room_for() {
        let mut waiting = Waiting::default();
        let to_do = to_do(false);
        let alone = ToDo { alone: true, ..to_do.clone() };
        for _ in 0..MOST_SQUARES_ALONE {
            assert!(waiting.push(found(0, 1.0), Urgency::new(0, 1.0), &alone));
        }
        assert!(!waiting.push(found(0, 1.0), Urgency::new(0, 1.0), &alone));
        // For others there is room, and they are not what is taken out.
        assert!(waiting.push(found(1, 1.0), Urgency::new(0, 1.0), &to_do));
        let least = waiting.pop_least_alone();
        assert!(!least.is_empty() && least.iter().all(|found| found.square.pixel == 0));
        for found in &least {
            assert!(waiting.push(*found, Urgency::new(0, 16.0), &alone));
        }
        assert!(!waiting.push(found(0, 1.0), Urgency::new(0, 1.0), &alone));
        // What nothing is known of is not taken out for others.
        waiting.clear();
        assert!(waiting.push(found(2, 1.0), Urgency::new(0, f64::INFINITY), &alone));
        assert!(waiting.push(found(3, 1.0), Urgency::new(1, 1.0), &alone));
        assert_eq!(waiting.pop_least_alone()[0].square.pixel, 3);
        waiting.clear();
        for _ in 0..MOST_OTHERS {
            assert!(waiting.push(found(0, 1.0), Urgency::new(0, 1.0), &to_do));
        }
        assert!(!waiting.push(found(0, 1.0), Urgency::default(), &to_do));
        for _ in MOST_OTHERS..MOST_WAITING {
            assert!(waiting.push(found(1, 1.0), Urgency::new(1, 1.0), &alone));
        }
        assert!(!waiting.push(found(1, 1.0), Urgency::new(1, 1.0), &alone));
        let (_, taken, _) = waiting.pop().unwrap();
        assert!([BATCH_RAYS, MOST_OTHERS % BATCH_RAYS].contains(&taken.len()));
        assert!(waiting.push(found(0, 1.0), Urgency::default(), &to_do));
    }
}
