//! Robots of space, and long drives of the plane.

use super::{Failure, on_one_thread};
use ipslam::association::Policy;
use ipslam::detections::Recording3;
use ipslam::geometry::{Pose3, StampedPose3};
use ipslam::io::datasets::{Converted, Converted3, Dataset, Dataset3, Options, imu_tracks};
use ipslam::metrics::space::space_errors;
use ipslam::metrics::trajectory::reference_errors;
use ipslam::semantic::{SemanticConfig, SemanticMap, Space, Weight, map, map_known};
use ipslam::visual_inertial;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;

const SEEDS: [u64; 5] = [1, 2, 3, 4, 5];
/// Two poses of a revisit are no farther apart [m] and the way between them is at least as long [m].
const REVISIT: (f64, f64) = (4.0, 100.0);
/// A loop is closed at a revisit where the two poses are, relative to each other, off by less [m]: cars are parked 5 m apart.
const CLOSED: f64 = 2.5;

/// A section of the page.
type Section = fn(&Path) -> Result<String, Failure>;

/// Each section is printed as soon as it is made.
pub fn print(folder: &Path) -> Result<(), Failure> {
    #[cfg(feature = "images")]
    let pictures: &[Section] = &[super::pictures::page];
    #[cfg(not(feature = "images"))]
    let pictures: &[Section] = &[];
    let sections: [Section; 7] = [starry_night, inertial, tracking, furniture, office, streets, long_drives];
    for section in sections[..5].iter().chain(pictures).chain(&sections[5..]) {
        print!("{}", section(folder)?);
        std::io::stdout().flush()?;
    }
    Ok(())
}

/// A map of space, and how good it is.
struct Run {
    map: SemanticMap<Space>,
    seconds: f64,
    rms: f64,
}

impl Run {
    fn new(read: &Converted3, config: &SemanticConfig) -> Result<Self, Failure> {
        let (map, seconds) = on_one_thread(|| map(&read.recording, config, &|_| ()))?;
        Self::of(read, map?, seconds)
    }

    fn known(read: &Converted3) -> Result<Self, Failure> {
        let config = SemanticConfig::default();
        let (map, seconds) = on_one_thread(|| map_known(&read.recording, &read.ids, &config, &|_| ()))?;
        Self::of(read, map?, seconds)
    }

    fn of(read: &Converted3, map: SemanticMap<Space>, seconds: f64) -> Result<Self, Failure> {
        let rms = rms(&read.trajectory, &map.trajectory3()).ok_or("there are no true poses")?;
        Ok(Self { map, seconds, rms })
    }

    fn verdict(&self) -> &'static str {
        if self.map.verdict.is_consistent() { "consistent" } else { "doubtful" }
    }
}

fn rms(truth: &[StampedPose3], path: &[StampedPose3]) -> Option<f64> {
    space_errors(truth, path).map(|errors| errors.position.rmse)
}

/// Error of odometry alone.
fn reckoned(recording: &Recording3, truth: &[StampedPose3]) -> f64 {
    let path = recording.odometry.dead_reckoning(truth.iter().map(|pose| pose.stamp));
    rms(truth, &path).unwrap_or(f64::NAN)
}

/// Weights of each object on each landmark.
type Shares = BTreeMap<Option<u64>, BTreeMap<usize, f64>>;

fn shares(ids: &[Vec<Option<u64>>], weights: &[Weight]) -> Shares {
    let mut shares = Shares::new();
    for weight in weights {
        let of_object = shares.entry(ids[weight.frame][weight.detection]).or_default();
        *of_object.entry(weight.landmark).or_default() += weight.weight;
    }
    shares
}

/// Share of the weight of objects that is on the landmark that has most of it.
fn right(shares: &Shares, is_one: impl Fn(u64) -> bool) -> f64 {
    let of_objects = || shares.iter().filter(|(id, _)| id.is_some_and(&is_one)).map(|(_, on)| on);
    let most: f64 = of_objects().map(|on| on.values().copied().fold(0.0, f64::max)).sum();
    most / of_objects().flat_map(|on| on.values()).sum::<f64>()
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (count, sum) = values.fold((0.0, 0.0), |(count, sum), value| (count + 1.0, sum + value));
    sum / count
}

fn starry_night(folder: &Path) -> Result<String, Failure> {
    let mut table = "## Starry Night, rows 1214 to 1714
A rig of two cameras, moved by hand over points of light; four classes, 10 % wrong labels.

| | odometry alone | label seed 1 | 2 | 3 | 4 | 5 | landmarks | weight on the right one | called consistent | seconds |
|---|---|---|---|---|---|---|---|---|---|---|\n"
        .to_owned();
    let read = |seed| {
        let options = Options { classes: Some(4), rows: Some((1214, 1714)), seed: Some(seed), ..Options::default() };
        Dataset3::StarryNight.read(&folder.join("starry_night"), &options)
    };
    let mut row = |name: &str, run: &dyn Fn(&Converted3) -> Result<Run, Failure>| {
        let reads = SEEDS.into_iter().map(read).collect::<Result<Vec<_>, _>>()?;
        let runs = reads.iter().map(run).collect::<Result<Vec<_>, Failure>>()?;
        let errors: Vec<String> = runs.iter().map(|run| format!("{:.3}", run.rms)).collect();
        let landmarks: BTreeSet<usize> = runs.iter().map(|run| run.map.landmarks.len()).collect();
        let share =
            mean(reads.iter().zip(&runs).map(|(read, run)| right(&shares(&read.ids, &run.map.weights), |_| true)));
        let consistent = runs.iter().filter(|run| run.map.verdict.is_consistent()).count();
        writeln!(
            table,
            "| {name} | {:.3} | {} | {landmarks:?} | {:.1} % | {consistent} of 5 | {:.1} |",
            reckoned(&reads[0].recording, &reads[0].trajectory),
            errors.join(" | "),
            100.0 * share,
            mean(runs.iter().map(|run| run.seconds)),
        )?;
        Ok::<_, Failure>(())
    };
    row("ids hidden", &|read| Run::new(read, &SemanticConfig::default()))?;
    row("ids known", &Run::known)?;
    Ok(table + "\n")
}

fn inertial(folder: &Path) -> Result<String, Failure> {
    let (recording, truth) = imu_tracks::read(&folder.join("vio_v101_30s"))?;
    let (found, seconds) = on_one_thread(|| visual_inertial::estimate(&recording))?;
    let found = found?.trajectory(&recording, recording.frames.iter().map(|frame| frame.stamp));
    let errors = space_errors(&truth, &found).ok_or("there are no true poses")?;
    Ok(format!(
        "## EuRoC V1_01, the first 30 s
Tracks of features and inertial readings, no objects: {:.3} m, {:.2}°, {seconds:.1} s.\n\n",
        errors.position.rmse,
        errors.rotation.rmse.to_degrees(),
    ))
}

fn tracking(folder: &Path) -> Result<String, Failure> {
    let mut table = "## KITTI tracking
Boxes of a detector around cars, and visual odometry; no place is seen twice. Landmarks of moving cars: those with most of their
weight from cars that moved by more than 2 m, or from no car.

| drive | odometry alone | error | weight of parked cars on the right one | boxes of moving cars left out | of parked cars | parked cars on the map | landmarks of moving cars | | seconds |
|---|---|---|---|---|---|---|---|---|---|\n"
        .to_owned();
    for drive in ["0001", "0005", "0007", "0011"] {
        let read = Dataset3::KittiTracking.read(&folder.join("kitti_tracking").join(drive), &Options::default())?;
        let run = Run::new(&read, &SemanticConfig::default())?;
        let parked: BTreeSet<u64> = read.landmarks.iter().map(|landmark| landmark.id).collect();
        let shares = shares(&read.ids, &run.map.weights);
        let mut owners: BTreeMap<usize, (Option<u64>, f64)> = BTreeMap::new();
        for (id, on) in &shares {
            for (landmark, weight) in on {
                let owner = owners.entry(*landmark).or_insert((*id, *weight));
                if *weight > owner.1 {
                    *owner = (*id, *weight);
                }
            }
        }
        let is_parked = |id: &Option<u64>| id.is_some_and(|id| parked.contains(&id));
        let mapped: BTreeSet<Option<u64>> = owners.values().map(|(id, _)| *id).filter(is_parked).collect();
        let seen: BTreeSet<Option<u64>> = read.ids.iter().flatten().copied().filter(is_parked).collect();
        let count = |is_one: &dyn Fn(u64) -> bool, ids: &mut dyn Iterator<Item = Option<u64>>| {
            ids.flatten().filter(|id| is_one(*id)).count() as f64
        };
        let left_out = |is_one: &dyn Fn(u64) -> bool| {
            let out = run.map.moving.iter().map(|(frame, detection)| read.ids[*frame][*detection]);
            100.0 * count(is_one, &mut { out }) / count(is_one, &mut read.ids.iter().flatten().copied())
        };
        writeln!(
            table,
            "| {drive} | {:.2} | {:.2} | {:.1} % | {:.0} % | {:.1} % | {} of {} | {} | {} | {:.1} |",
            reckoned(&read.recording, &read.trajectory),
            run.rms,
            100.0 * right(&shares, |id| parked.contains(&id)),
            left_out(&|id| !parked.contains(&id)),
            left_out(&|id| parked.contains(&id)),
            mapped.len(),
            seen.len(),
            owners.values().filter(|(id, _)| !is_parked(id)).count(),
            run.verdict(),
            run.seconds,
        )?;
    }
    Ok(table + "\n")
}

fn streets(folder: &Path) -> Result<String, Failure> {
    let mut table = "## KITTI 05 and 06, semi-synthetic
The poses are true; parked cars, their boxes and odometry are simulated with a seed. Hard: the likeliest one-to-one assignment of
each frame, once, as it comes (a beam of one hypothesis), and in the sweeps; hard sweeps: the same in the sweeps alone, after the
forward pass with its beam. Revisits: keyframes that come within 4 m of an earlier one, 100 m of way later; the loop is closed where
the two are off by less than 2.5 m, relative to each other.

| drive, seed | odometry alone | soft | hard | hard sweeps | ids known | revisits closed, soft | hard | hard sweeps | soft | hard | hard sweeps | seconds, soft |
|---|---|---|---|---|---|---|---|---|---|---|---|---|\n"
        .to_owned();
    let soft = SemanticConfig::default();
    let hard_sweeps = SemanticConfig { association: Policy::Hungarian, ..soft };
    let hard = SemanticConfig { beam: 1, branches: 1, ..hard_sweeps };
    let drives = SEEDS.map(|seed| (6, seed)).into_iter().chain([(5, 1), (5, 2)]);
    for (drive, seed) in drives {
        let options = Options { robot: Some(drive), seed: Some(seed), ..Options::default() };
        let read = Dataset3::KittiOdometry.read(&folder.join("kitti_odometry_poses"), &options)?;
        let configs = [soft, hard, hard_sweeps];
        let runs = configs.iter().map(|config| Run::new(&read, config)).collect::<Result<Vec<_>, Failure>>()?;
        let columns = |cell: &dyn Fn(&Run) -> String| runs.iter().map(cell).collect::<Vec<_>>().join(" | ");
        let closed = |run: &Run| {
            let (closed, all) = revisits(&read.trajectory, &run.map.trajectory3());
            format!("{closed} of {all}")
        };
        writeln!(
            table,
            "| {drive:02}, {seed} | {:.2} | {} | {:.2} | {} | {} | {:.0} |",
            reckoned(&read.recording, &read.trajectory),
            columns(&|run| format!("{:.2}", run.rms)),
            Run::known(&read)?.rms,
            columns(&closed),
            columns(&|run| run.verdict().to_owned()),
            runs[0].seconds,
        )?;
        eprintln!("{drive:02}, {seed}");
    }
    Ok(table + "\n")
}

/// Revisits at which the loop is closed, and all.
fn revisits(truth: &[StampedPose3], path: &[StampedPose3]) -> (usize, usize) {
    let true_pose = |stamp: f64| {
        let place = truth.partition_point(|pose| pose.stamp < stamp - 1e-3);
        truth.get(place).map(|pose| pose.pose)
    };
    let poses: Vec<(Pose3, Pose3)> =
        path.iter().filter_map(|found| Some((true_pose(found.stamp)?, found.pose))).collect();
    let mut way = vec![0.0];
    way.extend(poses.windows(2).scan(0.0, |way, ends| {
        *way += (ends[1].0.position - ends[0].0.position).norm();
        Some(*way)
    }));
    let (mut closed, mut all) = (0, 0);
    for (number, (now, found)) in poses.iter().enumerate() {
        let earlier = (0..number).filter(|other| way[number] - way[*other] > REVISIT.1);
        let apart = |other: usize| (poses[other].0.position - now.position).norm();
        let Some(nearest) = earlier.min_by(|a, b| apart(*a).total_cmp(&apart(*b))) else { continue };
        if apart(nearest) < REVISIT.0 {
            let (true_nearest, found_nearest) = poses[nearest];
            let off = found.seen_from(found_nearest).position - now.seen_from(true_nearest).position;
            all += 1;
            closed += usize::from(off.norm() < CLOSED);
        }
    }
    (closed, all)
}

fn furniture(folder: &Path) -> Result<String, Failure> {
    let read = Dataset3::StataObjects.read(&folder.join("stata_objects"), &Options::default())?;
    let (found, seconds) = on_one_thread(|| map::<Space>(&read.recording, &SemanticConfig::default(), &|_| ()))?;
    let found = found?;
    let weight: f64 = found.weights.iter().map(|weight| weight.weight).sum();
    Ok(format!(
        "## SLAM with objects, MIT Stata Center
A camera with depth, 28 m; nobody knows the true way nor the objects. {} detections give {} landmarks ({}); {:.0} % of the
detections show one of them. Calibration: scale {:.3}, turn scale {:.3}. The map is called {}; {seconds:.1} s.\n\n",
        found.detections,
        found.landmarks.len(),
        count_classes(&read.recording, &found),
        100.0 * weight / found.detections as f64,
        found.calibration[0],
        found.calibration[1],
        if found.verdict.is_consistent() { "consistent" } else { "doubtful" },
    ))
}

/// How many landmarks there are of each class.
fn count_classes(recording: &Recording3, found: &SemanticMap<Space>) -> String {
    let mut classes: BTreeMap<&str, usize> = BTreeMap::new();
    for landmark in &found.landmarks {
        *classes.entry(&recording.sensors.classes[landmark.class()]).or_default() += 1;
    }
    let names: Vec<String> = classes.iter().map(|(name, count)| format!("{count} {name}")).collect();
    names.join(", ")
}

fn office(folder: &Path) -> Result<String, Failure> {
    let read = Dataset3::TumOffice.read(&folder.join("tum_fr3_office"), &Options::default())?;
    let run = Run::new(&read, &SemanticConfig::default())?;
    Ok(format!(
        "## TUM RGB-D, freiburg3_long_office_household, semi-synthetic
A camera is carried by hand round two desks, 22 m; boxes are of a detector, heights of five classes were measured in this drive, and
odometry is the true way with simulated drift. {} detections give {} landmarks ({}). The way errs by {:.3} m, odometry alone by
{:.3} m; the map is called {}; {:.1} s.\n\n",
        run.map.detections,
        run.map.landmarks.len(),
        count_classes(&read.recording, &run.map),
        run.rms,
        reckoned(&read.recording, &read.trajectory),
        run.verdict(),
        run.seconds,
    ))
}

fn long_drives(folder: &Path) -> Result<String, Failure> {
    let mut table = "## Long drives of the plane
One class, hundreds of objects, no true way: the error is the distance from the path with known identities.

| | odometry alone | error | landmarks | with known identities | weight on the right one | | seconds |
|---|---|---|---|---|---|---|---|\n"
        .to_owned();
    for (name, set, place) in
        [("Victoria Park", Dataset::VictoriaPark, "victoria_park"), ("DLR Spatial Cognition", Dataset::Dlr, "dlr")]
    {
        let Converted { recording, ids, .. } = set.read(&folder.join(place), &Options::default())?;
        let config = SemanticConfig::default();
        let known = map_known(&recording, &ids, &config, &|_| ())?;
        let (found, seconds) = on_one_thread(|| map(&recording, &config, &|_| ()))?;
        let (found, truth) = (found?, known.trajectory());
        let error = |path: &[_]| reference_errors(&truth, path).absolute.map_or(f64::NAN, |absolute| absolute.rmse);
        let reckoned = recording.odometry.dead_reckoning(truth.iter().map(|pose| pose.stamp));
        writeln!(
            table,
            "| {name} | {:.2} | {:.2} | {} | {} | {:.1} % | {} | {seconds:.0} |",
            error(&reckoned),
            error(&found.trajectory()),
            found.landmarks.len(),
            known.landmarks.len(),
            100.0 * right(&shares(&ids, &found.weights), |_| true),
            if found.verdict.is_consistent() { "consistent" } else { "doubtful" },
        )?;
    }
    Ok(table + "\n")
}
