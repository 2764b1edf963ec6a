//! Real logs: whole runs scored by the benchmark's relations, and scores compared with published ones and with an evaluator
//! in Python. Whole logs take minutes: they run where `IPSLAM_REQUIRE` names `data`, or with `--include-ignored`.

#![allow(clippy::expect_used, clippy::unwrap_used, clippy::panic, reason = "a test's helpers may fail as a test does")]

#[cfg(feature = "images")]
mod images;
mod localization;
mod metrics;
#[path = "../common/needs.rs"]
mod needs;
mod pipeline;
mod program;
#[path = "../common/python.rs"]
mod python;
mod semantic;
mod visual_inertial;

fn main() {
    let trials = [
        #[cfg(feature = "images")]
        images::trials(),
        localization::trials(),
        metrics::trials(),
        pipeline::trials(),
        program::trials(),
        semantic::trials(),
        visual_inertial::trials(),
    ];
    let trials = trials.into_iter().flatten().collect();
    libtest_mimic::run(&libtest_mimic::Arguments::from_args(), trials).exit();
}
