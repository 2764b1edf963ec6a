//! Python packages from PyPI for tests whose oracle they are, in an environment of their own under `target/`.

use std::path::PathBuf;
use std::process::Command;

/// A Python that finds these packages (`name==version`); `None`, with a notice, where it cannot be had and is not
/// required. `name` is of the environment's folder.
pub fn python_with(name: &str, packages: &[&str]) -> Option<PathBuf> {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("python-{name}"));
    let python = folder.join(if cfg!(windows) { "Scripts/python.exe" } else { "bin/python" });
    let succeeds = |command: &mut Command| command.output().is_ok_and(|output| output.status.success());
    // The file tells which packages were installed whole.
    let (done, wanted) = (folder.join("installed"), packages.join(" "));
    if std::fs::read_to_string(&done).is_ok_and(|installed| installed == wanted) {
        return Some(python);
    }
    let made = succeeds(Command::new("python3").args(["-m", "venv"]).arg(&folder))
        && succeeds(Command::new(&python).args(["-m", "pip", "install", "-q"]).args(packages))
        && std::fs::write(&done, &wanted).is_ok();
    if made {
        return Some(python);
    }
    let required = std::env::var("IPSLAM_REQUIRE").is_ok_and(|required| required.contains("python"));
    assert!(!required, "IPSLAM_REQUIRE asks for python, but a venv with {wanted} cannot be made");
    eprintln!("SKIPPED, NOT TESTED: python3 cannot make a venv with {wanted}");
    None
}
