//! Records how objects were mapped: a file for the viewer, from which the mapping can be repeated.
//!
//! Mapping processes all frames repeatedly, so it is recorded when it is finished. The timeline `step` repeats its course: one step for
//! each keyframe of the forward pass, one for each sweep, and one for the result. The timeline `frame` shows the result at each
//! keyframe: the detections made there, and their weights on landmarks. A map of space is drawn from above.
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
//! | [`CAMERA_SEEN`], [`CAMERA_LANDMARKS`], [`CAMERA_WEIGHTS`] | of space: detections in the picture \[pixels\], where landmarks would be seen, and the weights between them | frames |
//! | [`HYPOTHESIS_COUNT`] | how many hypotheses there are | steps of the forward pass |
//! | [`OBJECTIVE`], [`LANDMARK_COUNT`] | the objective \[nats\], and how many landmarks there are | every sweep, and the result |
//! | [`ABOUT`](super::blueprint::ABOUT) | TOML: version, recording, device, configuration | always |
//! | [`SENSORS`] | `sensors.toml` of the recording | always |
//! | [`SPEEDS`], [`ODOMETRY_READING`](super::blueprint::ODOMETRY_READING) | odometry: forward, turn, stamp; or x, y, heading, stamp; of space three speeds, three rates, stamp; or position, quaternion (x, y, z, w), stamp | every row |
//! | [`DETECTIONS`] | stamp; class, score, range, bearing of each detection; of space class, score, u, v, disparity | every frame |
//! | [`IDS`] | of each detection the object, NaN where it is unknown | every frame, if they were known |
//! | [`CHECKSUM`](super::blueprint::CHECKSUM) | that of the step | every step |
//! | [`POSE`](super::blueprint::POSE) | x, y, heading and stamp, as f64; of space position, quaternion and stamp | every keyframe, by `frame` |
//! | [`RESULT`](super::blueprint::RESULT) | checksum, landmarks, objective | the result |

pub use blueprint::{
    CAMERA_LANDMARKS, CAMERA_SEEN, CAMERA_WEIGHTS, DETECTIONS, ELLIPSES, FRAME_ROBOT, FRAME_SEEN, FRAME_TIMELINE,
    FRAME_WEIGHTS, HYPOTHESES, HYPOTHESIS_COUNT, IDS, LANDMARK_COUNT, LANDMARKS, OBJECTIVE, ODOMETRY, ROBOT, SEEN,
    SENSORS, SPEEDS, TRAJECTORY, WEIGHTS,
};
pub use read::{MappingResult, RecordedMapping, kind};
pub use worlds::Recorded;
pub use write::{Mapping, record, record_beside};

mod blueprint;
mod read;
mod worlds;
mod write;
