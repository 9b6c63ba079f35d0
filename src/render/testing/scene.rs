//! Scenes for tests.

use crate::render::camera::view::View;
use crate::scene::Scene;
use crate::space::Domain;

const CAMERA: &str = r#"
[camera]
position = ["-0.71", "0.93", "-1.37"]
look_at = [0.47, 0.14, 0.9]
[[volume]]
field = "Density"
scale = "linear"
range = [0.0, 1.0]
color = [[0.0, 1.0, 0.2, 0.0], [1.0, 0.1, 0.3, 1.0]]
"#;

/// A scene with the lines `settings` under `[render]`.
pub(crate) fn scene(settings: &str, width: u32, height: u32) -> Scene {
    let image = format!("[image]\nwidth = {width}\nheight = {height}\n");
    Scene::parse(&format!("{image}[render]\n{settings}\n{CAMERA}"), "test").unwrap()
}

/// A domain whose cells are no cubes.
pub(crate) fn domain() -> Domain {
    Domain::new([0.0, -0.1, 0.0], [1.0, 0.3, 2.0], [20, 12, 28]).unwrap()
}

/// The scene's camera in [`domain`].
pub(crate) fn view(scene: &Scene) -> View {
    View::new(scene, &domain()).unwrap()
}
