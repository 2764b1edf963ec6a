//! Ctrl-C, SIGTERM and SIGHUP: the first asks the run to end early and write what it has, the second ends it at once. One that
//! was ignored when the program started (nohup) stays ignored.

use anyhow::Context as _;
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::{SigId, flag, low_level};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, LazyLock, Mutex, PoisonError};

/// Exit code of a run that was interrupted.
pub const EXIT_CODE: u8 = 130;

static HAPPENED: LazyLock<Arc<AtomicBool>> = LazyLock::new(Arc::default);
/// What was registered.
static WATCHES: Mutex<Vec<SigId>> = Mutex::new(Vec::new());

#[cfg(unix)]
const SIGNALS: [i32; 3] = [SIGINT, SIGTERM, signal_hook::consts::SIGHUP];
#[cfg(not(unix))]
const SIGNALS: [i32; 2] = [SIGINT, SIGTERM];

/// Takes over the signals from here on.
pub fn watch() -> anyhow::Result<()> {
    let ignored = ignored();
    for signal in SIGNALS.into_iter().filter(|signal| ignored >> (signal - 1) & 1 == 0) {
        // In this order: at the first signal the flag is not yet set.
        let ids = [
            flag::register_conditional_shutdown(signal, EXIT_CODE.into(), Arc::clone(&HAPPENED)),
            flag::register(signal, Arc::clone(&HAPPENED)),
        ];
        for id in ids {
            let id = id.context("signals cannot be watched for")?;
            WATCHES.lock().unwrap_or_else(PoisonError::into_inner).push(id);
        }
    }
    Ok(())
}

/// Leaves the signals to whoever had them before, and forgets that one came: the process may go on.
pub fn forget() {
    for id in WATCHES.lock().unwrap_or_else(PoisonError::into_inner).drain(..) {
        low_level::unregister(id);
    }
    HAPPENED.store(false, Ordering::Relaxed);
}

/// Whether a signal came.
pub fn happened() -> bool {
    HAPPENED.load(Ordering::Relaxed)
}

/// A bit for each signal that the parent process set to be ignored, if the system provides it (Linux).
fn ignored() -> u64 {
    let mask = || {
        let status = std::fs::read_to_string("/proc/self/status").ok()?;
        let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"))?;
        u64::from_str_radix(mask.trim(), 16).ok()
    };
    mask().unwrap_or(0)
}
