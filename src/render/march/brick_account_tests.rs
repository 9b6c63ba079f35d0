//! What a ray's account says of its square, against all rays of it.

use glam::DVec3;

use proptest::prelude::*;

use crate::render::bounds::grade::{Care, PacketTransfer};
use crate::render::bounds::ray_error::RayError;
use crate::render::brick::interpolant::DrawnNeighbours;
use crate::render::brick::margin::{self, parts};
use crate::render::brick::passage::{Passage, Region};
use crate::render::brick::scaled::ScaledBrick;
use crate::render::brick::steepness::Surveyor;
use crate::render::camera::frame::{Footprint, Frame};
use crate::render::camera::rays::{PixelGrid, Square};
use crate::render::camera::view::View;
use crate::render::march::packets::{Accounts, Packets, Rays, TileRay};
use crate::render::march::ray::{Light, march};
use crate::render::march::ray_state::{Ending, RayState};
use crate::render::march::ray_tests::{shells, smooth, steps, transfer};
use crate::render::testing::data::{BRICKS, TestData, linear, rough};
use crate::render::tiles::ray_batch::{beam, meets};
use crate::render::transfer::distance::Distance;
use crate::render::transfer::pieces::TransferPieces;
use crate::render::transfer::table::TransferTable;
use crate::scene::{Interpolation, Scene, TransferFunction};

mod cases;

/// The value of a level's cell.
type Leaf = fn(u32, [i128; 3]) -> f64;

const EDGE: i128 = 8;
/// Rays across a square.
const RAYS: u32 = 16;

struct Part {
    brick: ScaledBrick,
    region: Region,
    frame: Frame,
    footprint: Footprint,
}

/// Bricks before a camera, front to back.
struct Stage<'s> {
    grid: PixelGrid,
    parts: Vec<Part>,
    light: Light<'s>,
    brightest: f64,
    /// How carefully packets march.
    care: Care,
}

/// How a square's ray is marched.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Way {
    WithoutAccount,
    Alone,
    InPackets,
}

/// What light may be off by for the march of packets.
const ALLOWED: f64 = 1e-2;

impl<'s> Stage<'s> {
    /// One brick, as if the domain ended at its faces; or all of a domain with one level.
    fn new(
        data: &TestData,
        level: u32,
        bricks: &[[i128; 3]],
        scene: &Scene,
        function: &TransferFunction,
        transfer: &'s TransferPieces,
        interpolation: Interpolation,
    ) -> Self {
        let view = View::new(scene, &data.domain).unwrap();
        let eye = data.domain.position(&scene.camera.position).unwrap();
        let eye = data.domain.cell_of(level as i32, &eye).map(|c| c.div_euclid(EDGE));
        let mut order = bricks.to_vec();
        order.sort_by_key(|at| (0..3).map(|a| (at[a] - eye[a]).abs()).sum::<i128>());
        let part = |at: &[i128; 3]| {
            let mut brick = data.brick(level, *at, EDGE as u32, interpolation);
            let distance = Distance::none([0.0, 1.0]);
            brick.survey(&transfer.all, &distance, &mut Surveyor::default());
            let corner = data.domain.cell_corner(level as i32, at.map(|c| c * EDGE));
            let frame = view.frame(&corner, level as i32, EDGE as f64);
            let region = region(data, level, *at, bricks.len() == 1);
            Some(Part {
                brick,
                region,
                frame,
                footprint: frame.footprint(DVec3::ZERO, DVec3::splat(EDGE as f64))?,
            })
        };
        let parts = order.iter().filter_map(part).collect();
        let size =
            data.domain.difference(&data.domain.upper(), &data.domain.cell_corner(0, [0; 3]));
        let grid = PixelGrid::new(&view, scene.render.samples);
        let longest = size.length();
        let brightest = transfer.brightest().min(transfer.largest_emission() * longest);
        let close = TransferPieces::new(function, |_| 0.01 * ALLOWED / longest);
        let table = TransferTable::new(&transfer.all, &close.merged);
        let allowed = Some(ALLOWED);
        let packets = Some(PacketTransfer::new(table, close, allowed, 1.0, longest));
        let ending = Ending::new(brightest, 0.0);
        let light = Light { pieces: &transfer.all, ending, packets };
        Self { grid, parts, light, brightest, care: Care::Rough }
    }

    /// What the square's ray gathers, and its account.
    fn gather(&self, square: &Square, way: Way) -> (RayState, RayError) {
        let (mut states, mut errors) = ([RayState::default()], [RayError::default()]);
        let mut packets = Packets::new();
        let light = &self.light;
        let (plane, half) = (self.grid.aim(square).plane, self.grid.pixel_size() * square.half());
        for Part { brick, region, frame, footprint } in &self.parts {
            let whole =
                Passage { brick, region: *region, drawn: DrawnNeighbours::ALL, hides: false };
            if way == Way::WithoutAccount {
                march(&whole, &frame.ray(plane), light, &mut states[0], None);
                continue;
            }
            for margin::Part { passage, frame, footprint } in parts(&whole, frame, footprint) {
                if !meets(&footprint, plane, half) {
                    continue;
                }
                let ray = frame.ray(plane);
                let covered = self.grid.covered(&footprint) / self.grid.weight(square);
                let beam = beam(&frame, &ray, half, covered);
                let diagonal = frame.cell_width.length();
                if way == Way::InPackets
                    && packets.enter(&passage, light, diagonal, self.care, true)
                {
                    let mut gathered = Rays { states: &mut states, errors: &mut errors };
                    let (rays, beams) = ([TileRay { index: 0, ray }], [beam]);
                    let accounts = Accounts::Squares(&beams);
                    packets.march(&passage, light, &rays, accounts, &mut gathered);
                } else {
                    march(&passage, &ray, light, &mut states[0], Some((&mut errors[0], &beam)));
                }
            }
        }
        (states[0], errors[0])
    }

    /// Compares the square's centre with [`RAYS`]² rays of it.
    fn check(&self, square: &Square) -> Result<(), TestCaseError> {
        let (mut mean, mut others) = ([0.0; 4], Vec::new());
        let width = 2.0 * square.half();
        for n in 0..RAYS * RAYS {
            let off = [n % RAYS, n / RAYS]
                .map(|i| ((f64::from(i) + 0.5) / f64::from(RAYS) - 0.5) * width);
            let centre_of = [square.centre[0] + off[0], square.centre[1] + off[1]];
            let (other, _) =
                self.gather(&Square { centre: centre_of, ..*square }, Way::WithoutAccount);
            for (c, value) in channels(&other).into_iter().enumerate() {
                mean[c] += value / f64::from(RAYS * RAYS);
                others.push(value);
            }
        }
        for way in [Way::Alone, Way::InPackets] {
            let (state, error) = self.gather(square, way);
            self.compare(&state, &error, &mean, &others)?;
        }
        Ok(())
    }

    /// Compares the square's centre with other rays of it, channel by channel, and with their mean.
    fn compare(
        &self,
        state: &RayState,
        error: &RayError,
        mean: &[f64; 4],
        others: &[f64],
    ) -> Result<(), TestCaseError> {
        let (centre, brightest) = (channels(state), self.brightest);
        let (light, opacity) = (state.radiance, state.opacity());
        // Of light, and of opacity, whose own light is never brighter than 1.
        let farthest = error.off_by(light, brightest).max(error.farthest.dimmed);
        let shares = error.shares(light, opacity, brightest, 0.0);
        let apart = |(n, value): (usize, &f64)| (value - centre[n % 4]).abs();
        let worst = others.iter().enumerate().map(apart).fold(0.0, f64::max);
        let rounding = 1e-9 * (1.0 + state.light()) + shares.quadrature;
        prop_assert!(worst <= farthest + rounding, "farthest {worst:e}, not {farthest:e}");
        let off = (0..4).map(|c| (mean[c] - centre[c]).abs()).fold(0.0, f64::max);
        let area = shares.pixel_area;
        prop_assert!(off <= area + rounding, "mean {off:e}, not {area:e}");
        Ok(())
    }
}

fn channels(state: &RayState) -> [f64; 4] {
    let [r, g, b] = state.radiance;
    [r, g, b, state.opacity()]
}

/// All of a brick within the domain, and where that ends.
fn region(data: &TestData, level: u32, at: [i128; 3], is_alone: bool) -> Region {
    let cells = data.domain.root_cells().map(|n| i128::from(n) << level);
    let hi: [f64; 3] = std::array::from_fn(|a| EDGE.min(cells[a] - at[a] * EDGE) as f64);
    let ends = (0..3).fold(0, |ends, a| {
        let (lower, upper) = (at[a] == 0, (at[a] + 1) * EDGE >= cells[a]);
        ends | u8::from(lower) << a | u8::from(upper) << (3 + a)
    });
    Region { lo: [0.0; 3], hi, ends: if is_alone { 0x3f } else { ends } }
}

/// A camera `distance` away from `target`, in a random direction.
fn camera(target: [f64; 3], off: [f64; 3], fov: f64, projection: Option<f64>) -> Scene {
    let eye: [f64; 3] = std::array::from_fn(|a| target[a] + off[a]);
    let lens = match projection {
        Some(height) => format!("projection = \"orthographic\"\nheight = {height}"),
        None => format!("fov = {fov}"),
    };
    let text = format!(
        "[image]\nwidth = 6\nheight = 6\n[camera]\nposition = {eye:?}\nlook_at = {target:?}\n\
         up = [0.31, 1.0, 0.17]\n{lens}\n[render]\nsamples = \"area\"\n\
         [[volume]]\nfield = \"Density\"\n"
    );
    Scene::parse(&text, "test").unwrap()
}

fn media(number: usize) -> TransferFunction {
    let emission = [(0.0, 0.0), (0.5, 2.0), (1.0, 0.5)];
    match number {
        0 => smooth(),
        1 => shells(),
        2 => steps(),
        3 => transfer(&[(0.0, 0.0)], &emission),
        4 => transfer(&[(0.0, 0.0)], &[(0.0, 0.0), (1.0, 2.0)]),
        _ => transfer(&[(0.0, 30.0), (1.0, 90.0)], &emission.map(|(x, j)| (x, 60.0 * j))),
    }
}

fn squares() -> impl Strategy<Value = Vec<Square>> {
    let square = (prop::array::uniform2(0.0..6.0_f64), 0..8_u8)
        .prop_map(|(centre, halvings)| Square { centre, offset: [0; 2], pixel: 0, halvings });
    prop::collection::vec(square, 12)
}

fn interpolations() -> impl Strategy<Value = Interpolation> {
    prop_oneof![Just(Interpolation::Linear), Just(Interpolation::Cell)]
}

fn leaves<const N: usize>(leaves: [Leaf; N]) -> impl Strategy<Value = Leaf> {
    (0..N).prop_map(move |n| leaves[n])
}

/// Squares around the middle of the picture.
fn middle_squares() -> Vec<Square> {
    (0..5).map(|halvings| Square { centre: [3.0; 2], offset: [0; 2], pixel: 0, halvings }).collect()
}

/// In the middle of a column of cells, which is in the middle of bricks.
const IN_COLUMN: [f64; 3] = [1.15, 0.125, 1.5];

fn bright_column(_: u32, [x, y, _]: [i128; 3]) -> f64 {
    if [x, y] == [11, 4] { 1.0 } else { 0.1 }
}

fn dark_column(level: u32, cell: [i128; 3]) -> f64 {
    1.0 - bright_column(level, cell)
}

/// All bricks of a domain with one level.
fn all_bricks() -> Vec<[i128; 3]> {
    (0..12).map(|n| [n % 3, n / 3 % 2, n / 6]).collect()
}

/// Checks squares of a picture of `bricks` of a domain with one level.
fn check_all(
    data: &TestData,
    bricks: &[[i128; 3]],
    scene: &Scene,
    medium: usize,
    interpolation: Interpolation,
    squares: &[Square],
) -> Result<(), TestCaseError> {
    let function = media(medium);
    let transfer = TransferPieces::new(&function, |_| 0.0);
    let stage = Stage::new(data, 0, bricks, scene, &function, &transfer, interpolation);
    squares.iter().try_for_each(|square| stage.check(square))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(80))]

    #[test]
    fn a_square_of_one_brick_is_as_far_off_as_its_account_says(
        number in 0..BRICKS.len(),
        off in prop::array::uniform3(-2.5..2.5_f64),
        (fov, is_flat) in (20.0..90.0_f64, any::<bool>()),
        medium in 0..6_usize,
        interpolation in interpolations(),
        squares in squares(),
    ) {
        let (level, at) = BRICKS[number];
        let data = TestData::new(rough);
        let width = data.domain.cell_width(level as i32) * EDGE as f64;
        let left = data.domain.left();
        let target = std::array::from_fn(|a| left[a] + (at[a] as f64 + 0.5) * width[a]);
        let off = std::array::from_fn(|a| off[a] * width.max_element());
        let flat = is_flat.then(|| width.max_element() * 1.5);
        let scene = camera(target, off, fov, flat);
        let function = media(medium);
        let transfer = TransferPieces::new(&function, |_| 0.0);
        let stage = Stage::new(&data, level, &[at], &scene, &function, &transfer, interpolation);
        for square in squares {
            stage.check(&square)?;
        }
    }

    #[test]
    fn a_square_along_what_differs_from_its_surroundings_is_as_far_off_as_its_account_says(
        leaf in leaves([bright_column, dark_column]),
        turn in prop::array::uniform2(-0.01..0.01_f64),
        height in 0.1..3.0_f64,
        medium in 0..6_usize,
        interpolation in interpolations(),
    ) {
        let data = TestData::one_level(leaf);
        let scene = camera(IN_COLUMN, [turn[0], turn[1], 3.0], 0.0, Some(height));
        check_all(&data, &all_bricks(), &scene, medium, interpolation, &middle_squares())?;
    }

    #[test]
    fn a_square_along_a_side_of_the_domain_is_as_far_off_as_its_account_says(
        leaf in leaves([rough, linear, |_, _| 0.5]),
        beside in -0.1..0.1_f64,
        turn in prop::array::uniform2(-0.05..0.05_f64),
        height in 0.1..3.0_f64,
        medium in 0..6_usize,
        interpolation in interpolations(),
    ) {
        let data = TestData::one_level(leaf);
        let target = [1.0, 0.0, data.domain.left()[2] + beside];
        let scene = camera(target, [3.0, turn[0], turn[1]], 0.0, Some(height));
        check_all(&data, &all_bricks(), &scene, medium, interpolation, &middle_squares())?;
    }

    #[test]
    fn a_square_of_many_bricks_is_as_far_off_as_its_account_says(
        is_rough in any::<bool>(),
        off in prop::array::uniform3(-3.0..3.0_f64),
        fov in 20.0..90.0_f64,
        medium in 0..6_usize,
        interpolation in interpolations(),
        squares in squares(),
    ) {
        let data = TestData::one_level(if is_rough { rough } else { linear });
        let scene = camera([1.0, 0.5, 1.5], off, fov, None);
        check_all(&data, &all_bricks(), &scene, medium, interpolation, &squares)?;
    }
}
