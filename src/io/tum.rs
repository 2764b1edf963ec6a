//! Trajectories as text, one pose a line, in the order of the list (stamps may repeat and go backwards).
//!
//! Written and read: TUM, `t x y z qx qy qz qw`, seconds, metres and a quaternion. The robot moves in the x-y plane:
//! z, roll and pitch are written as 0 and left out when read. Read as well: `t x y theta`, radians. Plain or gzip.

use super::{WriteError, columns, write_whole};
use crate::geometry::{Pose, Pose3, StampedPose, StampedPose3};
use crate::log::LogError;
use nalgebra::{Point3, Quaternion, Unit};
use std::io::Write;
use std::path::Path;

const EXPECTED: &str = "a trajectory has 8 columns (TUM: t x y z qx qy qz qw) or 4 (t x y theta [rad])";

/// Reads a trajectory of either kind; recognised by the number of columns of its first row.
///
/// # Errors
/// The file cannot be read, holds no pose, or one of its lines is not a pose.
pub fn read(path: &Path) -> Result<Vec<StampedPose>, LogError> {
    let mut trajectory = Vec::new();
    let mut columns_of_first = None;
    columns::read_rows(path, EXPECTED, |row| {
        let expected = *columns_of_first.get_or_insert(row.len());
        if row.len() != expected {
            return Err(format!("{} columns, but the first pose of the file has {expected}", row.len()));
        }
        let (stamp, pose) = match *row {
            [t, x, y, theta] => (t, Pose::new(x, y, theta)),
            [t, x, y, _, qx, qy, qz, qw] => (t, Pose::new(x, y, heading_of_quaternion([qx, qy, qz, qw])?)),
            _ => return Err(format!("{} columns", row.len())),
        };
        trajectory.push(StampedPose { stamp, pose });
        Ok(())
    })?;
    Ok(trajectory)
}

/// Reads a trajectory of space, TUM only.
///
/// # Errors
/// The file cannot be read, holds no pose, or one of its lines is not a pose.
pub fn read3(path: &Path) -> Result<Vec<StampedPose3>, LogError> {
    let mut trajectory = Vec::new();
    columns::read_rows(path, "a trajectory of space has 8 columns (TUM: t x y z qx qy qz qw)", |row| {
        let &[stamp, x, y, z, qx, qy, qz, qw] = row else { return Err(format!("{} columns", row.len())) };
        let rotation = Unit::try_new(Quaternion::new(qw, qx, qy, qz), 1e-3)
            .ok_or_else(|| "the quaternion (columns 5 to 8) has no length".to_owned())?;
        trajectory.push(StampedPose3 { stamp, pose: Pose3::new(Point3::new(x, y, z), rotation) });
        Ok(())
    })?;
    Ok(trajectory)
}

/// Writes a trajectory of space as TUM. Stamps come back exactly, positions to 1e-9 m.
///
/// # Errors
/// The file cannot be written; what stood there before is then untouched.
pub fn write3(path: &Path, trajectory: &[StampedPose3]) -> Result<(), WriteError> {
    write_whole(path, |file| {
        writeln!(file, "# t x y z qx qy qz qw")?;
        for &StampedPose3 { stamp, pose: Pose3 { position: p, rotation } } in trajectory {
            let q = rotation.coords;
            let stamp = stamp_text(stamp);
            writeln!(file, "{stamp} {:.9} {:.9} {:.9} {:.12} {:.12} {:.12} {:.12}", p.x, p.y, p.z, q.x, q.y, q.z, q.w)?;
        }
        Ok(())
    })
}

/// Rotation about z \[rad\] of a quaternion x, y, z, w of any length but none.
fn heading_of_quaternion([x, y, z, w]: [f64; 4]) -> Result<f64, String> {
    if x * x + y * y + z * z + w * w < 1e-6 {
        return Err("the quaternion (columns 5 to 8) has no length".to_owned());
    }
    Ok((2.0 * (w * z + x * y)).atan2(w * w + x * x - y * y - z * z))
}

/// Writes a trajectory as TUM. Stamps come back exactly, positions to 1e-9 m, headings to 1e-11 rad.
///
/// # Errors
/// The file cannot be written; what stood there before is then untouched.
pub fn write(path: &Path, trajectory: &[StampedPose]) -> Result<(), WriteError> {
    write_whole(path, |file| write_poses(trajectory, file))
}

/// The same to anything that takes bytes.
///
/// # Errors
/// What `out` says.
pub fn write_poses(trajectory: &[StampedPose], mut out: impl Write) -> std::io::Result<()> {
    writeln!(out, "# t x y z qx qy qz qw")?;
    for &StampedPose { stamp, pose } in trajectory {
        let (qz, qw) = (pose.heading / 2.0).sin_cos();
        writeln!(out, "{} {:.9} {:.9} 0 0 0 {qz:.12} {qw:.12}", stamp_text(stamp), pose.x, pose.y)?;
    }
    Ok(())
}

/// The shortest text that reads back as the same number, with 6 decimals at least.
pub(super) fn stamp_text(stamp: f64) -> String {
    let shortest = stamp.to_string();
    match shortest.split_once('.') {
        Some((_, decimals)) if decimals.len() >= 6 => shortest,
        _ => format!("{stamp:.6}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::{FRAC_PI_2, PI};

    fn read_text(text: &[u8]) -> Result<Vec<StampedPose>, LogError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("trajectory.txt");
        std::fs::write(&path, text).unwrap();
        read(&path)
    }

    #[test]
    fn writes_what_the_format_says() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("trajectory.tum");
        let poses = [(1134864645.90321, Pose::new(1.5, -2.0, FRAC_PI_2)), (3.0, Pose::new(0.0, 1e4, PI))];
        write(&path, &poses.map(|(stamp, pose)| StampedPose { stamp, pose })).unwrap();
        let expected = "# t x y z qx qy qz qw\n\
             1134864645.903210 1.500000000 -2.000000000 0 0 0 0.707106781187 0.707106781187\n\
             3.000000 0.000000000 10000.000000000 0 0 0 1.000000000000 0.000000000000\n";
        assert_eq!(std::fs::read_to_string(&path).unwrap(), expected);
    }

    proptest! {
        #[test]
        fn reads_back_what_it_wrote(
            rows in prop::collection::vec((-1e9..2e9, -1e4..1e4, -1e4..1e4, -PI..PI), 1..20)
        ) {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("trajectory.tum");
            let written: Vec<_> =
                rows.iter().map(|&(stamp, x, y, h)| StampedPose { stamp, pose: Pose::new(x, y, h) }).collect();
            write(&path, &written).unwrap();
            let back = read(&path).unwrap();
            prop_assert_eq!(written.len(), back.len());
            for (a, b) in written.iter().zip(&back) {
                prop_assert_eq!(a.stamp, b.stamp);
                prop_assert!((a.pose.position() - b.pose.position()).norm() < 1e-9, "{:?} came back as {:?}", a, b);
                prop_assert!(crate::geometry::wrap_angle(a.pose.heading - b.pose.heading).abs() < 1e-11);
            }
        }
    }

    #[test]
    fn a_tilted_or_scaled_quaternion_keeps_its_heading() {
        // Heading 0.3, then pitch 0.2 (about the turned y axis), all times 2: a product of half-angle quaternions.
        let (sz, cz) = 0.15_f64.sin_cos();
        let (sy, cy) = 0.1_f64.sin_cos();
        let q = [-sz * sy, cz * sy, sz * cy, cz * cy].map(|c| 2.0 * c);
        let text = format!("7 1 2 3 {} {} {} {}\n", q[0], q[1], q[2], q[3]);
        let poses = read_text(text.as_bytes()).unwrap();
        assert!((poses[0].pose.heading - 0.3).abs() < 1e-12, "{poses:?}");
        assert_eq!((poses[0].stamp, poses[0].pose.x, poses[0].pose.y), (7.0, 1.0, 2.0));
    }

    #[test]
    fn keeps_the_order_and_leaves_out_comments() {
        let poses = read_text(b"# t x y theta\r\n\r\n 2 1 0 3.5\r\n1 5 6 0\r\n2 7 8 0\r\n").unwrap();
        assert_eq!(poses.iter().map(|p| p.stamp).collect::<Vec<_>>(), [2.0, 1.0, 2.0]);
        assert!((poses[0].pose.heading - (3.5 - 2.0 * PI)).abs() < 1e-12);
    }

    #[test]
    fn says_what_is_wrong_and_where() {
        let cases: [(&[u8], &str); 8] = [
            (b"", "no row of numbers"),
            (b"# only this\n", "no row of numbers"),
            (b"FLASER 180 1.0\n", "line 1: column 1, `FLASER`, is not a number; a trajectory has"),
            (b"1 2 3\n", "line 1: 3 columns; a trajectory has"),
            (b"# t x y theta\n1 2 3 4\n1 2 3\n", "trajectory.txt:3: 3 columns, but the first pose of the file has 4"),
            (b"1 2 3 4\n1 2 nan 4\n", "trajectory.txt:2: column 3, `nan`, is not finite"),
            (b"1 2 3 4\n\xff\xfe 2 3 4\n", "trajectory.txt:2: column 1"),
            (b"1 0 0 0 0 0 0 1\n2 0 0 0 0 0 0 0\n", "trajectory.txt:2: the quaternion (columns 5 to 8) has no length"),
        ];
        for (text, expected) in cases {
            let message = read_text(text).unwrap_err().to_string();
            assert!(message.contains(expected), "{message:?} does not say {expected:?}");
        }
        let message = read(Path::new("/nowhere/trajectory.tum")).unwrap_err().to_string();
        assert!(message.contains("/nowhere/trajectory.tum: cannot be opened"), "{message}");
    }

    #[test]
    fn a_cut_gzip_file_is_told() {
        let mut packed = Vec::new();
        let mut encoder = flate2::write::GzEncoder::new(&mut packed, flate2::Compression::default());
        for i in 0..1000 {
            writeln!(encoder, "{i} {} 0 0", (i as f64).sin()).unwrap();
        }
        encoder.finish().unwrap();
        assert_eq!(read_text(&packed).unwrap().len(), 1000);
        let message = read_text(&packed[..packed.len() / 2]).unwrap_err().to_string();
        assert!(message.contains("is the file complete?"), "{message}");
    }
}
