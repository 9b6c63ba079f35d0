//! Which tiles are drawn next, and before which one all are done.

/// Turns at a picture's tiles, taken by threads.
#[derive(Debug, Default)]
pub(crate) struct Turns {
    next: u64,
    in_hand: Vec<u64>,
}

impl Turns {
    /// The next turn, which then is in hand.
    pub(crate) fn take(&mut self) -> u64 {
        let turn = self.next;
        self.next += 1;
        self.in_hand.push(turn);
        turn
    }

    /// A turn is over. Returns the first that is not.
    pub(crate) fn finish(&mut self, turn: u64) -> u64 {
        self.in_hand.retain(|other| *other != turn);
        self.in_hand.iter().copied().min().unwrap_or(self.next)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turns_in_hand_hold_back_the_first_that_is_not_over() {
        let mut turns = Turns::default();
        assert_eq!([turns.take(), turns.take(), turns.take()], [0, 1, 2]);
        assert_eq!([turns.finish(1), turns.finish(0)], [0, 2]);
        assert_eq!((turns.take(), turns.finish(3), turns.finish(2)), (3, 2, 4));
    }
}
