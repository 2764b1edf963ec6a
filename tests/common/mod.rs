//! What several integration tests need.

use std::path::PathBuf;

/// A file among the real logs; `None`, with a notice, where there are none and none are required.
pub fn data(file: &str) -> Option<PathBuf> {
    let folder = std::env::var_os("IPSLAM_DATA")
        .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/data"), PathBuf::from);
    let path = folder.join(file);
    if path.is_file() {
        return Some(path);
    }
    let required = std::env::var("IPSLAM_REQUIRE").is_ok_and(|required| required.contains("data"));
    assert!(!required, "{} is required and missing", path.display());
    eprintln!("SKIPPED, nothing tested: {} is missing; set IPSLAM_DATA to the folder of logs", path.display());
    None
}
