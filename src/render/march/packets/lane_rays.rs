//! Where a packet's rays come into a brick, worked out for all lanes at once, in f64.

use super::TileRay;
use crate::lanes::{Kernel, Lanes, MOST_LANES};
use crate::render::brick::passage::Region;
use crate::render::camera::frame::LocalRay;
use crate::render::march::packet::{ORIGIN_STEP, Packet};
use crate::render::march::ray::CellRange;

/// What rounding of f64 does to places in a brick, cells, and more.
const PLACE_ROUNDING: f64 = 1e-12;

/// A number for each lane.
type Row = [f64; MOST_LANES];

/// A packet's rays, lane by lane, as [`LocalRay`] has them.
#[derive(Debug)]
#[repr(align(64))]
pub(super) struct LaneRays {
    origin: [Row; 3],
    direction: [Row; 3],
    length: Row,
    sigma_min: Row,
    /// σ where each enters the brick's region and where it leaves; both 0 where it does neither.
    from: Row,
    to: Row,
    /// σ per unit of t.
    unit: Row,
}

impl LaneRays {
    /// Lanes that hold rays without meaning, all of whose numbers are finite.
    pub(super) fn new() -> Self {
        let [zero, one] = [0.0, 1.0].map(|x| [x; MOST_LANES]);
        Self {
            origin: [zero; 3],
            direction: [one; 3],
            length: one,
            sigma_min: zero,
            from: zero,
            to: zero,
            unit: one,
        }
    }

    /// Takes in rays, as many as there are lanes at most.
    pub(super) fn take(&mut self, rays: &[TileRay]) {
        for (lane, TileRay { ray, .. }) in rays.iter().enumerate().take(MOST_LANES) {
            for a in 0..3 {
                self.origin[a][lane] = ray.origin[a];
                self.direction[a][lane] = ray.direction[a];
            }
            self.length[lane] = ray.length;
            self.sigma_min[lane] = ray.sigma_min;
        }
    }

    /// The ray in a lane.
    pub(super) fn ray(&self, lane: usize) -> LocalRay {
        LocalRay {
            origin: self.origin.map(|row| row[lane]).into(),
            direction: self.direction.map(|row| row[lane]).into(),
            length: self.length[lane],
            sigma_min: self.sigma_min[lane],
        }
    }

    /// σ where it enters and where it leaves.
    pub(super) fn span(&self, lane: usize) -> (f64, f64) {
        (self.from[lane], self.to[lane])
    }

    /// σ per unit of t.
    pub(super) fn unit(&self, lane: usize) -> f64 {
        self.unit[lane]
    }

    /// Code length per unit of σ.
    pub(super) fn length(&self, lane: usize) -> f64 {
        self.length[lane]
    }
}

/// Sets all lanes to where their rays come into a brick, and to their directions. Its output has
/// the lanes that meet it; others are set to anything that is a number.
pub(super) struct EnterBrick<'s> {
    /// What of the brick is drawn.
    pub(super) region: &'s Region,
    /// The cells that rays walk through.
    pub(super) range: &'s CellRange,
    /// How far before the brick number 0 of these begins, cells.
    pub(super) shift: f64,
    /// The rays; where each enters and leaves is set here.
    pub(super) lane_rays: &'s mut LaneRays,
    /// The packet that is set off.
    pub(super) packet: &'s mut Packet,
    /// How many lanes there are rays for.
    pub(super) count: usize,
}

impl Kernel for EnterBrick<'_> {
    type Output = u32;

    #[inline(always)]
    fn run<L: Lanes>(self, _lanes: L) -> u32 {
        let Self { region, range, shift, lane_rays, packet, count } = self;
        let met = clip::<L>(region, lane_rays);
        for a in 0..3 {
            let ends = [range.lo[a], range.hi[a]].map(f64::from);
            set_axis::<L>(ends, shift, lane_rays, packet, a);
        }
        for lane in 0..L::COUNT {
            let end = split((lane_rays.to[lane] - lane_rays.from[lane]) / lane_rays.unit[lane]);
            packet.end[0].0[lane] = end[0];
            packet.end[1].0[lane] = end[1];
            packet.t[0].0[lane] = 0.0;
            packet.t[1].0[lane] = 0.0;
        }
        met & ((1 << count) - 1)
    }
}

/// Finds `from`, `to` and `unit` of all rays; returns which of them meet the region, as
/// [`crate::render::brick::walk::clip`] has it.
#[inline(always)]
fn clip<L: Lanes>(region: &Region, lane_rays: &mut LaneRays) -> u32 {
    let (mut from, mut to) = (lane_rays.sigma_min, [f64::INFINITY; MOST_LANES]);
    let mut most = [0.0; MOST_LANES];
    for a in 0..3 {
        let (lo, hi) = (region.lo[a], region.hi[a]);
        for lane in 0..L::COUNT {
            let (origin, direction) = (lane_rays.origin[a][lane], lane_rays.direction[a][lane]);
            let inverse = 1.0 / direction;
            let (s, t) = ((lo - origin) * inverse, (hi - origin) * inverse);
            // Along an axis without motion all of the ray is between the planes, or nothing.
            let moves = inverse.abs() < f64::INFINITY;
            let all =
                if (lo <= origin) & (origin < hi) { f64::NEG_INFINITY } else { f64::INFINITY };
            let near = if moves { least(s, t) } else { all };
            let far = if moves { largest(s, t) } else { f64::INFINITY };
            from[lane] = largest(near, from[lane]);
            to[lane] = least(far, to[lane]);
            most[lane] = largest(direction.abs(), most[lane]);
        }
    }
    let mut met = 0;
    for lane in 0..L::COUNT {
        let is_finite = (to[lane] < f64::INFINITY) & (from[lane] > f64::NEG_INFINITY);
        let meets = (from[lane] < to[lane]) & is_finite;
        lane_rays.from[lane] = if meets { from[lane] } else { 0.0 };
        lane_rays.to[lane] = if meets { to[lane] } else { 0.0 };
        lane_rays.unit[lane] = 1.0 / most[lane];
        met |= u32::from(meets) << lane;
    }
    met
}

/// Sets where rays enter along an axis, in a cell from `lo` to `hi`, and their directions.
#[inline(always)]
fn set_axis<L: Lanes>(
    [lo, hi]: [f64; 2],
    shift: f64,
    lane_rays: &LaneRays,
    packet: &mut Packet,
    a: usize,
) {
    for lane in 0..L::COUNT {
        let (origin, direction) = (lane_rays.origin[a][lane], lane_rays.direction[a][lane]);
        let enters = origin + direction * lane_rays.from[lane] + shift;
        let leaves = origin + direction * lane_rays.to[lane] + shift;
        let cell = least(largest(enters.trunc(), lo), hi);
        // Between two planes a ray through constant cells is as good as one in the middle.
        let stays = (direction == 0.0) | is_between_planes(enters, leaves);
        let is_between = (shift == 0.0) & stays;
        let start = if is_between { cell + 0.5 } else { enters };
        let slope = direction * lane_rays.unit[lane];
        let along = if is_between { 0.0 } else { slope };
        let aside = [enters - start, slope - along];
        let coarse = rounded(start);
        packet.origin[0][a].0[lane] = coarse as f32;
        packet.origin[1][a].0[lane] = (start - coarse) as f32;
        let along = split(along);
        packet.direction[0][a].0[lane] = along[0];
        packet.direction[1][a].0[lane] = along[1];
        packet.aside[0][a].0[lane] = aside[0] as f32;
        packet.aside[1][a].0[lane] = aside[1] as f32;
        packet.cell[a].0[lane] = cell as f32;
    }
}

/// A number as the sum of two.
#[inline(always)]
pub(super) fn split(x: f64) -> [f32; 2] {
    let coarse = x as f32;
    [coarse, (x - f64::from(coarse)) as f32]
}

/// The smaller of two numbers; one comparison, where `f64::min` looks for such as are none.
#[inline(always)]
fn least(a: f64, b: f64) -> f64 {
    if a < b { a } else { b }
}

#[inline(always)]
fn largest(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}

/// The nearest multiple of [`ORIGIN_STEP`] to a number much smaller than 2⁵¹ of these.
#[inline(always)]
fn rounded(x: f64) -> f64 {
    // Sums are whole multiples of it there, in one instruction that all processors have.
    const LARGE: f64 = ORIGIN_STEP * (3_i64 << 51) as f64;
    (x + LARGE) - LARGE
}

/// Whether a ray that goes from one place to another along an axis crosses no plane, nor comes as
/// close to one as rounding.
#[inline(always)]
fn is_between_planes(from: f64, to: f64) -> bool {
    let (low, high) = (least(from, to) - PLACE_ROUNDING, largest(from, to) + PLACE_ROUNDING);
    low.trunc() == high.trunc()
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use proptest::prelude::*;

    use super::*;
    use crate::lanes::Width;
    use crate::render::brick::walk::clip;
    use crate::render::march::ray::DUAL_SHIFT;

    /// Cells along the brick's edge.
    const EDGE: f64 = 8.0;

    fn number() -> impl Strategy<Value = f64> {
        prop_oneof![3 => -2.0..10.0_f64, 1 => (-2..10_i32).prop_map(f64::from)]
    }

    fn ray() -> impl Strategy<Value = LocalRay> {
        let towards = prop_oneof![4 => -1.0..1.0_f64, 1 => Just(0.0), 1 => -1e-300..1e-300_f64];
        let [from, towards] =
            [prop::array::uniform3(number()).boxed(), prop::array::uniform3(towards).boxed()];
        let eye = prop_oneof![Just(f64::NEG_INFINITY), -5.0..5.0_f64];
        (from, towards, eye).prop_filter_map("no direction", |(origin, direction, sigma_min)| {
            let direction = DVec3::from(direction);
            (direction.length() > 1e-3).then(|| LocalRay {
                origin: origin.into(),
                direction,
                length: direction.length(),
                sigma_min,
            })
        })
    }

    proptest! {
        /// One by one, as [`clip`] has it and by the rules' own words.
        #[test]
        fn all_lanes_set_off_like_single_rays(
            rays in prop::collection::vec(ray(), 1..=MOST_LANES),
            (lo, hi) in (prop::array::uniform3(0.0..4.0_f64), prop::array::uniform3(4.0..=EDGE)),
            is_dual in any::<bool>(),
        ) {
            let region = Region { lo, hi, ends: 0 };
            let shift = if is_dual { DUAL_SHIFT } else { 0.0 };
            let range = CellRange::of(&region, shift);
            for width in Width::all() {
                let (mut lane_rays, mut packet) = (LaneRays::new(), Packet::new());
                let rays = &rays[..rays.len().min(width.count())];
                let tile_ray = |(index, &ray)| TileRay { index, ray };
                lane_rays.take(&rays.iter().enumerate().map(tile_ray).collect::<Vec<_>>());
                let (region, range, count) = (&region, &range, rays.len());
                let (all, rows) = (&mut lane_rays, &mut packet);
                let met =
                    width.run(EnterBrick { region, range, shift, lane_rays: all, packet: rows, count });
                prop_assert_eq!(met >> count, 0);
                for (lane, ray) in rays.iter().enumerate() {
                    prop_assert_eq!(lane_rays.ray(lane), *ray);
                    let span = clip(ray, lo, hi);
                    prop_assert_eq!(met >> lane & 1 == 1, span.is_some());
                    let Some(span) = span else { continue };
                    prop_assert_eq!(lane_rays.span(lane), span);
                    check_start(&packet, lane, ray, span, range, shift)?;
                }
            }
        }
    }

    fn check_start(
        packet: &Packet,
        lane: usize,
        ray: &LocalRay,
        span: (f64, f64),
        range: &CellRange,
        shift: f64,
    ) -> Result<(), TestCaseError> {
        let unit = ray.direction.abs().max_element().recip();
        let [enters, leaves] = [span.0, span.1].map(|s| ray.origin + ray.direction * s + shift);
        let long = |rows: [&crate::lanes::Row; 2]| {
            rows.iter().map(|row| f64::from(row.0[lane])).sum::<f64>()
        };
        let cell = packet.cell(lane);
        for a in 0..3 {
            prop_assert_eq!(cell[a], (enters[a] as i32).clamp(range.lo[a], range.hi[a]));
            let low = (enters[a].min(leaves[a]) - PLACE_ROUNDING) as i32;
            let high = (enters[a].max(leaves[a]) + PLACE_ROUNDING) as i32;
            let is_between = shift == 0.0 && (ray.direction[a] == 0.0 || low == high);
            let [start, along] = if is_between {
                [f64::from(cell[a]) + 0.5, 0.0]
            } else {
                [enters[a], ray.direction[a] * unit]
            };
            let near = f64::from(packet.origin[0][a].0[lane]);
            prop_assert_eq!(near, (start / ORIGIN_STEP).round_ties_even() * ORIGIN_STEP);
            let found = long([&packet.origin[0][a], &packet.origin[1][a]]);
            prop_assert!((found - start).abs() <= 1e-12);
            let found = long([&packet.direction[0][a], &packet.direction[1][a]]);
            prop_assert!((found - along).abs() <= 1e-14, "{} {}", found, along);
        }
        let end = (span.1 - span.0) / unit;
        let found = long([&packet.end[0], &packet.end[1]]);
        prop_assert!((found - end).abs() <= 1e-14 * end);
        prop_assert_eq!(packet.reached(lane), 0.0);
        Ok(())
    }
}
