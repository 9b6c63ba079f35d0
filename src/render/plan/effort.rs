//! How many rays a picture takes whose pixels stand for areas. A small picture may take more for each
//! of its pixels, and takes more at least: its pixels are far apart, and tell little of each other.

/// Rays of a picture, about, and of a pixel on average over a tile: where the bound needs more, it stays
/// above the tolerance, and says so.
const MOST: u64 = 16_000_000;
const MOST_PER_PIXEL: u64 = 64;
const FEWEST_PER_PIXEL: u64 = 8;
/// Rays of a picture that bounds within the tolerance are worth, of a pixel at least: with 8 a large
/// picture was certified in 3 times its exact one's time (`docs/AREAS.md`). And how many times the usual
/// number a tile may take that needs more than others: one that comes short costs the picture its
/// certificate, when most of the work is done.
const WORTHWHILE: u64 = 128_000;
const WORTHWHILE_PER_PIXEL: u64 = 3;
const UNEVEN: u64 = 64;
/// Rays that stand for themselves, likewise; and how many more a pixel may take where those of the
/// picture are not more than so many.
const MOST_RAYS_ALONE: u64 = 32_000_000;
const MOST_ALONE_PER_PIXEL: u64 = 256;
const FEWEST_ALONE_PER_PIXEL: u64 = 16;
const SMALL_ALONE: u64 = 8_000_000;
const SMALL_ALONE_PER_PIXEL: u64 = 4096;
/// A picture takes about so many of these at least, and a pixel no more than the quarters of quarters of
/// quarters: all of those of pixels that are drawn together have room.
const LEAST_ALONE: u64 = 16 << 10;
const MOST_HALVED: u32 = 3;
/// Rays of a picture, about, by which what may shine is looked for where bounds are not sought.
const SCOUTING: u64 = 512_000;
/// Rays of a picture's dark pixels, about, that need not be dark by their bounds; fewer than the quarters
/// of quarters tell too little to be worth their time. A pixel takes more of them than others do in pictures
/// so small that all of theirs are few.
const GLINTS: u64 = 1 << 22;
const LEAST_GLINT_HALVINGS: u32 = 2;
const FEW_GLINTS: u64 = 1 << 16;
const MOST_GLINT_HALVINGS: u32 = 5;

/// Rays for each pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Effort {
    /// At most, on average over a tile, where they stand for areas.
    pub(crate) most: u64,
    /// At most, on average over a tile, where they stand for areas and bounds of all pixels are
    /// sought.
    pub(crate) most_certified: u64,
    /// What bounds of all pixels are worth, on average over the picture.
    pub(crate) worthwhile: u64,
    /// At most, on average over a tile, where they stand for areas and bounds are not sought, but
    /// what may shine is.
    pub(crate) scouting: u64,
    /// At most, on average over a tile, where they stand for themselves.
    pub(crate) most_alone: u64,
    /// How often a pixel is halved at least for rays that stand for themselves.
    pub(crate) least_halvings: u8,
    /// How often a pixel is halved that is dark and may not be, by its bound.
    pub(crate) glint_halvings: u8,
}

impl Effort {
    /// What a picture of so many pixels takes.
    pub(crate) fn of(pixels: u64) -> Self {
        let each = |all: u64| all / pixels.max(1);
        let most = each(MOST).clamp(FEWEST_PER_PIXEL, MOST_PER_PIXEL);
        let alone = each(MOST_RAYS_ALONE).clamp(FEWEST_ALONE_PER_PIXEL, MOST_ALONE_PER_PIXEL);
        let worthwhile = each(WORTHWHILE).max(WORTHWHILE_PER_PIXEL);
        let power = |rays: u64| each(rays).checked_ilog(4).unwrap_or(0);
        let halvings = |rays: u64| power(rays).min(MOST_HALVED);
        let glints = halvings(GLINTS).max(power(FEW_GLINTS).min(MOST_GLINT_HALVINGS));
        let glints = Some(glints).filter(|&halvings| halvings >= LEAST_GLINT_HALVINGS);
        Self {
            most,
            most_certified: UNEVEN * most,
            worthwhile,
            scouting: each(SCOUTING).clamp(FEWEST_PER_PIXEL, most),
            most_alone: alone.max(each(SMALL_ALONE).min(SMALL_ALONE_PER_PIXEL)),
            least_halvings: halvings(LEAST_ALONE) as u8,
            glint_halvings: glints.unwrap_or(0) as u8,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_pictures_take_more_rays_a_pixel_and_large_ones_no_more_in_all() {
        let sizes = [1, 63, 1024, 4096, 12_707, 65_536, 262_144, 2_073_600, 33_177_600];
        for [small, large] in sizes.array_windows() {
            let [a, b] = [small, large].map(|n| Effort::of(*n));
            assert!(a.most >= b.most && a.most_alone >= b.most_alone);
            assert!(a.worthwhile >= b.worthwhile && a.least_halvings >= b.least_halvings);
            assert!(a.glint_halvings >= b.glint_halvings && a.glint_halvings >= a.least_halvings);
        }
        let halvings = [63, 256, 1024, 4096, 16_384].map(|n| Effort::of(n).least_halvings);
        assert_eq!(halvings, [3, 3, 2, 1, 0]);
        let glints = [63, 256, 1024, 16_384, 65_536, 262_144].map(|n| Effort::of(n).glint_halvings);
        assert_eq!(glints, [5, 4, 3, 3, 3, 2]);
        for size in [63, 4096, 65_536, 262_144, 1_000_000] {
            let Effort { most_alone, most, .. } = Effort::of(size);
            assert!(most_alone * size <= MOST_RAYS_ALONE && most * size <= MOST, "{size}");
        }
        assert_eq!(Effort::of(0), Effort::of(1));
    }
}
