//! Records how objects were mapped: a file for the viewer, from which the mapping can be repeated.
//!
//! Mapping looks at all frames again and again, so it is recorded when it is done. On the timeline `step` it happens once
//! more: a step a keyframe of the forward pass, a step a sweep, and at last the result. On the timeline `frame` the result
//! tells of each keyframe what the robot saw there, and which landmarks that shows.
//!
//! | Path | What | When |
//! |---|---|---|
//! | [`ROBOT`] | pose of the best hypothesis, an arrow | steps of the forward pass |
//! | [`HYPOTHESES`] | positions of all hypotheses, brighter where they are likelier | steps of the forward pass |
//! | [`SEEN`] | the detections, in the colour of their label, as the best hypothesis saw them | steps of the forward pass |
//! | [`TRAJECTORY`], [`LANDMARKS`] | path and map, in the colour of their class | every sweep, and the result |
//! | [`ELLIPSES`] | what holds each landmark with 95 % | the result |
//! | [`WEIGHTS`] | all weights: a line from each detection to each landmark, the brighter the larger its weight | the result |
//! | [`ODOMETRY`] | the path by odometry alone | always |
//! | [`FRAME_ROBOT`], [`FRAME_SEEN`], [`FRAME_WEIGHTS`] | robot, detections and weights of the keyframe | frames |
//! | [`HYPOTHESIS_COUNT`] | how many hypotheses there are | steps of the forward pass |
//! | [`OBJECTIVE`], [`LANDMARK_COUNT`] | the objective \[nats\], and how many landmarks there are | every sweep, and the result |
//! | [`ABOUT`](super::blueprint::ABOUT) | TOML: version, recording, device, configuration | always |
//! | [`SENSORS`] | `sensors.toml` of the recording | always |
//! | [`SPEEDS`], [`ODOMETRY_READING`](super::blueprint::ODOMETRY_READING) | odometry: forward, turn, stamp; or x, y, heading, stamp | every row |
//! | [`DETECTIONS`] | stamp; class, score, range, bearing of each detection | every frame |
//! | [`IDS`] | of each detection the object, NaN where nobody knows | every frame, if they were known |
//! | [`CHECKSUM`](super::blueprint::CHECKSUM) | that of the step | every step |
//! | [`POSE`](super::blueprint::POSE) | x, y, heading and stamp, as f64 | every keyframe, by `frame` |
//! | [`RESULT`](super::blueprint::RESULT) | checksum, landmarks, objective | the result |

pub use layout::{
    DETECTIONS, ELLIPSES, FRAME_ROBOT, FRAME_SEEN, FRAME_TIMELINE, FRAME_WEIGHTS, HYPOTHESES, HYPOTHESIS_COUNT, IDS,
    LANDMARK_COUNT, LANDMARKS, OBJECTIVE, ODOMETRY, ROBOT, SEEN, SENSORS, SPEEDS, TRAJECTORY, WEIGHTS,
};
pub use read::{MappingResult, RecordedMapping};
pub use write::{Mapping, record, record_beside};

mod layout;
mod read;
mod write;
