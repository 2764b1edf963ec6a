//! The program from outside: each test starts it in a fresh directory.

use assert_cmd::cargo::cargo_bin;
use ipslam::io::carmen::{CarmenLog, CarmenWriter};
use ipslam::io::{map_json, map_server, tum};
use ipslam::log::{LogEntry, LogSource as _};
use ipslam::map::LineMap;
use ipslam::metrics::trajectory::reference_errors;
use ipslam::ppca::Cluster;
use ipslam::simulate::{Simulation, SimulationConfig, building};
use serde_json::Value;
use std::io::Read as _;
use std::path::PathBuf;
use std::process::{Command, Output};
use tempfile::TempDir;

const SEED: u64 = 3;
const FEW: [&str; 4] = ["--maps", "4", "--particles", "4"];
const OUTPUTS: [&str; 15] = [
    "config.toml",
    "figure3_odometry_map.png",
    "figure4a_trajectory.png",
    "figure4b_clusters.png",
    "figure4c_points.png",
    "figure4d_reprojected.png",
    "map.json",
    "map.pgm",
    "map.png",
    "map.svg",
    "map.yaml",
    "poses.csv",
    "summary.json",
    "trajectory.tum",
    "walls.geojson",
];

/// A directory with the program in it.
struct Place {
    folder: TempDir,
}

impl Place {
    fn new() -> Self {
        Self { folder: tempfile::tempdir().unwrap() }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn write(&self, name: &str, bytes: impl AsRef<[u8]>) {
        std::fs::write(self.path(name), bytes).unwrap();
    }

    fn command(&self, words: &[&str]) -> Command {
        let mut command = Command::new(cargo_bin("ipslam"));
        // Graphics drivers complain where a session has no such folder.
        command.current_dir(self.folder.path()).env("XDG_RUNTIME_DIR", self.folder.path()).args(words);
        command
    }

    fn ipslam(&self, words: &[&str]) -> Done {
        Done::new(self.command(words).output().unwrap())
    }

    /// `run` with few particles.
    fn run(&self, words: &[&str]) -> Done {
        self.ipslam(&[&["run"], &FEW[..], words].concat())
    }

    fn summary(&self, folder: &str) -> Value {
        serde_json::from_slice(&std::fs::read(self.path(folder).join("summary.json")).unwrap()).unwrap()
    }

    fn warnings(&self, folder: &str) -> String {
        self.summary(folder)["warnings"].to_string()
    }

    /// Every output is there, none besides, and each is what its name says.
    fn assert_outputs(&self, folder: &str) {
        let folder = self.path(folder);
        let mut names: Vec<_> =
            std::fs::read_dir(&folder).unwrap().map(|file| file.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        assert_eq!(names, OUTPUTS);
        for name in names.iter().filter(|name| name.ends_with(".png")) {
            let png = std::fs::read(folder.join(name)).unwrap();
            let pixels = resvg::tiny_skia::Pixmap::decode_png(&png).unwrap();
            let coloured = pixels.pixels().iter().filter(|p| (p.red(), p.green(), p.blue()) != (255, 255, 255)).count();
            assert!(coloured > 1000, "{name} has only {coloured} pixels that are not white");
        }
        assert!(std::fs::read_to_string(folder.join("map.svg")).unwrap().starts_with("<svg"));
        map_json::read_map(&folder.join("map.json")).unwrap();
        tum::read(&folder.join("trajectory.tum")).unwrap();
    }
}

/// What the program left.
struct Done {
    code: Option<i32>,
    out: String,
    err: String,
}

impl Done {
    fn new(output: Output) -> Self {
        let text = |bytes| String::from_utf8(bytes).unwrap();
        Self { code: output.status.code(), out: text(output.stdout), err: text(output.stderr) }
    }

    #[track_caller]
    fn ended(&self, code: i32) -> &Self {
        assert_eq!(self.code, Some(code), "stdout:\n{}\nstderr:\n{}", self.out, self.err);
        self
    }

    /// One error, and it holds these words.
    #[track_caller]
    fn failed(&self, code: i32, words: &[&str]) {
        self.ended(code);
        assert_eq!(self.err.matches("error:").count(), 1, "{}", self.err);
        assert!(!self.err.contains("panicked"), "{}", self.err);
        let error = &self.err[self.err.find("error:").unwrap()..];
        for word in words {
            assert!(error.contains(word), "{word:?} is not in: {error}");
        }
    }
}

/// A drive of so many seconds, and its log as text.
fn drive(seconds: f64) -> (Simulation, String) {
    let config = SimulationConfig { seed: SEED, duration: Some(seconds), ..SimulationConfig::default() };
    let simulation = Simulation::new("drive".to_owned(), building(), config).unwrap();
    let mut writer = CarmenWriter::new(Vec::new());
    for entry in simulation.open().unwrap() {
        let mut entry = entry.unwrap();
        if let LogEntry::Laser(reading) = &mut entry {
            // Only what has no maximum range is written as FLASER, which these tests edit.
            reading.max_range = f64::INFINITY;
        }
        writer.write(&entry).unwrap();
    }
    let text = String::from_utf8(writer.finish().unwrap()).unwrap();
    (simulation, text)
}

/// The lines of a log that `keep` returns something for, changed to it.
fn edited(text: &str, mut edit: impl FnMut(usize, &str) -> Option<String>) -> String {
    text.lines().enumerate().filter_map(|(index, line)| edit(index, line)).map(|line| line + "\n").collect()
}

/// The messages of a log that were stamped between two times.
fn between(text: &str, from: f64, to: f64) -> String {
    let stamp = |line: &str| line.rsplit(' ').nth(2).and_then(|word| word.parse::<f64>().ok());
    edited(text, |_, line| stamp(line).is_none_or(|stamp| (from..to).contains(&stamp)).then(|| line.to_owned()))
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut packed = Vec::new();
    flate2::bufread::GzEncoder::new(bytes, flate2::Compression::fast()).read_to_end(&mut packed).unwrap();
    packed
}

#[test]
fn a_run_writes_all_that_it_promises() {
    let place = Place::new();
    let (simulation, text) = drive(6.0);
    place.write("drive.log.gz", gzip(text.as_bytes()));
    let done = place.run(&["drive.log.gz", "--backend", "cpu"]);
    done.ended(0);
    assert_eq!(done.err, "mapping drive: 4 particles in 4 maps on the CPU\noutputs are in ipslam-out/drive\n");
    place.assert_outputs("ipslam-out/drive");

    // One pose for each reading, with its stamp.
    let stamps: Vec<f64> = simulation
        .open()
        .unwrap()
        .filter_map(|entry| match entry.unwrap() {
            LogEntry::Odometry { stamp, .. } => Some(stamp),
            LogEntry::Laser(reading) => Some(reading.stamp),
            LogEntry::Turn { .. } | LogEntry::Truth { .. } => None,
        })
        .collect();
    let trajectory = tum::read(&place.path("ipslam-out/drive/trajectory.tum")).unwrap();
    assert_eq!(trajectory.iter().map(|pose| pose.stamp).collect::<Vec<_>>(), stamps);

    let summary = place.summary("ipslam-out/drive");
    let number = |pointer: &str| summary.pointer(pointer).and_then(Value::as_f64).expect(pointer);
    let clusters = map_json::read_map(&place.path("ipslam-out/drive/map.json")).unwrap().clusters.len();
    let json_bytes = std::fs::metadata(place.path("ipslam-out/drive/map.json")).unwrap().len();
    assert!(clusters > 5, "{clusters} clusters");
    for (pointer, expected) in [
        ("/beams/scans", simulation.sweeps() as f64),
        ("/log/stats/laser", simulation.sweeps() as f64),
        ("/log/duration_s", 6.0),
        ("/map/clusters", clusters as f64),
        ("/map/numbers", 5.0 * clusters as f64),
        ("/map/numbers_of_points", 2.0 * number("/beams/points")),
        ("/map/share_of_points", 2.5 * clusters as f64 / number("/beams/points")),
        ("/map/json_bytes", json_bytes as f64),
        ("/configuration/particles", 4.0),
        ("/seed", 1.0),
    ] {
        assert!((number(pointer) - expected).abs() < 1e-9, "{pointer} is {}, not {expected}", number(pointer));
    }
    let beams = number("/beams/points") + number("/beams/no_return") + number("/beams/invalid");
    assert_eq!(beams, simulation.sweeps() as f64 * simulation.config().laser.beams as f64);
    let [mean, worst] = ["mean", "worst"].map(|name| number(&format!("/filter/effective_sample_size/{name}")));
    assert!((1.0..=4.0).contains(&worst) && (worst..=4.0).contains(&mean), "{worst} {mean}");
    assert_eq!(place.warnings("ipslam-out/drive"), "[]");
    for words in ["31 scans in 6.0 s", "4 particles in 4 maps, seed 1", "times real time", "absolute (ATE)"] {
        assert!(done.out.contains(words), "{words:?} is not in\n{}", done.out);
    }
    if cfg!(target_os = "linux") {
        assert!(number("/peak_memory_bytes") > 1e6);
    }
}

#[test]
fn without_a_log_the_building_is_mapped_near_the_truth() {
    let place = Place::new();
    let done = place.ipslam(&["run", "--maps", "10", "--particles", "10", "--max-scans", "300"]);
    done.ended(0);
    place.assert_outputs("ipslam-out/building");
    let trajectory = tum::read(&place.path("ipslam-out/building/trajectory.tum")).unwrap();
    let truth: Vec<_> = Simulation::building(1).truth().take(299).collect();
    let rmse = reference_errors(&truth, &trajectory).absolute.unwrap().rmse;
    // The laser errs by a centimetre or so; odometry alone by far more, which the same measure has to see.
    assert!(rmse < 0.1, "{rmse} m");
    let odometry: Vec<_> = Simulation::building(1)
        .open()
        .unwrap()
        .filter_map(|entry| match entry.unwrap() {
            LogEntry::Odometry { stamp, odom_from_robot: pose } => Some(ipslam::geometry::StampedPose { stamp, pose }),
            _ => None,
        })
        .take(600)
        .collect();
    let of_odometry = reference_errors(&truth, &odometry).absolute.unwrap().rmse;
    assert!(of_odometry > 2.0 * rmse, "{of_odometry} m by odometry, {rmse} m by the filter");
    let told = place.summary("ipslam-out/building")["metrics"]["reference"]["ate"]["translation_m"]["rmse"].as_f64();
    assert!((told.unwrap() - rmse).abs() < 1e-3, "{told:?} is told, {rmse} is so");
    assert!(place.warnings("ipslam-out/building").contains("ended after 300 scans"));
}

/// The walls are along the axes, and the robot still begins at the origin.
#[test]
fn a_building_is_turned_square() {
    let place = Place::new();
    // The log begins where the robot looks askew.
    let (simulation, text) = drive(20.0);
    let is_askew = |heading: f64| (4.0 * heading).sin() > 0.8;
    let start = simulation.truth().find(|truth| is_askew(truth.pose.heading)).unwrap().stamp;
    place.write("drive.log", between(&text, start, 20.0));
    for (words, folder) in [(&[][..], "plain"), (&["--align"], "square")] {
        place.run(&[&["drive.log", "--out", folder], words].concat()).ended(0);
    }
    let [plain, square] = ["plain", "square"].map(|folder| {
        let map = map_json::read_map(&place.path(folder).join("map.json")).unwrap();
        (map.main_direction(), tum::read(&place.path(folder).join("trajectory.tum")).unwrap())
    });
    assert!(square.0.abs() < 1e-6 && plain.0.abs() > 0.1, "{} rad, {} rad before", square.0, plain.0);
    for (a, b) in plain.1.iter().zip(&square.1) {
        let off = (ipslam::geometry::Pose::new(0.0, 0.0, -plain.0) * a.pose).seen_from(b.pose);
        assert!(off.x.hypot(off.y) < 1e-6 && off.heading.abs() < 1e-6, "{a:?} {b:?}");
    }
}

#[test]
fn the_trajectory_does_not_jump_at_the_first_scan() {
    let place = Place::new();
    let (_, text) = drive(2.0);
    place.write("drive.log", text);
    place.run(&["drive.log", "--out", "out"]).ended(0);
    let trajectory = tum::read(&place.path("out/trajectory.tum")).unwrap();
    for pair in trajectory.windows(2) {
        let jump = (pair[1].pose.position() - pair[0].pose.position()).norm();
        assert!(jump < 0.5, "{jump} m at {} s", pair[0].stamp);
    }
}

#[test]
fn threads_do_not_matter_and_seeds_do() {
    let place = Place::new();
    place.write("drive.log", drive(8.0).1);
    let trajectory = |folder: &str, words: &[&str]| {
        place.run(&[&["drive.log", "--out", folder], words].concat()).ended(0);
        std::fs::read(place.path(folder).join("trajectory.tum")).unwrap()
    };
    let one = trajectory("one", &["--threads", "1"]);
    assert!(one == trajectory("two", &["--threads", "2"]), "2 threads give another trajectory");
    assert!(one != trajectory("other", &["--seed", "2"]), "another seed gives the same trajectory");
    // What a run wrote of its configuration repeats it.
    place.ipslam(&["run", "drive.log", "--out", "again", "--config", "one/config.toml"]).ended(0);
    assert!(one == std::fs::read(place.path("again/trajectory.tum")).unwrap());
}

#[test]
fn options_win_over_the_file_and_the_file_over_the_preset() {
    let place = Place::new();
    place.write("drive.log", drive(1.0).1);
    place.write("my.toml", "particles = 6\nmaps = 6\nseed = 7\n[filter]\ntemper = 0.25\n");
    let words = ["run", "drive.log", "--preset", "paper", "--config", "my.toml", "--maps", "2", "--max-scans", "3"];
    place.ipslam(&[&words[..], &["--cell-size", "0.1"]].concat()).ended(0);
    let grid = std::fs::read_to_string(place.path("ipslam-out/drive/map.yaml")).unwrap();
    assert!(grid.contains("resolution: 0.1\n"), "{grid}");
    let summary = place.summary("ipslam-out/drive");
    let configuration = &summary["configuration"];
    let found = [&configuration["particles"], &configuration["maps"], &configuration["seed"]].map(Value::as_u64);
    assert_eq!(found, [Some(2), Some(2), Some(7)], "one pose a map, as in the file");
    assert_eq!(configuration["filter"]["temper"], 0.25);
    assert_eq!(configuration["ablation"]["matching"], "paper", "the preset's");
    assert_eq!(configuration["clustering"]["max_gap"], "inf", "the preset's");
    assert_eq!(summary["beams"]["scans"], 3);
}

#[test]
fn wrong_usage_ends_with_2() {
    let place = Place::new();
    place.write("key.toml", "[filter]\nresample_bellow = 0.5\n");
    place.write("value.toml", "[filter]\ntemper = -1\n");
    place.write("nan.toml", "[motion]\nheading_floor = nan\n");
    place.write("type.toml", "seed = \"one\"\n");
    place.write("binary.toml", "\u{1}\u{2}");
    let cases: [(&[&str], &[&str]); 21] = [
        (&["run", "--particles", "0"], &["--particles", "1 to 10000000"]),
        (&["run", "--particles", "-5"], &["--particles"]),
        (&["run", "--particles", "20000000", "--maps", "1"], &["--particles", "1 to 10000000"]),
        (&["run", "--particles", "99999999999999999999"], &["--particles"]),
        (&["run", "--maps", "0"], &["--maps", "1 to the number of particles"]),
        (&["run", "--maps", "8", "--particles", "4"], &["--maps", "which is 4"]),
        (&["run", "--maps", "4", "--particles", "10"], &["--particles", "8 or 12"]),
        (&["run", "--threads", "100000"], &["--threads", "1024"]),
        (&["run", "--threads", "-1"], &["--threads"]),
        (&["run", "--seed", "18446744073709551615"], &["--seed", "at most 9223372036854775807"]),
        (&["run", "--seed", "-1"], &["--seed"]),
        (&["run", "--max-scans", "0"], &["--max-scans"]),
        (&["run", "--cell-size", "0"], &["--cell-size", "0.001 to 10"]),
        (&["run", "--preset", "best"], &["--preset", "paper"]),
        (&["run", "--config", "key.toml"], &["key.toml", "line 2", "resample_bellow", "resample_below"]),
        (&["run", "--config", "value.toml"], &["filter.temper is -1"]),
        (&["run", "--config", "nan.toml"], &["motion.heading_floor is NaN"]),
        (&["run", "--config", "type.toml"], &["type.toml", "line 1", "seed"]),
        (&["run", "--config", "binary.toml"], &["binary.toml", "line 1"]),
        (&["run", "--colour"], &["--colour"]),
        (&["walk"], &["walk"]),
    ];
    for (words, expected) in cases {
        place.ipslam(words).failed(2, expected);
    }
    assert!(!place.path("ipslam-out").exists(), "wrong usage made a folder");
    let help = place.ipslam(&["run", "--help"]);
    help.ended(0);
    for words in ["Exit codes", "130  interrupted", "--relations <FILE>", "--connect[=<URL>]"] {
        assert!(help.out.contains(words), "{words:?} is not in\n{}", help.out);
    }
}

#[test]
fn what_is_no_log_is_told() {
    let place = Place::new();
    std::fs::create_dir(place.path("folder")).unwrap();
    place.write("empty.log", "");
    place.write("photo.jpg", [&b"\xff\xd8\xff\xe0\x00\x10JFIF\x00\x01"[..], &[0x80; 4096]].concat());
    place.write("odometry.log", edited(&drive(2.0).1, |_, line| line.starts_with("ODOM").then(|| line.to_owned())));
    place.write("few.log", "FLASER 5 1 2 3 0 0 0 0 0 0 1 host 1\n");
    let cases: [(&[&str], &[&str]); 8] = [
        (&["missing.log"], &["missing.log: cannot be opened"]),
        (&["folder"], &["folder: cannot be opened", "name a log file inside"]),
        (&["empty.log"], &["empty.log", "the file is empty", "CARMEN"]),
        (&["photo.jpg"], &["photo.jpg", "no CARMEN message", "convert"]),
        (&["odometry.log"], &["odometry.log: no laser reading"]),
        (&["few.log"], &["few.log: no laser reading", "malformed lines: 1; the first one: few.log:1"]),
        (&["odometry.log", "--reference", "missing.tum"], &["missing.tum: cannot be opened"]),
        (&["odometry.log", "--relations", "photo.jpg"], &["photo.jpg", "8 columns"]),
    ];
    std::fs::create_dir(place.path("mine")).unwrap();
    for (words, expected) in cases {
        place.run(words).failed(1, expected);
        place.run(&[words, &["--out", "mine"]].concat()).failed(1, expected);
    }
    assert!(!place.path("ipslam-out").exists(), "a log that is refused leaves a folder");
    assert!(place.path("mine").read_dir().unwrap().next().is_none(), "a folder that was there before is changed");
}

/// A folder of its own for each run, or the user's word.
#[test]
fn a_finished_run_is_not_lost() {
    let place = Place::new();
    place.write("drive.log", drive(1.0).1);
    let seeds = |folder: &str| place.summary(folder)["seed"].as_u64().unwrap();
    for seed in ["1", "2", "3"] {
        place.run(&["drive.log", "--seed", seed]).ended(0);
    }
    assert_eq!(["ipslam-out/drive", "ipslam-out/drive-2", "ipslam-out/drive-3"].map(seeds), [1, 2, 3]);
    place.run(&["drive.log", "--seed", "4", "--force"]).ended(0);
    assert_eq!(["ipslam-out/drive", "ipslam-out/drive-2"].map(seeds), [4, 2]);
    place.run(&["drive.log", "--seed", "5", "--out", "ipslam-out/drive"]).failed(2, &["ipslam-out/drive", "--force"]);
    let localize =
        ["localize", "ipslam-out/drive/map.json", "drive.log", "--out", "ipslam-out/drive", "--max-particles", "100"];
    place.ipslam(&localize).failed(2, &["holds a finished run", "--force"]);
    assert_eq!(seeds("ipslam-out/drive"), 4);
    place.run(&["drive.log", "--seed", "5", "--out", "ipslam-out/drive", "--force"]).ended(0);
    assert_eq!(seeds("ipslam-out/drive"), 5);

    let simulate = ["simulate", "--out", "sim", "--duration", "1", "--seed", "7"];
    place.ipslam(&simulate).ended(0);
    let before = std::fs::read(place.path("sim/building-seed7.log")).unwrap();
    let other = [&simulate[..], &["--beams", "90"]].concat();
    place.ipslam(&other).failed(2, &["sim/building-seed7.log", "--force"]);
    assert!(std::fs::read(place.path("sim/building-seed7.log")).unwrap() == before);
    place.ipslam(&[&other[..], &["--force"]].concat()).ended(0);
    assert!(std::fs::read(place.path("sim/building-seed7.log")).unwrap() != before);
}

#[test]
fn a_log_that_breaks_off_is_mapped_up_to_there() {
    let place = Place::new();
    let packed = gzip(drive(8.0).1.as_bytes());
    place.write("cut.log.gz", &packed[..packed.len() / 2]);
    let done = place.run(&["cut.log.gz", "--out", "out"]);
    done.failed(1, &["cut.log.gz", "reading broke off", "is the file complete?"]);
    place.assert_outputs("out");
    let scans = place.summary("out")["beams"]["scans"].as_u64().unwrap();
    assert!((5..41).contains(&scans), "{scans} scans");
    assert!(place.warnings("out").contains("the log breaks off"));
}

#[test]
fn damaged_lines_are_left_out_and_counted() {
    let place = Place::new();
    let (_, text) = drive(4.0);
    let mut laser = 0;
    let damaged = edited(&text, |_, line| {
        if !line.starts_with("FLASER") {
            return Some(line.to_owned());
        }
        laser += 1;
        match laser {
            // Cut in the middle, as by a full disk; a count that is not that of the ranges.
            3 => Some(line[..line.len() / 2].to_owned()),
            5 => Some(line.replacen(" 361 ", " 360 ", 1)),
            // No return in any beam, and ranges that are no numbers.
            7 => Some(with_ranges(line, |_| "81.91".to_owned())),
            9 => Some(with_ranges(line, |beam| ["nan", "inf", "-1", "-inf", "1e300"][beam % 5].to_owned())),
            _ => Some(line.to_owned()),
        }
    });
    assert!(laser > 10, "{laser} laser readings; is the log still written as FLASER?");
    place.write("damaged.log", damaged);
    let printed = place.run(&["damaged.log", "--out", "out", "--json"]);
    printed.ended(0);
    place.assert_outputs("out");
    let summary = place.summary("out");
    assert_eq!(serde_json::from_str::<Value>(&printed.out).unwrap(), summary);
    assert_eq!(summary["beams"]["scans"], laser - 2);
    assert_eq!(summary["beams"]["scans_without_points"], 2);
    assert_eq!(summary["log"]["stats"]["malformed"], 2);
    let warnings = place.warnings("out");
    for words in [
        "malformed lines left out: 2; ",
        "the first one: damaged.log:",
        &format!("scans without a point: 2 of {}", laser - 2),
    ] {
        assert!(warnings.contains(words), "{words:?} is not in {warnings}");
    }
}

/// A line of FLASER with other ranges.
fn with_ranges(line: &str, range: impl Fn(usize) -> String) -> String {
    let mut words: Vec<String> = line.split(' ').map(str::to_owned).collect();
    let beams: usize = words[1].parse().unwrap();
    words[2..2 + beams].iter_mut().enumerate().for_each(|(beam, word)| *word = range(beam));
    words.join(" ")
}

#[test]
fn strange_logs_are_mapped_with_a_warning() {
    let place = Place::new();
    let (_, text) = drive(3.0);
    let flaser = |line: &str| line.starts_with("FLASER").then(|| line.to_owned());
    let raw = |line: &str| {
        if !line.starts_with("FLASER") {
            return None;
        }
        // `FLASER n ranges..., two poses, stamp, host, stamp` without its poses, and with the angles that it implied.
        let words: Vec<&str> = line.split(' ').collect();
        let (beams, tail) = (words[1].parse::<usize>().unwrap(), words.len() - 3);
        let (ranges, tail) = (words[2..2 + beams].join(" "), words[tail..].join(" "));
        Some(format!("RAWLASER1 0 -1.5707963 3.1415926 0.00872665 80 0.01 0 {beams} {ranges} 0 {tail}"))
    };
    let first = |text: String| text.lines().next().unwrap().to_owned() + "\n";
    let backwards = edited(&text, |index, line| {
        let swap = |line: &str| line.rsplitn(4, ' ').nth(3).map(|start| format!("{start} 0.0 host 0.0"));
        if index == 20 { swap(line) } else { Some(line.to_owned()) }
    });
    for (name, log, expected) in [
        ("one", first(edited(&text, |_, line| flaser(line))), "one scan only"),
        ("no-odometry", edited(&text, |_, line| raw(line)), "no odometry at all"),
        (
            "blind",
            edited(&text, |_, line| Some(with_ranges(&flaser(line)?, |_| "90".to_owned()))),
            "scans without a point: 16 of 16",
        ),
        ("backwards", backwards, "stamps that go backwards: 1;"),
        ("laser-only", edited(&text, |_, line| flaser(line)), ""),
    ] {
        place.write(&format!("{name}.log"), log);
        place.run(&[&format!("{name}.log"), "--out", name]).ended(0);
        place.assert_outputs(name);
        let warnings = place.warnings(name);
        if expected.is_empty() {
            assert_eq!(warnings, "[]", "{name}");
        }
        assert!(warnings.contains(expected), "{name}: {expected:?} is not in {warnings}");
    }
}

#[test]
fn truth_is_scored() {
    let place = Place::new();
    let (simulation, text) = drive(8.0);
    place.write("drive.log", text);
    let truth: Vec<_> = simulation.truth().collect();
    tum::write(&place.path("truth.tum"), &truth).unwrap();
    let motion = truth[30].pose.seen_from(truth[5].pose);
    let relation =
        format!("{} {} {} {} 0 0 0 {}\n", truth[5].stamp, truth[30].stamp, motion.x, motion.y, motion.heading);
    place.write("drive.relations", relation);
    place.write("later.tum", "1000 1 2 3\n1001 1 2 3\n");
    let words = ["drive.log", "--out", "out", "--reference", "truth.tum", "--relations", "drive.relations"];
    place.run(&words).ended(0);
    let metrics = &place.summary("out")["metrics"];
    let error = metrics["relations"]["all"]["translation_m"]["mean"].as_f64().unwrap();
    assert!(error > 0.0 && error < 0.3, "{error} m");
    assert_eq!(metrics["reference"]["unmatched"], 0);

    place.run(&["drive.log", "--out", "late", "--reference", "later.tum"]).ended(0);
    assert!(place.warnings("late").contains("no stamp finds a pose"));
}

#[test]
fn a_place_for_outputs_is_tried_first() {
    let place = Place::new();
    place.write("drive.log", drive(1.0).1);
    place.write("file", "");
    let mut cases = vec!["file", "file/below"];
    if cfg!(target_os = "linux") {
        cases.push("/proc/ipslam");
    }
    for out in cases {
        let done = place.run(&["drive.log", "--out", out]);
        done.failed(1, &[out, "--out"]);
        assert!(!done.err.contains("mapping"), "the run began: {}", done.err);
    }
}

/// Slowly through a pipe: the map is that of the file. A signal ends the log, and what came until then is mapped.
#[cfg(unix)]
#[test]
fn a_log_is_mapped_as_it_comes() {
    use std::io::Write as _;
    use std::process::Stdio;
    let place = Place::new();
    let (_, text) = drive(6.0);
    place.write("drive.log", &text);
    place.run(&["drive.log", "--backend", "cpu"]).ended(0);
    let piped = |out: &str| {
        let words = [&["run", "-", "--backend", "cpu", "--out", out][..], &FEW[..]].concat();
        let mut command = place.command(&words);
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
    };
    let mut child = piped("piped");
    let mut pipe = child.stdin.take().unwrap();
    for piece in text.as_bytes().chunks(text.len() / 10) {
        pipe.write_all(piece).unwrap();
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    drop(pipe);
    Done::new(child.wait_with_output().unwrap()).ended(0);
    place.assert_outputs("piped");
    let trajectory = |folder: &str| std::fs::read(place.path(folder).join("trajectory.tum")).unwrap();
    assert!(trajectory("piped") == trajectory("ipslam-out/drive"));

    let mut child = piped("stopped");
    let mut pipe = child.stdin.take().unwrap();
    pipe.write_all(&text.as_bytes()[..text.len() / 2]).unwrap();
    std::thread::sleep(std::time::Duration::from_secs(1));
    let kill = Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(kill.success());
    Done::new(child.wait_with_output().unwrap()).ended(130);
    drop(pipe);
    place.assert_outputs("stopped");
    let scans = place.summary("stopped")["beams"]["scans"].as_u64().unwrap();
    assert!((1..=16).contains(&scans), "{scans} of 31 scans");
}

/// From a pipe a log becomes what it becomes from a file.
#[test]
fn a_log_is_converted_from_a_pipe() {
    use std::io::Write as _;
    use std::process::Stdio;
    let place = Place::new();
    let (_, text) = drive(2.0);
    place.write("drive.log", &text);
    place.ipslam(&["convert", "drive.log", "file.clf"]).ended(0);
    let piped = |output: &str| {
        let mut command = place.command(&["convert", "-", output]);
        let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        // Who refuses the output does not read.
        let _ = child.stdin.take().unwrap().write_all(text.as_bytes());
        Done::new(child.wait_with_output().unwrap())
    };
    piped("piped.clf").ended(0);
    let read = |name: &str| std::fs::read_to_string(place.path(name)).unwrap();
    assert!(read("piped.clf") == read("file.clf") && read("piped.clf").contains("FLASER"));
    piped("map.json").failed(2, &["- would be read as a log"]);
}

#[cfg(unix)]
#[test]
fn an_interrupted_run_writes_what_it_has() {
    use std::io::{BufRead as _, BufReader};
    let place = Place::new();
    let mut child = place
        .command(&["run", "--out", "out", "--maps", "100", "--particles", "100"])
        .stdout(std::process::Stdio::null())
        .stderr(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(child.stderr.take().unwrap()).lines();
    assert!(lines.next().unwrap().unwrap().starts_with("mapping building"));
    std::thread::sleep(std::time::Duration::from_millis(500));
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    let rest: Vec<String> = lines.map(Result::unwrap).collect();
    assert_eq!(child.wait().unwrap().code(), Some(130), "{rest:?}");
    assert!(rest[0].starts_with("interrupted") && rest.len() == 2, "{rest:?}");
    place.assert_outputs("out");
    let summary = place.summary("out");
    assert_eq!(summary["log"]["ended_by"], "interrupt");
    let scans = summary["beams"]["scans"].as_u64().unwrap();
    assert!((1..1532).contains(&scans), "{scans} scans");
}

#[cfg(not(feature = "record"))]
#[test]
fn recording_asks_for_its_feature() {
    let place = Place::new();
    for option in ["--record=run.rrd", "--connect", "--connect=rerun+http://127.0.0.1:9876/proxy"] {
        place.run(&[option]).failed(1, &["--features record"]);
    }
}

#[test]
fn the_commands_fit_together() {
    let place = Place::new();
    place.ipslam(&["simulate", "--out", "sim", "--duration", "5"]).ended(0);
    place.run(&["sim/building-seed1.log"]).ended(0);
    let trajectory = "ipslam-out/building-seed1/trajectory.tum";
    let done = place.ipslam(&["eval", trajectory, "--reference", "sim/building-seed1.truth.tum", "--json"]);
    done.ended(0);
    let scores: Value = serde_json::from_str(&done.out).unwrap();
    assert!(scores["reference"]["ate"]["translation_m"]["rmse"].as_f64().unwrap() < 0.3);
    place.ipslam(&["eval", "missing.tum", "--reference", "missing.tum"]).failed(1, &["missing.tum: cannot be opened"]);
    place.ipslam(&["simulate", "--out", "sim", "--beams", "0"]).failed(2, &["beams"]);
}

#[test]
fn a_backend_that_cannot_be_is_an_error() {
    let place = Place::new();
    place.run(&["--backend", "cuda"]).ended(2);
    place.run(&["--max-scans", "2", "--backend", "gpu", "--adapter", "no such thing"]).failed(1, &["no"]);
    place.run(&["--max-scans", "2", "--adapter", "no such thing"]).failed(1, &["no"]);
    let nothing_mapped = !place.path("ipslam-out/building/trajectory.tum").exists();
    assert!(nothing_mapped, "a run without its device went on");
}

/// Whatever there is, the run goes on, says where, and tells the same in its summary.
#[test]
fn the_backend_is_told() {
    let place = Place::new();
    let done = place.run(&["--max-scans", "40"]);
    done.ended(0);
    let device = place.summary("ipslam-out/building")["device"].as_str().unwrap().to_owned();
    assert!(
        done.err.contains(&format!("on the {device}\n")) && done.out.contains(&device),
        "{}\n{}",
        done.err,
        done.out
    );
}

/// What the table of a short run has to hold; with devices, each has its row.
#[test]
fn bench_prints_a_row_for_every_size() {
    let place = Place::new();
    let done = place.ipslam(&["bench", "--particles", "100,200", "--points", "90", "--clusters", "50"]);
    done.ended(0);
    for size in ["100     90       50  CPU", "200     90       50  CPU"] {
        assert!(done.out.contains(size), "{}", done.out);
    }
    place.ipslam(&["bench", "--particles", "0"]).ended(2);
    // Nothing but JSON comes out with `--json`.
    let done = place.ipslam(&["bench", "--particles", "100", "--points", "90", "--clusters", "50", "--json"]);
    let found: Value = serde_json::from_str(&done.ended(0).out).unwrap();
    assert!(found["cpu"]["peak_flop_a_second"].as_f64() > Some(1e6), "{found}");
    let rows = found["rows"].as_array().unwrap();
    assert!(rows.iter().all(|row| row["particles"] == 100 && row["seconds"].as_f64() > Some(0.0)), "{found}");
    assert_eq!(rows.iter().filter(|row| row["device"] == "CPU" && row["times_cpu"] == 1.0).count(), 1, "{found}");
}

#[cfg(feature = "gpu")]
#[test]
fn devices_are_listed_and_tested() {
    use ipslam::gpu::device::adapters;
    let done = Place::new().ipslam(&["devices"]);
    let adapters = adapters();
    if adapters.is_empty() {
        return done.failed(1, &["install", "mesa-vulkan-drivers"]);
    }
    done.ended(0);
    assert!(adapters.iter().all(|adapter| done.out.contains(&adapter.name)), "{}", done.out);
    assert_eq!(done.out.matches("self-test passed").count(), adapters.len(), "{}", done.out);
    let done = Place::new().ipslam(&["devices", "--json"]);
    let found: Value = serde_json::from_str(&done.ended(0).out).unwrap();
    let names: Vec<_> = found.as_array().unwrap().iter().filter_map(|device| device["name"].as_str()).collect();
    assert!(names.iter().eq(adapters.iter().map(|adapter| &adapter.name)), "{found}");
    assert!(found[0]["passed"] == true && found[0]["max_buffer_bytes"].as_u64() > Some(0), "{found}");
}

#[test]
fn logs_are_converted_to_the_last_digit() {
    let place = Place::new();
    let (_, text) = drive(2.0);
    place.write("drive.log.gz", gzip(text.as_bytes()));
    for words in [["drive.log.gz", "plain.clf"], ["plain.clf", "again.clf.gz"]] {
        let done = place.ipslam(&[&["convert"], &words[..]].concat());
        assert_eq!((&*done.ended(0).out, &*done.err), ("", ""));
    }
    let entries = |name: &str| -> Vec<LogEntry> {
        CarmenLog::new(place.path(name)).open().unwrap().map(|entry| entry.unwrap()).collect()
    };
    let original = entries("drive.log.gz");
    assert!(original.len() > 40 && std::fs::read(place.path("again.clf.gz")).unwrap().starts_with(&[0x1f, 0x8b]));
    for (a, b) in original.iter().zip(entries("again.clf.gz")) {
        match (a, &b) {
            (LogEntry::Laser(a), LogEntry::Laser(b)) => assert_eq!((a.stamp, &a.ranges), (b.stamp, &b.ranges)),
            _ => assert_eq!(a, &b),
        }
    }
    assert_eq!(entries("plain.clf").len(), original.len());

    // What is damaged is told, and the rest is converted.
    place.write("damaged.clf", text.replacen("ODOM ", "ODOM x ", 1));
    let done = place.ipslam(&["convert", "damaged.clf", "rest.clf"]);
    done.failed(1, &["1 lines were left out", "damaged.clf:"]);
    assert_eq!(entries("rest.clf").len(), original.len() - 1);
}

#[test]
fn maps_are_converted_through_every_format() {
    let place = Place::new();
    place.run(&["--max-scans", "40", "--backend", "cpu", "--out", "out"]).ended(0);
    let step = |from: &str, to: &str| {
        place.ipslam(&["convert", from, to]).ended(0);
    };
    step("out/map.json", "same.json");
    step("out/map.json", "drawn.yaml");
    step("drawn.yaml", "walls.json");
    step("out/map.yaml", "copy.yml");
    step("out/map.json", "walls.geojson");
    step("out/map.yaml", "walls.svg");
    step("out/map.yaml", "picture.png");
    step("picture.png", "back.yaml");
    assert!(std::fs::read(place.path("picture.png")).unwrap().starts_with(b"\x89PNG"));
    let [original, back] = ["out/map.yaml", "back.yaml"].map(|name| map_server::read(&place.path(name)).unwrap().grid);
    assert_eq!(original, back);
    std::fs::remove_file(place.path("picture.yaml")).unwrap();
    place.ipslam(&["convert", "picture.png", "none.json"]).failed(1, &["picture.yaml: cannot be read"]);
    let read = |name: &str| std::fs::read(place.path(name)).unwrap();
    assert_eq!(read("copy.pgm"), read("out/map.pgm"));
    let walls: Value = serde_json::from_slice(&read("walls.geojson")).unwrap();
    assert!(read("walls.svg").starts_with(b"<svg"));

    // A map that was drawn and read keeps its walls, as near as cells of 5 cm can tell, and its free area.
    let [original, before, after] =
        ["out/map.json", "same.json", "walls.json"].map(|name| map_json::read_map(&place.path(name)).unwrap());
    assert_eq!((original.clusters.len(), &original.free), (before.clusters.len(), &before.free));
    assert_eq!(walls["features"].as_array().unwrap().len(), before.clusters.len());
    let covered = |from: &LineMap, by: &LineMap, shift: f64| {
        let near = |wall: &Cluster| {
            let middle = wall.mean + nalgebra::Vector2::new(shift, shift);
            by.clusters.iter().any(|other| {
                let offset = middle - other.mean;
                let half = (3.0 * other.along_variance).sqrt() + 0.1;
                offset.dot(&other.normal()).abs() < 0.1 && offset.dot(&other.direction).abs() < half
            })
        };
        from.clusters.iter().filter(|wall| near(wall)).count() as f64 / from.clusters.len() as f64
    };
    assert!(before.clusters.len() > 5);
    let (shared, moved) = (covered(&before, &after, 0.0), covered(&before, &after, 0.5));
    assert!(shared > 0.6 && moved < 0.5 * shared, "{shared} of the walls are kept, {moved} of those half a metre off");
    let area = |map: &LineMap| map.free.as_ref().unwrap().area();
    assert!((area(&after) / area(&before) - 1.0).abs() < 0.2, "{} m², {} m²", area(&before), area(&after));
}

/// Around through every format, and back to the same poses.
#[test]
fn trajectories_are_converted_through_every_format() {
    let place = Place::new();
    let (simulation, _) = drive(3.0);
    let truth: Vec<_> = simulation.truth().collect();
    tum::write(&place.path("a.tum"), &truth).unwrap();
    for [from, to] in [["a.tum", "b.kitti"], ["b.kitti", "c.csv"], ["c.csv", "d.euroc.csv"], ["d.euroc.csv", "e.tum"]] {
        let done = place.ipslam(&["convert", from, to]);
        assert_eq!((&*done.ended(0).out, &*done.err), ("", ""));
    }
    let back = tum::read(&place.path("e.tum")).unwrap();
    assert!(truth.len() == back.len() && truth.len() > 10);
    for (a, b) in truth.iter().zip(&back) {
        let off = a.pose.seen_from(b.pose);
        assert!(
            (a.stamp - b.stamp).abs() < 1e-6 && off.x.hypot(off.y) < 1e-8 && off.heading.abs() < 1e-8,
            "{a:?} {b:?}"
        );
    }
    // Without its stamps a path is one all the same.
    std::fs::remove_file(place.path("b.times.txt")).unwrap();
    let done = place.ipslam(&["convert", "b.kitti", "f.tum"]);
    assert!(done.ended(0).err.contains("b.times.txt is not there"), "{}", done.err);
    assert_eq!(tum::read(&place.path("f.tum")).unwrap()[3].stamp, 3.0);
    place.ipslam(&["convert", "a.tum", "map.json"]).failed(2, &["a.tum: a trajectory makes another one only"]);
}

#[test]
fn what_cannot_be_converted_is_told_with_what_can() {
    let place = Place::new();
    let (_, text) = drive(1.0);
    place.write("drive.clf", &text);
    place.write("broken.json", "{");
    place.write("map.yaml", "image: none.png\nresolution: 0.1\norigin: [0, 0, 0]\n");
    for (code, words, expected) in [
        (2, ["drive.clf", "out.gif"], &["out.gif", "Formats, by the endings", ".geojson (walls)"][..]),
        (2, ["drive.clf", "out.json"], &["a log is made a map by `ipslam run drive.clf`"]),
        (2, ["out.geojson", "out.json"], &["out.geojson: this format is only written"]),
        (2, ["drive.clf", "./drive.clf"], &["./drive.clf: this is the file that is read"]),
        (2, ["map.yaml", "map.png"], &["map.yaml: this is the file that is read"]),
        (1, ["broken.json", "out.yaml"], &["broken.json: no map as ipslam writes it"]),
        (1, ["broken.json", "out.clf"], &["broken.json"]),
        (1, ["map.yaml", "out.json"], &["none.png: cannot be read"]),
        (1, ["none.clf", "out.clf"], &["none.clf: cannot be opened"]),
        (1, ["drive.clf", "none/out.clf"], &["its folder does not exist"]),
    ] {
        place.ipslam(&[&["convert"], &words[..]].concat()).failed(code, expected);
    }
    assert!(!place.path("out.json").exists() && !place.path("out.clf").exists());
    assert_eq!(std::fs::read(place.path("drive.clf")).unwrap(), text.as_bytes());
}

/// A machine without a display is told of the browser, and a map is told from a recording.
#[test]
fn what_cannot_be_shown_is_told_with_what_can() {
    let place = Place::new();
    place.write("run.rrd", "RRF2");
    if cfg!(target_os = "linux") {
        let mut view = place.command(&["view", "run.rrd"]);
        let done = Done::new(view.env_remove("DISPLAY").env_remove("WAYLAND_DISPLAY").output().unwrap());
        done.failed(2, &["ipslam view --web-viewer run.rrd"]);
    }
    if cfg!(feature = "record") {
        place.ipslam(&["replay", "map.json"]).failed(2, &["map.json: this is a map", "ipslam localize map.json LOG"]);
        place.ipslam(&["replay", "my.clf"]).failed(2, &["my.clf: this is a log", "ipslam run my.clf --record"]);
    }
    // Defaults stand as they are to be typed.
    let help = place.ipslam(&["bench", "--help"]);
    assert!(help.ended(0).out.contains("[default: 180,361,1080]"), "{}", help.out);
}

#[test]
fn shells_and_manuals_know_every_command() {
    let place = Place::new();
    let commands = [
        "run",
        "localize",
        "replay",
        "view",
        "eval",
        "simulate",
        "devices",
        "bench",
        "convert",
        "config",
        "completions",
        "man",
    ];
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let done = place.ipslam(&["completions", shell]);
        for word in commands.iter().chain(&["max-scans", "ipslam"]) {
            assert!(done.ended(0).out.contains(word), "{word} is not in the completions of {shell}");
        }
    }
    place.ipslam(&["completions", "sh"]).ended(2);
    let manual = place.ipslam(&["man"]);
    let manual = &manual.ended(0).out;
    assert!(manual.contains("Exit codes") && manual.contains("\\-\\-max\\-scans"), "{manual}");
    for command in commands {
        assert!(manual.contains(&format!(".TH ipslam-{command}")), "{command} has no page");
    }
    // The shell itself takes the script for one.
    let script = place.ipslam(&["completions", "bash"]).out;
    place.write("script", script);
    let done = Done::new(Command::new("bash").args(["-n"]).arg(place.path("script")).output().unwrap());
    done.ended(0);
}

/// What `config` prints is a configuration, and what the documentation has.
#[test]
fn every_parameter_is_explained() {
    let place = Place::new();
    let printed = place.ipslam(&["config"]).ended(0).out.clone();
    // Every key is there, with its default and a comment above it.
    let defaults = toml::Table::try_from(ipslam::config::SlamConfig::default()).unwrap();
    assert_eq!(toml::from_str::<toml::Table>(&printed).unwrap(), defaults);
    let lines: Vec<&str> = printed.lines().collect();
    assert_eq!(lines.windows(2).find(|pair| pair[1].contains(" = ") && !pair[0].starts_with('#')), None);
    let range = "# Shorter ranges are no measurement [m].\n# Range: 0 to 1000000.\nmin_range = 0.1\n";
    assert!(printed.contains(range), "{printed}");
    place.write("drive.log", drive(1.0).1);
    let maps = ipslam::config::SlamConfig::default().maps;
    place.write(
        "all.toml",
        printed
            .replace(&format!("\nmaps = {maps}\n"), "\nmaps = 2\n")
            .replace(&format!("\nparticles = {maps}\n"), "\nparticles = 2\n"),
    );
    place.ipslam(&["run", "drive.log", "--config", "all.toml", "--out", "out"]).ended(0);
    assert_eq!(place.summary("out")["configuration"]["maps"], 2);
    let documented = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/docs/parameters.md")).unwrap();
    let (_, block) = documented.split_once("```toml\n").unwrap();
    assert_eq!(
        block.trim_end().strip_suffix("```").unwrap(),
        printed,
        "docs/parameters.md is not what `ipslam config` prints"
    );
}

/// In the map of a drive, by the log of the same drive: as `map.json` and as a grid, from anywhere and from a prior.
#[test]
fn the_robot_is_found_in_a_map_of_either_kind() {
    let place = Place::new();
    let (_, text) = drive(60.0);
    place.write("drive.clf", &text);
    place.run(&["drive.clf", "--backend", "cpu", "--out", "mapped"]).ended(0);
    for (map, more) in [
        ("mapped/map.json", &["--skip", "10"][..]),
        ("mapped/map.yaml", &["--skip", "10"]),
        ("mapped/map.json", &["--start", "0,0,0", "--start-spread", "0.3,0.1"]),
    ] {
        let words = [
            "localize",
            map,
            "drive.clf",
            "--reference",
            "mapped/trajectory.tum",
            "--backend",
            "cpu",
            "--out",
            "found",
            "--force",
        ];
        let done = place.ipslam(&[&words[..], &["--max-particles", "20000", "--json"], more].concat());
        let found: Value = serde_json::from_str(&done.ended(0).out).unwrap();
        let against = &found["against_reference"];
        let (compared, right) = (against["compared"].as_u64().unwrap(), against["right"].as_u64().unwrap());
        assert!(compared > 100 && right * 20 >= compared * 19, "{map}: {found:#}");
        assert!(found["first_fix"]["metres"].as_f64().unwrap() < 15.0, "{found:#}");
        // Once found, a few do.
        assert!(found["particles"]["median"].as_u64().unwrap() < 2000, "{found:#}");
        assert_eq!(place.summary("found")["particles"], found["particles"]);
        // A pose that is not relied on is there and marked.
        let located = tum::read(&place.path("found/trajectory.tum")).unwrap().len();
        let poses = std::fs::read_to_string(place.path("found/poses.csv")).unwrap();
        let [relied_on, not] = [",1", ",0"].map(|end| poses.lines().filter(|row| row.ends_with(end)).count());
        assert!(located > 0 && relied_on == located && not > 0, "{located} located; {relied_on} and {not} rows");
        assert!(std::fs::read(place.path("found/map.png")).unwrap().starts_with(b"\x89PNG"));
    }
}

/// A second drive begins in the middle of the first one and goes on where that did not: it is found there, and one map tells of
/// both, in the frame of the first.
#[test]
fn a_drive_goes_on_with_the_map_of_another() {
    let place = Place::new();
    let drive = |seed: u64| {
        let config = SimulationConfig { seed, duration: Some(90.0), ..SimulationConfig::default() };
        let simulation = Simulation::new("drive".to_owned(), building(), config).unwrap();
        let mut writer = CarmenWriter::new(Vec::new());
        simulation.open().unwrap().for_each(|entry| writer.write(&entry.unwrap()).unwrap());
        (simulation, String::from_utf8(writer.finish().unwrap()).unwrap())
    };
    let ((first_simulation, first), (simulation, second)) = (drive(3), drive(4));
    place.write("first.clf", between(&first, 0.0, 50.0));
    place.write("second.clf", between(&second, 25.0, 90.0));
    place.write("short.clf", between(&second, 25.0, 26.0));
    place.run(&["first.clf", "--backend", "cpu", "--out", "one"]).ended(0);
    let done = place.run(&["second.clf", "--backend", "cpu", "--out", "two", "--continue", "one"]);
    assert!(done.ended(0).out.contains("goes on with one/map.json"), "{}", done.out);
    let first_scan = place.summary("two")["continues"]["first_scan"].as_u64().unwrap() as usize;
    let poses = std::fs::read_to_string(place.path("two/poses.csv")).unwrap();
    let not_relied_on = poses.lines().filter(|row| row.ends_with(",0")).count();
    assert!(first_scan < 10 && not_relied_on == first_scan, "{first_scan} {not_relied_on}");

    // Where the first drive has the building there the second one is, as closely.
    let trajectory = |folder: &str| tum::read(&place.path(folder).join("trajectory.tum")).unwrap();
    let [of_first, of_second] = [first_simulation, simulation].map(|simulation| simulation.truth().collect::<Vec<_>>());
    let truth_from_one = reference_errors(&of_first, &trajectory("one")).reference_from_world;
    let truth = ipslam::metrics::PoseLookup::new(&of_second);
    let off = |found: &ipslam::geometry::StampedPose| {
        let off = (truth_from_one * found.pose).seen_from(truth.at(found.stamp)?);
        Some(off.x.hypot(off.y))
    };
    let off: Vec<f64> = trajectory("two").iter().filter_map(off).collect();
    assert!(off.len() > 300, "{} poses", off.len());
    let worst = off.iter().copied().fold(0.0, f64::max);
    assert!(worst < 0.2, "{worst} m off in the frame of the first drive");

    let [one, two] = ["one/map.json", "two/map.json"].map(|name| map_json::read_map(&place.path(name)).unwrap());
    let is_in = |wall: &Cluster, map: &LineMap| {
        map.clusters.iter().any(|other| {
            let offset = wall.mean - other.mean;
            offset.dot(&other.normal()).abs() < 0.15 && offset.dot(&other.direction).abs() < 0.5 * other.length() + 0.15
        })
    };
    let share = |from: &LineMap, by: &LineMap| {
        from.clusters.iter().filter(|wall| is_in(wall, by)).count() as f64 / from.clusters.len() as f64
    };
    assert!(share(&one, &two) > 0.95, "{} of the first map are left", share(&one, &two));
    assert!(share(&two, &one) < 0.9, "{} of the map were known before", share(&two, &one));
    // Where the first drive began, the second one never was.
    let grid = |name: &str| map_server::read(&place.path(name)).unwrap().grid;
    let start = nalgebra::Point2::new(0.3, 0.0);
    let cells = ["one/map.yaml", "two/map.yaml"].map(|name| grid(name).at(start));
    assert_eq!(cells, [ipslam::grid::Cell::Free; 2]);

    // In one command, the second log in the folder of its own.
    let done = place.run(&["first.clf", "second.clf", "--backend", "cpu", "--out", "both"]);
    assert_eq!(done.ended(0).err.matches("outputs are in both/").count(), 2, "{}", done.err);
    for [folder, file] in [["one", "first"], ["two", "second"]] {
        let read = |path: PathBuf| std::fs::read(path.join("trajectory.tum")).unwrap();
        assert!(read(place.path(folder)) == read(place.path(&format!("both/{file}"))), "{file}");
    }

    let continued = |words: &[&str]| place.run(&[words, &["--out", "three"]].concat());
    continued(&["short.clf", "--continue", "one"]).failed(1, &["located nowhere"]);
    continued(&["second.clf", "--continue", "none"]).failed(1, &["none"]);
    continued(&["second.clf", "--start", "0,0,0"]).ended(2);
    assert!(!place.path("three").exists());
}

#[test]
fn a_map_that_cannot_be_used_is_an_error() {
    let place = Place::new();
    let (_, text) = drive(2.0);
    place.write("drive.clf", &text);
    place.run(&["drive.clf", "--backend", "cpu", "--out", "mapped"]).ended(0);
    let map: Value = serde_json::from_slice(&std::fs::read(place.path("mapped/map.json")).unwrap()).unwrap();
    let without = |member: &str, value: Value| {
        let mut map = map.clone();
        map[member] = value;
        map.to_string()
    };
    place.write("no_area.json", without("free", Value::Null));
    place.write("no_walls.json", without("clusters", Value::Array(Vec::new())));
    for (words, expected) in [
        (&["map.txt", "drive.clf"][..], &["map.txt: a map is a .json file"][..]),
        (&["none.json", "drive.clf"], &["none.json: cannot be opened"]),
        (&["no_area.json", "drive.clf"], &["has no free area", "run the log again"]),
        (&["no_walls.json", "drive.clf"], &["no_walls.json: it has no wall"]),
        (&["mapped/map.json", "none.clf"], &["none.clf: cannot be opened"]),
    ] {
        place.ipslam(&[&["localize"], words].concat()).failed(1, expected);
    }
    place.ipslam(&["localize", "mapped/map.json"]).failed(2, &["no log is named"]);
    for words in [["--start", "1,2"], ["--start", "1,2,x"], ["--max-particles", "-1"], ["--max-particles", "0"]] {
        place.ipslam(&[&["localize", "mapped/map.json", "drive.clf"], &words[..]].concat()).ended(2);
    }
}

/// Objects beside lines, from the simulator's files; what cannot be used is told.
#[test]
fn detections_come_to_the_map() {
    let place = Place::new();
    place.ipslam(&["simulate", "--out", "sim", "--world", "wings", "--duration", "12"]).ended(0);
    let run = ["run", "sim/wings-seed1.log", "--detections", "sim/detections.csv", "--out", "out"];
    let done = place.ipslam(&[&run[..], &FEW].concat());
    assert!(done.ended(0).out.contains("\nobjects  "), "{}", done.out);
    let summary = place.summary("out");
    let found = summary["objects"]["landmarks"].as_u64().unwrap();
    assert!(found > 3 && summary["objects"]["frames_used"].as_u64().unwrap() > 10, "{}", summary["objects"]);
    let table = std::fs::read_to_string(place.path("out/landmarks.csv")).unwrap();
    assert!(table.starts_with("landmark,class,x,y,xx,xy,yy,weight\n") && table.contains(",door,"), "{table}");
    assert_eq!(table.lines().count() as u64, found + 1);
    assert!(std::fs::read_to_string(place.path("out/map.svg")).unwrap().contains("id=\"landmarks\""));

    place
        .ipslam(&[&run[..], &["--force", "--record", "run.rrd"]].concat())
        .failed(2, &["cannot be recorded yet", "--record"]);
    let text = std::fs::read_to_string(place.path("sim/detections.csv")).unwrap();
    place.write("sim/detections.csv", text.replacen(",chair,", ",dragon,", 1));
    place.ipslam(&[&run[..], &["--force"]].concat()).failed(1, &["sim/detections.csv:", "`dragon`", "sensors.toml"]);
    std::fs::remove_file(place.path("sim/sensors.toml")).unwrap();
    place.ipslam(&[&run[..], &["--force"]].concat()).failed(1, &["sim/sensors.toml", "cannot be opened"]);
}
