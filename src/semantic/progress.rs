//! Progress of the mapping.

use std::sync::atomic::{AtomicUsize, Ordering};

/// Counts steps of several runs at once.
pub struct Progress<'a> {
    done: AtomicUsize,
    all: usize,
    report: &'a (dyn Fn(f64) + Sync),
}

impl<'a> Progress<'a> {
    /// No step done of `all`; `report` is called with the share that is done, 0 to 1.
    pub fn new(report: &'a (dyn Fn(f64) + Sync), all: usize) -> Self {
        Self { done: AtomicUsize::new(0), all, report }
    }

    /// One step more.
    pub fn advance(&self) {
        let done = self.done.fetch_add(1, Ordering::Relaxed) + 1;
        (self.report)(done as f64 / self.all as f64);
    }

    /// All is done.
    pub fn finish(&self) {
        (self.report)(1.0);
    }
}
