//! Pictures: what a camera's pictures say about its way and about the objects around it, as the semantic system takes it.
//!
//! Section 3 of S. Bowman et al., "Probabilistic Data Association for Semantic SLAM", ICRA 2017: of each keyframe ORB features
//! ([`Orb`]), followed from keyframe to keyframe ([`Tracker`]) where two pictures agree on a motion ([`relative_pose`]), and the
//! objects that a detector names ([`Detector`]). By the tracks alone the camera's way follows, up to its scale
//! ([`VisualOdometry`]). [`FrontEnd`] makes of all that a recording of detections and odometry in space: the semantic system itself
//! sees no picture.

mod detector;
mod front_end;
mod matching;
mod odometry;
mod orb;
mod tracks;
mod two_view;

pub use detector::{Detector, DetectorError, ObjectBox};
pub use front_end::{FrontEnd, ImageError, Shown};
pub use matching::match_features;
pub use odometry::VisualOdometry;
pub use orb::{Descriptor, Orb, OrbFeature};
pub use tracks::{Keyframe, Tracker};
pub use two_view::{Pair, TwoView, relative_pose};
