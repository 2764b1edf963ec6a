//! `ipslam degrade` and `ipslam benchmark` from outside.

use assert_cmd::cargo::cargo_bin;
use ipslam::io::carmen::CarmenLog;
use ipslam::log::{LogEntry, LogSource as _};
use serde_json::Value;
use std::path::Path;
use std::process::Command;

/// Starts the program in a folder; it has to end so, and say these words. Returns what it printed.
#[track_caller]
fn ipslam(folder: &Path, words: &[&str], code: i32, expected: &[&str]) -> String {
    let done = Command::new(cargo_bin("ipslam")).current_dir(folder).args(words).output().unwrap();
    let [out, err] = [done.stdout, done.stderr].map(|bytes| String::from_utf8(bytes).unwrap());
    assert_eq!(done.status.code(), Some(code), "{out}\n{err}");
    expected.iter().for_each(|word| assert!(err.contains(word), "{word:?} is not in {err}"));
    out
}

fn json(path: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

fn simulated(folder: &Path, seeds: &[&str]) {
    for seed in seeds {
        let words = ["simulate", "--out", "logs", "--duration", "6", "--beams", "121", "--seed", seed];
        ipslam(folder, &words, 0, &[]);
    }
}

const LOG: &str = "logs/building-seed1.log";

#[test]
fn a_log_is_made_harder_and_stays_itself() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    simulated(folder, &["1"]);
    let before = std::fs::read(folder.join(LOG)).unwrap();
    let out = ipslam(folder, &["degrade", LOG, "hard.clf", "--skip", "4", "--noise", "2"], 0, &[]);
    assert_eq!(out, "hard.clf: 8 of 31 scans\n");
    let entries = |name: &str| -> Vec<LogEntry> {
        CarmenLog::new(folder.join(name)).open().unwrap().map(|entry| entry.unwrap()).collect()
    };
    let count = |is: fn(&LogEntry) -> bool| entries("hard.clf").iter().filter(|entry| is(entry)).count();
    assert_eq!(count(|entry| matches!(entry, LogEntry::Laser(_))), 8);
    assert_eq!(count(LogEntry::is_reading), 31);

    // Odometry that never changes is none.
    ipslam(folder, &["degrade", LOG, "blind.clf", "--no-odometry"], 0, &[]);
    let words = ["run", "blind.clf", "--maps", "4", "--particles", "4", "--backend", "cpu", "--out", "blind"];
    ipslam(folder, &words, 0, &[]);
    let summary = json(&folder.join("blind/summary.json"));
    assert_eq!(summary["verdict"], "doubtful");
    assert!(summary["doubts"].to_string().contains("no odometry"), "{summary:#}");

    let bytes = std::fs::read(folder.join("hard.clf")).unwrap();
    for (out, words, code, expected) in [
        (LOG, &["--force"][..], 2, &["this is the log that is read"][..]),
        ("./logs/../logs/building-seed1.log", &["--force"], 2, &["this is the log that is read"]),
        ("hard.clf", &[], 2, &["hard.clf: it is there already", "--force"]),
        ("new.clf", &["--noise", "-1"], 2, &["noise is -1, but has to be 0 to 1000"]),
        ("new.clf", &["--fov", "400"], 2, &["field_of_view", "0 to 6.28"]),
        ("new.clf", &["--scale", "1"], 2, &["--scale", "1.05,0.9"]),
        ("none/new.clf", &[], 1, &["none/new.clf: cannot be written", "create it first"]),
    ] {
        ipslam(folder, &[&["degrade", LOG, out], words].concat(), code, expected);
    }
    ipslam(folder, &["degrade", "none.log", "new.clf"], 1, &["none.log: cannot be opened"]);
    assert!(std::fs::read(folder.join(LOG)).unwrap() == before && !folder.join("new.clf").exists());
    assert!(std::fs::read(folder.join("hard.clf")).unwrap() == bytes);
    let again = ["degrade", LOG, "hard.clf", "--skip", "4", "--noise", "2", "--force"];
    ipslam(folder, &again, 0, &[]);
    assert!(std::fs::read(folder.join("hard.clf")).unwrap() == bytes, "one seed, two logs");
    ipslam(folder, &[&again[..], &["--seed", "2"]].concat(), 0, &[]);
    assert!(std::fs::read(folder.join("hard.clf")).unwrap() != bytes, "two seeds, one log");
}

#[test]
fn a_benchmark_is_the_runs_that_it_names() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    simulated(folder, &["1", "2"]);
    let write = |name: &str, text: &str| std::fs::write(folder.join(name), text).unwrap();
    write("logs/broken.log", "what is this?\n");
    write("logs/broken.tum", "0 0 0 0 0 0 0 1\n");
    write("logs/alone.log", "");
    let words = ["benchmark", "logs", "--maps", "1,2x4", "--hard", "skip 2;noise  4 spike 1", "--out", "out"];
    ipslam(
        folder,
        &words,
        1,
        &["18 runs over 3 logs; logs without a truth beside them: 1", "broken, as recorded", "CARMEN"],
    );

    let found = json(&folder.join("out/benchmark.json"));
    assert_eq!(found["command"], "ipslam benchmark logs --seeds 1 --maps 1,2x4 --hard 'skip 2; noise 4 spike 1'");
    let runs = found["runs"].as_array().unwrap();
    assert_eq!(runs.len(), 18);
    assert!(runs.iter().all(|run| (run["log"] == "broken") == run["error"].is_string()), "{runs:#?}");
    let run = |log: &str, kind: &str, maps: u64| {
        let is = |run: &&Value| run["log"] == log && run["kind"] == kind && run["maps"] == maps;
        runs.iter().find(is).unwrap()
    };
    for run in runs.iter().filter(|run| run["error"].is_null()) {
        let closed = run["rms_m"].as_f64().unwrap() <= 0.4;
        assert_eq!(run["closed"], closed);
        assert_eq!(run["right_verdict"], closed == (run["verdict"] == "consistent"));
        assert!(run["clusters"].as_u64().unwrap() > 0 && run["way_m"].as_f64().unwrap() > 1.0, "{run}");
        assert!(cfg!(not(target_os = "linux")) || run["cpu_s"].as_f64().unwrap() > 0.0);
    }
    assert_eq!(run("building-seed2", "skip 2", 2)["particles"], 4);

    // The same as what the other commands do.
    ipslam(folder, &["degrade", LOG, "hard.clf", "--noise", "4", "--spike", "1"], 0, &[]);
    for (log, kind) in [(LOG, "as recorded"), ("hard.clf", "noise 4 spike 1")] {
        let reference = "logs/building-seed1.truth.tum";
        let alone = ["run", log, "--maps", "2", "--particles", "4", "--backend", "cpu", "--reference", reference];
        ipslam(folder, &[&alone[..], &["--out", "alone", "--force"]].concat(), 0, &[]);
        let alone = json(&folder.join("alone/summary.json"));
        let of_benchmark = run("building-seed1", kind, 2);
        assert_eq!(of_benchmark["rms_m"], alone["metrics"]["reference"]["ate"]["translation_m"]["rmse"], "{kind}");
        assert_eq!(of_benchmark["verdict"], alone["verdict"]);
    }
    assert_ne!(run("building-seed1", "as recorded", 2)["rms_m"], run("building-seed1", "noise 4 spike 1", 2)["rms_m"]);

    let page = std::fs::read_to_string(folder.join("out/benchmark.md")).unwrap();
    for words in
        ["| broken | skip 2 | 1 | 2x4 | failed: ", "18 runs, 6 failed.", "| closed | ", "| broken | skip 2 | 0 of 1;"]
    {
        assert!(page.contains(words), "{words:?} is not in\n{page}");
    }
    let sheet =
        resvg::tiny_skia::Pixmap::decode_png(&std::fs::read(folder.join("out/benchmark.png")).unwrap()).unwrap();
    assert_eq!((sheet.width(), sheet.height()), (6 * 320, 3 * 320));
    let walls = sheet.pixels().iter().filter(|pixel| pixel.red() > 150 && pixel.green() < 120).count();
    assert!(walls > 1000, "{walls} pixels of walls");
    let below = &sheet.pixels()[260 * 1920..320 * 1920];
    let text = below.iter().filter(|pixel| pixel.red() < 128).count();
    assert!(text > 500, "{text} pixels of text below the first row of maps");

    for (words, expected) in [
        (&["benchmark", "logs", "--out", "out"][..], "an earlier benchmark is there"),
        (&["benchmark", "out"], "no log here has a truth beside it"),
        (&["benchmark", "logs", "--hard", "sleet 3"], "--hard"),
        (&["benchmark", "logs", "--hard", "random 2"], "random is 2, but has to be 0 to 1"),
        (&["benchmark", "logs", "--maps", "4x6"], "--particles"),
    ] {
        ipslam(folder, words, 2, &[expected]);
    }
    assert!(!folder.join("ipslam-benchmark").exists());
}
