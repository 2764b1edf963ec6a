//! The progress bar: how far the log is, how fast, and how the filter does. None where stderr is no terminal.

use indicatif::{ProgressBar, ProgressStyle};
use std::time::{Duration, Instant};

const EVERY: Duration = Duration::from_millis(100);

/// A bar on stderr.
pub struct Progress {
    bar: ProgressBar,
    began: Instant,
    updated: Instant,
}

impl Progress {
    /// A bar for a log of so many bytes or entries, or a spinner where that is not known.
    pub fn new(length: Option<u64>) -> Self {
        let bar = length.map_or_else(ProgressBar::new_spinner, ProgressBar::new);
        let parts =
            if length.is_some() { "{bar:12} {percent:>3} % {elapsed}, {eta} left" } else { "{spinner} {elapsed}" };
        if let Ok(style) = ProgressStyle::with_template(&format!("{parts}; {{wide_msg}}")) {
            bar.set_style(style);
        }
        let now = Instant::now();
        Self { bar, began: now, updated: now }
    }

    /// Shows where the run is; what is said besides may depend on the seconds since it began.
    pub fn update(&mut self, done: u64, message: impl FnOnce(f64) -> String) {
        if self.updated.elapsed() < EVERY || self.bar.is_hidden() {
            return;
        }
        self.updated = Instant::now();
        let seconds = self.began.elapsed().as_secs_f64();
        self.bar.set_position(done);
        self.bar.set_message(message(seconds));
    }

    /// Takes the bar away.
    pub fn finish(self) {
        self.bar.finish_and_clear();
    }
}
