//! Which devices there are, and one of them opened.

use super::waiting::block_on;
use super::{DeviceError, guarded};
use std::sync::{Arc, Mutex, PoisonError};

/// A device that kernels may run on.
#[derive(Clone, Debug)]
pub struct Adapter {
    adapter: wgpu::Adapter,
    /// What its driver calls it.
    pub name: String,
    /// What it is: a GPU of its own, one in the processor, or the processor playing one.
    pub kind: AdapterKind,
    /// Driver and its version.
    pub driver: String,
    /// Interface that it is reached through.
    pub interface: String,
}

/// What a device is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[non_exhaustive]
pub enum AdapterKind {
    /// A GPU of its own.
    Discrete,
    /// A GPU in the processor.
    Integrated,
    /// A GPU lent to a virtual machine.
    Virtual,
    /// Unknown.
    Other,
    /// No GPU: the processor plays one.
    Software,
}

/// Every device, the likely fastest first.
pub fn adapters() -> Vec<Adapter> {
    let listed = guarded("list", || {
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
        Ok(block_on(instance.enumerate_adapters(wgpu::Backends::PRIMARY)))
    });
    // A driver that cannot be asked has no devices.
    let found = listed.unwrap_or_default();
    let mut adapters: Vec<Adapter> = found.into_iter().map(Adapter::new).collect();
    adapters.sort_by_key(|adapter| adapter.kind);
    adapters
}

/// The device whose name has this text in it, whatever its case; without a text the likely fastest.
///
/// # Errors
/// There is none, or none of that name; the message lists the devices, or names what to install.
pub fn find(name: Option<&str>) -> Result<Adapter, DeviceError> {
    let adapters = adapters();
    if adapters.is_empty() {
        let reason = if cfg!(target_family = "wasm") {
            "the browser offers no WebGPU"
        } else {
            "no driver was found; install the Vulkan driver of the graphics card, or for one in software \
             mesa-vulkan-drivers (Debian, Ubuntu)"
        };
        return Err(DeviceError::NoDevice { reason: reason.to_owned() });
    }
    let names: Vec<String> = adapters.iter().map(|adapter| adapter.name.clone()).collect();
    let is_meant =
        |adapter: &Adapter| name.is_none_or(|name| adapter.name.to_lowercase().contains(&name.to_lowercase()));
    adapters.into_iter().find(is_meant).ok_or_else(|| DeviceError::NoDevice {
        reason: format!("none is called {}; there are: {}", name.unwrap_or_default(), names.join(", ")),
    })
}

impl Adapter {
    fn new(adapter: wgpu::Adapter) -> Self {
        let info = adapter.get_info();
        let kind = match info.device_type {
            wgpu::DeviceType::DiscreteGpu => AdapterKind::Discrete,
            wgpu::DeviceType::IntegratedGpu => AdapterKind::Integrated,
            wgpu::DeviceType::VirtualGpu => AdapterKind::Virtual,
            wgpu::DeviceType::Other => AdapterKind::Other,
            wgpu::DeviceType::Cpu => AdapterKind::Software,
        };
        let driver = format!("{} {}", info.driver, info.driver_info).trim().to_owned();
        // Browsers seldom say more of a GPU than that there is one.
        let name = if info.name.is_empty() { "WebGPU".to_owned() } else { info.name };
        Self { adapter, name, kind, driver, interface: info.backend.to_string() }
    }

    /// What bounds a dispatch.
    pub fn limits(&self) -> wgpu::Limits {
        self.adapter.limits()
    }

    /// Whether lanes can share what they have loaded: subgroups, of eight lanes at least. A browser wants to read that in a kernel,
    /// in words that drivers do not know.
    pub fn can_broadcast(&self) -> bool {
        !cfg!(target_family = "wasm")
            && self.adapter.features().contains(wgpu::Features::SUBGROUP)
            && self.adapter.get_info().subgroup_min_size >= 8
    }

    /// Opens it.
    ///
    /// # Errors
    /// Its driver refuses.
    pub fn open(&self) -> Result<Device, DeviceError> {
        let failure = Failure::default();
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("ipslam"),
            required_features: self.adapter.features() & wgpu::Features::SUBGROUP,
            // As much as it has; the work is cut to fit.
            required_limits: self.adapter.limits(),
            ..wgpu::DeviceDescriptor::default()
        };
        let (device, queue) = block_on(self.adapter.request_device(&descriptor))
            .map_err(|error| DeviceError::DeviceFailed { device: self.name.clone(), reason: error.to_string() })?;
        let noted = failure.clone();
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| noted.note(error.to_string())));
        let noted = failure.clone();
        device.set_device_lost_callback(move |_, message| noted.note(format!("it was lost: {message}")));
        Ok(Device { name: self.name.clone(), limits: device.limits(), device, queue, failure })
    }
}

/// A device at work.
#[derive(Debug)]
pub struct Device {
    /// What its driver calls it.
    pub name: String,
    pub(super) limits: wgpu::Limits,
    pub(super) device: wgpu::Device,
    pub(super) queue: wgpu::Queue,
    failure: Failure,
}

impl Device {
    /// Whether all went well until now.
    ///
    /// # Errors
    /// The first thing that went wrong.
    pub fn check(&self) -> Result<(), DeviceError> {
        match self.failure.first() {
            None => Ok(()),
            Some(reason) => Err(self.failed(reason)),
        }
    }

    /// Ends it, as a driver may at any time: whatever follows fails.
    pub fn destroy(&self) {
        self.device.destroy();
    }

    /// Bytes that one storage buffer can hold.
    pub fn largest_storage(&self) -> u64 {
        self.limits.max_storage_buffer_binding_size.min(self.limits.max_buffer_size)
    }

    /// Workgroups that one dispatch can have.
    pub fn most_workgroups(&self) -> usize {
        self.limits.max_compute_workgroups_per_dimension as usize
    }

    /// Offsets of uniforms are multiples of this \[bytes\].
    pub fn uniform_stride(&self) -> u32 {
        self.limits.min_uniform_buffer_offset_alignment
    }

    pub(super) fn failed(&self, reason: impl ToString) -> DeviceError {
        DeviceError::DeviceFailed { device: self.name.clone(), reason: reason.to_string() }
    }
}

/// Errors come from the driver at any time; the first is kept.
#[derive(Clone, Debug, Default)]
struct Failure(Arc<Mutex<Option<String>>>);

impl Failure {
    fn note(&self, reason: String) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(reason);
    }

    fn first(&self) -> Option<String> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}
