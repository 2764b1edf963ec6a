//! Kernels, what they see, and one submission of several of them.

use super::DeviceError;
use super::buffers::{Buffer, Readback, Usage};
use super::device::Device;
use bytemuck::Pod;
use std::marker::PhantomData;

/// How kernels see buffers: those of a bind group, in the order of their bindings.
#[derive(Debug)]
pub struct Bindings {
    layout: wgpu::BindGroupLayout,
    group: wgpu::BindGroup,
}

/// A buffer at its binding.
pub struct Bound<'a> {
    /// The buffer.
    pub buffer: &'a mut Buffer,
    /// Of a uniform, the bytes that a kernel sees.
    pub size: Option<u64>,
    /// Whether each dispatch of a submission sees another part of it.
    pub is_dynamic: bool,
}

impl<'a> Bound<'a> {
    /// A whole buffer.
    pub fn whole(buffer: &'a mut Buffer) -> Self {
        Self { buffer, size: None, is_dynamic: false }
    }
}

impl Bindings {
    /// These buffers, in this order.
    pub fn new(device: &Device, bound: &[Bound<'_>]) -> Self {
        let entry = |(binding, bound): (u32, &Bound<'_>)| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::COMPUTE,
            ty: wgpu::BindingType::Buffer {
                ty: match bound.buffer.usage {
                    Usage::Uniform => wgpu::BufferBindingType::Uniform,
                    usage => wgpu::BufferBindingType::Storage { read_only: usage == Usage::Input },
                },
                has_dynamic_offset: bound.is_dynamic,
                min_binding_size: None,
            },
            count: None,
        };
        let entries: Vec<_> = (0..).zip(bound).map(entry).collect();
        let descriptor = wgpu::BindGroupLayoutDescriptor { label: None, entries: &entries };
        let layout = device.device.create_bind_group_layout(&descriptor);
        let group = bind(device, &layout, bound);
        Self { layout, group }
    }

    /// The same buffers again, where one of them has been made anew since.
    pub fn update(&mut self, device: &Device, bound: &mut [Bound<'_>]) {
        if bound.iter().any(|bound| bound.buffer.is_new) {
            bound.iter_mut().for_each(|bound| bound.buffer.is_new = false);
            self.group = bind(device, &self.layout, bound);
        }
    }
}

fn bind(device: &Device, layout: &wgpu::BindGroupLayout, bound: &[Bound<'_>]) -> wgpu::BindGroup {
    fn entry<'b>((binding, bound): (u32, &'b Bound<'_>)) -> wgpu::BindGroupEntry<'b> {
        let size = bound.size.and_then(wgpu::BufferSize::new);
        let part = wgpu::BufferBinding { buffer: &bound.buffer.buffer, offset: 0, size };
        wgpu::BindGroupEntry { binding, resource: wgpu::BindingResource::Buffer(part) }
    }
    let entries: Vec<_> = (0..).zip(bound).map(entry).collect();
    device.device.create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout, entries: &entries })
}

/// A kernel, ready to run.
#[derive(Debug)]
pub struct Pipeline(wgpu::ComputePipeline);

impl Pipeline {
    /// Makes a kernel of a WGSL text ready.
    pub fn new(device: &Device, bindings: &Bindings, entry_point: &str, source: String) -> Self {
        let [pipeline] = Self::all(device, bindings, entry_point, source, [&[]]);
        pipeline
    }

    /// Makes a kernel of a WGSL text ready, once for each value of an override constant of it.
    pub fn with_constants<const N: usize>(
        device: &Device,
        bindings: &Bindings,
        entry_point: &str,
        source: String,
        constant: &str,
        values: [f64; N],
    ) -> [Self; N] {
        let constants = values.map(|value| [(constant, value)]);
        Self::all(device, bindings, entry_point, source, constants.each_ref().map(|of_one| &of_one[..]))
    }

    fn all<const N: usize>(
        device: &Device,
        bindings: &Bindings,
        entry_point: &str,
        source: String,
        constants: [&[(&str, f64)]; N],
    ) -> [Self; N] {
        let layout = device.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: None,
            bind_group_layouts: &[Some(&bindings.layout)],
            immediate_size: 0,
        });
        let label = Some(entry_point);
        let source = wgpu::ShaderSource::Wgsl(source.into());
        let module = device.device.create_shader_module(wgpu::ShaderModuleDescriptor { label, source });
        constants.map(|constants| {
            let descriptor = wgpu::ComputePipelineDescriptor {
                label,
                layout: Some(&layout),
                module: &module,
                entry_point: label,
                compilation_options: wgpu::PipelineCompilationOptions {
                    constants,
                    // Every lane writes its own place before others read it.
                    zero_initialize_workgroup_memory: false,
                },
                cache: None,
            };
            Self(device.device.create_compute_pipeline(&descriptor))
        })
    }
}

/// Work that is given to a device in one go.
pub struct Submission<'a> {
    device: &'a Device,
    encoder: wgpu::CommandEncoder,
}

impl<'a> Submission<'a> {
    /// No work yet.
    pub fn new(device: &'a Device) -> Self {
        let encoder = device.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        Self { device, encoder }
    }

    /// Appends kernels, one after the other, on `workgroups` workgroups; each with the offset of its dynamic binding \[bytes\].
    pub fn dispatch<'p>(
        &mut self,
        bindings: &Bindings,
        workgroups: usize,
        kernels: impl IntoIterator<Item = (&'p Pipeline, u32)>,
    ) {
        let mut pass = self.encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        for (Pipeline(pipeline), offset) in kernels {
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, &bindings.group, &[offset]);
            pass.dispatch_workgroups(workgroups as u32, 1, 1);
        }
    }

    /// Has the first items of a buffer copied, to be read after the submission.
    ///
    /// # Errors
    /// The device cannot hold as much.
    pub fn copy<T: Pod>(&mut self, from: &Buffer, to: &mut Buffer, count: usize) -> Result<Readback<T>, DeviceError> {
        let bytes = (count * size_of::<T>()) as u64;
        to.hold(self.device, bytes)?;
        if bytes > 0 {
            self.encoder.copy_buffer_to_buffer(&from.buffer, 0, &to.buffer, 0, bytes);
        }
        Ok(Readback { buffer: to.buffer.clone(), bytes, items: PhantomData })
    }

    /// Gives it to the device.
    pub fn submit(self) {
        self.device.queue.submit([self.encoder.finish()]);
    }
}
