//! What other systems reach on public logs: mean translational errors over the benchmark's relations \[m\].

/// A figure.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Published {
    /// A word of the log's name.
    pub log: &'static str,
    /// The system.
    pub system: &'static str,
    /// Over all relations.
    pub all: f64,
    /// Over those longer than 10 s.
    pub loops: Option<f64>,
    /// Who says so.
    pub source: &'static str,
}

/// R. Kuemmerle et al., "On measuring the accuracy of SLAM algorithms", Autonomous Robots 27, 2009.
const KUEMMERLE: &str = "Kuemmerle et al. 2009";
/// One thread, poses at every log line, the parameters of the README.
const MEASURED: &str = "measured for the README";

const fn figure(
    log: &'static str,
    system: &'static str,
    all: f64,
    loops: Option<f64>,
    source: &'static str,
) -> Published {
    Published { log, system, all, loops, source }
}

/// All of them.
pub const PUBLISHED: [Published; 14] = [
    figure("csail", "scan matching", 0.106, None, KUEMMERLE),
    figure("csail", "RBPF, 50 particles", 0.049, None, KUEMMERLE),
    figure("csail", "graph mapping", 0.004, None, KUEMMERLE),
    figure("csail", "GMapping, 30 particles", 0.055, Some(0.087), MEASURED),
    figure("csail", "Karto", 0.0373, Some(0.055), MEASURED),
    figure("csail", "LaMa Slam2D, fine", 0.0325, Some(0.049), MEASURED),
    figure("csail", "LaMa, 30 particles, fine", 0.0309, Some(0.048), MEASURED),
    figure("intel", "scan matching", 0.220, None, KUEMMERLE),
    figure("intel", "RBPF, 50 particles", 0.070, None, KUEMMERLE),
    figure("intel", "graph mapping", 0.031, None, KUEMMERLE),
    figure("intel", "GMapping, 30 particles", 0.041, Some(0.055), MEASURED),
    figure("intel", "Karto", 0.0222, Some(0.0259), MEASURED),
    figure("intel", "LaMa Slam2D, fine", 0.0231, Some(0.0295), MEASURED),
    figure("intel", "LaMa, 30 particles, fine", 0.0218, Some(0.0274), MEASURED),
];
