//! Keyframes: the times at which the robot's pose is estimated.

use super::world::World;
use crate::detections::Motion;

/// The longest time between two keyframes \[s\]. Where nothing is seen for longer, keyframes without detections are inserted:
/// the calibration of odometry takes each motion for an arc, which a long one is not.
const LONGEST_GAP: f64 = 1.0;

/// A time at which the pose is estimated.
#[derive(Clone, Debug)]
pub struct Keyframe<W: World> {
    /// Seconds.
    pub stamp: f64,
    /// Number of the frame in the recording; `None` if nothing was seen.
    pub frame: Option<usize>,
    /// What was seen in view, with the number in the frame.
    pub seen: Vec<(usize, W::Detection)>,
    /// The motion since the keyframe before.
    pub motion: Motion<W::Pose>,
}

/// Keyframes: the frames with detections in view that are at least `interval` \[s\] apart, and times between them.
/// Detections that are not `wanted`, by frame and number, are left out.
pub fn keyframes<W: World>(
    recording: &W::Recording,
    interval: f64,
    wanted: impl Fn(usize, usize) -> bool,
) -> Vec<Keyframe<W>> {
    let mut keyframes: Vec<Keyframe<W>> = Vec::new();
    for (number, (stamp_of_frame, mut seen)) in W::frames(recording).into_iter().enumerate() {
        seen.retain(|(detection, _)| wanted(number, *detection));
        let last = keyframes.last().map(|last| last.stamp);
        // Stamps are decimal fractions, whose differences are off by their rounding.
        if seen.is_empty() || last.is_some_and(|last| stamp_of_frame - last < interval - 1e-6) {
            continue;
        }
        let from = last.unwrap_or(stamp_of_frame);
        let parts = ((stamp_of_frame - from) / LONGEST_GAP).ceil().max(1.0) as usize;
        for part in 1..parts {
            let stamp = from + (stamp_of_frame - from) * part as f64 / parts as f64;
            push(&mut keyframes, recording, stamp, None, Vec::new());
        }
        push(&mut keyframes, recording, stamp_of_frame, Some(number), seen);
    }
    keyframes
}

fn push<W: World>(
    keyframes: &mut Vec<Keyframe<W>>,
    recording: &W::Recording,
    stamp: f64,
    frame: Option<usize>,
    seen: Vec<(usize, W::Detection)>,
) {
    let from = keyframes.last().map_or(stamp, |last| last.stamp);
    keyframes.push(Keyframe { stamp, frame, seen, motion: W::motion(recording, from, stamp) });
}
