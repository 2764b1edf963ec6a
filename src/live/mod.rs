//! A node of ROS 2 over DDS, without ROS installed.
//!
//! What the robot's topics say is recorded as it comes, as a bag that is read while it grows: a live drive is one more log
//! ([`Node::subscribe`], [`McapLog::of_stream`](crate::io::mcap::McapLog::of_stream)). [`LiveMapping`] and [`LiveLocalization`] are
//! [`Slam`](crate::slam::Slam) and [`Localization`](crate::localization::Localization) that publish what they report.
//! Topics, types and frames are in `docs/live.md`.
//!
//! The correction of the odometry, `map -> odom`, is published by the thread that receives messages, at every scan and every
//! odometry message with its stamp, so that others have it while the filter is busy; it is that of the last reading that the filter
//! took in. Scans are dropped where the filter is ten seconds behind.

mod input;
mod localizing;
mod mapping;
mod messages;
mod node;
mod publisher;

pub use input::{Shared, State};
pub use localizing::LiveLocalization;
pub use mapping::{LiveMapping, Save};
pub use node::{LiveError, Names, Network, Node};
