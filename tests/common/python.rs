//! Python with packages that read what ipslam writes, and write what it reads.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::Command;

/// What the tests ask for.
const PACKAGES: [&str; 9] =
    ["evo", "PyYAML", "Pillow", "jsonschema", "geojson", "shapely", "rosbags==0.11.9", "mcap==1.6.0", "numpy"];

/// A Python with these packages, in an environment of its own that the first test makes; or why it cannot be had.
pub fn environment() -> Result<PathBuf, String> {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("python");
    let (python, complete) = (folder.join("bin/python"), folder.join("packages"));
    // One test makes it, the others wait.
    let lock = File::create(folder.with_extension("lock")).map_err(|error| format!("there is no lock: {error}"))?;
    lock.lock().map_err(|error| format!("there is no lock: {error}"))?;
    let wanted = PACKAGES.join(" ");
    if std::fs::read_to_string(&complete).is_ok_and(|found| found == wanted) {
        return Ok(python);
    }
    succeed(Command::new("python3").args(["-m", "venv"]).arg(&folder))?;
    succeed(Command::new(&python).args(["-m", "pip", "install", "-q"]).args(PACKAGES))?;
    std::fs::write(&complete, wanted).map_err(|error| format!("{}: {error}", complete.display()))?;
    Ok(python)
}

fn succeed(command: &mut Command) -> Result<(), String> {
    match command.output() {
        Ok(done) if done.status.success() => Ok(()),
        Ok(done) => Err(format!("{command:?} failed: {}", String::from_utf8_lossy(&done.stderr).trim())),
        Err(error) => Err(format!("{command:?} cannot be run: {error}")),
    }
}
