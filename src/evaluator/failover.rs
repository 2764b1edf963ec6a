//! The CPU takes over where a device fails.

use super::pose::LocalPose;
use super::sighting::Sighting;
use super::{Advance, Evaluator, Propagation, Proposal, Scene, Weighed, cpu};
use crate::gpu::{DeviceError, guarded};

/// An evaluator that may fail, and the CPU from then on.
#[derive(Debug)]
pub struct Failover {
    preferred: Option<Box<dyn Evaluator>>,
    failure: Option<DeviceError>,
}

impl Failover {
    /// This evaluator as long as it answers; without one, the CPU from the start.
    pub fn new(preferred: Option<Box<dyn Evaluator>>) -> Self {
        Self { preferred, failure: None }
    }

    /// Why the CPU took over.
    pub fn failure(&self) -> Option<&DeviceError> {
        self.failure.as_ref()
    }

    /// As [`Evaluator::propagate`].
    pub fn propagate(&mut self, scene: &Scene<'_>, how: &Propagation<'_>) -> Vec<Proposal> {
        self.preferred(|evaluator| evaluator.propagate(scene, how)).unwrap_or_else(|| cpu::propagate_all(scene, how))
    }

    /// As [`Evaluator::weigh`].
    pub fn weigh(&mut self, scene: &Scene<'_>, poses: &[LocalPose]) -> Vec<f32> {
        self.preferred(|evaluator| evaluator.weigh(scene, poses)).unwrap_or_else(|| cpu::weigh_all(scene, poses))
    }

    /// As [`Evaluator::advance`].
    pub fn advance(&mut self, scene: &Scene<'_>, how: &Advance, poses: &[LocalPose]) -> Vec<Weighed> {
        self.preferred(|evaluator| evaluator.advance(scene, how, poses))
            .unwrap_or_else(|| cpu::advance_all(scene, how, poses))
    }

    /// As [`Evaluator::associate`].
    pub fn associate(&mut self, sighting: &Sighting<'_>, poses: &[LocalPose]) -> Vec<f32> {
        self.preferred(|evaluator| evaluator.associate(sighting, poses))
            .unwrap_or_else(|| cpu::associate_all(sighting, poses))
    }

    /// What the preferred evaluator answers, while there is one.
    fn preferred<T>(&mut self, ask: impl FnOnce(&mut dyn Evaluator) -> Result<T, DeviceError>) -> Option<T> {
        let evaluator = self.preferred.as_deref_mut()?;
        match guarded("in use", || ask(evaluator)) {
            Ok(answer) => Some(answer),
            Err(failure) => {
                // Taking down what is broken may wait for it, or panic: it stays where it is until the program ends.
                std::mem::forget(self.preferred.take());
                self.failure = Some(failure);
                None
            }
        }
    }
}
