//! What a cache file gives: everything that is asked of it, in one process, with panics, memory
//! and time watched.

use std::path::Path;
use std::sync::mpsc;
use std::time::Duration;

use deepfield::cache::{Cache, Cursor, verify};
use deepfield::render::{Probe, RenderOptions, render};
use deepfield::scene::{Interpolation, Scene};
use deepfield::space::Decimal;

use super::allocator::peak_of;

/// Most bytes that may be live while one cache is examined.
const MOST_BYTES: usize = 256 << 20;
/// Longest examination of one cache; a sound one takes a tenth of a second.
const LONGEST: Duration = Duration::from_secs(60);

/// An answer as it can be compared, or the error.
type Answer = Result<Vec<u32>, String>;

/// What a cache gave.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Examined {
    /// Whether it was opened, and found whole.
    pub(crate) verified: Result<(), String>,
    /// Points looked up, then pictures.
    pub(crate) answers: Vec<Answer>,
}

/// What is asked of caches.
#[derive(Clone)]
pub(crate) struct Questions {
    scenes: Vec<Scene>,
    points: Vec<[Decimal; 3]>,
    field: String,
}

const CAMERAS: [&str; 2] = [
    "position = [0.45, 0.4, -1.2]\nlook_at = [0.45, 0.45, 0.4]\nfov = 45.0",
    "position = [\"0.4127\", 0.55, 0.33]\nlook_at = [0.3, 0.3, 0.77]\nfov = 70.0",
];

impl Questions {
    /// Pictures from outside and inside, and points, of `field`.
    pub(crate) fn new(field: &str) -> Self {
        let scene = |(camera, interpolation): (&str, &str)| {
            let text = format!(
                "[image]\nwidth = 16\nheight = 16\n[camera]\n{camera}\n[render]\n\
                 interpolation = \"{interpolation}\"\ntolerance = 0\nsamples = 1\n[[volume]]\n\
                 field = \"{field}\"\nscale = \"log10\"\nabsorption = [[0.0, 0.0], [0.3, 0.0], \
                 [1.0, 8.0]]\n"
            );
            Scene::parse(&text, "scene").unwrap()
        };
        let number = |text: f64| Decimal::from_shortest(text).unwrap();
        let point = |i: u32| {
            [0.618_033_9, 0.414_213_5, 0.732_050_8]
                .map(|step| number((f64::from(i) * step).fract()))
        };
        Self {
            scenes: vec![scene((CAMERAS[0], "cell")), scene((CAMERAS[1], "linear"))],
            points: (0..16).map(point).chain([[0.4127, 0.5961, 0.3313].map(number)]).collect(),
            field: field.into(),
        }
    }

    fn ask(&self, path: &Path) -> Examined {
        let cache = match Cache::open(path, 4 * Cursor::WINDOWS) {
            Ok(cache) => cache,
            Err(error) => return Examined { verified: Err(error.to_string()), answers: vec![] },
        };
        let report = verify(&cache, &mut |_, _| {}).map_err(|error| error.to_string());
        let verified = report.and_then(|report| match report.listed.first() {
            None => Ok(()),
            Some(damage) => Err(damage.reason.clone()),
        });
        let mut answers = Vec::new();
        for interpolation in [Interpolation::Cell, Interpolation::Linear] {
            answers.extend(self.points.iter().map(|p| self.look_up(&cache, interpolation, p)));
        }
        answers.extend(self.scenes.iter().map(|scene| picture(&cache, scene)));
        Examined { verified, answers }
    }

    fn look_up(&self, cache: &Cache, how: Interpolation, point: &[Decimal; 3]) -> Answer {
        let found = Probe::new(cache, &self.field, how).and_then(|mut probe| probe.at(point));
        let bits = |value: f64| [value.to_bits() as u32, (value.to_bits() >> 32) as u32];
        match found {
            Ok(None) => Ok(vec![]),
            Ok(Some(found)) => Ok([&[found.level][..], &bits(found.value)].concat()),
            Err(error) => Err(error.to_string()),
        }
    }

    /// Asks everything of the cache at `path`.
    ///
    /// # Errors
    /// A panic, a vast allocation, an endless walk, and errors that are not one clear line.
    pub(crate) fn examine(&self, path: &Path) -> Result<Examined, String> {
        let (sender, receiver) = mpsc::channel();
        let (questions, path) = (self.clone(), path.to_path_buf());
        let thread = std::thread::spawn(move || {
            let outcome = peak_of(|| std::panic::catch_unwind(|| questions.ask(&path)));
            // Whoever waited has given up when this fails.
            let _ = sender.send(outcome);
        });
        let (outcome, peak) = receiver
            .recv_timeout(LONGEST)
            .map_err(|_| format!("still running after {LONGEST:?}"))?;
        thread.join().map_err(|_| "the examination itself failed")?;
        if peak > MOST_BYTES {
            return Err(format!("{peak} bytes were live"));
        }
        let examined = outcome.map_err(|_| "the program panicked")?;
        let unclear =
            |error: &&String| error.is_empty() || error.contains('\n') || error.len() > 999;
        if let Some(error) = examined.errors().find(unclear) {
            return Err(format!("`{error}` is not one clear line"));
        }
        Ok(examined)
    }
}

fn picture(cache: &Cache, scene: &Scene) -> Answer {
    let options = RenderOptions {
        memory: 128 << 20,
        threads: Some(1),
        progress: None,
        fixed: None,
        resident: false,
    };
    let rendered = render(cache, scene, &options).map_err(|error| error.to_string())?;
    let values = rendered.film.pixels().iter().flatten();
    assert!(values.clone().all(|value| value.is_finite()), "a pixel is no number");
    Ok(values.map(|value| value.to_bits()).collect())
}

impl Examined {
    fn errors(&self) -> impl Iterator<Item = &String> {
        let answers = self.answers.iter().filter_map(|answer| answer.as_ref().err());
        answers.chain(self.verified.as_ref().err())
    }

    /// Whether every answer is an error or what a sound cache gave.
    pub(crate) fn answers_nothing_else(&self, sound: &Self) -> bool {
        self.answers.iter().zip(&sound.answers).all(|(own, right)| own.is_err() || own == right)
    }
}
