//! Files that would be destroyed, readers that go away, and signals.

use assert_cmd::cargo::cargo_bin;
use std::path::Path;
#[cfg(all(unix, feature = "record"))]
use std::process::Output;
use std::process::{Command, Stdio};

fn ipslam(folder: &Path, words: &[&str]) -> Command {
    let mut command = Command::new(cargo_bin("ipslam"));
    command.current_dir(folder).args(words);
    command
}

fn simulated(seconds: &str) -> tempfile::TempDir {
    let place = tempfile::tempdir().unwrap();
    let done = ipslam(place.path(), &["simulate", "--out", ".", "--duration", seconds]).output().unwrap();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    place
}

const RUN: [&str; 8] = ["run", "building-seed1.log", "--maps", "4", "--particles", "4", "--backend", "cpu"];

#[cfg(all(unix, feature = "record"))]
fn text(done: &Output) -> String {
    String::from_utf8_lossy(&done.stderr).into_owned()
}

/// By its own name, by a link, and by a hard link.
#[cfg(all(unix, feature = "record"))]
#[test]
fn a_run_does_not_record_onto_its_log() {
    let place = simulated("2");
    let log = place.path().join("building-seed1.log");
    let before = std::fs::read(&log).unwrap();
    std::os::unix::fs::symlink(&log, place.path().join("link")).unwrap();
    std::fs::hard_link(&log, place.path().join("hard")).unwrap();
    for name in ["building-seed1.log", "./building-seed1.log", "link", "hard"] {
        let done = ipslam(place.path(), &[&RUN[..], &["--record", name]].concat()).output().unwrap();
        assert_eq!(done.status.code(), Some(1), "{name}");
        assert!(text(&done).contains("is read by the run"), "{name}: {}", text(&done));
        assert!(std::fs::read(&log).unwrap() == before, "{name}: the log is another one");
    }
    let done = ipslam(place.path(), &[&RUN[..], &["--record", "run.rrd"]].concat()).output().unwrap();
    assert!(done.status.success(), "{}", text(&done));
    let before = std::fs::read(place.path().join("run.rrd")).unwrap();
    let done = ipslam(place.path(), &["replay", "run.rrd", "--record", "run.rrd"]).output().unwrap();
    assert_eq!(done.status.code(), Some(1));
    // A log that is refused cuts no older recording.
    std::fs::write(place.path().join("none.log"), "PARAM nothing 1\n").unwrap();
    let done = ipslam(place.path(), &["run", "none.log", "--backend", "cpu", "--record", "run.rrd"]).output().unwrap();
    assert_eq!(done.status.code(), Some(1), "{}", text(&done));
    assert!(std::fs::read(place.path().join("run.rrd")).unwrap() == before, "the recording is another one");
}

/// A full disk behind stderr, and a pipe that nobody reads, are no reason to lose a run.
#[cfg(target_os = "linux")]
#[test]
fn a_reader_that_is_gone_ends_no_run() {
    let place = simulated("2");
    let full = || std::fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    let status = ipslam(place.path(), &RUN).stderr(full()).stdout(full()).status().unwrap();
    assert_eq!(status.code(), Some(0));
    assert!(place.path().join("ipslam-out/building-seed1/summary.json").is_file());
    for words in [&RUN[..], &["devices"], &["simulate", "--out", "again", "--duration", "1"]] {
        let mut child = ipslam(place.path(), words).stderr(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
        drop((child.stderr.take(), child.stdout.take()));
        // Without the feature there are no devices to list.
        let code = i32::from(words == ["devices"] && cfg!(not(feature = "gpu")));
        assert_eq!(child.wait().unwrap().code(), Some(code), "{words:?}");
    }
}

/// As `nohup` starts a program: whoever ignores a signal wants it ignored.
#[cfg(target_os = "linux")]
#[test]
fn an_ignored_signal_stays_ignored() {
    let place = simulated("60");
    for (trap, signal, code) in [("HUP", "HUP", 0), ("INT", "INT", 0), ("HUP", "INT", 130)] {
        let script = format!("trap '' {trap}; exec \"$0\" \"$@\"");
        let mut child = Command::new("sh")
            .current_dir(place.path())
            .args(["-c", &script])
            .arg(cargo_bin("ipslam"))
            .args([
                "run",
                "building-seed1.log",
                "--maps",
                "32",
                "--particles",
                "32",
                "--backend",
                "cpu",
                "--force",
                "--out",
                signal,
            ])
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        std::thread::sleep(std::time::Duration::from_millis(700));
        let kill = Command::new("kill").args([&format!("-{signal}"), &child.id().to_string()]).status().unwrap();
        assert!(kill.success(), "the run was over too soon");
        assert_eq!(child.wait().unwrap().code(), Some(code), "{signal} while {trap} is ignored");
    }
}

#[cfg(unix)]
#[test]
fn an_interrupted_conversion_leaves_nothing_behind() {
    let place = tempfile::tempdir().unwrap();
    let mut child = ipslam(place.path(), &["simulate", "--out", ".", "--duration", "20000"])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    std::thread::sleep(std::time::Duration::from_millis(700));
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    assert_eq!(child.wait().unwrap().code(), Some(130));
    let left: Vec<_> = std::fs::read_dir(place.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert!(left.is_empty(), "{left:?}");
}
