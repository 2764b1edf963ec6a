//! Any bytes as a grid of ROS's map_server: up to the first zero byte the YAML, then the picture `map.pgm`.
//!
//! `cargo +nightly fuzz run map_server fuzz/corpus/map_server fuzz/seeds/map_server -- -max_total_time=60`

#![no_main]

use ipslam::io::map_server::read;
use ipslam_fuzz::file;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    let mut parts = data.splitn(2, |&byte| byte == 0);
    let yaml = file("map.yaml", parts.next().unwrap_or_default());
    file("map.pgm", parts.next().unwrap_or_default());
    match read(&yaml) {
        // The picture may be another file.
        Err(error) => assert!(!error.to_string().is_empty()),
        Ok(found) => {
            let cells = u64::from(found.grid.width()) * u64::from(found.grid.height());
            assert!(cells > 0 && cells == found.grid.cells().len() as u64);
            assert!(found.grid.resolution() > 0.0 && found.grid.world_from_grid().is_finite());
        }
    }
});
