//! The buffers of the kernels, named as in `shaders/shared/layout.wgsl`.

use super::layout::{Job, Phase};
use crate::gpu::DeviceError;
use crate::gpu::buffers::{Buffer, Usage};
use crate::gpu::device::Device;
use crate::gpu::submission::Bound;

/// Every buffer that kernels see.
#[derive(Debug)]
pub struct Buffers {
    pub job: Buffer,
    pub phase: Buffer,
    pub tiles: Buffer,
    pub clusters: Buffer,
    pub slots: Buffer,
    pub groups: Buffer,
    pub poses: Buffer,
    pub modes: Buffer,
    pub candidates: Buffer,
    pub bounds: Buffer,
}

impl Buffers {
    pub fn new(device: &Device) -> Result<Self, DeviceError> {
        let mut phase = Buffer::new(device, "the phases", Usage::Uniform);
        phase.hold(device, u64::from(Phase::COUNT * device.uniform_stride()))?;
        for each in [[false, false], [false, true], [true, false], [true, true]].map(|[a, b]| Phase::new(a, b)) {
            phase.write_at(device, u64::from(phase_offset(device, each)), &[each]);
        }
        Ok(Self {
            job: Buffer::new(device, "the step", Usage::Uniform),
            phase,
            tiles: Buffer::new(device, "the points of the scan", Usage::Input),
            clusters: Buffer::new(device, "the clusters", Usage::Input),
            slots: Buffer::new(device, "the maps", Usage::Input),
            groups: Buffer::new(device, "the groups of particles", Usage::Input),
            poses: Buffer::new(device, "the poses", Usage::Output),
            modes: Buffer::new(device, "the modes", Usage::Output),
            candidates: Buffer::new(device, "the candidate lists", Usage::Output),
            bounds: Buffer::new(device, "the bounds of the groups", Usage::Output),
        })
    }

    /// The buffers at their bindings: two uniforms, the second at an offset of its own for each dispatch, then what kernels
    /// read alone, then what they write.
    pub fn bound(&mut self) -> [Bound<'_>; 10] {
        let Self { job, phase, tiles, clusters, slots, groups, poses, modes, candidates, bounds } = self;
        [
            Bound { buffer: job, size: Some(size_of::<Job>() as u64), is_dynamic: false },
            Bound { buffer: phase, size: Some(size_of::<Phase>() as u64), is_dynamic: true },
            Bound::whole(tiles),
            Bound::whole(clusters),
            Bound::whole(slots),
            Bound::whole(groups),
            Bound::whole(poses),
            Bound::whole(modes),
            Bound::whole(candidates),
            Bound::whole(bounds),
        ]
    }
}

/// Where a phase lies in its buffer \[bytes\].
pub fn phase_offset(device: &Device, phase: Phase) -> u32 {
    phase.number() * device.uniform_stride()
}
