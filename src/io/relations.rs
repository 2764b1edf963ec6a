//! Relations: the true motion between pairs of stamps, the ground truth of the SLAM benchmark of Kuemmerle et al.,
//! "On measuring the accuracy of SLAM algorithms", Autonomous Robots 27, 2009.
//!
//! Text, plain or gzip, one relation a line: `t1 t2 x y z roll pitch yaw`, seconds, metres, radians. The robot moves in
//! the x-y plane: z, roll and pitch are left out. The order of the lines means nothing; t2 may lie before t1.

use super::columns;
use crate::geometry::Pose;
use crate::log::LogError;
use std::path::Path;

const EXPECTED: &str = "a relations file has 8 columns (t1 t2 x y z roll pitch yaw)";

/// The true motion of the robot between two stamps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Relation {
    /// Seconds.
    pub first_stamp: f64,
    /// Seconds.
    pub second_stamp: f64,
    /// Pose of the robot at the second stamp, seen from its pose at the first.
    pub first_from_second: Pose,
}

/// Reads a relations file.
///
/// # Errors
/// The file cannot be read, holds no relation, or one of its lines is not a relation.
pub fn read(path: &Path) -> Result<Vec<Relation>, LogError> {
    let mut relations = Vec::new();
    columns::read_rows(path, EXPECTED, |row| {
        let &[first_stamp, second_stamp, x, y, _z, _roll, _pitch, yaw] = row else {
            return Err(format!("{} columns in place of 8", row.len()));
        };
        relations.push(Relation { first_stamp, second_stamp, first_from_second: Pose::new(x, y, yaw) });
        Ok(())
    })?;
    Ok(relations)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read_text(text: &str) -> Result<Vec<Relation>, LogError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("log.relations");
        std::fs::write(&path, text).unwrap();
        read(&path)
    }

    #[test]
    fn reads_the_plane_of_each_relation() {
        let relations = read_text("# comment\n10.5 9.25 1 -2 30 0.1 0.2 0.5\n").unwrap();
        let expected = Relation { first_stamp: 10.5, second_stamp: 9.25, first_from_second: Pose::new(1.0, -2.0, 0.5) };
        assert_eq!(relations, [expected]);
    }

    #[test]
    fn says_what_is_wrong_and_where() {
        let cases = [
            ("", "no row of numbers; a relations file has 8 columns"),
            ("1 2 3 4\n", "line 1: 4 columns in place of 8; a relations file has"),
            ("1 2 3 4 5 6 7 8\n1 2 3 4 5 6 7\n", "log.relations:2: 7 columns in place of 8"),
            ("1 2 3 4 5 6 7 8\n1 2 3 x 5 6 7 8\n", "log.relations:2: column 4, `x`, is not a number"),
        ];
        for (text, expected) in cases {
            let message = read_text(text).unwrap_err().to_string();
            assert!(message.contains(expected), "{message:?} does not say {expected:?}");
        }
    }
}
