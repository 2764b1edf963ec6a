//! `ipslam view`: opens a recording in the Rerun viewer.

use anyhow::{bail, ensure};
use std::io::ErrorKind;
use std::path::PathBuf;
use std::process::Command;

/// Opens a recording in the Rerun viewer, where one is installed.
#[derive(Debug, clap::Args)]
pub struct ViewArgs {
    /// Recording that `ipslam run --record` or `ipslam replay` made
    #[arg(value_name = "RUN.rrd")]
    recording: PathBuf,
}

/// The viewer reads what this version writes.
const VIEWER: &str = "0.36.3";

/// Opens the recording and waits until the viewer is closed.
pub fn view(args: &ViewArgs) -> anyhow::Result<()> {
    let shown = args.recording.display();
    ensure!(args.recording.is_file(), "{shown}: no file; `ipslam run --record {shown}` makes one");
    match Command::new("rerun").arg(&args.recording).status() {
        Ok(status) if status.success() => Ok(()),
        Ok(status) => bail!("the viewer `rerun` could not show {shown} ({status}); it should be version {VIEWER}"),
        Err(error) if error.kind() == ErrorKind::NotFound => bail!(
            "the Rerun viewer is not installed: `pip install rerun-sdk=={VIEWER}` puts the program `rerun` on the path; \
             or open {shown} at https://app.rerun.io/version/{VIEWER}"
        ),
        Err(error) => bail!("the viewer `rerun` cannot be started: {error}"),
    }
}
