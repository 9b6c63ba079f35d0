//! The scene file.

use std::path::Path;

use toml::de::DeTable;

use super::camera::{self, CameraSettings};
use super::entry::{Entry, Table, Text, shown};
use super::render::{self, RenderSettings};
use super::volume::{self, VolumeSettings};
use crate::{Error, Result, text_file};

/// Largest scene file that is read.
pub const MAX_SCENE_BYTES: u64 = 16 << 20;
/// What messages call it.
const WHAT: &str = "scene file";
/// Most signs and blanks of a scene file. Every number, word and bracket of a TOML text takes about
/// 150 bytes while it is parsed; digits do not, so positions may be as long as the file.
const MAX_SCENE_SIGNS: usize = 160_000;
/// Longest text that a message quotes, characters.
const MAX_QUOTED: usize = 40;
/// Largest width and height of a picture, pixels.
const MAX_PIXELS_PER_AXIS: u32 = 65_536;
/// Largest exposure, stops, of either sign: beyond it no f32 is left in range.
const MAX_EXPOSURE: f64 = 200.0;

/// `[image]`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImageSettings {
    /// Pixels in a row, 1 to 65,536.
    pub width: u32,
    /// Rows, 1 to 65,536.
    pub height: u32,
    /// Stops, in PNG only: pixels are multiplied by 2^exposure.
    pub exposure: f64,
}

impl Default for ImageSettings {
    fn default() -> Self {
        Self { width: 512, height: 512, exposure: 0.0 }
    }
}

impl ImageSettings {
    const KEYS: [&str; 3] = ["width", "height", "exposure"];

    fn parse(table: &Table<'_>) -> Result<Self> {
        let mut settings = Self::default();
        if let Some(entry) = table.get("width") {
            settings.width = entry.whole(1..MAX_PIXELS_PER_AXIS + 1)?;
        }
        if let Some(entry) = table.get("height") {
            settings.height = entry.whole(1..MAX_PIXELS_PER_AXIS + 1)?;
        }
        if let Some(entry) = table.get("exposure") {
            settings.exposure = entry.number()?;
            if settings.exposure.abs() > MAX_EXPOSURE {
                let reason = format!("must be from -{MAX_EXPOSURE} to {MAX_EXPOSURE} stops");
                return Err(entry.error(reason));
            }
        }
        Ok(settings)
    }

    /// Parses `WxH`: width and height, as a scene may give them.
    ///
    /// # Errors
    /// Anything else.
    pub fn parse_size(text: &str) -> Result<[u32; 2]> {
        let sides: Vec<&str> = text.split(['x', 'X', '×']).map(str::trim).collect();
        let [Ok(width), Ok(height)] =
            sides.iter().map(|side| side.parse::<u64>()).collect::<Vec<_>>()[..]
        else {
            let reason = "a size is WIDTHxHEIGHT in pixels, as in 320x180, not";
            return Err(Error::request(format!("{reason} `{}`", shown(text))));
        };
        let side = |name: &str, pixels: u64| {
            let side = u32::try_from(pixels).ok();
            side.filter(|side| (1..=MAX_PIXELS_PER_AXIS).contains(side)).ok_or_else(|| {
                Error::request(format!("`{name}`: must be from 1 to {MAX_PIXELS_PER_AXIS}"))
            })
        };
        Ok([side("width", width)?, side("height", height)?])
    }
}

/// Everything a scene file says, defaults filled in.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    /// The picture.
    pub image: ImageSettings,
    /// The camera.
    pub camera: CameraSettings,
    /// How it is computed.
    pub render: RenderSettings,
    /// What is shown.
    pub volume: VolumeSettings,
    /// What the file says to no effect, each with its line and key, for warnings.
    pub in_vain: Vec<String>,
    /// The file, for messages.
    pub place: String,
    /// The file's text.
    pub source: String,
}

impl Scene {
    /// Reads the scene file at `path`.
    ///
    /// # Errors
    /// A file that cannot be read, is larger than [`MAX_SCENE_BYTES`] or is not UTF-8, and those
    /// of [`Self::parse`].
    pub fn load(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let text = text_file::read(path, WHAT, MAX_SCENE_BYTES)?;
        Self::parse(&text, &path.display().to_string())
    }

    /// Parses the text of a scene file; `place` is what messages call it.
    ///
    /// # Errors
    /// Text that is not TOML, unknown or missing keys, values of the wrong type or out of range:
    /// the message has line, key and what is expected there.
    pub fn parse(text: &str, place: &str) -> Result<Self> {
        if text.len() as u64 > MAX_SCENE_BYTES {
            return Err(text_file::too_large(place, WHAT, MAX_SCENE_BYTES));
        }
        check_signs(text, place)?;
        let lines = Text { place, source: text };
        let document = DeTable::parse(text).map_err(|error| {
            let span = error.span().unwrap_or_default();
            let what = one_line(error.message());
            let at = text.get(span.clone()).and_then(short_word);
            let at = at.map_or_else(String::new, |word| format!(": `{word}`"));
            lines.error(span.start, format!("not valid TOML: {what}{at}"))
        })?;
        let known = ["image", "camera", "render", "volume"];
        let root = Table::new(lines, "", 0, document.get_ref(), &known)?;
        let image = section(&root, "image", "[image]", &ImageSettings::KEYS)?
            .map_or(Ok(ImageSettings::default()), |table| ImageSettings::parse(&table))?;
        let camera_table = root.required("camera")?.table("[camera]", &camera::KEYS)?;
        let camera = CameraSettings::parse(&camera_table)?;
        let render = section(&root, "render", "[render]", &render::KEYS)?
            .map_or(Ok(RenderSettings::default()), |table| RenderSettings::parse(&table))?;
        let volume_table = only_volume(root.required("volume")?)?;
        let volume = VolumeSettings::parse(&volume_table)?;
        let mut in_vain = volume::in_vain(&volume_table, &volume);
        in_vain.extend(camera::in_vain(&camera_table, camera.projection));
        Ok(Self {
            image,
            camera,
            render,
            volume,
            in_vain,
            place: place.to_owned(),
            source: text.to_owned(),
        })
    }
}

fn section<'a>(
    root: &Table<'a>,
    key: &'static str,
    name: &'static str,
    known: &[&str],
) -> Result<Option<Table<'a>>> {
    root.get(key).map(|entry| entry.table(name, known)).transpose()
}

fn only_volume(entry: Entry<'_>) -> Result<Table<'_>> {
    let volumes = entry.elements().map_err(|_| entry.error("a volume is written as [[volume]]"))?;
    match volumes.as_slice() {
        [] => Err(entry.error("a scene needs one [[volume]]")),
        [one] => one.table("[[volume]]", &volume::KEYS),
        [_, second, ..] => {
            Err(second.error("several volumes are not supported yet; leave one [[volume]]"))
        }
    }
}

fn check_signs(text: &str, place: &str) -> Result<()> {
    let inside_word = |byte: &u8| {
        byte.is_ascii_alphanumeric()
            || !byte.is_ascii()
            || matches!(byte, b'_' | b'+' | b'-' | b'#')
    };
    if text.bytes().filter(|byte| !inside_word(byte)).count() <= MAX_SCENE_SIGNS {
        return Ok(());
    }
    let reason =
        format!("more than {MAX_SCENE_SIGNS} signs and blanks; a scene file is a short TOML text");
    Err(Error::invalid(place, reason))
}

/// A text to be quoted, if it is within one line and short.
fn short_word(text: &str) -> Option<&str> {
    let is_short = !text.is_empty() && text.chars().count() <= MAX_QUOTED;
    (is_short && !text.contains(char::is_control)).then_some(text)
}

/// A foreign message without line breaks, and not too long.
fn one_line(message: &str) -> String {
    message.chars().take(200).collect::<String>().replace(char::is_control, " ")
}
