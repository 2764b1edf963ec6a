//! A device that fails in the middle of a drive.

use ipslam::config::SlamConfig;
use ipslam::evaluator::by_size::{BySize, MANY};
use ipslam::evaluator::cpu::CpuEvaluator;
use ipslam::evaluator::pose::LocalPose;
use ipslam::evaluator::sighting::Sighting;
use ipslam::evaluator::{Advance, Evaluator, Propagation, Proposal, Scene, Weighed};
use ipslam::gpu::DeviceError;
use ipslam::log::LogSource;
use ipslam::report::Estimator as _;
use ipslam::simulate::Simulation;
use ipslam::slam::Slam;

/// Answers so many times, then no more: it fails, or panics as libraries do where a device is lost while they wait for it.
#[derive(Debug)]
struct Dying {
    answers: u32,
    panics: bool,
}

impl Dying {
    fn breathe(&mut self) -> Result<(), DeviceError> {
        let failure = || DeviceError::DeviceFailed { device: "Dying".to_owned(), reason: "it has died".to_owned() };
        match self.answers.checked_sub(1) {
            Some(left) => self.answers = left,
            None if self.panics => panic!("Dying: it has died"),
            None => return Err(failure()),
        }
        Ok(())
    }
}

impl Evaluator for Dying {
    fn propagate(&mut self, scene: &Scene<'_>, how: &Propagation<'_>) -> Result<Vec<Proposal>, DeviceError> {
        self.breathe()?;
        CpuEvaluator.propagate(scene, how)
    }

    fn weigh(&mut self, scene: &Scene<'_>, poses: &[LocalPose]) -> Result<Vec<f32>, DeviceError> {
        self.breathe()?;
        CpuEvaluator.weigh(scene, poses)
    }

    fn advance(&mut self, scene: &Scene<'_>, how: &Advance, poses: &[LocalPose]) -> Result<Vec<Weighed>, DeviceError> {
        self.breathe()?;
        CpuEvaluator.advance(scene, how, poses)
    }

    fn associate(&mut self, sighting: &Sighting<'_>, poses: &[LocalPose]) -> Result<Vec<f32>, DeviceError> {
        self.breathe()?;
        CpuEvaluator.associate(sighting, poses)
    }
}

/// The drive goes on to the same end, whichever call was the last one, and the failure is told.
#[test]
fn the_cpu_does_the_step_again() {
    let mut paper = SlamConfig { particles: 5, maps: 5, ..SlamConfig::paper() };
    (paper.tracking.step_distance, paper.tracking.step_turn) = (0.0, 0.0);
    for config in [SlamConfig { particles: 8, maps: 4, ..SlamConfig::default() }, paper] {
        let drive = |mut slam: Slam| {
            let entries = Simulation::building(1).open().unwrap().take(150);
            entries.for_each(|entry| slam.add(&entry.unwrap(), &mut |_| ()));
            (slam.evaluator_failure().map(ToString::to_string), slam.result().trajectory())
        };
        let (no_failure, expected) = drive(Slam::new(config));
        assert_eq!(no_failure, None);
        for (answers, panics) in [(0, false), (0, true), (1, false), (30, false), (30, true), (u32::MAX, false)] {
            let dying = Dying { answers, panics };
            let (failure, trajectory) = drive(Slam::with_evaluator(config, Box::new(dying)));
            assert_eq!(failure.is_none(), answers == u32::MAX, "after {answers} answers");
            assert!(failure.is_none_or(|failure| failure.contains("Dying") && failure.contains("it has died")));
            assert_eq!(trajectory, expected, "after {answers} answers");
        }
    }
}

/// A device that fails at once is not asked as long as there are few particles.
#[test]
fn a_device_is_for_many_particles() {
    for (particles, is_asked) in [(8, false), (MANY - 8, false), (MANY, true)] {
        let config = SlamConfig { particles, maps: 8, ..SlamConfig::default() };
        let dying = Dying { answers: 0, panics: false };
        let mut slam = Slam::with_evaluator(config, Box::new(BySize::new(dying)));
        let entries = Simulation::building(1).open().unwrap().take(30);
        entries.for_each(|entry| slam.add(&entry.unwrap(), &mut |_| ()));
        assert_eq!(slam.evaluator_failure().is_some(), is_asked, "{particles} particles");
    }
}
