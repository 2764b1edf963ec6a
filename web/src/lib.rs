//! The library in a browser: maps a log that is in memory, and hands a page what to show of it, as arrays of numbers.
//! Metres, radians, seconds, in the world's frame.
//!
//! A log is given in, `work` does the work, and `take` hands out what came of it. `work` takes nothing and returns nothing, so that
//! JavaScript can wrap it in `WebAssembly.promising`: it may be suspended while a GPU works.

use backend::Backend;
use ipslam::config::SlamConfig;
use ipslam::io::mcap::Topics;
use ipslam::io::open_bytes;
use ipslam::simulate::Simulation;
use mapped::Mapped;
use std::cell::Cell;
use wasm_bindgen::prelude::*;

mod backend;
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
    backend: Backend,
    topics: Topics,
}

#[wasm_bindgen]
impl Settings {
    /// The defaults, with as many particles as maps. The backend is `auto`, `gpu` or `cpu`, as of the program. Topics are those of a
    /// bag; empty where it has one of the kind.
    ///
    /// # Errors
    /// A number is outside of its range, or there is no such backend.
    #[wasm_bindgen(constructor)]
    pub fn new(maps: f64, seed: f64, backend: &str, scan_topic: &str, odometry_topic: &str) -> Result<Self, String> {
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
        Ok(Self { config, backend: backend.parse()?, topics })
    }
}

type Work = Box<dyn FnOnce() -> Result<Mapped, String>>;

thread_local! {
    static WORK: Cell<Option<Work>> = const { Cell::new(None) };
    static DONE: Cell<Option<Result<Mapped, String>>> = const { Cell::new(None) };
}

/// To map: the log in the bytes of a file.
#[wasm_bindgen]
pub fn give_log(name: String, bytes: Vec<u8>, settings: Settings, viewer: Viewer) {
    WORK.set(Some(Box::new(move || {
        let Settings { config, backend, topics } = settings;
        let log = open_bytes(&name, bytes, &topics).map_err(|error| in_page(&error.to_string()))?;
        live::map(&*log, None, config, backend, &viewer).map_err(|error| in_page(&error))
    })));
}

/// To map: the built-in building.
#[wasm_bindgen]
pub fn give_building(settings: Settings, viewer: Viewer) {
    WORK.set(Some(Box::new(move || {
        let building = Simulation::building(1);
        live::map(&building, Some(building.sweeps()), settings.config, settings.backend, &viewer)
    })));
}

/// Maps what was given.
#[wasm_bindgen]
pub fn work() {
    DONE.set(WORK.take().map(|work| work()));
}

/// What `work` made.
///
/// # Errors
/// It was no log, or had no scan; or a GPU was asked for and there is none.
#[wasm_bindgen]
pub fn take() -> Result<Mapped, String> {
    DONE.take().unwrap_or_else(|| Err("nothing was mapped".to_owned()))
}

/// The text of an error, with the program's options by the names that they have on the page.
fn in_page(text: &str) -> String {
    text.replace("--scan-topic", "“Scan topic”").replace("--odom-topic", "“Odometry topic”")
}
