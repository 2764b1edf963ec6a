//! A GPU, through Vulkan, Metal or DirectX 12: devices, buffers and submissions, whatever kernels they run. Nothing else
//! names the crate `wgpu`, and the feature `gpu` removes it.
//!
//! In a browser it is WebGPU, whose answers come only while the program rests. So there every call has to come through a function
//! that JavaScript made with `WebAssembly.promising`, in a browser that has it (`waiting.js`).

#[cfg(feature = "gpu")]
pub mod buffers;
#[cfg(feature = "gpu")]
pub mod device;
#[cfg(feature = "gpu")]
pub mod submission;
#[cfg(feature = "gpu")]
mod waiting;

use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind};

thread_local! {
    static IS_GUARDED: Cell<bool> = const { Cell::new(false) };
}

/// Whether this thread does work whose panics become a [`DeviceError`]; a panic hook need not print them.
pub fn is_guarded() -> bool {
    IS_GUARDED.get()
}

/// Does some work on a device. Libraries below us panic where a driver gives up at a moment that they do not expect.
///
/// # Errors
/// Those of the work; [`DeviceError::DeviceFailed`] where it panics.
pub fn guarded<T>(device: &str, work: impl FnOnce() -> Result<T, DeviceError>) -> Result<T, DeviceError> {
    let before = IS_GUARDED.replace(true);
    // After a panic whatever the work touched is not used again: see `Failover`.
    let done = catch_unwind(AssertUnwindSafe(work));
    IS_GUARDED.set(before);
    done.unwrap_or_else(|panic| {
        let text = panic.downcast_ref::<String>().map(String::as_str);
        let text = text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("it gave up");
        let reason = text.lines().last().unwrap_or_default().trim().to_owned();
        Err(DeviceError::DeviceFailed { device: device.to_owned(), reason })
    })
}

/// Why a device gave no answer.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DeviceError {
    /// There is no device to run on.
    #[error("no device: {reason}")]
    NoDevice {
        /// What was looked for, what was found, and what to do.
        reason: String,
    },
    /// The device gave up.
    #[error("the device {device} failed: {reason}")]
    DeviceFailed {
        /// Its name.
        device: String,
        /// In the words of its driver.
        reason: String,
    },
    /// More than the device holds.
    #[error("the device {device} has no room for {what}: {needed} bytes, and it can hold {largest}")]
    TooLarge {
        /// Its name.
        device: String,
        /// What was to be stored.
        what: &'static str,
        /// Bytes that it takes.
        needed: u64,
        /// Bytes that there are.
        largest: u64,
    },
}
