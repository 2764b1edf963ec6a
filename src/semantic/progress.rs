//! How much of the mapping is done.

use std::sync::atomic::{AtomicUsize, Ordering};

/// Counts steps of several runs at once.
pub struct Progress<'a> {
    done: AtomicUsize,
    all: usize,
    tell: &'a (dyn Fn(f64) + Sync),
}

impl<'a> Progress<'a> {
    /// Nothing done of so many steps.
    pub fn new(tell: &'a (dyn Fn(f64) + Sync), all: usize) -> Self {
        Self { done: AtomicUsize::new(0), all, tell }
    }

    /// One step more.
    pub fn advance(&self) {
        let done = self.done.fetch_add(1, Ordering::Relaxed) + 1;
        (self.tell)(done as f64 / self.all as f64);
    }

    /// All is done.
    pub fn finish(&self) {
        (self.tell)(1.0);
    }
}
