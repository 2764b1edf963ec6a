//! `ipslam devices`: which devices there are, and whether they compute what the CPU computes.

#[cfg(feature = "gpu")]
use ipslam::evaluator::{
    EvaluatorError,
    gpu::{
        GpuEvaluator,
        device::{Adapter, adapters, find},
    },
    workload::Workload,
};

/// Lists the devices that particles can be evaluated on, each with a short test against the CPU.
#[derive(Debug, clap::Args)]
pub struct DevicesArgs {}

/// Nats a point that the weights of a device may be off.
#[cfg(feature = "gpu")]
const TOLERANCE: f64 = 1e-3;

/// Prints the list; a device that fails its test is an error.
#[cfg(feature = "gpu")]
pub fn devices(_: &DevicesArgs) -> anyhow::Result<Vec<anyhow::Error>> {
    let adapters = adapters();
    if adapters.is_empty() {
        // Tells what to do about it.
        find(None)?;
    }
    let mut errors = Vec::new();
    for adapter in adapters {
        let limits = adapter.limits();
        let megabytes = |bytes: u64| bytes / 1_000_000;
        println!("{}", adapter.name);
        println!("  kind      {:?}, {}, {}", adapter.kind, adapter.interface, adapter.driver);
        println!(
            "  limits    {} MB a buffer, {} MB bound at a time, {} workgroups a dispatch, {} kB shared in one",
            megabytes(limits.max_buffer_size),
            megabytes(limits.max_storage_buffer_binding_size),
            limits.max_compute_workgroups_per_dimension,
            limits.max_compute_workgroup_storage_size / 1000
        );
        match test(&adapter) {
            Ok(difference) if difference <= TOLERANCE => {
                println!("  self-test passed: at most {difference:.0e} nats a point from the CPU");
            }
            Ok(difference) => {
                println!("  self-test FAILED");
                let name = &adapter.name;
                errors.push(anyhow::anyhow!("{name} is {difference:.0e} nats a point off; use another, or the CPU"));
            }
            Err(error) => {
                println!("  self-test FAILED");
                errors.push(error.into());
            }
        }
    }
    Ok(errors)
}

#[cfg(feature = "gpu")]
fn test(adapter: &Adapter) -> Result<f64, EvaluatorError> {
    Workload::new(1000, 361, 200).difference(&mut GpuEvaluator::new(adapter)?)
}

/// There is nothing to list.
#[cfg(not(feature = "gpu"))]
pub fn devices(_: &DevicesArgs) -> anyhow::Result<Vec<anyhow::Error>> {
    anyhow::bail!("this program was built without the feature gpu: build it with `--features gpu`")
}
