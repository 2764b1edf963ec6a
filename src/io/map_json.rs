//! The map of a run as `map.json`: a header that says what the numbers mean, one object a cluster, and the area where
//! a robot can be.
//!
//! A cluster is given by its mean, direction, two standard deviations and count. Covariance and endpoints follow from
//! these; they are written for readers who want them, and the covariance is checked on reading, so that an edit of
//! one and not the other is noticed.
//!
//! The free area is optional, and given by rows of cells: of each row the runs of free cells, `[start, end)`, the lowest
//! row first, from the corner `world_from_grid`.

use crate::geometry::Pose;
use crate::grid::FreeArea;
use crate::map::LineMap;
use crate::ppca::Cluster;
use nalgebra::{Point2, Vector2};
use serde::{Deserialize, Serialize};
use serde_json::value::{RawValue, to_raw_value};
use std::fs::File;
use std::io::{BufReader, Error, ErrorKind, Write};
use std::path::{Path, PathBuf};

const FORMAT: &str = "ipslam map";
const VERSION: u32 = 1;
/// No coordinate is larger \[m\]: the Earth's circumference.
const FARTHEST: f64 = 4.1e7;
const FRAME: &str = "world: the robot's first pose is the origin, x ahead of it, y to its left";

/// Why a map could not be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MapError {
    /// The file cannot be opened.
    #[error("{path}: cannot be opened: {source}")]
    Open {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The text is no JSON, breaks off, or a field is missing or of another type.
    #[error("{path}: no map as ipslam writes it: {source}")]
    Json {
        /// The file.
        path: PathBuf,
        /// What is wrong, with line and column.
        source: serde_json::Error,
    },
    /// The file holds something else.
    #[error("{path}: its {field} is {found:?}; this program reads {expected:?}")]
    NotThisFormat {
        /// The file.
        path: PathBuf,
        /// Which field of the header.
        field: &'static str,
        /// What it says.
        found: String,
        /// What is understood.
        expected: String,
    },
    /// A cluster cannot be one.
    #[error("{path}: cluster {index} (from 0): {reason}; correct it or remove the cluster")]
    Cluster {
        /// The file.
        path: PathBuf,
        /// Place in the list, from 0.
        index: usize,
        /// What is wrong with it, with the field's name.
        reason: String,
    },
    /// The free area cannot be one.
    #[error("{path}: the member free: {reason}; correct it or remove the member")]
    Free {
        /// The file.
        path: PathBuf,
        /// What is wrong with it, with the field's name.
        reason: String,
    },
}

/// The whole file; `Row` is a row of the free area as it is written or as it is read.
#[derive(Serialize, Deserialize)]
struct MapFile<Row> {
    format: String,
    version: u32,
    units: Units,
    frame: String,
    clusters: Vec<ClusterEntry>,
    #[serde(skip_serializing_if = "Option::is_none")]
    free: Option<FreeEntry<Row>>,
}

#[derive(Serialize, Deserialize)]
struct FreeEntry<Row> {
    cell_size: f64,
    world_from_grid: Pose,
    rows: Vec<Row>,
}

#[derive(Serialize, Deserialize, PartialEq, Debug)]
struct Units {
    length: String,
    angle: String,
}

#[derive(Serialize, Deserialize)]
struct ClusterEntry {
    mean: [f64; 2],
    covariance: Covariance,
    direction: f64,
    std_along: f64,
    std_across: f64,
    #[serde(skip_deserializing)]
    endpoints: [[f64; 2]; 2],
    count: f64,
}

#[derive(Serialize, Deserialize)]
struct Covariance {
    xx: f64,
    xy: f64,
    yy: f64,
}

/// Writes a map, in the world's frame.
///
/// # Errors
/// The writing fails; [`ErrorKind::InvalidData`] at a cluster that could not be read back.
pub fn write_map(map: &LineMap, mut out: impl Write) -> std::io::Result<()> {
    let mut entries = Vec::new();
    for (index, cluster) in map.clusters.iter().enumerate() {
        let entry = ClusterEntry::new(cluster);
        let invalid = |reason| Error::new(ErrorKind::InvalidData, format!("cluster {index} (from 0): {reason}"));
        entry.check().map_err(invalid)?;
        entries.push(entry);
    }
    let file = MapFile {
        format: FORMAT.to_owned(),
        version: VERSION,
        units: Units::si(),
        frame: FRAME.to_owned(),
        clusters: entries,
        free: map.free.as_ref().map(FreeEntry::new).transpose()?,
    };
    serde_json::to_writer_pretty(&mut out, &file)?;
    writeln!(out)
}

/// Reads a map, in the world's frame.
///
/// # Errors
/// The file cannot be opened, is no such map, or a cluster or the free area cannot be one; the message names it.
pub fn read_map(path: &Path) -> Result<LineMap, MapError> {
    let path = || path.to_path_buf();
    let text = File::open(path()).map_err(|source| MapError::Open { path: path(), source })?;
    let file: MapFile<Vec<[u32; 2]>> =
        serde_json::from_reader(BufReader::new(text)).map_err(|source| MapError::Json { path: path(), source })?;
    let header = [
        ("format", file.format, FORMAT.to_owned()),
        ("version", file.version.to_string(), VERSION.to_string()),
        ("unit of length", file.units.length, Units::si().length),
        ("unit of angle", file.units.angle, Units::si().angle),
    ];
    for (field, found, expected) in header {
        if found != expected {
            return Err(MapError::NotThisFormat { path: path(), field, found, expected });
        }
    }
    let read = |(index, entry): (usize, &ClusterEntry)| {
        entry.check().map_err(|reason| MapError::Cluster { path: path(), index, reason })?;
        Ok(entry.cluster())
    };
    let clusters = file.clusters.iter().enumerate().map(read).collect::<Result<_, _>>()?;
    let area = |free: FreeEntry<_>| FreeArea::from_rows(free.cell_size, free.world_from_grid, &free.rows);
    let free = file.free.map(area).transpose().map_err(|reason| MapError::Free { path: path(), reason })?;
    Ok(LineMap { clusters, free })
}

impl Units {
    fn si() -> Self {
        Self { length: "m".to_owned(), angle: "rad".to_owned() }
    }
}

impl FreeEntry<Box<RawValue>> {
    /// A row takes one line of the file.
    fn new(free: &FreeArea) -> serde_json::Result<Self> {
        let rows = free.rows().iter().map(to_raw_value).collect::<serde_json::Result<_>>()?;
        Ok(Self { cell_size: free.cell_size(), world_from_grid: free.world_from_grid(), rows })
    }
}

impl ClusterEntry {
    fn new(cluster: &Cluster) -> Self {
        let covariance = cluster.covariance();
        Self {
            mean: cluster.mean.into(),
            covariance: Covariance { xx: covariance.m11, xy: covariance.m12, yy: covariance.m22 },
            direction: cluster.direction.y.atan2(cluster.direction.x),
            std_along: cluster.along_variance.sqrt(),
            std_across: cluster.across_variance.sqrt(),
            endpoints: cluster.endpoints().map(Into::into),
            count: cluster.count,
        }
    }

    fn cluster(&self) -> Cluster {
        Cluster {
            mean: Point2::from(self.mean),
            direction: Vector2::new(self.direction.cos(), self.direction.sin()),
            along_variance: self.std_along * self.std_along,
            across_variance: self.std_across * self.std_across,
            count: self.count,
        }
    }

    /// What keeps this from being a cluster.
    fn check(&self) -> Result<(), String> {
        let Covariance { xx, xy, yy } = self.covariance;
        let numbers = [
            ("mean x", self.mean[0]),
            ("mean y", self.mean[1]),
            ("covariance xx", xx),
            ("covariance xy", xy),
            ("covariance yy", yy),
            ("direction", self.direction),
            ("std_along", self.std_along),
            ("std_across", self.std_across),
            ("count", self.count),
        ];
        for (field, value) in numbers {
            if !value.is_finite() {
                return Err(format!("{field} is {value}, which is no finite number"));
            }
            if value.abs() > FARTHEST && field != "count" && !field.starts_with("covariance") {
                return Err(format!("{field} is {value:e}, and nothing on Earth is further than {FARTHEST:e} m"));
            }
            let signed = field.starts_with("mean") || field == "direction" || field == "covariance xy";
            if value < 0.0 && !signed {
                return Err(format!("{field} is {value}, which is negative"));
            }
        }
        let expected = self.cluster().covariance();
        let difference = (expected.m11 - xx).abs().max((expected.m12 - xy).abs()).max((expected.m22 - yy).abs());
        // Room for numbers that were rounded to six digits by hand.
        if difference > 1e-5 * (xx + yy) + 1e-12 {
            return Err(format!(
                "its covariance ({xx}, {xy}, {yy}) is not that of direction {}, std_along {} and std_across {}",
                self.direction, self.std_along, self.std_across
            ));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn clusters() -> impl Strategy<Value = Vec<Cluster>> {
        let cluster = (-1e3..1e3, -1e3..1e3, -3.1..3.1f64, 0.0..9.0, 0.0..0.1, 0.5..1e6).prop_map(
            |(x, y, angle, along_variance, across_variance, count)| Cluster {
                mean: Point2::new(x, y),
                direction: Vector2::new(angle.cos(), angle.sin()),
                along_variance,
                across_variance,
                count,
            },
        );
        proptest::collection::vec(cluster, 0..5)
    }

    fn one() -> Cluster {
        Cluster {
            mean: Point2::new(1.0, 2.0),
            direction: Vector2::new(0.6, 0.8),
            along_variance: 4.0,
            across_variance: 0.01,
            count: 50.0,
        }
    }

    fn text_of(clusters: &[Cluster]) -> String {
        let mut bytes = Vec::new();
        write_map(&LineMap { clusters: clusters.to_vec(), free: None }, &mut bytes).unwrap();
        String::from_utf8(bytes).unwrap()
    }

    fn read_text(text: &str) -> Result<LineMap, MapError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("map.json");
        std::fs::write(&path, text).unwrap();
        read_map(&path)
    }

    fn difference(a: &Cluster, b: &Cluster) -> f64 {
        let numbers = |c: &Cluster| {
            [c.mean.x, c.mean.y, c.direction.x, c.direction.y, c.along_variance, c.across_variance, c.count]
        };
        numbers(a).iter().zip(numbers(b)).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    }

    proptest! {
        #[test]
        fn what_is_written_is_read(clusters in clusters()) {
            let LineMap { clusters: read, free } = read_text(&text_of(&clusters)).unwrap();
            prop_assert_eq!(free, None);
            prop_assert_eq!(read.len(), clusters.len());
            for (read, written) in read.iter().zip(&clusters) {
                prop_assert!(difference(read, written) < 1e-9, "{:?} is not {:?}", read, written);
            }
        }
    }

    /// The oracle: numbers worked out by hand for std 2 along (0.6, 0.8) and 0.1 across.
    #[test]
    fn fields_mean_what_they_say() {
        let file: serde_json::Value = serde_json::from_str(&text_of(&[one()])).unwrap();
        assert_eq!(file["format"], "ipslam map");
        assert_eq!(file["units"]["length"], "m");
        assert_eq!(file["units"]["angle"], "rad");
        let cluster = &file["clusters"][0];
        let expect = |value: &serde_json::Value, expected: f64| {
            let value = value.as_f64().unwrap();
            assert!((value - expected).abs() < 1e-12, "{value} is not {expected}");
        };
        expect(&cluster["mean"][1], 2.0);
        // C = 4 u uᵀ + 0.01 v vᵀ with u = (0.6, 0.8), v = (-0.8, 0.6).
        expect(&cluster["covariance"]["xx"], 1.44 + 0.0064);
        expect(&cluster["covariance"]["xy"], 1.92 - 0.0048);
        expect(&cluster["covariance"]["yy"], 2.56 + 0.0036);
        expect(&cluster["direction"], 0.927_295_218_001_612_2);
        expect(&cluster["std_along"], 2.0);
        expect(&cluster["std_across"], 0.1);
        // √3 standard deviations from the mean.
        expect(&cluster["endpoints"][1][0], 1.0 + 0.6 * 2.0 * 1.732_050_807_568_877_2);
        expect(&cluster["count"], 50.0);
    }

    #[test]
    fn a_wrong_file_is_refused_with_its_reason() {
        let good = text_of(&[one(), one()]);
        assert_eq!(read_text(&good).unwrap().clusters.len(), 2);
        let edited = |from: &str, to: &str| {
            assert!(good.contains(from), "{from} is in {good}");
            read_text(&good.replacen(from, to, 1)).unwrap_err().to_string()
        };
        for (from, to, reason) in [
            ("ipslam map", "something", "its format is \"something\""),
            ("\"version\": 1", "\"version\": 2", "its version is \"2\""),
            ("\"length\": \"m\"", "\"length\": \"mm\"", "unit of length is \"mm\""),
            ("\"std_across\": 0.1", "\"std_across\": -0.1", "std_across is -0.1, which is negative"),
            ("\"count\": 50.0", "\"count\": -1", "count is -1, which is negative"),
            ("\"std_along\": 2.0", "\"std_along\": 2.5", "is not that of direction"),
            ("\"std_along\": 2.0", "\"std_along\": 1e999", "number out of range at line"),
            ("\"std_along\": 2.0", "\"std_along\": null", "invalid type: null"),
            ("\"count\": 50.0", "\"number\": 50.0", "missing field `count`"),
        ] {
            let error = edited(from, to);
            assert!(error.contains(reason) && error.contains("map.json"), "{error:?} says {reason:?}");
        }
        let broken_off = read_text(&good[..good.len() / 2]).unwrap_err().to_string();
        assert!(broken_off.contains("EOF while parsing"), "{broken_off}");
        assert!(matches!(read_map(Path::new("no/such/map.json")), Err(MapError::Open { .. })));
    }

    #[test]
    fn the_free_area_is_told_by_its_runs() {
        let rows = [vec![], vec![[2, 5], [7, 8]], vec![[0, 1]]];
        let free = FreeArea::from_rows(0.25, Pose::new(-3.0, 2.0, 0.5), &rows).unwrap();
        let mut bytes = Vec::new();
        write_map(&LineMap { clusters: vec![one()], free: Some(free.clone()) }, &mut bytes).unwrap();
        let text = String::from_utf8(bytes).unwrap();
        assert!(text.contains("\n      [[2,5],[7,8]],\n"), "a row is a line: {text}");
        assert_eq!(read_text(&text).unwrap().free, Some(free));

        for (from, to, reason) in [
            ("[[0,1]]", "[[1,0]]", "row 2 (from 0) has a run [1, 0] out of order"),
            ("[[2,5],[7,8]]", "[[2,5],[4,8]]", "row 1 (from 0) has a run [4, 8] out of order"),
            ("[[0,1]]", "[[0,4000000000]]", "a run [0, 4000000000] out of order or range"),
            ("[[0,1]]", "[[0,-1]]", "invalid value: integer `-1`"),
            ("[[0,1]]", "[[0,1,2]]", "trailing characters"),
            ("\"cell_size\": 0.25", "\"cell_size\": 0", "cell_size is 0"),
            ("\"x\": -3.0", "\"x\": null", "invalid type: null"),
            ("[[2,5],[7,8]],\n      [[0,1]]", "[]", "it has no free cell"),
        ] {
            assert!(text.contains(from), "{from} is in {text}");
            let error = read_text(&text.replacen(from, to, 1)).unwrap_err().to_string();
            assert!(error.contains(reason) && error.contains("map.json"), "{error:?} says {reason:?}");
        }
    }

    #[test]
    fn what_cannot_be_read_back_is_not_written() {
        let broken = [
            Cluster { along_variance: f64::NAN, ..one() },
            Cluster { across_variance: -1.0, ..one() },
            Cluster { mean: Point2::new(f64::INFINITY, 0.0), ..one() },
        ];
        for cluster in broken {
            let map = LineMap { clusters: vec![one(), cluster], free: None };
            let error = write_map(&map, Vec::new()).unwrap_err();
            assert_eq!(error.kind(), ErrorKind::InvalidData);
            assert!(error.to_string().contains("cluster 1"), "{error}");
        }
    }
}
