//! Trajectories in the formats of other programs. In memory a pose is one of space; what moves in the plane has z = 0.
//!
//! | Format | Names end in | A pose |
//! |---|---|---|
//! | TUM | `.tum`, `.xyt` | `t x y z qx qy qz qw`, or `t x y theta` (read) |
//! | KITTI | `.kitti` | the twelve numbers of `world_from_robot` as a matrix \[R p\], row by row; its stamp is in `NAME.times.txt` |
//! | CSV | `.csv` | [`poses.csv`](super::poses): `t,x,y,heading`, seen from above |
//! | EuRoC | `.euroc.csv`, read also `.csv` | `timestamp,x,y,z,qw,qx,qy,qz` and more columns, the timestamp in nanoseconds |

use super::lines::Lines;
use super::table::{Layout, Row, read_table};
use super::{WriteError, columns, tum, write_whole};
use crate::geometry::{Pose, Pose3, StampedPose, StampedPose3};
use crate::log::LogError;
use nalgebra::{Matrix3, Point3, Quaternion, Rotation3, Unit, UnitQuaternion, Vector3};
use std::path::{Path, PathBuf};

/// How a trajectory is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum TrajectoryFormat {
    /// `t x y z qx qy qz qw`
    Tum,
    /// Matrices, without stamps.
    Kitti,
    /// A table with the columns `t`, `x`, `y` and `heading`.
    Csv,
    /// `timestamp,x,y,z,qw,qx,qy,qz`
    Euroc,
}

impl TrajectoryFormat {
    /// The format that the ending of a name stands for.
    pub fn of(path: &Path) -> Option<Self> {
        let name = path.file_name()?.to_string_lossy().to_lowercase();
        let endings = [
            (".tum", Self::Tum),
            (".xyt", Self::Tum),
            (".kitti", Self::Kitti),
            (".euroc.csv", Self::Euroc),
            (".csv", Self::Csv),
        ];
        endings.iter().find(|(ending, _)| name.ends_with(ending)).map(|&(_, format)| format)
    }
}

/// Where the stamps \[s\] of a KITTI trajectory are, one a line.
pub fn times_path(kitti: &Path) -> PathBuf {
    kitti.with_extension("times.txt")
}

/// Reads a trajectory. Poses of `poses.csv` that are not relied on are left out. A KITTI trajectory without a file of stamps
/// has a pose a second. A table of the EuRoC kind is known by its content.
///
/// # Errors
/// A file cannot be read, holds no pose, or one of its rows is not a pose.
pub fn read(path: &Path, format: TrajectoryFormat) -> Result<Vec<StampedPose3>, LogError> {
    match format {
        TrajectoryFormat::Tum => read_tum(path),
        TrajectoryFormat::Kitti => read_kitti(path),
        TrajectoryFormat::Csv | TrajectoryFormat::Euroc if is_euroc(path)? => read_euroc(path),
        TrajectoryFormat::Csv | TrajectoryFormat::Euroc => read_csv(path),
    }
}

/// Writes a trajectory; of one in the KITTI format its stamps as well ([`times_path`]).
///
/// # Errors
/// A file cannot be written; what stood there before is then untouched.
pub fn write(path: &Path, format: TrajectoryFormat, trajectory: &[StampedPose3]) -> Result<(), WriteError> {
    match format {
        TrajectoryFormat::Tum => return tum::write3(path, trajectory),
        TrajectoryFormat::Kitti => write_whole(&times_path(path), |file| {
            trajectory.iter().try_for_each(|pose| writeln!(file, "{}", tum::stamp_text(pose.stamp)))
        })?,
        TrajectoryFormat::Csv | TrajectoryFormat::Euroc => {}
    }
    write_whole(path, |file| {
        match format {
            TrajectoryFormat::Csv => writeln!(file, "t,x,y,heading")?,
            TrajectoryFormat::Euroc => writeln!(
                file,
                "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []"
            )?,
            TrajectoryFormat::Tum | TrajectoryFormat::Kitti => {}
        }
        for StampedPose3 { stamp, pose: Pose3 { position: p, rotation } } in trajectory {
            if format == TrajectoryFormat::Kitti {
                let rotation = rotation.to_rotation_matrix();
                let row = |row: usize| {
                    format!(
                        "{:.12} {:.12} {:.12} {:.9}",
                        rotation[(row, 0)],
                        rotation[(row, 1)],
                        rotation[(row, 2)],
                        p[row]
                    )
                };
                writeln!(file, "{} {} {}", row(0), row(1), row(2))?;
            } else if format == TrajectoryFormat::Csv {
                writeln!(file, "{stamp},{:.9},{:.9},{:.12}", p.x, p.y, rotation.euler_angles().2)?;
            } else {
                let q = rotation.coords;
                let nanoseconds = nanoseconds(*stamp);
                writeln!(
                    file,
                    "{nanoseconds},{:.9},{:.9},{:.9},{:.12},{:.12},{:.12},{:.12}",
                    p.x, p.y, p.z, q.w, q.x, q.y, q.z
                )?;
            }
        }
        Ok(())
    })
}

fn in_space(&StampedPose { stamp, pose: Pose { x, y, heading } }: &StampedPose) -> StampedPose3 {
    let rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), heading);
    StampedPose3 { stamp, pose: Pose3::new(Point3::new(x, y, 0.0), rotation) }
}

fn read_tum(path: &Path) -> Result<Vec<StampedPose3>, LogError> {
    // The rows of a trajectory of the plane say so by their number of columns.
    tum::read3(path).or_else(|_| Ok(tum::read(path)?.iter().map(in_space).collect()))
}

/// How far the columns of a rotation may be from unit vectors at right angles: numbers with four digits are rotations.
const ROUNDING: f64 = 1e-3;

fn read_kitti(path: &Path) -> Result<Vec<StampedPose3>, LogError> {
    let mut trajectory = Vec::new();
    columns::read_rows(path, "a KITTI trajectory has 12 columns: the first three rows of a matrix", |row| {
        let &[xx, xy, xz, x, yx, yy, yz, y, zx, zy, zz, z] = row else { return Err(format!("{} columns", row.len())) };
        let matrix = Matrix3::new(xx, xy, xz, yx, yy, yz, zx, zy, zz);
        let off = (matrix.transpose() * matrix - Matrix3::identity()).amax();
        if off > ROUNDING || matrix.determinant() < 0.0 {
            return Err("its columns 1-3, 5-7 and 9-11 are no rotation".to_owned());
        }
        let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(matrix));
        trajectory
            .push(StampedPose3 { stamp: trajectory.len() as f64, pose: Pose3::new(Point3::new(x, y, z), rotation) });
        Ok(())
    })?;
    let times = times_path(path);
    if times.exists() {
        let mut stamps = Vec::new();
        columns::read_rows(&times, "stamps, one a line", |row| {
            let &[stamp] = row else { return Err(format!("{} columns", row.len())) };
            stamps.push(stamp);
            Ok(())
        })?;
        if stamps.len() != trajectory.len() {
            let reason = format!("{} stamps for {} poses", stamps.len(), trajectory.len());
            return Err(LogError::NotThisFormat { path: times, reason, expected: "a stamp for each pose is needed" });
        }
        trajectory.iter_mut().zip(stamps).for_each(|(pose, stamp)| pose.stamp = stamp);
    }
    Ok(trajectory)
}

fn read_csv(path: &Path) -> Result<Vec<StampedPose3>, LogError> {
    const TABLE: [Layout; 1] = [Layout { required: &["t", "x", "y", "heading"], optional: &["relied_on"] }];
    let mut trajectory = Vec::new();
    let expected = "a table of poses has the columns t, x, y and heading; one of EuRoC has numbers in all of them";
    read_table(path, &TABLE, expected, |_, row: &Row<'_>| {
        if row.text(4) != "0" {
            let pose = Pose::new(row.number(1)?, row.number(2)?, row.number(3)?);
            trajectory.push(in_space(&StampedPose { stamp: row.number(0)?, pose }));
        }
        Ok(())
    })?;
    if trajectory.is_empty() {
        let reason = "no pose that is relied on".to_owned();
        return Err(LogError::NotThisFormat { path: path.to_owned(), reason, expected });
    }
    Ok(trajectory)
}

const EUROC: &str = "a trajectory of EuRoC has rows of timestamp [ns],x,y,z,qw,qx,qy,qz";

/// Whether a table has numbers in its first row, and no names.
fn is_euroc(path: &Path) -> Result<bool, LogError> {
    let mut line = String::new();
    Lines::open(path)?.next_into(&mut line)?;
    Ok(line.split(',').next().is_some_and(|first| first.trim().parse::<i64>().is_ok()))
}

fn read_euroc(path: &Path) -> Result<Vec<StampedPose3>, LogError> {
    let (mut lines, mut line, mut trajectory) = (Lines::open(path)?, String::new(), Vec::new());
    while lines.next_into(&mut line)? {
        trajectory.push(euroc(&line).map_err(|reason| lines.error(format!("{reason}; {EUROC}")))?);
    }
    Ok(trajectory)
}

fn euroc(line: &str) -> Result<StampedPose3, String> {
    let mut words = line.split(',').map(str::trim);
    let stamp = words.next().unwrap_or_default();
    let stamp: i64 = stamp.parse().map_err(|_| format!("`{stamp:.30}` is no whole number of nanoseconds"))?;
    let mut numbers = [0.0; 7];
    for number in &mut numbers {
        let word = words.next().ok_or("it has fewer than 8 columns")?;
        *number =
            word.parse().ok().filter(|number: &f64| number.is_finite()).ok_or(format!("`{word:.30}` is no number"))?;
    }
    let [x, y, z, qw, qx, qy, qz] = numbers;
    let rotation = Unit::try_new(Quaternion::new(qw, qx, qy, qz), 1e-3).ok_or("the quaternion has no length")?;
    Ok(StampedPose3 { stamp: seconds(stamp), pose: Pose3::new(Point3::new(x, y, z), rotation) })
}

const NANOSECONDS: i64 = 1_000_000_000;

fn seconds(nanoseconds: i64) -> f64 {
    // Whole seconds apart, so that it is rounded once.
    nanoseconds.div_euclid(NANOSECONDS) as f64 + nanoseconds.rem_euclid(NANOSECONDS) as f64 / NANOSECONDS as f64
}

fn nanoseconds(seconds: f64) -> i64 {
    let whole = seconds.floor();
    (whole as i64).saturating_mul(NANOSECONDS).saturating_add(((seconds - whole) * NANOSECONDS as f64).round() as i64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::{FRAC_PI_2, PI};

    /// The files of a pose a quarter turn to the left, from the definitions of the formats.
    #[test]
    fn writes_what_the_formats_say() {
        let folder = tempfile::tempdir().unwrap();
        let pose = in_space(&StampedPose { stamp: 1403636580.8385556, pose: Pose::new(1.5, -2.0, FRAC_PI_2) });
        for (name, expected) in [
            (
                "a.kitti",
                "0.000000000000 -1.000000000000 0.000000000000 1.500000000 1.000000000000 0.000000000000 \
                         0.000000000000 -2.000000000 0.000000000000 0.000000000000 1.000000000000 0.000000000\n",
            ),
            ("a.times.txt", "1403636580.8385556\n"),
            ("a.csv", "t,x,y,heading\n1403636580.8385556,1.500000000,-2.000000000,1.570796326795\n"),
            (
                "a.euroc.csv",
                "1403636580838555574,1.500000000,-2.000000000,0.000000000,0.707106781187,0.000000000000,\
                             0.000000000000,0.707106781187\n",
            ),
        ] {
            if let Some(format) = TrajectoryFormat::of(Path::new(name)) {
                write(&folder.path().join(name), format, &[pose]).unwrap();
            }
            let written = std::fs::read_to_string(folder.path().join(name)).unwrap();
            assert_eq!(
                written.lines().last().unwrap().replace("-0.000000000000", "0.000000000000"),
                expected.lines().last().unwrap(),
                "{name}"
            );
        }
    }

    proptest! {
        #[test]
        fn reads_back_what_it_wrote(rows in prop::collection::vec((0.0..2e9, -1e4..1e4, -1e4..1e4, -PI..PI), 1..20)) {
            let folder = tempfile::tempdir().unwrap();
            let written: Vec<StampedPose3> =
                rows.iter().map(|&(stamp, x, y, h)| in_space(&StampedPose { stamp, pose: Pose::new(x, y, h) })).collect();
            for name in ["a.tum", "a.kitti", "a.csv", "a.euroc.csv"] {
                let path = folder.path().join(name);
                let format = TrajectoryFormat::of(&path).unwrap();
                write(&path, format, &written).unwrap();
                let back = read(&path, format).unwrap();
                prop_assert_eq!(back.len(), written.len());
                for (a, b) in written.iter().zip(&back) {
                    prop_assert!((a.stamp - b.stamp).abs() < 1e-6, "{}: {} {}", name, a.stamp, b.stamp);
                    let off = (a.pose.position - b.pose.position).norm();
                    let turned = a.pose.rotation.angle_to(&b.pose.rotation);
                    prop_assert!(off < 1e-8 && turned < 1e-5, "{}: {:?} {:?}", name, a, b);
                }
            }
        }
    }

    #[test]
    fn what_is_no_trajectory_is_told() {
        let folder = tempfile::tempdir().unwrap();
        for (name, text, expected) in [
            ("a.kitti", "1 0 0 1 0 1 0 2 0 0 1\n", "11 columns"),
            ("a.kitti", "2 0 0 1 0 1 0 2 0 0 1 0\n", "are no rotation"),
            ("a.kitti", "1 0 0 1 0 1 0 2 0 0 -1 0\n", "are no rotation"),
            ("a.csv", "t,x,y\n1,2,3\n", "t, x, y and heading"),
            ("a.csv", "t,x,y,heading,relied_on\n1,,,,0\n", "no pose that is relied on"),
            ("a.csv", "1,2,3,4,1,0,0\n", "fewer than 8 columns"),
            ("a.euroc.csv", "1,2,3,4,0,0,0,0\n", "has no length"),
            ("a.euroc.csv", "1,2,3,nan,0,0,0,0\n", "`nan` is no number"),
            ("a.tum", "1,2,3\n", "not a number"),
        ] {
            let path = folder.path().join(name);
            std::fs::write(&path, text).unwrap();
            let error = read(&path, TrajectoryFormat::of(&path).unwrap()).unwrap_err().to_string();
            assert!(error.contains(expected) && error.contains(name), "{error}");
        }
        let kitti = folder.path().join("b.kitti");
        std::fs::write(&kitti, "1 0 0 1 0 1 0 2 0 0 1 0\n").unwrap();
        assert_eq!(read(&kitti, TrajectoryFormat::Kitti).unwrap()[0].stamp, 0.0);
        std::fs::write(times_path(&kitti), "7\n8\n").unwrap();
        assert!(read(&kitti, TrajectoryFormat::Kitti).unwrap_err().to_string().contains("2 stamps for 1 poses"));
    }
}
