//! The progress bar: how far the log is, how fast, and how the filter does. None where stderr is no terminal.

use super::interrupt;
use super::say::say;
use indicatif::{ProgressBar, ProgressStyle};
use ipslam::log::LogError;
use ipslam::pipeline::{Counts, Outcome, Progress, Run};
use ipslam::report::{Estimator, Observer};
use std::time::{Duration, Instant};

const EVERY: Duration = Duration::from_millis(100);
/// Parts of a whole whose size is not known.
pub const PERMILLE: u64 = 1000;

/// Runs a log with a bar on stderr, until it ends or the user interrupts it; `message` describes the state of the
/// filter, from the counts and the seconds since the start.
pub fn run_with_bar(
    run: &Run<'_>,
    estimator: &mut dyn Estimator,
    observers: &mut [Box<dyn Observer + '_>],
    message: impl Fn(&Counts, f64) -> String,
) -> Result<Outcome, LogError> {
    let (mut bar, mut smoothing) = (None, None);
    let outcome = run.run(estimator, observers, &mut |progress| {
        match progress {
            Progress::Entry { bytes, counts } => {
                let bar = bar.get_or_insert_with(|| Bar::new(bytes.map(|(_, all)| all)));
                let done = bytes.map_or(counts.scans, |(done, _)| done);
                bar.update(done, |seconds| message(counts, seconds));
            }
            Progress::Smoothing(share) => {
                bar.take().into_iter().for_each(Bar::finish);
                let bar = smoothing.get_or_insert_with(|| Bar::new(Some(PERMILLE)));
                bar.update((share * PERMILLE as f64) as u64, |_| "smoothing".to_owned());
            }
        }
        // A live log ends there by itself.
        run.source.is_live() || !interrupt::happened()
    });
    if interrupt::happened() {
        say!("interrupted: writing what was done until now; again to stop at once");
    }
    bar.into_iter().chain(smoothing).for_each(Bar::finish);
    outcome
}

/// A bar on stderr.
pub struct Bar {
    bar: ProgressBar,
    length: Option<u64>,
    /// Done at the first update: what a reader takes at once, before there is an entry.
    first: Option<u64>,
    began: Instant,
    updated: Instant,
}

impl Bar {
    /// A bar of this length in bytes or entries, or a spinner where the length is not known.
    pub fn new(length: Option<u64>) -> Self {
        let bar = length.map_or_else(ProgressBar::new_spinner, ProgressBar::new);
        let parts =
            if length.is_some() { "{bar:12} {percent:>3} % {elapsed}, {eta} left" } else { "{spinner} {elapsed}" };
        if let Ok(style) = ProgressStyle::with_template(&format!("{parts}; {{wide_msg}}")) {
            bar.set_style(style);
        }
        let now = Instant::now();
        Self { bar, length, first: None, began: now, updated: now }
    }

    /// A spinner for work of unknown length.
    pub fn busy(message: &'static str) -> Self {
        let this = Self::new(None);
        this.bar.set_message(message);
        this.bar.enable_steady_tick(EVERY);
        this
    }

    /// Shows where the run is; what is said besides may depend on the seconds since it began.
    pub fn update(&mut self, done: u64, message: impl FnOnce(f64) -> String) {
        let first = *self.first.get_or_insert(done);
        if self.updated.elapsed() < EVERY || self.bar.is_hidden() {
            return;
        }
        self.updated = Instant::now();
        let seconds = self.began.elapsed().as_secs_f64();
        if let Some(length) = self.length {
            self.bar.set_length(length.saturating_sub(first));
        }
        self.bar.set_position(done.saturating_sub(first));
        self.bar.set_message(message(seconds));
    }

    /// Takes the bar away.
    pub fn finish(self) {
        self.bar.finish_and_clear();
    }
}
