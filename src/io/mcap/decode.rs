//! Messages from their bytes: those of ROS 2 (CDR, of either byte order) and of ROS 1.

use super::records::{Channel, Fields};
use super::ros1::Ros1;
use re_cdr::{BigEndian, LittleEndian, from_bytes};
use serde::de::DeserializeOwned;

impl Channel {
    /// Whether its messages are encoded in a way that is understood: as by ROS 2, or as by ROS 1.
    pub(super) fn is_understood(&self) -> bool {
        ["cdr", "ros1"].contains(&&*self.encoding)
    }
}

/// Reads a message; `Err` holds what is wrong with it.
pub(super) fn decode<T: DeserializeOwned + Ros1>(channel: &Channel, data: &[u8]) -> Result<T, String> {
    match &*channel.encoding {
        "ros1" => T::read(&mut Fields(data)).ok_or_else(|| {
            "it is shorter than its fields, of which ROS 1 has one more in a header (seq): was it written with the types of ROS 2?"
                .to_owned()
        }),
        _ => from_cdr(data),
    }
}

fn from_cdr<T: DeserializeOwned>(data: &[u8]) -> Result<T, String> {
    let decoded = match data {
        [0, 0, _, _, fields @ ..] => from_bytes::<T, BigEndian>(fields),
        [0, 1, _, _, fields @ ..] => from_bytes::<T, LittleEndian>(fields),
        _ => {
            let begin = &data[..data.len().min(4)];
            return Err(format!(
                "it is not plain CDR, as it begins with {begin:02x?} (was each message compressed? `ros2 bag convert` \
                 undoes that)"
            ));
        }
    };
    decoded.map(|(message, _)| message).map_err(|error| error.to_string())
}
