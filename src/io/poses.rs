//! Poses with what is known of them, as a table: of every reading the pose, its covariance, and whether it can be relied on.

use super::{WriteError, write_whole};
use crate::report::Estimate;
use std::path::Path;

/// Writes `t,x,y,heading,xx,xy,xh,yy,yh,hh,relied_on`, a row for each reading, in the order of the log. Stamps come back
/// exactly. A pose that is not relied on is there, with a 0 in the last column; where there is none yet, its columns are empty.
///
/// # Errors
/// The file cannot be written; what stood there before is then untouched.
pub fn write(path: &Path, estimates: &[Estimate]) -> Result<(), WriteError> {
    write_whole(path, |file| {
        writeln!(file, "t,x,y,heading,xx,xy,xh,yy,yh,hh,relied_on")?;
        for estimate in estimates {
            write!(file, "{},", estimate.stamp)?;
            match estimate.world_from_robot {
                Some(pose) => write!(file, "{:.9},{:.9},{:.12},", pose.x, pose.y, pose.heading)?,
                None => write!(file, ",,,")?,
            }
            match estimate.covariance {
                Some(c) => {
                    let triangle = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];
                    triangle.into_iter().try_for_each(|place| write!(file, "{:.6e},", c[place]))?;
                }
                None => write!(file, ",,,,,,")?,
            }
            writeln!(file, "{}", u8::from(estimate.relied_on().is_some()))?;
        }
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Pose;
    use crate::report::Confidence;
    use nalgebra::Matrix3;

    #[test]
    fn writes_what_the_format_says() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("poses.csv");
        let located = |is_located| Some(Confidence { weight: 1.0, explained: 1.0, is_located });
        let covariance = Matrix3::new(1.0, 0.5, 0.25, 0.5, 2.0, -0.125, 0.25, -0.125, 3.0);
        let known = Estimate {
            stamp: 1134864645.90321,
            odom_from_robot: Pose::IDENTITY,
            world_from_robot: Some(Pose::new(1.5, -2.0, 0.25)),
            covariance: Some(covariance),
            confidence: None,
        };
        let doubtful = Estimate { stamp: 2.0, confidence: located(false), ..known };
        let none = Estimate { stamp: 3.0, world_from_robot: None, covariance: None, ..known };
        write(&path, &[known, doubtful, none]).unwrap();
        let pose = "1.500000000,-2.000000000,0.250000000000,1.000000e0,5.000000e-1,2.500000e-1,2.000000e0,-1.250000e-1,3.000000e0";
        let expected =
            format!("t,x,y,heading,xx,xy,xh,yy,yh,hh,relied_on\n1134864645.90321,{pose},1\n2,{pose},0\n3,,,,,,,,,,0\n");
        assert_eq!(std::fs::read_to_string(&path).unwrap(), expected);
    }
}
