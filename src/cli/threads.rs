//! `--threads`.

use anyhow::Context as _;

/// How many threads work.
#[derive(Debug, clap::Args)]
pub struct ThreadArgs {
    /// Threads, up to 1024; 0 for one for each core. The result does not depend on it
    #[arg(long, default_value_t = 0, allow_negative_numbers = true, value_parser = clap::value_parser!(u16).range(..=1024))]
    threads: u16,
}

impl ThreadArgs {
    /// Starts them.
    pub fn start(&self) -> anyhow::Result<()> {
        // As rayon starts them by itself; a second command of one process has them already.
        if self.threads == 0 {
            return Ok(());
        }
        let pool = rayon::ThreadPoolBuilder::new().num_threads(usize::from(self.threads));
        pool.build_global().context("no threads (option --threads)")
    }
}
