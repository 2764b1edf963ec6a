//! Files in and out, one module a format. Bags are written, and our files read, by programs in Python that know nothing of
//! ipslam.

#![allow(clippy::expect_used, clippy::unwrap_used, clippy::panic, reason = "a test's helpers may fail as a test does")]

mod carmen;
#[path = "../common/logs.rs"]
mod logs;
mod mcap;
#[path = "../common/needs.rs"]
mod needs;
#[path = "../common/python.rs"]
mod python;
mod readers;
#[cfg(feature = "record")]
mod recording;
mod semantic;
mod semantic_space;
mod visual_inertial;

fn main() {
    let trials = [
        carmen::trials(),
        mcap::trials(),
        readers::trials(),
        semantic::trials(),
        semantic_space::trials(),
        visual_inertial::trials(),
        #[cfg(feature = "record")]
        recording::trials(),
    ];
    libtest_mimic::run(&libtest_mimic::Arguments::from_args(), trials.into_iter().flatten().collect()).exit();
}
