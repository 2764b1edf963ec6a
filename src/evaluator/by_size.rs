//! A device for many particles, the CPU for few.

use super::cpu::CpuEvaluator;
use super::pose::LocalPose;
use super::sighting::Sighting;
use super::{Advance, Evaluator, Propagation, Proposal, Scene, Weighed};
use crate::gpu::DeviceError;

/// Takes calls with at least [`MANY`] particles to a device, and the others to the CPU.
#[derive(Debug)]
pub struct BySize<E> {
    device: E,
    cpu: CpuEvaluator,
}

/// A call takes a device a millisecond or more, however few particles it has: the CPU is done sooner with fewer than this, which
/// also leave most of a device idle (benches/README.md).
pub const MANY: usize = 1024;

impl<E: Evaluator> BySize<E> {
    /// This device for many particles.
    pub fn new(device: E) -> Self {
        Self { device, cpu: CpuEvaluator }
    }

    fn of(&mut self, particles: usize) -> &mut dyn Evaluator {
        if particles < MANY { &mut self.cpu } else { &mut self.device }
    }
}

impl<E: Evaluator> Evaluator for BySize<E> {
    fn propagate(&mut self, scene: &Scene<'_>, how: &Propagation<'_>) -> Result<Vec<Proposal>, DeviceError> {
        self.of(how.particles()).propagate(scene, how)
    }

    fn weigh(&mut self, scene: &Scene<'_>, poses: &[LocalPose]) -> Result<Vec<f32>, DeviceError> {
        self.of(poses.len()).weigh(scene, poses)
    }

    fn advance(&mut self, scene: &Scene<'_>, how: &Advance, poses: &[LocalPose]) -> Result<Vec<Weighed>, DeviceError> {
        self.of(poses.len()).advance(scene, how, poses)
    }

    fn associate(&mut self, sighting: &Sighting<'_>, poses: &[LocalPose]) -> Result<Vec<f32>, DeviceError> {
        self.of(poses.len()).associate(sighting, poses)
    }
}
