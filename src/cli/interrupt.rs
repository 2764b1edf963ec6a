//! Ctrl-C and SIGTERM: the first asks the run to end early and write what it has, the second ends it at once.

use anyhow::Context as _;
use std::sync::atomic::{AtomicBool, Ordering};

/// Exit code of a run that was interrupted.
pub const EXIT_CODE: u8 = 130;

static HAPPENED: AtomicBool = AtomicBool::new(false);

/// Takes over the signals from here on.
pub fn watch() -> anyhow::Result<()> {
    let on_signal = || {
        if HAPPENED.swap(true, Ordering::Relaxed) {
            std::process::exit(EXIT_CODE.into());
        }
        eprintln!("interrupted: writing what was done until now; again to stop at once");
    };
    ctrlc::set_handler(on_signal).context("Ctrl-C cannot be watched for")
}

/// Whether a signal came.
pub fn happened() -> bool {
    HAPPENED.load(Ordering::Relaxed)
}
