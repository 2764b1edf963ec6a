//! Which evaluator a run takes: a GPU or the CPU.

#[cfg(feature = "gpu")]
use super::{UsageError, say::print_line};
use clap::ValueEnum;
use ipslam::evaluator::Evaluator;
#[cfg(feature = "gpu")]
use ipslam::evaluator::{
    by_size::{BySize, MANY},
    gpu::GpuEvaluator,
};
#[cfg(feature = "gpu")]
use std::process::{Command, Stdio};
#[cfg(feature = "gpu")]
use std::time::{Duration, Instant};

/// What evaluates the particles.
#[derive(Debug, clap::Args)]
pub struct BackendArgs {
    /// What draws and weighs the particles
    #[arg(long, value_enum, default_value_t = Backend::Auto)]
    backend: Backend,
    /// The device whose name has this text in it; `ipslam devices` lists the names
    #[arg(long, value_name = "NAME")]
    adapter: Option<String>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Backend {
    /// A GPU, if available, for steps with 1024 particles or more; else the CPU
    Auto,
    /// A GPU for every step; an error if none is available
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
    /// The chosen evaluator.
    pub fn choose(&self) -> anyhow::Result<Chosen> {
        let without = "this program was built without the feature gpu";
        anyhow::ensure!(self.backend != Backend::Gpu && self.adapter.is_none(), "no GPU: {without}");
        Ok(Chosen::cpu((self.backend == Backend::Auto).then(|| without.to_owned())))
    }
}

#[cfg(feature = "gpu")]
impl BackendArgs {
    /// The chosen evaluator.
    pub fn choose(&self) -> anyhow::Result<Chosen> {
        use ipslam::gpu::device::find;
        match self.backend {
            Backend::Cpu => {
                anyhow::ensure!(
                    self.adapter.is_none(),
                    UsageError("--adapter chooses a GPU, and --backend cpu takes none".to_owned())
                );
                Ok(Chosen::cpu(None))
            }
            Backend::Gpu => {
                let (device, name) = open(&find(self.adapter.as_deref())?)?;
                Ok(Chosen { evaluator: Some(Box::new(device)), name })
            }
            // A device that was named is taken, whatever it is.
            Backend::Auto if self.adapter.is_some() => Ok(by_size(open(&find(self.adapter.as_deref())?)?)),
            Backend::Auto => Ok(match probe() {
                Ok(()) => find(None)
                    .and_then(|adapter| open(&adapter))
                    .map_or_else(|error| Chosen::cpu(Some(error.to_string())), by_size),
                Err(reason) => Chosen::cpu(Some(reason)),
            }),
        }
    }
}

#[cfg(feature = "gpu")]
fn open(adapter: &ipslam::gpu::device::Adapter) -> Result<(GpuEvaluator, String), ipslam::gpu::DeviceError> {
    let name = format!("{} ({}, {})", adapter.name, adapter.interface, adapter.driver);
    Ok((GpuEvaluator::new(adapter)?, name))
}

#[cfg(feature = "gpu")]
fn by_size((device, name): (GpuEvaluator, String)) -> Chosen {
    let name = format!("{name}; the CPU for fewer than {MANY} particles");
    Chosen { evaluator: Some(Box::new(BySize::new(device))), name }
}

/// Whether a usable GPU exists, found out in a child process: a driver may crash when its devices are merely listed, and may print
/// its own messages to stderr.
#[cfg(feature = "gpu")]
fn probe() -> Result<(), String> {
    const PATIENCE: Duration = Duration::from_secs(20);
    let program = std::env::current_exe().map_err(|error| format!("the graphics driver cannot be queried: {error}"))?;
    let mut child = Command::new(program)
        .args(["devices", "--probe"])
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .map_err(|error| format!("the graphics driver cannot be queried: {error}"))?;
    let began = Instant::now();
    while let Ok(None) = child.try_wait() {
        if began.elapsed() > PATIENCE {
            // It may be over by now, or nothing may help.
            let _ = child.kill();
            return Err(format!("the graphics driver did not answer in {} s", PATIENCE.as_secs()));
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    let output = child.wait_with_output().map_err(|error| format!("the graphics driver cannot be queried: {error}"))?;
    match String::from_utf8_lossy(&output.stdout).trim() {
        USABLE if output.status.success() => Ok(()),
        reason if output.status.success() => Err(reason.to_owned()),
        _ => Err(format!("the graphics driver crashed when its devices were listed: {}", output.status)),
    }
}

/// What the other process prints if there is a GPU.
#[cfg(feature = "gpu")]
const USABLE: &str = "usable";

/// The other process: says on stdout whether there is a GPU, or why not.
#[cfg(feature = "gpu")]
pub fn answer_probe() {
    use ipslam::gpu::device::{AdapterKind, find};
    match find(None) {
        Ok(adapter) if adapter.kind == AdapterKind::Software => {
            print_line!("{} is no GPU but software", adapter.name);
        }
        Ok(_) => print_line!("{USABLE}"),
        Err(error) => print_line!("{error}"),
    }
}
