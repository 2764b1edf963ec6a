//! A GPU, through Vulkan, Metal or DirectX 12: devices, buffers and submissions, whatever kernels they run. Nothing else
//! names the crate `wgpu`, and the feature `gpu` removes it.

#[cfg(feature = "gpu")]
pub mod buffers;
#[cfg(feature = "gpu")]
pub mod device;
#[cfg(feature = "gpu")]
pub mod submission;

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
