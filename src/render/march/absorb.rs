//! Emission and absorption where the mapped value is a polynomial along the ray.

use super::ray_state::{Ending, RayState};
use crate::polynomial::Polynomial;
use crate::render::bounds::crossing::{Crossing, is_clean};
use crate::render::bounds::sums::Sums;
use crate::render::transfer::change::Change;
use crate::render::transfer::piece::Piece;
use crate::render::transfer::pieces::PieceList;
use crate::render::transfer::storage::Reach;

/// A stretch is halved this often at most in search of the transfer function's bends; what is
/// left then is 2⁻²⁰ of it, and an extremum at most.
const SEARCH_HALVINGS: u32 = 20;
/// In parts shorter than this share of a stretch x counts as a straight line.
const SHORTEST_PART: f64 = 1e-6;
/// A part may reach this share of a piece's width beyond the piece.
const OVERSHOOT: f64 = 1e-6;
/// Rounding of a root.
const ROOT_ROUNDING: f64 = 16.0 * f64::EPSILON;

/// What a stretch of ray says of its error but for how far its values may be off: sums over
/// parts of ∫ T̃ ds (`lit`) times what the transfer function does there.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Tally {
    /// Length of the stretch, code length.
    pub(crate) length: f64,
    /// ∫ T̃ ds, code length.
    pub(crate) lit: f64,
    /// Slopes of emission and extinction.
    pub(crate) slope: Sums,
    /// Steps of emission and extinction within reach.
    pub(crate) jumps: Sums,
    /// Steps of their slopes within reach.
    pub(crate) kinks: Sums,
    /// Slopes, and steps of slopes, times what x is off by storage.
    pub(crate) stored: Sums,
    /// Half the second derivative of the emission.
    pub(crate) bend: f64,
    /// Errors of the emission.
    pub(crate) quadrature: f64,
}

/// Adds stretches of ray, front to back, to a ray's sums.
pub(crate) struct Integrator<'a> {
    /// The pieces that stretches are cut into.
    pub(super) pieces: &'a PieceList,
    /// What the ray has gathered so far.
    pub(crate) state: &'a mut RayState,
    /// Where the ray may end.
    ending: &'a Ending,
    /// How far values along the ray may be off; none where no one asks.
    pub(crate) reach: Option<Reach>,
    /// What has been integrated since it was taken.
    pub(crate) tally: Tally,
    /// Stretches integrated.
    pub(super) count: u64,
}

impl<'a> Integrator<'a> {
    /// An integrator by `pieces` that adds to `state`. `accounts`: whether to keep a tally.
    pub(super) fn new(
        pieces: &'a PieceList,
        ending: &'a Ending,
        accounts: bool,
        state: &'a mut RayState,
    ) -> Self {
        Self {
            pieces,
            state,
            ending,
            reach: accounts.then(Reach::default),
            tally: Tally::default(),
            count: 0,
        }
    }
}

impl<'a> Integrator<'a> {
    /// Whether nothing further can change the picture.
    #[inline]
    pub(super) fn is_faded(&self) -> bool {
        self.state.is_done(self.ending)
    }

    /// A stretch of `length` code lengths along which the mapped value is `x`.
    pub(super) fn along<const N: usize>(&mut self, x: &Polynomial<N>, length: f64) {
        self.search(x, length, SEARCH_HALVINGS);
    }

    /// A stretch within one piece of the transfer function, `x` in `range`.
    #[inline]
    pub(super) fn along_piece<const N: usize>(
        &mut self,
        x: &Polynomial<N>,
        piece: &Piece,
        range: [f64; 2],
        length: f64,
    ) {
        if let Some(reach) = self.reach
            && !self.is_clear(piece, range)
        {
            self.look_around(x, range, &reach, length, false);
        }
        self.within(x, piece, range, length);
    }

    /// Whether no values within reach of `range` are in another piece.
    #[inline]
    pub(super) fn is_clear(&self, piece: &Piece, [low, high]: [f64; 2]) -> bool {
        self.reach.is_none_or(|reach| {
            low - reach.most() >= piece.start && high + reach.most() < piece.end
        })
    }

    /// A stretch within a transparent piece that [`Self::is_clear`], with x up to `high`.
    #[inline]
    pub(super) fn through_nothing(&mut self, piece: &Piece, high: f64, length: f64) {
        self.account(piece, high, length, self.state.transmittance * length);
    }

    /// Tallies the steps of the transfer function that lie within `reach` of `x`, but, if x is
    /// `monotone`, for those that are crossed with nothing else near.
    #[cold]
    fn look_around<const N: usize>(
        &mut self,
        x: &Polynomial<N>,
        [low, high]: [f64; 2],
        reach: &Reach,
        length: f64,
        monotone: bool,
    ) {
        let most = reach.most();
        let (first, last) = (self.pieces.find(low - most), self.pieces.find(high + most));
        for index in first + 1..=last {
            let piece = self.pieces.piece(index);
            if !piece.step.is_nothing() {
                let [stored, close] = reach.near(piece.start);
                let near = length * x.share_near(piece.start, close);
                let lit = near * self.state.transmittance;
                let pair = [self.pieces.piece(index - 1), piece];
                if !(monotone && is_clean([low, high], pair, most)) {
                    let across = length * reach.share_across(x, piece.start);
                    let across = (across, across * self.state.transmittance);
                    self.tally.jumps.add(piece.step.jump, across.0, across.1);
                    self.tally.kinks.add(piece.step.kink, near, lit);
                    self.tally.stored.add(piece.step.kink.times(stored), near, lit);
                }
                self.tally.bend += piece.step.bend * lit;
            }
        }
    }

    /// Tallies a stretch of `length` code lengths, and ∫ T ds = `lit`, that has been integrated,
    /// with x up to `high`.
    #[inline]
    fn account(&mut self, piece: &Piece, high: f64, length: f64, lit: f64) {
        let Some(reach) = self.reach else { return };
        let slope = Change { emission: piece.slope[0], extinction: piece.slope[1] };
        // Of squares others' values count as well; how slopes differ there, with kinks.
        let stored = slope.times(reach.storage.up_to(high + reach.others));
        self.tally.stored.add(stored, length, lit);
        self.tally.length += length;
        self.tally.lit += lit;
        self.tally.slope.add(slope, length, lit);
        self.tally.bend += piece.bend * lit;
        self.tally.quadrature += piece.deviation * lit;
    }

    fn search<const N: usize>(&mut self, x: &Polynomial<N>, length: f64, halvings: u32) {
        let points = x.control_points();
        let [low, high] = range(&points);
        let piece = self.pieces.at(low);
        if high < piece.end {
            return self.along_piece(x, piece, [low, high], length);
        }
        let (rising, falling) = points.windows(2).fold((true, true), |(rising, falling), pair| {
            (rising && pair[0] <= pair[1], falling && pair[0] >= pair[1])
        });
        if rising || falling {
            self.cross(x, length, rising);
        } else if halvings == 0 {
            let turn = x.turn();
            let [before, after] = [x.part(0.0, turn), x.part(turn, 1.0)];
            self.cross(&before, turn * length, before.at(0.0) < before.at(1.0));
            self.cross(&after, (1.0 - turn) * length, after.at(0.0) < after.at(1.0));
        } else {
            self.search(&x.part(0.0, 0.5), 0.5 * length, halvings - 1);
            self.search(&x.part(0.5, 1.0), 0.5 * length, halvings - 1);
        }
    }

    /// Walks a monotone `x` from piece to piece of the transfer function.
    fn cross<const N: usize>(&mut self, x: &Polynomial<N>, length: f64, rising: bool) {
        let ends = [x.at(0.0), x.at(1.0)];
        if let Some(reach) = self.reach {
            self.look_around(x, range(&ends), &reach, length, true);
        }
        let (mut index, last) = (self.pieces.find(ends[0]), self.pieces.find(ends[1]));
        let (mut from, mut entry) = (0.0, ends[0]);
        let mut crossing: Option<Crossing<'_>> = None;
        loop {
            let piece = self.pieces.piece(index);
            let is_last = if rising { index >= last } else { index <= last };
            let exit = match (is_last, rising) {
                (true, _) => x.at(1.0),
                (_, true) => piece.end,
                (_, false) => piece.start,
            };
            let to = if is_last { 1.0 } else { x.solve(exit, from) };
            if let Some(crossing) = crossing.take() {
                let [jump, kink] =
                    crossing.sums(x, length, [from, to], piece, self.ending.brightest);
                self.tally.jumps = self.tally.jumps.plus(jump);
                self.tally.kinks = self.tally.kinks.plus(kink);
                self.tally.stored = self.tally.stored.plus(kink.times(crossing.stored()));
            }
            let before = self.state.transmittance;
            self.part(x, [from, to], [entry, exit], piece, length);
            if is_last {
                return;
            }
            (from, entry) = (to, exit);
            let lower = if rising { index } else { index - 1 };
            crossing = self.crossing(x, length, lower, piece, before);
            index = if rising { index + 1 } else { index - 1 };
        }
    }

    /// The way's crossing of the step behind piece `lower`, out of the piece `before`, if that is
    /// tallied with what follows it.
    fn crossing<const N: usize>(
        &self,
        x: &Polynomial<N>,
        length: f64,
        lower: usize,
        before: &'a Piece,
        transmittance: f64,
    ) -> Option<Crossing<'a>> {
        let reach = self.reach?;
        let pieces = self.pieces;
        let pair = [pieces.piece(lower), pieces.piece(lower + 1)];
        let is_alone =
            !pair[1].step.is_nothing() && is_clean([x.at(0.0), x.at(1.0)], pair, reach.most());
        let both = [transmittance, self.state.transmittance];
        is_alone.then(|| Crossing::new(x, length, pair[1], &reach, before, both))
    }

    /// The part of a monotone `x` over s in [`from`, `to`], which crosses `piece` from x =
    /// `ends[0]` to `ends[1]`.
    fn part<const N: usize>(
        &mut self,
        x: &Polynomial<N>,
        [from, to]: [f64; 2],
        ends: [f64; 2],
        piece: &Piece,
        length: f64,
    ) {
        let (width, rise) = (to - from, ends[1] - ends[0]);
        let part = x.part(from, to).between(ends);
        let [low, high] = range(&part.control_points());
        let slack = OVERSHOOT * (piece.end - piece.start);
        let fits = low >= piece.start - slack && high <= piece.end + slack;
        if fits && width >= SHORTEST_PART {
            return self.within(&part, piece, [low, high], width * length);
        }
        // The difference of two close roots is rounding, that of the values at them is not.
        let by_slope = (rise / x.slope(0.5 * (from + to))).abs();
        let is_better = (by_slope - width).abs() <= OVERSHOOT * width + ROOT_ROUNDING;
        let share = if is_better { by_slope } else { width };
        let line = Polynomial([ends[0], rise, 0.0, 0.0]);
        self.within(&line, piece, range(&ends), share * length);
    }

    /// A stretch of constant `x`.
    pub(super) fn constant(&mut self, x: f64, length: f64) {
        let piece = self.pieces.at(x);
        let mut lit = self.state.transmittance * length;
        if !piece.is_transparent {
            self.count += 1;
            lit = self.state.pass(piece.extinction(x), piece.emission(x), length);
        }
        self.account(piece, x, length, lit);
    }

    /// A whole cell of constant `x`.
    pub(super) fn cell(&mut self, x: f64, length: f64) {
        if let Some(reach) = self.reach {
            self.look_around(&Polynomial([x]), [x, x], &reach, length, false);
        }
        self.constant(x, length);
    }

    /// A stretch within one piece of the transfer function, `x` in `range`.
    #[inline]
    fn within<const N: usize>(
        &mut self,
        x: &Polynomial<N>,
        piece: &Piece,
        range: [f64; 2],
        length: f64,
    ) {
        if piece.is_transparent {
            return self.through_nothing(piece, range[1], length);
        }
        let lit = match self.simply(x, piece, range, length) {
            Some(lit) => lit,
            None => self.exactly(x, piece, range, length),
        };
        self.account(piece, range[1], length, lit);
    }
}

/// The smallest and the largest of `points`, NaN left out.
#[inline]
pub(super) fn range<const N: usize>(points: &[f64; N]) -> [f64; 2] {
    let low = points.iter().copied().fold(f64::INFINITY, f64::min);
    [low, points.iter().copied().fold(f64::NEG_INFINITY, f64::max)]
}
