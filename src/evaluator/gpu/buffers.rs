//! The buffers of the device. They grow by half where they have to, and never shrink.

use super::device::Opened;
use super::layout::{Job, Phase};
use crate::evaluator::EvaluatorError;
use bytemuck::Pod;
use std::marker::PhantomData;

/// Every buffer, named as in `shaders/shared/layout.wgsl`, and how kernels see them.
#[derive(Debug)]
pub struct Buffers {
    pub job: Grown,
    pub phase: Grown,
    pub tiles: Grown,
    pub clusters: Grown,
    pub slots: Grown,
    pub groups: Grown,
    pub poses: Grown,
    pub modes: Grown,
    pub candidates: Grown,
    pub bounds: Grown,
    pub read_poses: Grown,
    pub read_more: Grown,
    layout: wgpu::BindGroupLayout,
    bindings: wgpu::BindGroup,
}

/// One buffer.
#[derive(Debug)]
pub struct Grown {
    what: &'static str,
    usage: wgpu::BufferUsages,
    buffer: wgpu::Buffer,
    /// Whether it was made anew after it was bound.
    is_new: bool,
}

/// Every buffer has room for this \[bytes\]: an empty one cannot be bound.
const LEAST: u64 = 1024;

impl Grown {
    fn new(opened: &Opened, what: &'static str, usage: wgpu::BufferUsages, size: u64) -> Self {
        let usage = usage | wgpu::BufferUsages::COPY_DST;
        let descriptor = wgpu::BufferDescriptor { label: Some(what), size, usage, mapped_at_creation: false };
        Self { what, usage, buffer: opened.device.create_buffer(&descriptor), is_new: true }
    }

    /// Makes room for so many bytes. Where it has to grow for that, what it held is lost, and the answer is true.
    pub fn hold(&mut self, opened: &Opened, bytes: u64) -> Result<bool, EvaluatorError> {
        if bytes <= self.buffer.size() {
            return Ok(false);
        }
        let limits = &opened.limits;
        let is_bound = self.usage.contains(wgpu::BufferUsages::STORAGE);
        let bound = if is_bound { limits.max_storage_buffer_binding_size } else { u64::MAX };
        let largest = limits.max_buffer_size.min(bound) & !3;
        if bytes > largest {
            let device = opened.name.clone();
            return Err(EvaluatorError::TooLarge { device, what: self.what, needed: bytes, largest });
        }
        let roomy = (bytes + bytes / 2).next_multiple_of(4).min(largest);
        *self = Self::new(opened, self.what, self.usage, roomy);
        Ok(true)
    }

    /// Makes room for these, and uploads them.
    pub fn fill<T: Pod>(&mut self, opened: &Opened, items: &[T]) -> Result<(), EvaluatorError> {
        self.hold(opened, size_of_val(items) as u64)?;
        self.write(opened, 0, items);
        Ok(())
    }

    /// Uploads these to where the `first` of their kind lies.
    pub fn write<T: Pod>(&self, opened: &Opened, first: usize, items: &[T]) {
        self.write_at(opened, (first * size_of::<T>()) as u64, items);
    }

    fn write_at<T: Pod>(&self, opened: &Opened, offset: u64, items: &[T]) {
        if !items.is_empty() {
            opened.queue.write_buffer(&self.buffer, offset, bytemuck::cast_slice(items));
        }
    }

    /// Has the first items of another buffer copied into this one, to be read after the submission.
    pub fn copy<T: Pod>(
        &mut self,
        opened: &Opened,
        encoder: &mut wgpu::CommandEncoder,
        from: &Grown,
        count: usize,
    ) -> Result<Copied<T>, EvaluatorError> {
        let bytes = (count * size_of::<T>()) as u64;
        self.hold(opened, bytes)?;
        if bytes > 0 {
            encoder.copy_buffer_to_buffer(&from.buffer, 0, &self.buffer, 0, bytes);
        }
        Ok(Copied { buffer: self.buffer.clone(), bytes, items: PhantomData })
    }
}

/// Items on their way back from the device.
pub struct Copied<T> {
    buffer: wgpu::Buffer,
    bytes: u64,
    items: PhantomData<T>,
}

impl<T: Pod> Copied<T> {
    /// Waits for the submission and hands them over.
    pub fn read(self, opened: &Opened) -> Result<Vec<T>, EvaluatorError> {
        if self.bytes == 0 {
            return Ok(Vec::new());
        }
        let (tell, told) = std::sync::mpsc::channel();
        self.buffer.map_async(wgpu::MapMode::Read, ..self.bytes, move |mapped| {
            // Whoever no longer listens has failed already.
            let _ = tell.send(mapped);
        });
        opened.device.poll(wgpu::PollType::wait_indefinitely()).map_err(|error| opened.failed(error))?;
        opened.check()?;
        match told.try_recv() {
            Ok(Ok(())) => {}
            Ok(Err(error)) => return Err(opened.failed(error)),
            Err(_) => return Err(opened.failed("it did not answer")),
        }
        let view = self.buffer.get_mapped_range(..self.bytes).map_err(|error| opened.failed(error))?;
        let items = bytemuck::pod_collect_to_vec(&view);
        drop(view);
        self.buffer.unmap();
        Ok(items)
    }
}

impl Buffers {
    pub fn new(opened: &Opened) -> Self {
        use wgpu::BufferUsages as Usage;
        let make = |what, usage| Grown::new(opened, what, usage, LEAST);
        let layout = layout(opened);
        let phase = Grown::new(opened, "the phases", Usage::UNIFORM, u64::from(Phase::COUNT * phase_stride(opened)));
        for each in [[false, false], [false, true], [true, false], [true, true]].map(|[a, b]| Phase::new(a, b)) {
            phase.write_at(opened, u64::from(phase_offset(opened, each)), &[each]);
        }
        let job = make("the step", Usage::UNIFORM);
        let tiles = make("the points of the scan", Usage::STORAGE);
        let clusters = make("the clusters", Usage::STORAGE);
        let slots = make("the maps", Usage::STORAGE);
        let groups = make("the groups of particles", Usage::STORAGE);
        let poses = make("the poses", Usage::STORAGE | Usage::COPY_SRC);
        let modes = make("the modes", Usage::STORAGE | Usage::COPY_SRC);
        let candidates = make("the candidate lists", Usage::STORAGE | Usage::COPY_SRC);
        let bounds = make("the bounds of the groups", Usage::STORAGE);
        let storage = [&tiles, &clusters, &slots, &groups, &poses, &modes, &candidates, &bounds];
        let bindings = bind(opened, &layout, &job, &phase, storage);
        let (read_poses, read_more) =
            (make("the poses to read", Usage::MAP_READ), make("what else is read", Usage::MAP_READ));
        Self {
            job,
            phase,
            tiles,
            clusters,
            slots,
            groups,
            poses,
            modes,
            candidates,
            bounds,
            read_poses,
            read_more,
            layout,
            bindings,
        }
    }

    /// How kernels see the buffers.
    pub fn layout(&self) -> &wgpu::BindGroupLayout {
        &self.layout
    }

    /// The buffers as they are now.
    pub fn bindings(&mut self, opened: &Opened) -> &wgpu::BindGroup {
        let Self { tiles, clusters, slots, groups, poses, modes, candidates, bounds, .. } = self;
        let mut storage = [tiles, clusters, slots, groups, poses, modes, candidates, bounds];
        if storage.iter().any(|buffer| buffer.is_new) {
            storage.iter_mut().for_each(|buffer| buffer.is_new = false);
            self.bindings = bind(opened, &self.layout, &self.job, &self.phase, storage.map(|buffer| &*buffer));
        }
        &self.bindings
    }
}

/// Where a phase lies in its buffer.
pub fn phase_offset(opened: &Opened, phase: Phase) -> u32 {
    phase.number() * phase_stride(opened)
}

fn phase_stride(opened: &Opened) -> u32 {
    opened.limits.min_uniform_buffer_offset_alignment
}

/// Two uniforms, the second at an offset of its own for each dispatch, then what the kernels read alone, then what they
/// write.
fn layout(opened: &Opened) -> wgpu::BindGroupLayout {
    let entries = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9].map(|binding| wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::COMPUTE,
        ty: wgpu::BindingType::Buffer {
            ty: match binding {
                0 | 1 => wgpu::BufferBindingType::Uniform,
                _ => wgpu::BufferBindingType::Storage { read_only: binding < 6 },
            },
            has_dynamic_offset: binding == 1,
            min_binding_size: None,
        },
        count: None,
    });
    opened.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: None, entries: &entries })
}

fn bind(
    opened: &Opened,
    layout: &wgpu::BindGroupLayout,
    job: &Grown,
    phase: &Grown,
    storage: [&Grown; 8],
) -> wgpu::BindGroup {
    let whole = |grown: &Grown| (grown.buffer.clone(), None);
    let part = |grown: &Grown, size: usize| (grown.buffer.clone(), wgpu::BufferSize::new(size as u64));
    let uniforms = [part(job, size_of::<Job>()), part(phase, size_of::<Phase>())];
    let bound: Vec<(wgpu::Buffer, Option<wgpu::BufferSize>)> = uniforms.into_iter().chain(storage.map(whole)).collect();
    let entries: Vec<wgpu::BindGroupEntry<'_>> = (0..)
        .zip(&bound)
        .map(|(binding, (buffer, size))| wgpu::BindGroupEntry {
            binding,
            resource: wgpu::BindingResource::Buffer(wgpu::BufferBinding { buffer, offset: 0, size: *size }),
        })
        .collect();
    opened.device.create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout, entries: &entries })
}
