//! `--record` and `--connect`: the run for the Rerun viewer, with the feature `record`.

use ipslam::record::Observer;
use std::path::PathBuf;

/// Where to record.
#[derive(Debug, clap::Args)]
pub struct RecordingArgs {
    /// Record every step to this file, for the Rerun viewer
    #[arg(long, value_name = "FILE.rrd")]
    record: Option<PathBuf>,
    /// Show every step in a running Rerun viewer, on this machine where no URL is given
    #[arg(long, value_name = "URL", num_args = 0..=1, require_equals = true)]
    connect: Option<Option<String>>,
}

impl RecordingArgs {
    /// Who has to be told of every step of the run `name`.
    #[cfg(feature = "record")]
    pub fn observers(&self, name: &str) -> anyhow::Result<Vec<Box<dyn Observer>>> {
        use ipslam::record::rerun::RerunObserver;
        let mut observers: Vec<Box<dyn Observer>> = Vec::new();
        if let Some(path) = &self.record {
            observers.push(Box::new(RerunObserver::to_file(path, name)?));
        }
        if let Some(url) = &self.connect {
            observers.push(Box::new(RerunObserver::connect(url.as_deref(), name)?));
        }
        Ok(observers)
    }

    /// Without the feature there is nobody to be told.
    #[cfg(not(feature = "record"))]
    pub fn observers(&self, _name: &str) -> anyhow::Result<Vec<Box<dyn Observer>>> {
        anyhow::ensure!(
            self.record.is_none() && self.connect.is_none(),
            "--record and --connect need the feature `record`, which this program was built without; build it with \
             `cargo build --release --features record`"
        );
        Ok(Vec::new())
    }
}
