//! What evaluates the particles: WebGPU or the CPU.

use ipslam::evaluator::Evaluator;
use ipslam::evaluator::by_size::{BySize, MANY};
use ipslam::evaluator::gpu::GpuEvaluator;
use ipslam::gpu::device::{AdapterKind, find};
use std::str::FromStr;

/// What was asked for, in the words of the program's `--backend`.
#[derive(Clone, Copy)]
pub enum Backend {
    /// WebGPU for steps with many particles, where there is a GPU; else the CPU.
    Auto,
    /// WebGPU for every step.
    Gpu,
    /// The CPU.
    Cpu,
}

impl FromStr for Backend {
    type Err = String;

    fn from_str(word: &str) -> Result<Self, String> {
        match word {
            "auto" => Ok(Self::Auto),
            "gpu" => Ok(Self::Gpu),
            "cpu" => Ok(Self::Cpu),
            _ => Err(format!("backend: auto, gpu or cpu is needed, not {word}")),
        }
    }
}

/// An evaluator, and its name. Without one the CPU is meant.
pub type Chosen = (Option<Box<dyn Evaluator>>, String);

impl Backend {
    /// Opens the device. Has to be called where WebAssembly can be suspended, unless it is the CPU that was asked for.
    ///
    /// # Errors
    /// The browser has no WebGPU, and the CPU was not to take its place.
    pub fn choose(self) -> Result<Chosen, String> {
        let cpu = |reason: &str| (None, format!("CPU{reason}"));
        let found = match self {
            Self::Cpu => return Ok(cpu("")),
            Self::Gpu => find(None).map_err(|error| error.to_string())?,
            Self::Auto => match find(None) {
                Ok(adapter) if adapter.kind != AdapterKind::Software => adapter,
                _ => return Ok(cpu(" (the browser has no GPU)")),
            },
        };
        let software = if found.kind == AdapterKind::Software { ", in software" } else { "" };
        let name = match found.name.as_str() {
            "WebGPU" => format!("WebGPU{software}"),
            name => format!("WebGPU: {name}{software}"),
        };
        match (self, GpuEvaluator::new(&found)) {
            (Self::Auto, Ok(device)) => {
                Ok((Some(Box::new(BySize::new(device))), format!("{name}; the CPU for fewer than {MANY} particles")))
            }
            (_, Ok(device)) => Ok((Some(Box::new(device)), name)),
            (Self::Auto, Err(error)) => Ok(cpu(&format!(" ({error})"))),
            (_, Err(error)) => Err(error.to_string()),
        }
    }
}
