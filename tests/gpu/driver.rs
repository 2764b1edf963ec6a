//! Drivers that fail: a stand-in for Mesa's driver in software (`failing_driver.c`) loses the device, never answers, has no
//! memory, crashes or hangs. The program goes on with the CPU, or says why it cannot do what was asked for.

use ipslam::gpu::device::adapters;
use libtest_mimic::Trial;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};

/// Linux, a C compiler, and the driver that is stood in for.
fn can_be_built() -> bool {
    let has_compiler = || Command::new("cc").arg("--version").output().is_ok_and(|done| done.status.success());
    cfg!(target_os = "linux") && adapters().iter().any(|adapter| adapter.name.contains("llvmpipe")) && has_compiler()
}

/// The stand-in, built in a folder of its own.
struct Driver {
    folder: tempfile::TempDir,
    manifest: PathBuf,
}

impl Driver {
    fn build() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let (library, manifest) = (folder.path().join("failing.so"), folder.path().join("failing.json"));
        let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/gpu/failing_driver.c");
        let mut compiler = Command::new("cc");
        let built = compiler.args(["-shared", "-fPIC", "-o"]).arg(&library).arg(source).arg("-ldl").output().unwrap();
        assert!(built.status.success(), "{}", String::from_utf8_lossy(&built.stderr));
        let text = serde_json::json!({
            "file_format_version": "1.0.0",
            "ICD": { "library_path": library, "api_version": "1.3.0" },
        });
        std::fs::write(&manifest, text.to_string()).unwrap();
        Self { folder, manifest }
    }

    /// A short run through the built-in building with a driver that fails like this after so many submissions.
    fn start(&self, backend: &str, how: &str, after: u32) -> Child {
        Command::new(env!("CARGO_BIN_EXE_ipslam"))
            .current_dir(self.folder.path())
            .args(["run", "--maps", "4", "--particles", "4", "--max-scans", "12", "--backend", backend, "--out"])
            .arg(self.out(how))
            .env("VK_DRIVER_FILES", &self.manifest)
            .env("VK_ICD_FILENAMES", &self.manifest)
            .env("FAIL_HOW", how)
            .env("FAIL_AFTER", after.to_string())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap()
    }

    fn run(&self, backend: &str, how: &str, after: u32) -> Output {
        self.start(backend, how, after).wait_with_output().unwrap()
    }

    fn out(&self, how: &str) -> PathBuf {
        self.folder.path().join(how.replace(' ', "-"))
    }

    /// The summary, and positions of the trajectory.
    fn outputs(&self, how: &str) -> (serde_json::Value, Vec<[f64; 2]>) {
        let read = |name: &str| std::fs::read_to_string(self.out(how).join(name)).unwrap();
        let number = |word: &str| word.parse::<f64>().unwrap();
        let position = |line: &str| {
            let words: Vec<&str> = line.split(' ').collect();
            [number(words[1]), number(words[2])]
        };
        let trajectory = read("trajectory.tum").lines().filter(|line| !line.starts_with('#')).map(position).collect();
        (serde_json::from_str(&read("summary.json")).unwrap(), trajectory)
    }
}

/// The test, where it can run.
pub fn trial() -> Trial {
    let name = "a_driver_that_fails_or_hangs_ends_on_the_cpu";
    if can_be_built() {
        Trial::test(name, || {
            a_driver_that_fails();
            Ok(())
        })
    } else {
        Trial::test(name, || Ok(())).with_ignored_flag(true).with_kind("no llvmpipe, or no cc")
    }
}

fn a_driver_that_fails() {
    let driver = Driver::build();
    // It is given up after 20 s, and the others take about as long.
    let hanging = driver.start("auto", "hang when listed", 0);
    let done = driver.run("gpu", "never", 0);
    assert!(done.status.success(), "{done:?}");
    let (summary, whole) = driver.outputs("never");
    assert!(!summary["warnings"].to_string().contains("the CPU"), "{summary}");

    for (how, after, reason) in [("submit", 3, "lost"), ("wait", 3, "lost"), ("time-out", 3, "timed out")] {
        let done = driver.run("gpu", how, after);
        assert!(done.status.success(), "{how}: {done:?}");
        let (summary, trajectory) = driver.outputs(how);
        let warnings = summary["warnings"].to_string();
        assert!(warnings.contains("the CPU did the step again and went on"), "{how}: {warnings}");
        assert!(warnings.to_lowercase().contains(reason), "{how}: {warnings}");
        assert_eq!(trajectory.len(), whole.len(), "{how}");
        // As far as runs with another device differ: the robot has driven 1 m.
        let apart = trajectory.iter().zip(&whole).map(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1])).fold(0.0, f64::max);
        assert!(apart < 0.05, "{how}: {apart} m apart");
    }

    // A device that was asked for and cannot be opened is an error; one that was not is none.
    for how in ["memory", "map"] {
        let done = driver.run("gpu", how, 0);
        let text = String::from_utf8_lossy(&done.stderr).into_owned();
        assert_eq!(done.status.code(), Some(1), "{how}: {text}");
        assert!(text.contains("llvmpipe") && text.contains("failed") && !text.contains("panicked"), "{how}: {text}");
    }
    let done = driver.run("auto", "crash when listed", 0);
    assert!(done.status.success(), "{done:?}");
    let device = driver.outputs("crash when listed").0["device"].to_string();
    assert!(device.contains("the graphics driver crashed when its devices were listed"), "{device}");

    let done = hanging.wait_with_output().unwrap();
    assert!(done.status.success(), "{done:?}");
    let device = driver.outputs("hang when listed").0["device"].to_string();
    assert!(device.contains("the graphics driver did not answer in 20 s"), "{device}");
}
