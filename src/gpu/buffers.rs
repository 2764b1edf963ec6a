//! Buffers of a device. They grow by half where they have to, and never shrink.

use super::DeviceError;
use super::device::Device;
use super::waiting::{answered, wake};
use bytemuck::Pod;
use std::marker::PhantomData;

/// What a buffer is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Usage {
    /// A few numbers that all lanes read.
    Uniform,
    /// What kernels read.
    Input,
    /// What kernels write, and what may be copied from there.
    Output,
    /// Where outputs are copied to, for the host to read.
    Readback,
}

/// One buffer.
#[derive(Debug)]
pub struct Buffer {
    what: &'static str,
    pub(super) usage: Usage,
    pub(super) buffer: wgpu::Buffer,
    /// Whether it was made anew after it was bound.
    pub(super) is_new: bool,
}

/// Every buffer has room for this \[bytes\]: an empty one cannot be bound.
const LEAST: u64 = 1024;

impl Buffer {
    /// An empty buffer; `what` names it in errors.
    pub fn new(device: &Device, what: &'static str, usage: Usage) -> Self {
        Self::with_size(device, what, usage, LEAST)
    }

    fn with_size(device: &Device, what: &'static str, usage: Usage, size: u64) -> Self {
        let flags = match usage {
            Usage::Uniform => wgpu::BufferUsages::UNIFORM,
            Usage::Input => wgpu::BufferUsages::STORAGE,
            Usage::Output => wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC,
            Usage::Readback => wgpu::BufferUsages::MAP_READ,
        };
        let descriptor = wgpu::BufferDescriptor {
            label: Some(what),
            size,
            usage: flags | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        };
        Self { what, usage, buffer: device.device.create_buffer(&descriptor), is_new: true }
    }

    /// Makes room for `bytes`. Returns true where the buffer had to grow, which loses its contents.
    ///
    /// # Errors
    /// The device cannot hold as much.
    pub fn hold(&mut self, device: &Device, bytes: u64) -> Result<bool, DeviceError> {
        if bytes <= self.buffer.size() {
            return Ok(false);
        }
        let limits = &device.limits;
        let is_bound = matches!(self.usage, Usage::Input | Usage::Output);
        let bound = if is_bound { limits.max_storage_buffer_binding_size } else { u64::MAX };
        let largest = limits.max_buffer_size.min(bound) & !3;
        if bytes > largest {
            let device = device.name.clone();
            return Err(DeviceError::TooLarge { device, what: self.what, needed: bytes, largest });
        }
        let roomy = (bytes + bytes / 2).next_multiple_of(4).min(largest);
        *self = Self::with_size(device, self.what, self.usage, roomy);
        Ok(true)
    }

    /// Makes room for these, and uploads them.
    ///
    /// # Errors
    /// The device cannot hold as much.
    pub fn fill<T: Pod>(&mut self, device: &Device, items: &[T]) -> Result<(), DeviceError> {
        self.hold(device, size_of_val(items) as u64)?;
        self.write(device, 0, items);
        Ok(())
    }

    /// Uploads these to where the `first` of their kind lies.
    pub fn write<T: Pod>(&self, device: &Device, first: usize, items: &[T]) {
        self.write_at(device, (first * size_of::<T>()) as u64, items);
    }

    /// Uploads these to an offset \[bytes\].
    pub fn write_at<T: Pod>(&self, device: &Device, offset: u64, items: &[T]) {
        if !items.is_empty() {
            device.queue.write_buffer(&self.buffer, offset, bytemuck::cast_slice(items));
        }
    }
}

/// Items on their way back from the device.
pub struct Readback<T> {
    pub(super) buffer: wgpu::Buffer,
    pub(super) bytes: u64,
    pub(super) items: PhantomData<T>,
}

impl<T: Pod> Readback<T> {
    /// Waits for the submission and hands them over.
    ///
    /// # Errors
    /// The device failed.
    pub fn read(self, device: &Device) -> Result<Vec<T>, DeviceError> {
        if self.bytes == 0 {
            return Ok(Vec::new());
        }
        let (sender, receiver) = std::sync::mpsc::channel();
        self.buffer.map_async(wgpu::MapMode::Read, ..self.bytes, move |mapped| {
            // Whoever no longer listens has failed already.
            let _ = sender.send(mapped);
            wake();
        });
        let mapped = answered(&device.device, &receiver).map_err(|error| device.failed(error))?;
        device.check()?;
        match mapped {
            Some(Ok(())) => {}
            Some(Err(error)) => return Err(device.failed(error)),
            None => return Err(device.failed("it did not answer")),
        }
        let view = self.buffer.get_mapped_range(..self.bytes).map_err(|error| device.failed(error))?;
        let items = bytemuck::pod_collect_to_vec(&view);
        drop(view);
        self.buffer.unmap();
        Ok(items)
    }
}
