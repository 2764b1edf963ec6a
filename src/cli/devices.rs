//! `ipslam devices`: which devices there are, and whether they compute what the CPU computes.

#[cfg(feature = "gpu")]
use super::{say::print_line, workload::Workload};
#[cfg(feature = "gpu")]
use ipslam::{
    evaluator::gpu::GpuEvaluator,
    gpu::DeviceError,
    gpu::device::{Adapter, adapters, find},
};
#[cfg(feature = "gpu")]
use serde::Serialize;

/// Lists the devices that particles can be evaluated on, each with a short test against the CPU.
#[derive(Debug, clap::Args)]
pub struct DevicesArgs {
    /// Print JSON
    #[arg(long)]
    json: bool,
    /// Say whether there is a GPU, and no more: how the program asks a driver that may crash
    #[arg(long, hide = true)]
    probe: bool,
}

/// Nats a point that the weights of a device may be off.
#[cfg(feature = "gpu")]
const TOLERANCE: f64 = 1e-3;

/// What a device is and can.
#[cfg(feature = "gpu")]
#[derive(Serialize)]
struct Device {
    name: String,
    kind: String,
    interface: String,
    driver: String,
    max_buffer_bytes: u64,
    max_bound_bytes: u64,
    max_workgroups_a_dimension: u32,
    max_shared_bytes: u32,
    /// How far the weights are from those of the CPU; `None` where the test could not be made.
    difference_nats_a_point: Option<f64>,
    passed: bool,
}

/// Prints the list; a device that fails its test is an error.
#[cfg(feature = "gpu")]
pub fn devices(args: &DevicesArgs) -> anyhow::Result<Vec<anyhow::Error>> {
    if args.probe {
        super::backend::answer_probe();
        return Ok(Vec::new());
    }
    let adapters = adapters();
    if adapters.is_empty() {
        // Names the remedy.
        find(None)?;
    }
    let (mut devices, mut errors) = (Vec::new(), Vec::new());
    for adapter in adapters {
        let tested = test(&adapter);
        let difference = tested.as_ref().ok().copied();
        let limits = adapter.limits();
        let device = Device {
            name: adapter.name.clone(),
            kind: format!("{:?}", adapter.kind),
            interface: adapter.interface.clone(),
            driver: adapter.driver.clone(),
            max_buffer_bytes: limits.max_buffer_size,
            max_bound_bytes: limits.max_storage_buffer_binding_size,
            max_workgroups_a_dimension: limits.max_compute_workgroups_per_dimension,
            max_shared_bytes: limits.max_compute_workgroup_storage_size,
            difference_nats_a_point: difference,
            passed: difference.is_some_and(|difference| difference <= TOLERANCE),
        };
        match tested {
            Ok(difference) if !device.passed => {
                let name = &device.name;
                errors.push(anyhow::anyhow!("{name} is {difference:.0e} nats a point off; use another, or the CPU"));
            }
            Ok(_) => {}
            Err(error) => errors.push(error.into()),
        }
        if !args.json {
            print_line!("{}", device.lines().trim_end());
        }
        devices.push(device);
    }
    if args.json {
        print_line!("{:#}", serde_json::to_value(&devices)?);
    }
    Ok(errors)
}

#[cfg(feature = "gpu")]
fn test(adapter: &Adapter) -> Result<f64, DeviceError> {
    Workload::new(1000, 361, 200).difference(&mut GpuEvaluator::new(adapter)?)
}

#[cfg(feature = "gpu")]
impl Device {
    fn lines(&self) -> String {
        let test = match self.difference_nats_a_point {
            Some(difference) if self.passed => format!("passed: at most {difference:.0e} nats a point from the CPU"),
            _ => "FAILED".to_owned(),
        };
        let megabytes = |bytes: u64| bytes / 1_000_000;
        format!(
            "{}\n  kind      {}, {}, {}\n  limits    {} MB a buffer, {} MB bound at a time, {} workgroups a dispatch, {} kB \
             shared in one\n  self-test {test}\n",
            self.name,
            self.kind,
            self.interface,
            self.driver,
            megabytes(self.max_buffer_bytes),
            megabytes(self.max_bound_bytes),
            self.max_workgroups_a_dimension,
            self.max_shared_bytes / 1000,
        )
    }
}

/// There is nothing to list.
#[cfg(not(feature = "gpu"))]
pub fn devices(_: &DevicesArgs) -> anyhow::Result<Vec<anyhow::Error>> {
    anyhow::bail!("this program was built without the feature gpu: build it with `--features gpu`")
}
