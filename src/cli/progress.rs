//! Progress bars, on a terminal only.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// A bar on stderr with rate and time left; hidden where stderr is no terminal.
pub(super) struct Bar {
    bar: ProgressBar,
}

impl Bar {
    /// A bar that begins with `label` and counts in `unit`.
    pub(super) fn new(label: &str, unit: &str) -> Self {
        let bar = ProgressBar::with_draw_target(Some(0), ProgressDrawTarget::stderr());
        let template = format!(
            "{{prefix:>10}} [{{bar:30}}] {{pos}}/{{len}} {unit}, {{per_sec}}, {{eta}} left"
        );
        if let Ok(style) = ProgressStyle::with_template(&template) {
            bar.set_style(style);
        }
        bar.set_prefix(label.to_owned());
        Self { bar }
    }

    /// Shows what is being done, and how far it is.
    pub(super) fn show(&self, label: &str, done: u64, total: u64) {
        if self.bar.prefix() != label {
            self.bar.set_prefix(label.to_owned());
            self.bar.reset();
        }
        self.bar.set_length(total);
        self.bar.set_position(done);
    }
}

impl Drop for Bar {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}
