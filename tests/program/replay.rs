//! Recorded runs are read back, run again, verified and compared; a run that is killed leaves what it did.
use ipslam::config::{Config, SlamConfig};
use ipslam::io::carmen::CarmenWriter;
use ipslam::io::map_json;
use ipslam::log::{LogEntry, LogSource};
use ipslam::pipeline::{Continued, RunInfo};
use ipslam::random::{self, Draw};
use ipslam::record::rerun::read::{ReadError, RecordedRun};
use ipslam::record::rerun::{Level, RerunObserver};
use ipslam::report::{Estimator as _, Event, Observer, StepReport};
use ipslam::simulate::Simulation;
use ipslam::slam::Slam;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

fn config() -> SlamConfig {
    SlamConfig { particles: 4, maps: 4, seed: 5, ..SlamConfig::default() }
}

fn info() -> RunInfo {
    RunInfo { log: "building".to_owned(), device: "CPU".to_owned(), config: Config::Slam(config()), continues: None }
}

fn entries(count: usize) -> Vec<LogEntry> {
    Simulation::building(1).open().unwrap().take(count).map(Result::unwrap).collect()
}

/// The same with a turn by a gyroscope before each reading.
fn with_turns(entries: Vec<LogEntry>) -> Vec<LogEntry> {
    let turn = |entry: &LogEntry| {
        entry.is_reading().then(|| LogEntry::Turn { stamp: entry.stamp(), by_gyro: 0.01 * entry.stamp().sin() })
    };
    entries.into_iter().flat_map(|entry| turn(&entry).into_iter().chain([entry])).collect()
}

/// Records a drive.
fn record(path: &Path, level: Level, change: impl Fn(&mut StepReport<'_>)) -> Vec<LogEntry> {
    record_entries(path, level, with_turns(entries(400)), change)
}

/// Records these entries; `change` may lie about a step.
fn record_entries(
    path: &Path,
    level: Level,
    entries: Vec<LogEntry>,
    change: impl Fn(&mut StepReport<'_>),
) -> Vec<LogEntry> {
    let mut observer = RerunObserver::to_file(path, &info(), level).unwrap();
    let mut slam = Slam::new(config());
    for entry in &entries {
        observer.on_event(&Event::Entry(entry));
        slam.add(entry, &mut |event| {
            let Event::Step(report) = event else { return };
            let mut report = StepReport::clone(report);
            change(&mut report);
            observer.on_event(&Event::Step(&report));
        });
    }
    observer.on_event(&Event::Finished { result: &slam.result(), is_smoothed: false });
    assert_eq!(observer.failure(), None);
    entries
}

fn log_of(run: &RecordedRun) -> Vec<LogEntry> {
    LogSource::open(run).unwrap().map(Result::unwrap).collect()
}

fn ipslam(folder: &Path, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_ipslam")).current_dir(folder).args(args).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

#[test]
fn a_recording_holds_the_run() {
    let folder = tempfile::tempdir().unwrap();
    for level in [Level::Light, Level::Full] {
        let path = folder.path().join("run.rrd");
        let entries = record(&path, level, |_| ());
        let run = RecordedRun::open(&path).unwrap();
        assert_eq!(run.store().info, info());
        assert_eq!(run.store().version, env!("CARGO_PKG_VERSION"));
        assert_eq!(run.entries, entries.len() as u64);
        // Any number of times, as every log.
        for _ in 0..2 {
            assert_eq!(log_of(&run), entries, "{level:?}");
        }

        let mut slam = Slam::new(config());
        let mut steps = Vec::new();
        for entry in &entries {
            slam.add(entry, &mut |event| {
                let Event::Step(report) = event else { return };
                steps.push((report.step, report.world_from_robot, report.checksum()));
            });
        }
        assert!(steps.len() > 5, "{}", steps.len());
        let found: Vec<_> = run.steps.iter().map(|step| (step.step, step.world_from_robot, step.checksum)).collect();
        assert_eq!(found, steps);
        assert_eq!(run.result.unwrap().checksum, slam.result().checksum());
        let readings = entries.iter().filter(|entry| entry.is_reading());
        assert_eq!(run.trajectory.len(), readings.count());
    }
}

#[test]
fn a_checksum_sees_every_bit() {
    let mut slam = Slam::new(config());
    let mut seen = 0;
    for entry in entries(60) {
        slam.add(&entry, &mut |event| {
            let Event::Step(report) = *event else { return };
            let is = report.checksum();
            let mut particles = report.particles.to_vec();
            particles[3].weight = f64::from_bits(particles[3].weight.to_bits() ^ 1);
            assert_ne!(StepReport { particles: &particles, ..StepReport::clone(report) }.checksum(), is);
            let mut map = report.map.to_vec();
            if let Some(cluster) = map.last_mut() {
                cluster.mean.y = f64::from_bits(cluster.mean.y.to_bits() ^ 1);
                assert_ne!(StepReport { map: &map, ..StepReport::clone(report) }.checksum(), is);
                seen += 1;
            }
            let parents: Vec<u32> = report.parents.iter().rev().copied().collect();
            assert_ne!(StepReport { parents: &parents, ..StepReport::clone(report) }.checksum(), is);
        });
    }
    assert!(seen > 0);
}

#[test]
fn a_replay_is_the_run_to_the_last_bit() {
    let folder = tempfile::tempdir().unwrap();
    let few = ["--maps", "4", "--particles", "8", "--max-scans", "200", "--backend", "cpu"];
    let done = ipslam(folder.path(), &[&["run", "--record", "run.rrd"], &few[..]].concat());
    assert!(done.status.success(), "{}", text(&done.stderr));
    let done = ipslam(folder.path(), &["replay", "run.rrd", "--verify", "--threads", "1"]);
    assert!(done.status.success(), "{}", text(&done.stderr));
    assert!(text(&done.stdout).contains("identical bit for bit"), "{}", text(&done.stdout));

    // With another seed it is another run: compared, not verified.
    let done = ipslam(folder.path(), &["replay", "run.rrd", "--seed", "9", "--backend", "cpu", "--json"]);
    assert!(done.status.success(), "{}", text(&done.stderr));
    let compared: serde_json::Value = serde_json::from_slice(&done.stdout).unwrap();
    assert_eq!((&compared["recorded"]["seed"], &compared["replayed"]["seed"]), (&1.into(), &9.into()));
    assert!(compared["first_step_that_differs"].is_u64(), "{compared}");
    assert!(compared["trajectories_apart_m"]["max"].as_f64().unwrap() > 0.0, "{compared}");
    let both = folder.path().join("ipslam-out/run-replayed-2/replay.rrd");
    assert!(both.is_file());
    // What lies side by side is no run of its own.
    assert!(matches!(RecordedRun::open(&both), Err(ReadError::NotARecording { .. })));

    let done = ipslam(folder.path(), &["replay", "run.rrd", "--verify", "--seed", "9"]);
    assert_eq!(done.status.code(), Some(2));
}

/// The recording holds the map of the earlier drive, its free area, and where the second drive began.
#[test]
fn a_run_that_continues_is_replayed() {
    let folder = tempfile::tempdir().unwrap();
    let mut writer = CarmenWriter::new(Vec::new());
    entries(400).iter().for_each(|entry| writer.write(entry).unwrap());
    std::fs::write(folder.path().join("drive.clf"), writer.finish().unwrap()).unwrap();
    let few = ["run", "drive.clf", "--maps", "4", "--particles", "8", "--backend", "cpu", "--out"];
    let done = ipslam(folder.path(), &[&few[..], &["one"]].concat());
    assert!(done.status.success(), "{}", text(&done.stderr));
    let continued = ["two", "--continue", "one", "--start", "0,0,0", "--record", "run.rrd"];
    let done = ipslam(folder.path(), &[&few[..], &continued].concat());
    assert!(done.status.success(), "{}", text(&done.stderr));

    let run = RecordedRun::open(&folder.path().join("run.rrd")).unwrap();
    let Continued { map, world_from_robot, .. } = run.store().info.continues.clone().unwrap();
    assert_eq!(map, map_json::read_map(&folder.path().join("one/map.json")).unwrap());
    assert!(map.free.is_some() && world_from_robot.position().coords.norm() < 0.2, "{world_from_robot:?}");

    let done = ipslam(folder.path(), &["replay", "run.rrd", "--verify", "--out", "replayed", "--cell-size", "0.1"]);
    assert!(done.status.success(), "{}", text(&done.stderr));
    assert!(text(&done.stdout).contains("identical bit for bit"), "{}", text(&done.stdout));
    let walls = |out: &str| map_json::read_map(&folder.path().join(out).join("map.json")).unwrap().clusters;
    assert!(walls("two") == walls("replayed") && walls("two") != walls("one"));
    let summary = std::fs::read(folder.path().join("replayed/summary.json")).unwrap();
    let summary: serde_json::Value = serde_json::from_slice(&summary).unwrap();
    assert_eq!(summary["continues"]["map"], "one/map.json");

    // Of several logs each is recorded.
    let both =
        ["drive.clf", "drive.clf", "--max-scans", "40", "--maps", "4", "--particles", "8", "--record", "both.rrd"];
    let done = ipslam(folder.path(), &[&["run"][..], &both].concat());
    assert!(done.status.success(), "{}", text(&done.stderr));
    let continues = ["both.rrd", "both-2.rrd"]
        .map(|name| RecordedRun::open(&folder.path().join(name)).unwrap().store().info.continues.is_some());
    assert_eq!(continues, [false, true]);
}

#[test]
fn a_replay_finds_the_step_that_differs() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.rrd");
    record(&path, Level::Light, |report| {
        if report.step == 4 {
            report.world_from_robot.x += 1e-12;
        }
    });
    let done = ipslam(folder.path(), &["replay", "run.rrd", "--verify"]);
    assert_eq!(done.status.code(), Some(1));
    assert!(text(&done.stderr).contains("step 4: the best particle was at"), "{}", text(&done.stderr));
}

#[test]
fn what_is_no_recording_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("log.rrd"), "ODOM 0 0 0").unwrap();
    for (name, expected) in
        [("log.rrd", "a recording is needed"), ("missing.rrd", "cannot be opened"), (".", "cannot be opened")]
    {
        let done = ipslam(folder.path(), &["replay", name]);
        let error = text(&done.stderr);
        assert!(done.status.code() == Some(1) && error.contains(expected) && error.contains(name), "{error}");
    }
}

/// Bits that flip, bytes that are overwritten, an end that is missing: what can be read is read, and the rest is an error.
#[test]
fn any_damage_is_survived() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.rrd");
    record_entries(&path, Level::Light, entries(40), |_| ());
    let whole = std::fs::read(&path).unwrap();
    let (mut read, mut refused) = (0, 0);
    for trial in 0..150 {
        let [place, what, ..] = random::bits(6, 0, trial, Draw::Motion);
        let place = place as usize % whole.len();
        let mut bytes = whole.clone();
        match trial % 3 {
            0 => bytes[place] ^= 1 << (what % 8),
            1 => bytes.truncate(place),
            _ => bytes[place..].iter_mut().zip(what.to_le_bytes()).for_each(|(byte, new)| *byte = new),
        }
        std::fs::write(&path, bytes).unwrap();
        match RecordedRun::open(&path) {
            Ok(run) => {
                let readable = LogSource::open(&run).unwrap().filter(Result::is_ok).count();
                assert_eq!(readable as u64, run.entries, "trial {trial}");
                read += 1;
            }
            Err(error) => {
                assert!(error.to_string().contains("run.rrd"), "trial {trial}: {error}");
                refused += 1;
            }
        }
    }
    println!("{read} were read, {refused} refused");
    assert!(read > 10 && refused > 10, "{read} were read, {refused} refused");
}

/// Records steps until it is killed.
#[test]
#[ignore = "started by a_killed_run_leaves_all_but_its_last_second"]
fn child_that_records() {
    let Ok(path) = std::env::var("IPSLAM_TEST_RECORD_TO") else { return };
    let mut observer = RerunObserver::to_file(Path::new(&path), &info(), Level::Light).unwrap();
    let mut slam = Slam::new(config());
    for entry in entries(5000) {
        observer.on_event(&Event::Entry(&entry));
        slam.add(&entry, &mut |event| observer.on_event(event));
        println!("\nentry");
        std::thread::sleep(Duration::from_millis(5));
    }
}

#[test]
fn a_killed_run_leaves_all_but_its_last_second() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.rrd");
    let mut child = Command::new(std::env::current_exe().unwrap())
        .args(["replay::child_that_records", "--exact", "--ignored", "--nocapture"])
        .env("IPSLAM_TEST_RECORD_TO", &path)
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut times = Vec::new();
    for line in BufReader::new(child.stdout.take().unwrap()).lines() {
        if line.unwrap() == "entry" {
            times.push(Instant::now());
        }
        if times.len() == 600 {
            break;
        }
    }
    // SIGKILL on Unix: the child has no chance to end its file.
    child.kill().unwrap();
    let killed = Instant::now();
    child.wait().unwrap();
    assert_eq!(times.len(), 600);
    let run = RecordedRun::open(&path).unwrap();
    let due = times.iter().filter(|time| killed - **time > Duration::from_secs(1)).count();
    println!("{} entries were recorded, {due} were due", run.entries);
    assert!(due > 100 && run.entries >= due as u64, "{} entries, {due} were due", run.entries);
    assert_eq!(log_of(&run), entries(run.entries as usize));
    assert!(run.result.is_none() && run.steps.len() > 3);
    let done = ipslam(folder.path(), &["replay", "run.rrd", "--verify"]);
    assert!(done.status.success(), "{}", text(&done.stderr));
    assert!(text(&done.stdout).contains("breaks off"), "{}", text(&done.stdout));
}
