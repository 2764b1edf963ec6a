//! The promise: from the same state, seed and scan, the GPU gives what the CPU gives, and both what slow formulas in f64
//! give.
//!
//! Without a device the tests that need one are reported as ignored, with the reason; `IPSLAM_REQUIRE=gpu` makes that a
//! failure. The device is the one whose name contains `IPSLAM_ADAPTER`, or the likely fastest.

#![allow(clippy::unwrap_used, clippy::panic)]

#[path = "../common/assignments.rs"]
mod assignments;
mod associate;
mod consistency;
mod driver;
mod failing;
mod layouts;
#[allow(dead_code, reason = "the tests need devices, and of this the folder of logs alone")]
#[path = "../common/needs.rs"]
mod needs;
#[path = "../common/oracle.rs"]
mod oracle;
#[allow(dead_code, reason = "as above")]
#[path = "../common/python.rs"]
mod python;
#[path = "../common/wall.rs"]
mod wall;
mod worlds;

use ipslam::gpu::device::{Adapter, find};
use libtest_mimic::{Arguments, Trial};

/// A test that needs a device.
type DeviceTest = fn(&Adapter);

const DEVICE_TESTS: [(&str, DeviceTest); 15] = [
    ("poses_are_propagated_alike", consistency::poses_are_propagated_alike),
    ("scans_are_weighed_alike", consistency::scans_are_weighed_alike),
    ("poses_advance_alike", consistency::poses_advance_alike),
    ("detections_are_associated_alike", associate::detections_are_associated_alike),
    ("poses_are_refined_alike", consistency::poses_are_refined_alike),
    ("draws_are_alike", consistency::draws_are_alike),
    ("candidate_lists_leave_nothing_out", consistency::candidate_lists_leave_nothing_out),
    ("work_is_split_to_fit", consistency::work_is_split_to_fit),
    ("a_step_uploads_what_changed", consistency::a_step_uploads_what_changed),
    ("every_particle_has_its_own_map", consistency::every_particle_has_its_own_map),
    ("a_drive_is_mapped_as_well", consistency::a_drive_is_mapped_as_well),
    ("wrong_kernels_are_found_out", failing::wrong_kernels_are_found_out),
    ("a_kernel_that_is_no_wgsl_is_an_error", failing::a_kernel_that_is_no_wgsl_is_an_error),
    ("a_lost_device_is_an_error_and_the_cpu_takes_over", failing::a_lost_device_is_an_error_and_the_cpu_takes_over),
    ("an_unknown_adapter_is_an_error_that_names_the_others", failing::an_unknown_adapter_is_an_error),
];

fn main() {
    let arguments = Arguments::from_args();
    let wanted = std::env::var("IPSLAM_ADAPTER").ok();
    let is_required = std::env::var("IPSLAM_REQUIRE").is_ok_and(|required| required.contains("gpu"));
    let mut trials = vec![
        trial("kernels_are_valid", layouts::kernels_are_valid),
        trial("structs_lie_alike_on_both_sides", layouts::structs_lie_alike_on_both_sides),
        trial("constants_are_the_same_on_both_sides", layouts::constants_are_the_same_on_both_sides),
    ];
    match find(wanted.as_deref()) {
        Ok(adapter) => {
            eprintln!("device: {} ({:?}, {})", adapter.name, adapter.kind, adapter.driver);
            trials.extend(DEVICE_TESTS.map(|(name, test)| {
                let adapter = adapter.clone();
                trial(name, move || test(&adapter))
            }));
        }
        Err(error) if is_required => trials.push(Trial::test("a_device", move || Err(error.to_string().into()))),
        Err(error) => {
            eprintln!("IGNORED, the GPU is not tested: {error}");
            let ignored = |name| Trial::test(name, || Ok(())).with_ignored_flag(true).with_kind("no device");
            trials.extend(DEVICE_TESTS.map(|(name, _)| ignored(name)));
        }
    }
    // The longest first.
    trials.insert(0, driver::trial());
    libtest_mimic::run(&arguments, trials).exit();
}

/// A test that passes unless it panics.
fn trial(name: &str, test: impl FnOnce() + Send + 'static) -> Trial {
    Trial::test(name, move || {
        test();
        Ok(())
    })
}
