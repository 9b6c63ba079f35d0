//! Progress bars, on a terminal only.

use std::fmt::Write;
use std::sync::{Mutex, Once, PoisonError, mpsc};
use std::thread;
use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle, WeakProgressBar};

/// The bar that was begun last, if it is still there.
static LAST: Mutex<Option<WeakProgressBar>> = Mutex::new(None);
/// The longest that the end of the process waits for a terminal that takes nothing.
const PATIENCE: Duration = Duration::from_millis(200);

/// A bar on stderr with rate and time left; hidden where stderr is no terminal, and until there is
/// something to count.
pub(super) struct Bar {
    bar: ProgressBar,
    target: Box<dyn Fn() -> ProgressDrawTarget + Send + Sync>,
    begun: Once,
}

impl Bar {
    /// A bar that begins with `label` and counts in `unit`.
    pub(super) fn new(label: &str, unit: &str) -> Self {
        let bar = Self::on(label, unit, ProgressDrawTarget::stderr);
        *LAST.lock().unwrap_or_else(PoisonError::into_inner) = Some(bar.bar.downgrade());
        bar
    }

    /// The same on the terminal that `target` gives.
    fn on(
        label: &str,
        unit: &str,
        target: impl Fn() -> ProgressDrawTarget + Send + Sync + 'static,
    ) -> Self {
        let bar = ProgressBar::with_draw_target(Some(0), ProgressDrawTarget::hidden());
        let template =
            format!("{{prefix:>10}} [{{bar:30}}] {{pos}}/{{len}} {unit}, {{rate}}/s, {{eta}} left");
        if let Ok(style) = ProgressStyle::with_template(&template) {
            let rate = |state: &ProgressState, text: &mut dyn Write| {
                // Text in memory takes all that is written.
                let _ = text.write_str(&rounded(state.per_sec()));
            };
            bar.set_style(style.with_key("rate", rate));
        }
        bar.set_prefix(label.to_owned());
        Self { bar, target: Box::new(target), begun: Once::new() }
    }

    /// Shows what is being done, and how far it is; nothing new where `total` is not known yet (0).
    pub(super) fn show(&self, label: &str, done: u64, total: u64) {
        if total == 0 {
            return;
        }
        self.bar.set_length(total);
        if self.bar.prefix() != label {
            self.bar.reset();
            self.bar.set_prefix(label.to_owned());
        }
        self.bar.set_position(done);
        self.begun.call_once(|| {
            self.bar.set_draw_target((self.target)());
            self.bar.tick();
        });
    }
}

impl Drop for Bar {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}

/// Runs `print`, which writes to a terminal, while no bar stands there.
pub(super) fn without_bar(print: impl FnOnce()) {
    match last() {
        Some(bar) => bar.suspend(print),
        None => print(),
    }
}

/// Clears the bar away before the process ends by a signal.
pub(super) fn clear() {
    let Some(bar) = last() else { return };
    let (sender, done) = mpsc::channel();
    // A terminal that was told to wait would hold the end up.
    let clear = move || {
        bar.finish_and_clear();
        let _ = sender.send(());
    };
    if thread::Builder::new().name("last line".to_owned()).spawn(clear).is_ok() {
        let _ = done.recv_timeout(PATIENCE);
    }
}

fn last() -> Option<ProgressBar> {
    LAST.lock().unwrap_or_else(PoisonError::into_inner).as_ref()?.upgrade()
}

/// A rate in three significant digits, or all those before the point.
fn rounded(rate: f64) -> String {
    let digits = (2.0 - rate.abs().log10().floor()).clamp(0.0, 6.0);
    // Of 0 the logarithm is infinite.
    let digits = if rate == 0.0 { 0 } else { digits as usize };
    format!("{rate:.digits$}")
}

#[cfg(test)]
mod tests {
    use std::io;
    use std::sync::Arc;

    use indicatif::TermLike;

    use super::*;

    /// Keeps all that is written to it.
    #[derive(Debug, Clone, Default)]
    struct Screen(Arc<Mutex<String>>);

    impl Screen {
        fn take(&self) -> String {
            std::mem::take(&mut self.0.lock().unwrap())
        }

        fn put(&self, text: &str) -> io::Result<()> {
            self.0.lock().unwrap().push_str(text);
            Ok(())
        }
    }

    impl TermLike for Screen {
        fn width(&self) -> u16 {
            100
        }
        fn move_cursor_up(&self, _: usize) -> io::Result<()> {
            Ok(())
        }
        fn move_cursor_down(&self, _: usize) -> io::Result<()> {
            Ok(())
        }
        fn move_cursor_right(&self, _: usize) -> io::Result<()> {
            Ok(())
        }
        fn move_cursor_left(&self, _: usize) -> io::Result<()> {
            Ok(())
        }
        fn write_line(&self, text: &str) -> io::Result<()> {
            self.put(text)
        }
        fn write_str(&self, text: &str) -> io::Result<()> {
            self.put(text)
        }
        fn clear_line(&self) -> io::Result<()> {
            self.put("<clear>")
        }
        fn flush(&self) -> io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn nothing_is_drawn_until_there_is_something_to_count() {
        let screen = Screen::default();
        let terminal = screen.clone();
        let target = move || ProgressDrawTarget::term_like(Box::new(terminal.clone()));
        let bar = Bar::on("first", "tiles", target);
        bar.show("first", 0, 0);
        assert_eq!(screen.take(), "");
        bar.show("second", 1, 4);
        let drawn = screen.take();
        assert!(drawn.contains("second [") && drawn.contains("1/4 tiles"), "{drawn}");
        bar.show("third", 0, 0);
        bar.bar.suspend(|| screen.put("<warning>").unwrap());
        let drawn = screen.take();
        assert!(drawn.contains("<clear><warning>"), "{drawn}");
        drop(bar);
        let drawn = screen.take();
        assert!(drawn.ends_with("<clear>") && !drawn.contains("0/0"), "{drawn}");
    }

    #[test]
    fn rates_have_three_digits() {
        let shown = [2742.848, 99.96, 27.4284, 0.27428, 0.0, 1e-9].map(rounded);
        assert_eq!(shown, ["2743", "100.0", "27.4", "0.274", "0", "0.000000"]);
    }
}
