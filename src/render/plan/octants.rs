//! In which order a brick's octants are met: its children's one by one, and those that it draws itself in
//! as few boxes as these leave, since whatever is done for each ray is done for each box.

/// A box of octants, numbered `x + 2y + 4z`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Octants {
    /// The lowest of them.
    lowest: u8,
    /// The axes, a bit each, along which they are two.
    both: u8,
}

/// What is met.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Piece {
    /// The child in an octant.
    Child(u8),
    /// Octants that the brick draws itself.
    Own(Octants),
}

/// The pieces of a brick, front to back.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pieces {
    pieces: [Piece; 8],
    count: u8,
    next: u8,
}

impl Octants {
    /// The whole brick.
    pub(super) const ALL: Self = Self { lowest: 0, both: 0b111 };

    /// A single one.
    pub(super) fn one(octant: u8) -> Self {
        Self { lowest: octant, both: 0 }
    }

    /// The box's ends along axis `a` in a brick of `edge` cells, in cells.
    pub(super) fn ends(self, a: usize, edge: f64) -> (f64, f64) {
        match (self.both >> a & 1, self.lowest >> a & 1) {
            (1, _) => (0.0, edge),
            (_, 0) => (0.0, 0.5 * edge),
            _ => (0.5 * edge, edge),
        }
    }

    /// A bit for each octant in the box.
    fn mask(self) -> u8 {
        let is_in = |octant: &u8| (octant ^ self.lowest) & !self.both == 0;
        (0..8).filter(is_in).fold(0, |mask, octant| mask | 1 << octant)
    }

    /// The axes along which it can be cut.
    fn axes(self) -> impl Iterator<Item = u8> {
        (0..3).filter(move |a| self.both >> a & 1 == 1)
    }

    /// Its halves along an axis, the lower one first.
    fn halves(self, axis: u8) -> [Self; 2] {
        let lower = Self { both: self.both & !(1 << axis), ..self };
        [lower, Self { lowest: lower.lowest | 1 << axis, ..lower }]
    }

    /// How many boxes it falls into that hold octants of `own` and none of `opened`.
    fn fewest(self, opened: u8, own: u8) -> u8 {
        let mask = self.mask();
        if mask & opened == 0 {
            return u8::from(mask & own != 0);
        }
        self.axes().map(|axis| self.in_halves(axis, opened, own)).min().unwrap_or(0)
    }

    /// The same where it is cut along an axis first.
    fn in_halves(self, axis: u8, opened: u8, own: u8) -> u8 {
        self.halves(axis).map(|half| half.fewest(opened, own)).iter().sum()
    }
}

impl Pieces {
    /// The children in the octants `opened`, and boxes of the others that hold all of `own`; octant
    /// `n ^ order` is the n-th from the eye.
    pub(super) fn new(opened: u8, own: u8, order: u8) -> Self {
        let mut pieces = Self { pieces: [Piece::Child(0); 8], count: 0, next: 0 };
        pieces.add(Octants::ALL, opened, own, order);
        pieces
    }

    fn add(&mut self, octants: Octants, opened: u8, own: u8, order: u8) {
        let mask = octants.mask();
        if mask & (opened | own) == 0 {
            return;
        }
        if mask & opened == 0 {
            return self.push(Piece::Own(octants));
        }
        let axis = octants.axes().min_by_key(|&axis| octants.in_halves(axis, opened, own));
        let Some(axis) = axis else { return self.push(Piece::Child(octants.lowest)) };
        let [lower, upper] = octants.halves(axis);
        let upper_first = order >> axis & 1 == 1;
        for half in if upper_first { [upper, lower] } else { [lower, upper] } {
            self.add(half, opened, own, order);
        }
    }

    fn push(&mut self, piece: Piece) {
        self.pieces[usize::from(self.count)] = piece;
        self.count += 1;
    }

    fn rest(&self) -> &[Piece] {
        &self.pieces[usize::from(self.next)..usize::from(self.count)]
    }

    /// Whether none of those that follow is the brick's own.
    pub(super) fn are_only_children(&self) -> bool {
        self.rest().iter().all(|piece| matches!(piece, Piece::Child(_)))
    }
}

impl Iterator for Pieces {
    type Item = Piece;

    fn next(&mut self) -> Option<Piece> {
        let piece = self.rest().first().copied()?;
        self.next += 1;
        Some(piece)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The octants that a piece covers.
    fn mask(piece: Piece) -> u8 {
        match piece {
            Piece::Child(octant) => 1 << octant,
            Piece::Own(octants) => octants.mask(),
        }
    }

    /// Whether some octant of `a` lies before one of `b`, as seen in `order`: along some axis in a nearer
    /// half, along none in a farther one.
    fn hides(a: u8, b: u8, order: u8) -> bool {
        let octants = |mask: u8| (0..8_u8).filter(move |octant| mask >> octant & 1 == 1);
        octants(a).any(|a| octants(b).any(|b| a != b && (a ^ order) & !(b ^ order) == 0))
    }

    #[test]
    fn all_octants_are_met_once_front_to_back_for_all_masks() {
        for opened in 0..=u8::MAX {
            for own in [!opened, !opened & 0b0101_0101, !opened & 0b0011_0110, 0] {
                for order in 0..8 {
                    let pieces: Vec<_> = Pieces::new(opened, own, order).collect();
                    let mut met = 0;
                    for (n, &piece) in pieces.iter().enumerate() {
                        assert_eq!(met & mask(piece), 0, "{opened:b} {own:b} {order}");
                        met |= mask(piece);
                        let is_child = matches!(piece, Piece::Child(_));
                        assert_eq!(mask(piece) & opened != 0, is_child);
                        assert!(is_child || mask(piece) & own != 0);
                        let before = &pieces[..n];
                        assert!(!before.iter().any(|&b| hides(mask(piece), mask(b), order)));
                    }
                    assert_eq!(met & (opened | own), opened | own);
                }
            }
        }
    }

    #[test]
    fn boxes_are_as_large_as_children_leave_them() {
        let own = |opened: u8| {
            let pieces = Pieces::new(opened, !opened, 0);
            pieces.filter(|piece| matches!(piece, Piece::Own(_))).map(mask).collect::<Vec<_>>()
        };
        assert_eq!(own(0), [0xff]);
        assert_eq!(own(1 << 7), [0x55, 0x22, 0x08]);
        assert_eq!(own(0x0f), [0xf0]);
        assert_eq!(own(1 | 1 << 7).len(), 4);
        assert!(own(0xff).is_empty());
        // Where nothing is drawn children need no boxes around them.
        assert_eq!(Pieces::new(1 << 5, 0, 3).collect::<Vec<_>>(), [Piece::Child(5)]);
    }

    #[test]
    fn it_is_known_when_only_children_follow() {
        let mut pieces = Pieces::new(1 << 7, 0x7f, 0);
        for (left, is_child) in [(3, false), (2, false), (1, true), (0, true)] {
            assert!(pieces.next().is_some());
            assert_eq!((pieces.rest().len(), pieces.are_only_children()), (left, is_child));
        }
        assert_eq!(pieces.next(), None);
    }

    #[test]
    fn boxes_end_where_their_octants_do() {
        let quarter = Octants { lowest: 0b100, both: 0b001 };
        assert_eq!([0, 1, 2].map(|a| quarter.ends(a, 8.0)), [(0.0, 8.0), (0.0, 4.0), (4.0, 8.0)]);
        assert_eq!([0, 1, 2].map(|a| Octants::ALL.ends(a, 8.0)), [(0.0, 8.0); 3]);
    }
}
