//! The reference of the certificate against analytic integrals and the double-double twin, and
//! how it converges.

mod support;
mod twin;

use std::path::Path;

use twin::cameras::{self, Random};
use twin::dataset::{Dataset, Precision};
use twin::interpolant::Interpolant;
use twin::picture::Picture;
use twin::reference::Reference;
use twin::reference::area::Effort;
use twin::reference::tree::Tree;
use twin::scene::Scene;

const EFFORT: Effort = Effort { accuracy: 1e-4, most_rays: 2000 };

fn load(input: &Path) -> twin::Result<Dataset> {
    let source = deepfield::source::open(input, None).map_err(|error| error.to_string())?;
    Dataset::load(source.as_ref(), "Density", Precision::Source)
}

fn synthetic(name: &str) -> twin::Result<Dataset> {
    let folder = tempfile::tempdir().map_err(|error| error.to_string())?;
    load(&support::synth(name, folder.path())?)
}

fn reference(text: &str, dataset: &Dataset, effort: Effort) -> twin::Result<Reference> {
    let scene = Scene::parse(text)?;
    let transfer = scene.transfer(dataset)?;
    let tree = Tree::new(&Interpolant::new(dataset, &transfer))?;
    Reference::render(&scene, dataset, &tree, effort)
}

/// Rays through every pixel's centre equal the double-double twin's.
#[test]
fn rays_equal_the_double_double_twins() -> twin::Result<()> {
    for name in ["small", "jumps", "offdomain", "factor4", "deep25", "deep48"] {
        let dataset = synthetic(name)?;
        let mut random = Random::new(7);
        for number in 0..8 {
            let view = cameras::random_view(&dataset, &mut random, 8, number % 2 == 0);
            let start = std::time::Instant::now();
            let twin = Picture::render(&Scene::parse(&view.scene())?, &dataset)?;
            let slow = start.elapsed();
            let start = std::time::Instant::now();
            let found = reference(&view.scene(), &dataset, EFFORT)?;
            eprintln!("{name} {number} slow {slow:?} fast {:?}", start.elapsed());
            if twin.largest() > 0.0 {
                let difference = found.picture.difference(&twin)?;
                assert!(difference.largest < 1e-9, "{name}: {difference:?}\n{}", view.scene());
            }
        }
    }
    Ok(())
}
