//! Any bytes as `map.json`: a map that is read has only sound clusters, and is written and read again as it is.
//!
//! `cargo +nightly fuzz run map_json fuzz/corpus/map_json fuzz/seeds/map_json -- -max_total_time=60`

#![no_main]

use ipslam::io::map_json::{read_map, write_map};
use ipslam_fuzz::file;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    let path = file("map.json", data);
    match read_map(&path) {
        Err(error) => assert!(error.to_string().contains("map.json"), "{error}"),
        Ok(map) => {
            for cluster in &map.clusters {
                assert!(cluster.along_variance >= cluster.across_variance && cluster.across_variance >= 0.0);
                assert!(cluster.mean.iter().chain(cluster.direction.iter()).all(|number| number.is_finite()));
            }
            let mut written = Vec::new();
            write_map(&map, &mut written).expect("memory takes all");
            let again = read_map(&file("map.json", &written)).expect("what was written is read");
            assert_eq!(again.clusters.len(), map.clusters.len());
        }
    }
});
