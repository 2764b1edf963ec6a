//! `ipslam eval`: how good a trajectory is, against the ground truth of its log.

use anyhow::bail;
use ipslam::geometry::StampedPose;
use ipslam::io::relations::Relation;
use ipslam::io::{relations, tum};
use ipslam::metrics::relations::{LOOP_SECONDS, RelationErrors, relation_errors};
use ipslam::metrics::trajectory::{RELATIVE_METRES, RELATIVE_SECONDS, ReferenceErrors, reference_errors};
use ipslam::metrics::{ErrorStats, PoseErrors};
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// Scores a trajectory against relations, reference poses, or both.
#[derive(Debug, clap::Args)]
#[command(group = clap::ArgGroup::new("truth").required(true).multiple(true))]
pub struct EvalArgs {
    /// Trajectory: TUM (t x y z qx qy qz qw) or t x y theta, plain or gzip
    trajectory: PathBuf,
    /// Relations of the SLAM benchmark (t1 t2 x y z roll pitch yaw), plain or gzip
    #[arg(long, value_name = "FILE", group = "truth")]
    relations: Option<PathBuf>,
    /// Trajectory of reference poses, in the formats of the trajectory
    #[arg(long, value_name = "FILE", group = "truth")]
    reference: Option<PathBuf>,
    /// Print JSON in place of a table
    #[arg(long)]
    json: bool,
}

/// Scores the trajectory and prints the errors.
pub fn eval(args: &EvalArgs) -> anyhow::Result<()> {
    let report = Report::new(args)?;
    let text = if args.json { format!("{:#}\n", report.json()) } else { report.table() };
    Ok(std::io::stdout().write_all(text.as_bytes())?)
}

/// The scores of a trajectory.
pub(super) struct Report<'a> {
    pub trajectory_path: &'a Path,
    pub poses: usize,
    pub relations: Option<(&'a Path, RelationErrors)>,
    pub reference: Option<(&'a Path, ReferenceErrors)>,
}

impl<'a> Report<'a> {
    fn new(args: &'a EvalArgs) -> anyhow::Result<Self> {
        let trajectory = tum::read(&args.trajectory)?;
        let mut report =
            Self { trajectory_path: &args.trajectory, poses: trajectory.len(), relations: None, reference: None };
        if let Some(path) = &args.relations {
            let relations = relations::read(path)?;
            let errors = relation_errors(&relations, &trajectory);
            if errors.all.is_none() {
                bail!(nothing_in_common(&args.trajectory, &trajectory, path, relation_stamps(&relations)));
            }
            report.relations = Some((path, errors));
        }
        if let Some(path) = &args.reference {
            let reference = tum::read(path)?;
            let errors = reference_errors(&reference, &trajectory);
            if errors.absolute.is_none() {
                let stamps = reference.iter().map(|pose| pose.stamp);
                bail!(nothing_in_common(&args.trajectory, &trajectory, path, stamps));
            }
            report.reference = Some((path, errors));
        }
        Ok(report)
    }

    pub(super) fn table(&self) -> String {
        let mut text = format!("trajectory {}: {} poses\n", self.trajectory_path.display(), self.poses);
        if let Some((path, errors)) = &self.relations {
            let RelationErrors { relations, unmatched, .. } = errors;
            let _ = write!(text, "\nrelations {}: {relations}, of them {unmatched} unmatched\n", path.display());
            text += TABLE_HEAD;
            text += &pose_rows("all", errors.all.as_ref());
            text += &pose_rows(&format!("at most {LOOP_SECONDS} s apart"), errors.local.as_ref());
            text += &pose_rows("farther apart: loops", errors.loop_closing.as_ref());
        }
        if let Some((path, errors)) = &self.reference {
            let ReferenceErrors { reference_poses, unmatched, .. } = errors;
            let _ = write!(text, "\nreference {}: {reference_poses} poses, ", path.display());
            let _ = write!(text, "of them {unmatched} unmatched\n{TABLE_HEAD}");
            text += &row("absolute (ATE), aligned", "m", errors.absolute.as_ref(), 1.0);
            text += &pose_rows(&format!("relative (RPE) in {RELATIVE_SECONDS} s"), errors.relative_in_time.as_ref());
            text += &pose_rows(&format!("relative (RPE) in {RELATIVE_METRES} m"), errors.relative_in_path.as_ref());
        }
        text
    }

    pub(super) fn json(&self) -> Value {
        let mut value = json!({ "trajectory": { "path": shown(self.trajectory_path), "poses": self.poses } });
        if let Some((path, errors)) = &self.relations {
            value["relations"] = json!({
                "path": shown(path),
                "count": errors.relations,
                "unmatched": errors.unmatched,
                "all": pose_json(errors.all.as_ref()),
                "local": pose_json(errors.local.as_ref()),
                "loop": pose_json(errors.loop_closing.as_ref()),
            });
        }
        if let Some((path, errors)) = &self.reference {
            value["reference"] = json!({
                "path": shown(path),
                "poses": errors.reference_poses,
                "unmatched": errors.unmatched,
                "ate": { "translation_m": errors.absolute },
                format!("rpe_{RELATIVE_SECONDS}_s"): pose_json(errors.relative_in_time.as_ref()),
                format!("rpe_{RELATIVE_METRES}_m"): pose_json(errors.relative_in_path.as_ref()),
            });
        }
        value
    }
}

fn shown(path: &Path) -> String {
    path.display().to_string()
}

fn relation_stamps(relations: &[Relation]) -> impl Iterator<Item = f64> {
    relations.iter().flat_map(|relation| [relation.first_stamp, relation.second_stamp])
}

/// The error where no stamp of the truth finds a pose.
fn nothing_in_common(
    trajectory_path: &Path,
    trajectory: &[StampedPose],
    truth_path: &Path,
    mut truth_stamps: impl Iterator<Item = f64>,
) -> String {
    let span = |stamps: &mut dyn Iterator<Item = f64>| {
        let (low, high) = stamps.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), t| (low.min(t), high.max(t)));
        format!("{low:.3} to {high:.3} s")
    };
    format!(
        "{}: no stamp of {} finds a pose here: the stamps are {} here and {} there; are both of the same log and clock?",
        trajectory_path.display(),
        truth_path.display(),
        span(&mut trajectory.iter().map(|pose| pose.stamp)),
        span(&mut truth_stamps),
    )
}

const TABLE_HEAD: &str =
    "                            [unit]   count      mean       std      rmse    median       max\n";

fn pose_rows(label: &str, errors: Option<&PoseErrors>) -> String {
    let metres = row(label, "m", errors.map(|errors| &errors.translation), 1.0);
    metres + &row("", "deg", errors.map(|errors| &errors.rotation), 1_f64.to_degrees())
}

fn row(label: &str, unit: &str, stats: Option<&ErrorStats>, factor: f64) -> String {
    let Some(ErrorStats { count, mean, std, rmse, median, max }) = stats else {
        return format!("  {label:<25} {unit:>6} {:>7}\n", 0);
    };
    let [mean, std, rmse, median, max] = [mean, std, rmse, median, max].map(|value| value * factor);
    format!("  {label:<25} {unit:>6} {count:>7} {mean:>9.4} {std:>9.4} {rmse:>9.4} {median:>9.4} {max:>9.4}\n")
}

fn pose_json(errors: Option<&PoseErrors>) -> Value {
    let Some(PoseErrors { translation, rotation }) = errors else { return Value::Null };
    let degrees = ErrorStats {
        count: rotation.count,
        mean: rotation.mean.to_degrees(),
        std: rotation.std.to_degrees(),
        rmse: rotation.rmse.to_degrees(),
        median: rotation.median.to_degrees(),
        max: rotation.max.to_degrees(),
    };
    json!({ "translation_m": translation, "rotation_rad": rotation, "rotation_deg": degrees })
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Parser)]
    struct Cli {
        #[command(flatten)]
        args: EvalArgs,
    }

    /// A straight drive at 1 m/s along x, eight poses a second, and one of its relations wrong by 0.5 m and 90°.
    fn files() -> (tempfile::TempDir, Vec<String>) {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name).display().to_string();
        let rows = |from: i32| (from..from + 240).map(|i| format!("{0} {0} 0 0\n", f64::from(i) / 8.0));
        std::fs::write(path("drive.txt"), rows(0).collect::<String>()).unwrap();
        std::fs::write(path("elsewhere.txt"), rows(800).collect::<String>()).unwrap();
        let relations = "0 2 2 0 0 0 0 0\n0 20 20 0.5 0 0 0 1.5707963267948966\n0 99 99 0 0 0 0 0\n";
        std::fs::write(path("relations.txt"), relations).unwrap();
        let paths = ["drive.txt", "relations.txt", "elsewhere.txt"].map(path).to_vec();
        (folder, paths)
    }

    fn parse(words: &[&str]) -> Result<EvalArgs, clap::Error> {
        Cli::try_parse_from([&["eval"], words].concat()).map(|cli| cli.args)
    }

    #[test]
    fn tells_both_kinds_of_truth() {
        let (_folder, paths) = files();
        let args = parse(&[&paths[0], "--relations", &paths[1], "--reference", &paths[0]]).unwrap();
        let report = Report::new(&args).unwrap();
        let json = report.json();
        for (pointer, expected) in [
            ("/trajectory/poses", 240.0),
            ("/relations/count", 3.0),
            ("/relations/unmatched", 1.0),
            ("/relations/all/translation_m/mean", 0.25),
            ("/relations/local/translation_m/max", 0.0),
            ("/relations/loop/translation_m/max", 0.5),
            ("/relations/loop/rotation_deg/max", 90.0),
            ("/relations/loop/rotation_rad/max", 90_f64.to_radians()),
            ("/reference/ate/translation_m/rmse", 0.0),
            ("/reference/rpe_1_s/translation_m/count", 234.0),
            ("/reference/rpe_10_m/translation_m/rmse", 0.0),
        ] {
            let found = json.pointer(pointer).and_then(Value::as_f64).unwrap_or(f64::NAN);
            assert!((found - expected).abs() < 1e-9, "{pointer}: {found}, not {expected} in {json:#}");
        }
        let table = report.table();
        for expected in ["3, of them 1 unmatched", "farther apart: loops", "0.5000", "90.0000", "(RPE) in 10 m"] {
            assert!(table.contains(expected), "{expected:?} is not in\n{table}");
        }
    }

    #[test]
    fn asks_for_a_truth_that_fits() {
        let (_folder, paths) = files();
        let message = parse(&[&paths[0]]).unwrap_err().to_string();
        assert!(message.contains("<--relations <FILE>|--reference <FILE>>"), "{message}");
        for (option, truth) in [("--relations", &paths[1]), ("--reference", &paths[0])] {
            let args = parse(&[&paths[2], option, truth]).unwrap();
            let message = eval(&args).unwrap_err().to_string();
            assert!(message.contains("100.000 to 129.875 s") && message.contains("same log and clock"), "{message}");
            let args = parse(&[&paths[0], option, truth, "--json"]).unwrap();
            eval(&args).unwrap();
        }
    }
}
