//! Which evaluator a run takes: a GPU or the CPU.

use clap::ValueEnum;
use ipslam::evaluator::Evaluator;

/// What evaluates the particles.
#[derive(Debug, clap::Args)]
pub struct BackendArgs {
    /// What draws and weighs the particles
    #[arg(long, value_enum, default_value_t = Backend::Auto)]
    backend: Backend,
    /// The device whose name has this text in it; `ipslam devices` tells the names
    #[arg(long, value_name = "NAME")]
    adapter: Option<String>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Backend {
    /// A GPU where there is one, else the CPU
    Auto,
    /// A GPU; an error where there is none
    Gpu,
    /// The CPU
    Cpu,
}

/// An evaluator, and its name. Without one the CPU is meant.
pub struct Chosen {
    pub evaluator: Option<Box<dyn Evaluator>>,
    pub name: String,
}

impl Chosen {
    /// The CPU, with the reason if it is a second choice.
    pub fn cpu(reason: Option<String>) -> Self {
        Self { evaluator: None, name: reason.map_or_else(|| "CPU".to_owned(), |reason| format!("CPU ({reason})")) }
    }
}

#[cfg(not(feature = "gpu"))]
impl BackendArgs {
    /// The evaluator that was asked for.
    pub fn choose(&self) -> anyhow::Result<Chosen> {
        let without = "this program was built without the feature gpu";
        anyhow::ensure!(self.backend != Backend::Gpu && self.adapter.is_none(), "no GPU: {without}");
        Ok(Chosen::cpu((self.backend == Backend::Auto).then(|| without.to_owned())))
    }
}

#[cfg(feature = "gpu")]
impl BackendArgs {
    /// The evaluator that was asked for.
    pub fn choose(&self) -> anyhow::Result<Chosen> {
        use ipslam::gpu::device::{AdapterKind, find};
        match self.backend {
            Backend::Cpu => {
                anyhow::ensure!(self.adapter.is_none(), "--adapter chooses a GPU, and --backend cpu takes none");
                Ok(Chosen::cpu(None))
            }
            Backend::Gpu => Ok(open(&find(self.adapter.as_deref())?)?),
            // A device that was named is taken, whatever it is.
            Backend::Auto if self.adapter.is_some() => Ok(open(&find(self.adapter.as_deref())?)?),
            Backend::Auto => Ok(match find(None) {
                Ok(adapter) if adapter.kind == AdapterKind::Software => {
                    Chosen::cpu(Some(format!("{} is no GPU but software", adapter.name)))
                }
                Ok(adapter) => open(&adapter).unwrap_or_else(|error| Chosen::cpu(Some(error.to_string()))),
                Err(error) => Chosen::cpu(Some(error.to_string())),
            }),
        }
    }
}

#[cfg(feature = "gpu")]
fn open(adapter: &ipslam::gpu::device::Adapter) -> Result<Chosen, ipslam::gpu::DeviceError> {
    let evaluator = ipslam::evaluator::gpu::GpuEvaluator::new(adapter)?;
    let name = format!("{} ({}, {})", adapter.name, adapter.interface, adapter.driver);
    Ok(Chosen { evaluator: Some(Box::new(evaluator)), name })
}
