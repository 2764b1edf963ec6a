//! Keyframes: the times at which the robot's pose is estimated.

use crate::detections::{Detection, Motion, Recording};
use nalgebra::Vector3;

/// The longest time between two keyframes \[s\]. Where nothing is seen for longer, keyframes without detections are inserted:
/// the calibration of odometry takes each motion for an arc, which a long one is not.
const LONGEST_GAP: f64 = 1.0;

/// A time at which the pose is estimated.
#[derive(Clone, Debug)]
pub struct Keyframe {
    /// Seconds.
    pub stamp: f64,
    /// Number of the frame in the recording; `None` if nothing was seen.
    pub frame: Option<usize>,
    /// The detections in view, with their numbers in the frame.
    pub seen: Vec<(usize, Detection)>,
    /// The motion since the keyframe before.
    pub motion: Motion,
    /// log of that motion: forward, sideways \[m\], turn \[rad\].
    pub twist: Vector3<f64>,
}

/// Keyframes: the frames with detections in view that are at least `interval` \[s\] apart, and times between them.
/// Detections that are not `wanted`, by frame and number, are left out.
pub fn keyframes(recording: &Recording, interval: f64, wanted: impl Fn(usize, usize) -> bool) -> Vec<Keyframe> {
    let view = recording.sensors.view;
    let mut keyframes: Vec<Keyframe> = Vec::new();
    for (number, frame) in recording.frames.iter().enumerate() {
        let seen = frame.in_view(view).filter(|(detection, _)| wanted(number, *detection));
        let seen: Vec<_> = seen.map(|(detection, seen)| (detection, *seen)).collect();
        let last = keyframes.last().map(|last| last.stamp);
        // Stamps are decimal fractions, whose differences are off by their rounding.
        if seen.is_empty() || last.is_some_and(|last| frame.stamp - last < interval - 1e-6) {
            continue;
        }
        let from = last.unwrap_or(frame.stamp);
        let parts = ((frame.stamp - from) / LONGEST_GAP).ceil().max(1.0) as usize;
        for part in 1..parts {
            let stamp = from + (frame.stamp - from) * part as f64 / parts as f64;
            push(&mut keyframes, recording, stamp, None, Vec::new());
        }
        push(&mut keyframes, recording, frame.stamp, Some(number), seen);
    }
    keyframes
}

fn push(
    keyframes: &mut Vec<Keyframe>,
    recording: &Recording,
    stamp: f64,
    frame: Option<usize>,
    seen: Vec<(usize, Detection)>,
) {
    let from = keyframes.last().map_or(stamp, |last| last.stamp);
    let motion = recording.odometry.motion(from, stamp);
    keyframes.push(Keyframe { stamp, frame, seen, motion, twist: motion.start_from_end.log() });
}
