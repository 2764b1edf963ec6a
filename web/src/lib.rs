//! The library in a browser: maps a log that is in memory, and hands a page what to show of it, as arrays of numbers.
//! Metres, radians, seconds, in the world's frame.

use ipslam::config::SlamConfig;
use ipslam::io::mcap::Topics;
use ipslam::io::open_bytes;
use ipslam::simulate::Simulation;
use mapped::Mapped;
use wasm_bindgen::prelude::*;

mod live;
mod mapped;

#[wasm_bindgen]
extern "C" {
    /// Who watches while a log is mapped: an object with these methods.
    pub type Viewer;

    /// What is done, as the words and the share of a progress bar, 0 to 1; no share where nobody knows.
    #[wasm_bindgen(method)]
    fn progress(this: &Viewer, doing: &str, share: Option<f64>);

    /// The filter after a step: walls as rows of `x1 y1 x2 y2`, the path of the best particle as rows of `x y heading`, the scan
    /// seen from its end as rows of `x y`, all particles as rows of `x y heading weight`, the scans so far, and the effective
    /// sample size.
    #[wasm_bindgen(method)]
    fn step(
        this: &Viewer,
        walls: Vec<f32>,
        path: Vec<f32>,
        scan: Vec<f32>,
        particles: Vec<f32>,
        scans: f64,
        effective_sample_size: f64,
    );
}

/// What can be set of a run.
#[wasm_bindgen]
pub struct Settings {
    config: SlamConfig,
    topics: Topics,
}

#[wasm_bindgen]
impl Settings {
    /// The defaults, with as many particles as maps. Topics are those of a bag; empty where it has one of the kind.
    ///
    /// # Errors
    /// A number is outside of its range.
    #[wasm_bindgen(constructor)]
    pub fn new(maps: f64, seed: f64, scan_topic: &str, odometry_topic: &str) -> Result<Self, String> {
        let count = |name: &str, number: f64, least: f64| {
            let is_count = number.fract() == 0.0 && (least..9e15).contains(&number);
            if is_count { Ok(number as u64) } else { Err(format!("{name}: a whole number from {least} is needed")) }
        };
        let maps = count("maps", maps, 1.0)? as usize;
        let config = SlamConfig { maps, particles: maps, seed: count("seed", seed, 0.0)?, ..SlamConfig::default() };
        config.validate().map_err(|error| error.to_string())?;
        let named = |topic: &str| Some(topic.trim().to_owned()).filter(|topic| !topic.is_empty());
        let topics = Topics {
            scan: named(scan_topic).into_iter().collect(),
            odometry: named(odometry_topic),
            ..Topics::default()
        };
        Ok(Self { config, topics })
    }
}

/// Maps the log in the bytes of a file.
///
/// # Errors
/// It is no log, or has no scan.
#[wasm_bindgen]
pub fn map_log(name: &str, bytes: Vec<u8>, settings: &Settings, viewer: &Viewer) -> Result<Mapped, String> {
    let log = open_bytes(name, bytes, &settings.topics).map_err(|error| in_page(&error.to_string()))?;
    live::map(&*log, None, settings.config, viewer).map_err(|error| in_page(&error))
}

/// Maps the built-in building.
///
/// # Errors
/// None that is known.
#[wasm_bindgen]
pub fn map_building(settings: &Settings, viewer: &Viewer) -> Result<Mapped, String> {
    let building = Simulation::building(1);
    live::map(&building, Some(building.sweeps()), settings.config, viewer)
}

/// The text of an error, with the program's options by the names that they have on the page.
fn in_page(text: &str) -> String {
    text.replace("--scan-topic", "“Scan topic”").replace("--odom-topic", "“Odometry topic”")
}
