//! The program on a real log.

use crate::needs::data;
use assert_cmd::cargo::cargo_bin;
use serde_json::Value;
use std::process::Command;

fn the_first_minute_of_a_real_log_is_mapped() {
    let folder = tempfile::tempdir().unwrap();
    let done = Command::new(cargo_bin("ipslam"))
        .current_dir(folder.path())
        .args(["run", "--backend", "cpu", "--maps", "4", "--particles", "4", "--max-scans", "200", "--out", "out"])
        .arg("--relations")
        .arg(data("csail/mit-csail.relations.gz").canonicalize().unwrap())
        .arg(data("csail/mit-csail.clf.gz").canonicalize().unwrap())
        .output()
        .unwrap();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let summary = std::fs::read(folder.path().join("out/summary.json")).unwrap();
    let summary: Value = serde_json::from_slice(&summary).unwrap();
    assert_eq!(summary["beams"]["scans"], 200);
    // Within the first 40 s there is no loop to close: scan matching alone is within a few centimetres.
    let error = summary["metrics"]["relations"]["all"]["translation_m"]["mean"].as_f64().unwrap();
    assert!(error < 0.1, "{error} m");
}

crate::needs::trials! {
    "program":
    Data { the_first_minute_of_a_real_log_is_mapped }
}
