//! The messages that are published, as ROS 2 defines them: CDR knows only the order of numbers and texts.

use crate::geometry;
use nalgebra::{Matrix3, Point2};
use serde::{Deserialize, Serialize};

/// `builtin_interfaces/msg/Time`
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct Time {
    sec: i32,
    nanosec: u32,
}

impl Time {
    /// Seconds.
    pub fn of(seconds: f64) -> Self {
        let whole = seconds.floor();
        // Rounding up to a second is left out: no clock is that exact.
        Self { sec: whole as i32, nanosec: (((seconds - whole) * 1e9) as u32).min(999_999_999) }
    }
}

/// `std_msgs/msg/Header`
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Header {
    pub stamp: Time,
    pub frame_id: String,
}

/// `geometry_msgs/msg/Vector3` and `geometry_msgs/msg/Point`
pub type Vector = [f64; 3];

/// `geometry_msgs/msg/Pose` and `geometry_msgs/msg/Transform`, which have the same numbers.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Pose {
    position: Vector,
    /// x, y, z, w
    orientation: [f64; 4],
}

impl From<geometry::Pose> for Pose {
    fn from(pose: geometry::Pose) -> Self {
        let (sine, cosine) = (0.5 * pose.heading).sin_cos();
        Self { position: [pose.x, pose.y, 0.0], orientation: [0.0, 0.0, sine, cosine] }
    }
}

impl Pose {
    /// Seen from above.
    fn flat(&self) -> geometry::Pose {
        let ([px, py, _], [x, y, z, w]) = (self.position, self.orientation);
        geometry::Pose::new(px, py, (2.0 * (w * z + x * y)).atan2(1.0 - 2.0 * (y * y + z * z)))
    }
}

/// `tf2_msgs/msg/TFMessage`
#[derive(Clone, Debug, Serialize)]
pub struct Transforms {
    pub transforms: Vec<StampedTransform>,
}

/// `geometry_msgs/msg/TransformStamped`
#[derive(Clone, Debug, Serialize)]
pub struct StampedTransform {
    pub header: Header,
    pub child_frame_id: String,
    pub transform: Pose,
}

/// `geometry_msgs/msg/PoseWithCovarianceStamped`
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct PoseWithCovariance {
    pub header: Header,
    pub pose: Pose,
    /// Of (x, y, z, roll, pitch, yaw).
    covariance: [[f64; 6]; 6],
}

/// Where x, y and heading are among the six.
const PLANE: [usize; 3] = [0, 1, 5];

impl PoseWithCovariance {
    pub fn new(header: Header, pose: geometry::Pose, of_plane: &Matrix3<f64>) -> Self {
        let mut covariance = [[0.0; 6]; 6];
        for (row, &six) in PLANE.iter().enumerate() {
            PLANE.iter().enumerate().for_each(|(column, &other)| covariance[six][other] = of_plane[(row, column)]);
        }
        Self { header, pose: pose.into(), covariance }
    }

    /// The pose seen from above, and the standard deviations of its position \[m\] and heading \[rad\]; `None` where a number is not
    /// finite.
    pub fn of_plane(&self) -> Option<(geometry::Pose, [f64; 2])> {
        let [x, y, heading] = PLANE.map(|index| self.covariance[index][index].max(0.0));
        let (pose, spread) = (self.pose.flat(), [(0.5 * (x + y)).sqrt(), heading.sqrt()]);
        (pose.is_finite() && spread.iter().all(|sigma| sigma.is_finite())).then_some((pose, spread))
    }
}

/// `nav_msgs/msg/OccupancyGrid`
#[derive(Clone, Debug, Serialize)]
pub struct OccupancyGrid {
    pub header: Header,
    pub info: MapMetaData,
    /// Percent occupied, row by row from the lower left; -1 is unknown.
    pub data: Vec<i8>,
}

/// `nav_msgs/msg/MapMetaData`
#[derive(Clone, Copy, Debug, Serialize)]
pub struct MapMetaData {
    pub map_load_time: Time,
    /// Side of a cell \[m\].
    pub resolution: f32,
    /// Cells in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Lower left corner.
    pub origin: Pose,
}

/// `visualization_msgs/msg/MarkerArray`
#[derive(Clone, Debug, Serialize)]
pub struct Markers {
    pub markers: Vec<Marker>,
}

/// `visualization_msgs/msg/Marker`
#[derive(Clone, Debug, Serialize)]
pub struct Marker {
    header: Header,
    ns: String,
    id: i32,
    kind: i32,
    action: i32,
    pose: Pose,
    scale: Vector,
    /// Red, green, blue and opacity.
    color: [f32; 4],
    lifetime: Time,
    frame_locked: bool,
    points: Vec<Vector>,
    colors: Vec<[f32; 4]>,
    texture_resource: String,
    /// `sensor_msgs/msg/CompressedImage`: header, format and data.
    texture: (Header, String, Vec<u8>),
    uv_coordinates: Vec<[f32; 2]>,
    text: String,
    mesh_resource: String,
    /// `visualization_msgs/msg/MeshFile`: name and data.
    mesh_file: (String, Vec<u8>),
    mesh_use_embedded_materials: bool,
}

impl Marker {
    /// Lines between two points each \[m\], of this width \[m\].
    pub fn lines(header: Header, ends: impl IntoIterator<Item = [Point2<f64>; 2]>, width: f64) -> Self {
        const LINE_LIST: i32 = 5;
        const ADD: i32 = 0;
        Self {
            header,
            ns: "walls".to_owned(),
            id: 0,
            kind: LINE_LIST,
            action: ADD,
            pose: geometry::Pose::IDENTITY.into(),
            scale: [width, 0.0, 0.0],
            color: [0.1, 0.3, 0.9, 1.0],
            lifetime: Time::default(),
            frame_locked: false,
            points: ends.into_iter().flatten().map(|end| [end.x, end.y, 0.0]).collect(),
            colors: Vec::new(),
            texture_resource: String::new(),
            texture: Default::default(),
            uv_coordinates: Vec::new(),
            text: String::new(),
            mesh_resource: String::new(),
            mesh_file: Default::default(),
            mesh_use_embedded_materials: false,
        }
    }
}

/// `diagnostic_msgs/msg/DiagnosticArray`
#[derive(Clone, Debug, Serialize)]
pub struct Diagnostics {
    pub header: Header,
    pub status: Vec<DiagnosticStatus>,
}

/// `diagnostic_msgs/msg/DiagnosticStatus`
#[derive(Clone, Debug, Serialize)]
pub struct DiagnosticStatus {
    /// 0 is all right, 1 a warning.
    pub level: u8,
    pub name: String,
    pub message: String,
    pub hardware_id: String,
    /// `diagnostic_msgs/msg/KeyValue`
    pub values: Vec<(String, String)>,
}

/// `std_msgs/msg/Empty`, which has a byte in CDR.
#[derive(Clone, Copy, Debug, Deserialize)]
pub struct Empty {
    _nothing: u8,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Pose as PlanePose;

    /// The oracle: the angle that the rotation's matrix turns the x axis by, for a pose that is tilted as well.
    #[test]
    fn a_pose_is_seen_from_above() {
        let turned = nalgebra::UnitQuaternion::from_euler_angles(0.1, -0.2, 2.5);
        let ahead = turned * nalgebra::Vector3::x();
        let pose = Pose { position: [1.0, 2.0, 3.0], orientation: [turned.i, turned.j, turned.k, turned.w] };
        let flat = pose.flat();
        assert!((flat.heading - ahead.y.atan2(ahead.x)).abs() < 1e-12 && [flat.x, flat.y] == [1.0, 2.0], "{flat:?}");
        let back = Pose::from(PlanePose::new(-1.0, 0.5, -3.0)).flat();
        assert!((back.heading + 3.0).abs() < 1e-12 && [back.x, back.y] == [-1.0, 0.5], "{back:?}");
    }

    #[test]
    fn time_keeps_its_parts() {
        let Time { sec, nanosec } = Time::of(1_700_000_000.25);
        assert_eq!((sec, nanosec), (1_700_000_000, 250_000_000));
        let Time { sec, nanosec } = Time::of(-0.25);
        assert_eq!((sec, nanosec), (-1, 750_000_000));
    }

    #[test]
    fn covariances_are_of_the_plane() {
        let covariance = Matrix3::new(0.04, 0.01, 0.0, 0.01, 0.09, 0.002, 0.0, 0.002, 0.0025);
        let message = PoseWithCovariance::new(Header::default(), PlanePose::new(1.0, 2.0, 0.5), &covariance);
        assert_eq!(
            [message.covariance[0][1], message.covariance[1][5], message.covariance[5][1]],
            [0.01, 0.002, 0.002]
        );
        assert_eq!(message.covariance[2], [0.0; 6]);
        let (pose, [position, heading]) = message.of_plane().unwrap();
        assert!((pose.heading - 0.5).abs() < 1e-12 && (position - 0.065_f64.sqrt()).abs() < 1e-12);
        assert!((heading - 0.05).abs() < 1e-12);
    }
}
