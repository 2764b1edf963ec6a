//! Any bytes as relations and as a trajectory of the TUM format: what is read is finite, in the order of its stamps.
//!
//! `cargo +nightly fuzz run relations fuzz/corpus/relations fuzz/seeds/relations -- -max_total_time=60`

#![no_main]

use ipslam::io::{relations, tum};
use ipslam_fuzz::file;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    let path = file("numbers.txt", data);
    match relations::read(&path) {
        Err(error) => assert!(error.to_string().contains("numbers.txt"), "{error}"),
        Ok(found) => assert!(found.iter().all(|relation| {
            (relation.first_stamp + relation.second_stamp).is_finite() && relation.first_from_second.is_finite()
        })),
    }
    match tum::read(&path) {
        Err(error) => assert!(error.to_string().contains("numbers.txt"), "{error}"),
        Ok(found) => assert!(found.iter().all(|stamped| stamped.stamp.is_finite() && stamped.pose.is_finite())),
    }
});
