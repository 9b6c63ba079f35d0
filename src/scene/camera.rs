//! `[camera]`.

use glam::DVec3;

use super::entry::{Entry, Table};
use crate::Result;
use crate::space::Decimal;

/// The keys that `[camera]` may have.
pub(super) const KEYS: [&str; 6] = ["projection", "position", "look_at", "up", "fov", "height"];

/// How rays leave the camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Projection {
    /// From one eye point.
    Perspective {
        /// Vertical field of view, degrees, in (0, 180); a telescope's may be tiny.
        fov_degrees: f64,
    },
    /// All along the view direction.
    Orthographic {
        /// Height of the view, code length, > 0.
        height: f64,
    },
}

/// Where the camera stands and how it looks.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraSettings {
    /// The projection with its own settings.
    pub projection: Projection,
    /// The eye, code length, exactly as written.
    pub position: [Decimal; 3],
    /// What is in the picture's centre, code length, exactly as written; not the eye.
    pub look_at: [Decimal; 3],
    /// A direction that is up in the picture: of any length but 0.
    pub up: DVec3,
}

#[derive(Clone, Copy)]
enum Kind {
    Perspective,
    Orthographic,
}

/// Known, and not supported.
const LATER: [&str; 2] = ["fisheye", "equirectangular"];

impl CameraSettings {
    /// Reads `[camera]`.
    ///
    /// # Errors
    /// A missing or malformed key, and a camera that looks at its own position.
    pub(super) fn parse(table: &Table<'_>) -> Result<Self> {
        let projection = parse_projection(table)?;
        let position = decimals(table.required("position")?)?;
        let look_at = table.required("look_at")?;
        let target = decimals(look_at)?;
        if target == position {
            return Err(look_at.error("the same point as `position`; they must differ"));
        }
        Ok(Self { projection, position, look_at: target, up: parse_up(table)? })
    }
}

/// What `table` says in vain: the key of the projection that it does not choose.
pub(super) fn in_vain(table: &Table<'_>, chosen: Projection) -> Option<String> {
    let (key, other) = match chosen {
        Projection::Perspective { .. } => ("height", "orthographic"),
        Projection::Orthographic { .. } => ("fov", "perspective"),
    };
    let reason = format_args!("has no effect: it is for projection = \"{other}\"");
    Some(table.get(key)?.error(reason).to_string())
}

fn parse_projection(table: &Table<'_>) -> Result<Projection> {
    let fov_degrees = positive(table, "fov", 45.0, 180.0)?;
    let height = positive(table, "height", 1.0, f64::INFINITY)?;
    let Some(entry) = table.get("projection") else {
        return Ok(Projection::Perspective { fov_degrees });
    };
    if LATER.contains(&entry.string()?) {
        return Err(entry.error(
            "this projection is not supported yet; use \"perspective\" or \"orthographic\"",
        ));
    }
    let known = [("perspective", Kind::Perspective), ("orthographic", Kind::Orthographic)];
    match entry.choice(&known)? {
        Kind::Perspective => Ok(Projection::Perspective { fov_degrees }),
        Kind::Orthographic => Ok(Projection::Orthographic { height }),
    }
}

fn positive(table: &Table<'_>, key: &'static str, default: f64, limit: f64) -> Result<f64> {
    let Some(entry) = table.get(key) else { return Ok(default) };
    let number = entry.number()?;
    if number > 0.0 && number < limit {
        return Ok(number);
    }
    let most = if limit.is_finite() { format!(" and below {limit}") } else { String::new() };
    Err(entry.error(format_args!("must be above 0{most}, not {number:?}")))
}

fn decimals(entry: Entry<'_>) -> Result<[Decimal; 3]> {
    let [x, y, z] = entry.exactly::<3>()?;
    Ok([x.decimal()?, y.decimal()?, z.decimal()?])
}

fn parse_up(table: &Table<'_>) -> Result<DVec3> {
    let Some(entry) = table.get("up") else { return Ok(DVec3::Y) };
    let up = entry.numbers::<3>()?;
    if up == [0.0; 3] {
        return Err(entry.error("must not be [0, 0, 0]"));
    }
    Ok(DVec3::from_array(up))
}
