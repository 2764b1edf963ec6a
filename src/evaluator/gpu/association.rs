//! Association on a GPU: its kernel, with buffers of its own. They are made when the first frame of detections comes.

use super::super::pose::LocalPose;
use super::super::sighting::{SECTORS, Sighting};
use crate::gpu::DeviceError;
use crate::gpu::buffers::{Buffer, Usage};
use crate::gpu::device::Device;
use crate::gpu::submission::{Bindings, Bound, Pipeline, Submission};
use bytemuck::{Pod, Zeroable};

/// What is the same for all particles.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct AssociationJob {
    /// Where the detector is, in the robot's frame.
    pub sensor: [f32; 2],
    /// The nearest that it sees.
    pub min_range: f32,
    /// Detections.
    pub seen_count: u32,
    /// The farthest that it sees in each sector.
    pub max_ranges: [f32; SECTORS],
}

/// The kernel `associate`, ready to run.
#[derive(Debug)]
pub struct Association {
    pipeline: Pipeline,
    bindings: Bindings,
    buffers: AssociationBuffers,
    read: Buffer,
}

/// Named as in `shaders/associate.wgsl`.
#[derive(Debug)]
struct AssociationBuffers {
    job: Buffer,
    seen: Buffer,
    landmarks: Buffer,
    spans: Buffer,
    particles: Buffer,
}

impl AssociationBuffers {
    fn bound(&mut self) -> [Bound<'_>; 5] {
        let Self { job, seen, landmarks, spans, particles } = self;
        [
            Bound { buffer: job, size: Some(size_of::<AssociationJob>() as u64), is_dynamic: true },
            Bound::whole(seen),
            Bound::whole(landmarks),
            Bound::whole(spans),
            Bound::whole(particles),
        ]
    }
}

impl Association {
    /// The whole text of the kernel.
    pub fn source() -> String {
        [include_str!("../../../shaders/shared/math.wgsl"), include_str!("../../../shaders/associate.wgsl")].join("\n")
    }

    pub(super) fn new(device: &Device) -> Result<Self, DeviceError> {
        let mut buffers = AssociationBuffers {
            job: Buffer::new(device, "the frame", Usage::Uniform),
            seen: Buffer::new(device, "the detections", Usage::Input),
            landmarks: Buffer::new(device, "the landmarks", Usage::Input),
            spans: Buffer::new(device, "the landmarks of each map", Usage::Input),
            particles: Buffer::new(device, "the particles", Usage::Output),
        };
        let bindings = Bindings::new(device, &buffers.bound());
        let pipeline = Pipeline::new(device, &bindings, "associate", Self::source());
        device.check()?;
        let read = Buffer::new(device, "the log-likelihoods", Usage::Readback);
        Ok(Self { pipeline, bindings, buffers, read })
    }

    /// As [`Evaluator::associate`](super::super::Evaluator::associate).
    pub(super) fn associate(
        &mut self,
        device: &Device,
        sighting: &Sighting<'_>,
        poses: &[LocalPose],
    ) -> Result<Vec<f32>, DeviceError> {
        let Self { pipeline, bindings, buffers, read } = self;
        let Sighting { seen, horizon, landmarks } = sighting;
        let job = AssociationJob {
            sensor: horizon.sensor,
            min_range: horizon.min_range,
            seen_count: seen.len() as u32,
            max_ranges: horizon.max_ranges,
        };
        buffers.job.write(device, 0, &[job]);
        buffers.seen.fill(device, seen)?;
        buffers.landmarks.fill(device, &landmarks.concat())?;
        let mut first = 0;
        let spans = landmarks.iter().map(|rows| {
            let span = [first, rows.len() as u32];
            first += span[1];
            span
        });
        let spans: Vec<[u32; 2]> = spans.collect();
        let poses_per_map = (poses.len() / landmarks.len().max(1)).max(1);
        let spans: Vec<[u32; 2]> = (0..poses.len()).map(|number| spans[number / poses_per_map]).collect();
        let mut log_likelihoods = Vec::with_capacity(poses.len());
        let at_once = device.most_workgroups();
        for (poses, spans) in poses.chunks(at_once).zip(spans.chunks(at_once)) {
            let particles: Vec<[f32; 4]> = poses.iter().map(|pose| [pose.x, pose.y, pose.heading, f32::NAN]).collect();
            buffers.spans.fill(device, spans)?;
            buffers.particles.fill(device, &particles)?;
            bindings.update(device, &mut buffers.bound());
            let mut submission = Submission::new(device);
            submission.dispatch(bindings, poses.len(), [(&*pipeline, 0)]);
            let copied = submission.copy::<[f32; 4]>(&buffers.particles, read, poses.len())?;
            submission.submit();
            log_likelihoods.extend(copied.read(device)?.into_iter().map(|[.., log_likelihood]| log_likelihood));
            device.check()?;
        }
        Ok(log_likelihoods)
    }
}
