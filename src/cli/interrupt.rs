//! Ctrl-C, SIGTERM and SIGHUP: the first asks the run to end early and write what it has, the second ends it at once. One that
//! was ignored when the program started (nohup) stays ignored.

use anyhow::Context as _;
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, LazyLock};

/// Exit code of a run that was interrupted.
pub const EXIT_CODE: u8 = 130;

static HAPPENED: LazyLock<Arc<AtomicBool>> = LazyLock::new(Arc::default);

#[cfg(unix)]
const SIGNALS: [i32; 3] = [SIGINT, SIGTERM, signal_hook::consts::SIGHUP];
#[cfg(not(unix))]
const SIGNALS: [i32; 2] = [SIGINT, SIGTERM];

/// Takes over the signals from here on.
pub fn watch() -> anyhow::Result<()> {
    let ignored = ignored();
    for signal in SIGNALS.into_iter().filter(|signal| ignored >> (signal - 1) & 1 == 0) {
        // In this order: at the first signal the flag is not yet set.
        flag::register_conditional_shutdown(signal, EXIT_CODE.into(), Arc::clone(&HAPPENED))
            .and_then(|_| flag::register(signal, Arc::clone(&HAPPENED)))
            .context("signals cannot be watched for")?;
    }
    Ok(())
}

/// Whether a signal came.
pub fn happened() -> bool {
    HAPPENED.load(Ordering::Relaxed)
}

/// A bit for each signal that whoever started the program wants ignored, where the system tells (Linux).
fn ignored() -> u64 {
    let mask = || {
        let status = std::fs::read_to_string("/proc/self/status").ok()?;
        let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"))?;
        u64::from_str_radix(mask.trim(), 16).ok()
    };
    mask().unwrap_or(0)
}
