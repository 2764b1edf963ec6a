//! `ipslam view`: opens a recording in the Rerun viewer.

use super::UsageError;
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
    /// Show it in a browser, served from here: for machines without a display
    #[arg(long)]
    web_viewer: bool,
}

/// The viewer reads what this version writes.
const VIEWER: &str = "0.36.3";

/// Opens the recording and waits until the viewer is closed.
pub fn view(args: &ViewArgs) -> anyhow::Result<()> {
    let shown = args.recording.display();
    ensure!(args.recording.is_file(), "{shown}: no file; `ipslam run --record {shown}` makes one");
    let has_display = ["DISPLAY", "WAYLAND_DISPLAY"].iter().any(|name| std::env::var_os(name).is_some());
    ensure!(
        args.web_viewer || has_display || !cfg!(target_os = "linux"),
        UsageError(format!("this machine has no display: `ipslam view --web-viewer {shown}` shows it in a browser"))
    );
    let web_viewer = args.web_viewer.then_some("--web-viewer");
    match Command::new("rerun").args(web_viewer).arg(&args.recording).status() {
        Ok(status) if status.success() => Ok(()),
        Ok(status) => bail!("the viewer `rerun` could not show {shown} ({status}); it should be version {VIEWER}"),
        Err(error) if error.kind() == ErrorKind::NotFound => bail!(
            "the Rerun viewer is not installed: `pip install rerun-sdk=={VIEWER}` puts the program `rerun` on the path; \
             or open {shown} at https://app.rerun.io/version/{VIEWER}"
        ),
        Err(error) => bail!("the viewer `rerun` cannot be started: {error}"),
    }
}
