//! Scenes for a cache whose user names none: from outside, and from within the deepest region.

use std::path::{Path, PathBuf};

use crate::Result;
use crate::atomic_file;
use crate::cache::{Cache, CachedField, largest_leaf};
use crate::render::Probe;
use crate::scene::Interpolation;
use crate::space::{Decimal, Domain, Position};

/// The field that is shown.
const FIELD: usize = 0;
/// From the cell that is looked at to the eye within, in such cells.
const EYE: [i128; 3] = [-11, 7, -13];
/// From the domain's middle to the eye outside, in its diagonals.
const AWAY: [f64; 3] = [0.9, 0.7, -1.3];
/// Values that are seen from outside are those of cells down to this part of the domain's diagonal:
/// about a pixel.
const PIXEL: f64 = 1.0 / 256.0;
/// Absorption over the length that is looked through, of a haze and of what is densest: from outside,
/// where that is small, and from within.
const OUTSIDE: [f64; 2] = [1.0, 30.0];
const WITHIN: [f64; 2] = [0.6, 20.0];
/// Where a haze lies, if nothing else says so.
const HAZE: f64 = 0.3;
/// Values that are nearer to each other, as a ratio, make no range.
const LEAST_RATIO: f64 = 1.5;

/// The cell that is looked at: of the deepest level, that with the field's largest value.
struct Core {
    octree: i32,
    index: [i128; 3],
    value: f64,
}

/// What differs between the views.
struct View {
    eye: [String; 3],
    fov: f64,
    /// Values that map to 0 and 1 under log10; none where the field has negative ones, or where these
    /// would be not positive or not apart.
    range: Option<[f64; 2]>,
    /// The value of a haze.
    haze: f64,
    /// Absorption of a haze and of what is at the range's end, 1 / code length.
    absorption: [f64; 2],
}

/// Writes `outside.toml` and `inside.toml` of the cache's first field to `folder`.
///
/// # Errors
/// A damaged cache, or a folder that takes no files.
pub(super) fn write(cache: &Cache, folder: &Path) -> Result<Vec<PathBuf>> {
    let core = Core::find(cache)?;
    let (domain, field) = (&cache.header().domain, &cache.header().fields[FIELD]);
    let target = domain.decimals(&core.corner(domain, [1; 3]))?;
    let views = [("outside.toml", outside(cache)?), ("inside.toml", inside(cache, &core)?)];
    let write = |(name, view): (&str, View)| {
        let path = folder.join(name);
        atomic_file::write(&path, &view.scene(field, &target))?;
        Ok(path)
    };
    views.into_iter().map(write).collect()
}

impl Core {
    /// The cell in a cache; the domain's middle, where no value is found.
    fn find(cache: &Cache) -> Result<Self> {
        let header = cache.header();
        let found = match largest_leaf(cache, FIELD, header.levels.len().saturating_sub(1))? {
            None => largest_leaf(cache, FIELD, 0)?,
            found => found,
        };
        let middle = header.domain.root_cells().map(|cells| i128::from(cells / 2));
        let middle = Self { octree: 0, index: middle, value: f64::NAN };
        Ok(found.map_or(middle, |cell| Self {
            octree: cell.octree,
            index: cell.index,
            value: header.fields[FIELD].value(cell.stored),
        }))
    }

    /// The lower corner of the cell, `halves` of such cells away.
    fn corner(&self, domain: &Domain, halves: [i128; 3]) -> Position {
        let index = std::array::from_fn(|a| 2 * self.index[a] + halves[a]);
        domain.cell_corner(self.octree + 1, index)
    }

    /// An eye beside the cell; along axes on which it would be outside, on the other side.
    fn eye(&self, domain: &Domain) -> Position {
        let [one, other] = [2, -2].map(|sign| self.corner(domain, EYE.map(|away| sign * away)));
        let upper = domain.upper().0;
        Position(std::array::from_fn(|a| {
            let is_inside = (0..upper[a]).contains(&one.0[a]);
            if is_inside { one.0[a] } else { other.0[a].clamp(0, upper[a] - 1) }
        }))
    }
}

/// All of the domain. What is as dense as the mean is a haze; halfway from there to the densest that a
/// pixel may show, in the logarithm, is the upper end.
fn outside(cache: &Cache) -> Result<View> {
    let (domain, field) = (&cache.header().domain, &cache.header().fields[FIELD]);
    let length = domain.difference(&domain.upper(), &domain.cell_corner(0, [0; 3])).length();
    let eye = std::array::from_fn(|a| {
        format!("{:e}", 0.5 * (domain.left()[a] + domain.right()[a]) + AWAY[a] * length)
    });
    let sides = (0..3).map(|a| domain.right()[a] - domain.left()[a]);
    let mean = field.sum / (sides.product::<f64>() - field.dropped_volume);
    let seen = largest_seen(cache, PIXEL * length)?;
    let range = are_apart(field, mean, seen).then(|| [0.5 * mean, (mean * seen).sqrt()]);
    let absorption = OUTSIDE.map(|over| over / length);
    Ok(View { eye, fov: 32.0, range, haze: mean, absorption })
}

/// The largest value that the index tells of cells down to `width` (code length), averages of finer
/// ones among them.
fn largest_seen(cache: &Cache, width: f64) -> Result<f64> {
    let header = cache.header();
    let is_seen = |octree| header.domain.cell_width(octree).length() >= width;
    let levels =
        header.levels.iter().take_while(|level| level.octree <= 0 || is_seen(level.octree));
    let mut cursor = cache.cursor();
    let mut largest = f32::NEG_INFINITY;
    for node in 0..levels.map(|level| level.nodes).sum() {
        largest = largest.max(cursor.field(node, FIELD)?.own[1]);
    }
    Ok(header.fields[FIELD].value(largest))
}

/// Whether a logarithmic range may go from `low` to `high`.
fn are_apart(field: &CachedField, low: f64, high: f64) -> bool {
    field.min >= 0.0 && low > 0.0 && high.is_finite() && high >= LEAST_RATIO * low
}

/// What is denser than around the eye: a quarter of the way from there to the densest, in the logarithm,
/// is the lower end, and that the upper.
fn inside(cache: &Cache, core: &Core) -> Result<View> {
    let (domain, field) = (&cache.header().domain, &cache.header().fields[FIELD]);
    let eye = core.eye(domain);
    let length = domain.difference(&core.corner(domain, [1; 3]), &eye).length();
    let eye = domain.decimals(&eye)?;
    let point: Vec<Decimal> = eye.iter().map(|text| Decimal::parse(text)).collect::<Result<_>>()?;
    let mut probe = Probe::new(cache, &field.name, Interpolation::Cell)?;
    let found = <[Decimal; 3]>::try_from(point).map_or(Ok(None), |point| probe.at(&point))?;
    let around = found.map_or(f64::NAN, |found| found.value);
    let low = around.powf(0.75) * core.value.powf(0.25);
    let range = are_apart(field, around, core.value).then_some([low, core.value]);
    let haze = low * (core.value / low).powf(HAZE);
    Ok(View { eye, fov: 40.0, range, haze, absorption: WITHIN.map(|over| over / length) })
}

impl View {
    /// The scale and the range: a logarithmic one where the view's own serves, else the field's extrema.
    fn mapping(&self, field: &CachedField) -> (&'static str, [f64; 2]) {
        match (self.range, field.smallest_positive) {
            (Some(range), _) => ("log10", range),
            (_, Some(low)) if low < field.max && field.min >= 0.0 => ("log10", [low, field.max]),
            _ if field.min < field.max => ("linear", [field.min, field.max]),
            _ => ("linear", [0.0, 1.0]),
        }
    }

    /// The scene's text.
    fn scene(&self, field: &CachedField, target: &[String; 3]) -> String {
        let Self { eye, fov, absorption: [thin, dense], .. } = self;
        let (scale, [low, high]) = self.mapping(field);
        let haze = self.range.map_or(HAZE, |_| (self.haze / low).ln() / (high / low).ln());
        format!(
            "[image]\nwidth = 320\nheight = 180\n[camera]\nposition = {eye:?}\n\
             look_at = {target:?}\nfov = {fov:?}\n[render]\nsamples = 1\ntolerance = \"1%\"\n\
             [[volume]]\nfield = {}\nscale = \"{scale}\"\nrange = [{low:e}, {high:e}]\n\
             colormap = \"inferno\"\n\
             absorption = [[0.0, 0.0], [{haze:.3}, {thin:e}], [1.0, {dense:e}]]\n",
            toml::Value::String(field.name.clone()),
        )
    }
}
