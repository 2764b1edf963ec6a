//! `ipslam replay`: runs a recorded log again, and compares what comes out with what was recorded. Recordings of objects are
//! replayed by `replay_semantic`.

use super::UsageError;
use super::backend::BackendArgs;
use super::configuration::ConfigArgs;
use super::output::OutArgs;
use super::recording::RecordLevel;
use super::run::GridArgs;
use super::threads::ThreadArgs;
use super::truth::TruthArgs;
use anyhow::bail;
use std::path::{Path, PathBuf};

/// Runs a recorded log again: to verify the recording, or with other options to compare with it.
#[derive(Debug, clap::Args)]
pub struct ReplayArgs {
    /// Recording that `ipslam run --record` or `ipslam semantic --record` made
    #[arg(value_name = "RUN.rrd")]
    pub recording: PathBuf,
    /// Compare bit for bit with what was recorded, on the CPU and with the recorded options; fail at the first difference
    #[arg(long, conflicts_with_all = ["preset", "config", "particles", "maps", "seed", "backend", "adapter"])]
    pub verify: bool,
    #[command(flatten)]
    pub config: ConfigArgs,
    #[command(flatten)]
    backend: BackendArgs,
    #[command(flatten)]
    pub threads: ThreadArgs,
    #[command(flatten)]
    pub truth: TruthArgs,
    #[command(flatten)]
    grid: GridArgs,
    #[command(flatten)]
    pub out: OutArgs,
    /// New recording with both runs side by side [default: replay.rrd among the outputs; none with --verify]
    #[arg(long, value_name = "FILE.rrd")]
    pub record: Option<PathBuf>,
    /// How much of each step is recorded
    #[arg(long, value_enum, default_value_t)]
    record_level: RecordLevel,
    /// Print the comparison as JSON, and nothing else
    #[arg(long)]
    pub json: bool,
}

/// For a file of a known other kind the error names the command that reads it; all others are left to the reader.
fn refuse_other(path: &Path) -> anyhow::Result<()> {
    let ending = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    let shown = path.display();
    let what = match &*ending {
        "json" | "yaml" | "yml" | "pgm" => {
            format!("this is a map: `ipslam localize {shown} LOG` finds the robot in it")
        }
        "clf" | "gz" | "mcap" | "db3" | "bag" => {
            format!("this is a log: `ipslam run {shown} --record RUN.rrd` makes a recording")
        }
        "tum" | "csv" | "kitti" => "this is a trajectory".to_owned(),
        _ => return Ok(()),
    };
    bail!(UsageError(format!("{shown}: {what}; what is replayed is a recording (.rrd) of `ipslam run --record`")))
}

/// Without the recorder nothing can be replayed.
#[cfg(not(feature = "record"))]
pub fn replay(args: &ReplayArgs) -> anyhow::Result<Vec<anyhow::Error>> {
    refuse_other(&args.recording)?;
    bail!("{}: replay needs {}", args.recording.display(), super::recording::FEATURE)
}

#[cfg(feature = "record")]
pub use with_recorder::replay;

#[cfg(feature = "record")]
mod with_recorder {
    use super::super::backend::Chosen;
    use super::super::interrupt;
    use super::super::recording::refuse_input;
    use super::super::replay_semantic::replay_mapping;
    use super::super::run::{Job, Printed};
    use super::super::say::{print_line, say};
    use super::{ReplayArgs, refuse_other};
    use anyhow::{bail, ensure};
    use ipslam::config::{Config, SlamConfig};
    use ipslam::detections::DetectionKind;
    use ipslam::grid::drawn;
    use ipslam::log::LogSource as _;
    use ipslam::pipeline::{Continued, Outcome, RunInfo};
    use ipslam::record::rerun::RerunObserver;
    use ipslam::record::rerun::read::{RecordedRun, RecordedStep, Store};
    use ipslam::record::rerun::semantic::{RecordedMapping, kind};
    use ipslam::report::{Event, Observer, StageTimes};
    use ipslam::semantic::{Plane, Space};
    use serde_json::json;
    use std::cell::RefCell;
    use std::fmt::Write as _;
    use std::rc::Rc;

    /// Runs the log of a recording again. Errors that the run went on after are returned as a list.
    pub fn replay(args: &ReplayArgs) -> anyhow::Result<Vec<anyhow::Error>> {
        refuse_other(&args.recording)?;
        let store = Store::open(&args.recording)?;
        if let Config::Semantic(_) = store.info.config {
            return match kind(&store)? {
                DetectionKind::Stereo => replay_mapping(args, RecordedMapping::<Space>::new(store)?),
                _ => replay_mapping(args, RecordedMapping::<Plane>::new(store)?),
            };
        }
        let recorded = RecordedRun::new(store)?;
        let shown = args.recording.display();
        ensure!(recorded.entries > 0, "{shown}: it holds no log: nothing was recorded before it broke off");
        let Config::Slam(recorded_config) = recorded.store().info.config else {
            bail!("{shown}: of a localisation; only what `ipslam run` recorded is replayed")
        };
        let config = args.config.over(recorded_config)?;
        let truth = args.truth.read()?;
        let mut outputs = args.out.open(&format!("{}-replayed", recorded.name()))?;
        args.threads.start()?;
        interrupt::watch()?;
        let chosen = if args.verify { Chosen::cpu(None) } else { args.backend.choose()? };
        let Chosen { evaluator, name: device } = chosen;
        if args.verify {
            ensure!(
                recorded.store().info.device.starts_with("CPU"),
                "{shown} was recorded on the {}: only the CPU repeats a run bit for bit; replay without --verify \
                 compares the two",
                recorded.store().info.device
            );
            if recorded.store().version != env!("CARGO_PKG_VERSION") {
                say!("{shown} was recorded by version {}: another version may differ", recorded.store().version);
            }
        }
        let info = RunInfo { device, config: Config::Slam(config), ..recorded.store().info.clone() };

        let replayed = Rc::new(RefCell::new(Replayed::default()));
        let mut observers: Vec<Box<dyn Observer>> = vec![Box::new(Listener(Rc::clone(&replayed)))];
        let record = args.record.clone().or_else(|| (!args.verify).then(|| outputs.path("replay.rrd")));
        if let Some(path) = &record {
            refuse_input(path, Some(&args.recording))?;
            observers.push(Box::new(RerunObserver::beside(&recorded, path, &info, args.record_level.into())?));
        }
        let smooth = recorded.result.is_none_or(|result| result.is_smoothed);
        let job = Job {
            // What is recorded has none.
            detections: None,
            source: &recorded,
            info: &info,
            config: &config,
            max_scans: None,
            truth: &truth,
            cell_size: args.grid.cell_size,
            earlier_grid: info
                .continues
                .as_ref()
                .map(|Continued { map, .. }| drawn(&map.clusters, map.free.as_ref(), args.grid.cell_size))
                .transpose()?,
            align: false,
            smooth,
            printed: (!args.json).then_some(Printed::Table),
            dropped: &|| 0,
        };
        let mapped = job.run(evaluator, &mut observers, &mut outputs)?;
        drop(observers);
        let replayed = replayed.take();

        if args.verify {
            verify(&recorded, &replayed)?;
            let what = if recorded.result.is_some() { "the result" } else { "no result: the recording breaks off" };
            print_line!("identical bit for bit: {} steps and {what}", recorded.steps.len());
            outputs.finish();
            return Ok(std::mem::take(&mut outputs.errors));
        }
        let comparison = Comparison::new(&recorded, [&recorded_config, &config], &replayed, &mapped, &info);
        outputs.write("comparison.json", format!("{:#}\n", comparison.json()).as_bytes());
        let text = if args.json { format!("{:#}\n", comparison.json()) } else { format!("\n{}", comparison.table()) };
        print_line!("{}", text.trim_end());
        if let Some(path) = record {
            say!("both runs side by side: {}", path.display());
        }
        outputs.finish();
        Ok(std::mem::take(&mut outputs.errors))
    }

    /// What the replay found.
    #[derive(Default)]
    struct Replayed {
        steps: Vec<RecordedStep>,
        result: Option<u32>,
    }

    struct Listener(Rc<RefCell<Replayed>>);

    impl Observer for Listener {
        fn on_event(&mut self, event: &Event<'_>) {
            match event {
                Event::Step(report) => self.0.borrow_mut().steps.push(RecordedStep::from(*report)),
                Event::Finished { result, .. } => self.0.borrow_mut().result = Some(result.checksum()),
                Event::Entry(_) | Event::Scan(_) | Event::Pose(_) => {}
            }
        }
    }

    /// Whether the replay is the recorded run to the last bit.
    fn verify(recorded: &RecordedRun, replayed: &Replayed) -> anyhow::Result<()> {
        for (was, is) in recorded.steps.iter().zip(&replayed.steps) {
            let poses = [was, is].map(|step| step.world_from_robot);
            let step = was.step;
            ensure!(poses[0] == poses[1], "step {step}: the best particle was at {:?}, now {:?}", poses[0], poses[1]);
            ensure!(
                was.checksum == is.checksum,
                "step {step}: particles, weights or map differ, at the same best pose"
            );
        }
        // A recording that breaks off may lack its last steps, but has none that the replay lacks.
        let (was, is) = (recorded.steps.len(), replayed.steps.len());
        ensure!(was <= is, "step {is}: the replay has no more steps, {was} were recorded");
        if let Some(result) = recorded.result {
            ensure!(was == is, "step {was}: the recording has no more steps, the replay has {is}");
            if replayed.result != Some(result.checksum) {
                bail!("all {was} steps are the same, but the result differs: map or trajectory");
            }
        }
        Ok(())
    }

    /// Two runs of one log.
    struct Comparison<'a> {
        recorded: Side<'a>,
        replayed: Side<'a>,
        /// The first step whose particles, weights or map differ.
        first_difference: Option<u32>,
        /// How far the final trajectories are apart at the same reading: mean and maximum [m].
        apart: Option<(f64, f64)>,
    }

    struct Side<'a> {
        device: &'a str,
        config: &'a SlamConfig,
        steps: &'a [RecordedStep],
    }

    impl<'a> Comparison<'a> {
        fn new(
            recorded: &'a RecordedRun,
            [recorded_config, config]: [&'a SlamConfig; 2],
            replayed: &'a Replayed,
            mapped: &Outcome,
            info: &'a RunInfo,
        ) -> Self {
            let (was, is) = (&recorded.steps, &replayed.steps);
            let differ = |(was, is): &(&RecordedStep, &RecordedStep)| was.checksum != is.checksum;
            let shorter = (was.len() != is.len()).then_some(was.len().min(is.len()) as u32);
            let first_difference = was.iter().zip(is).find(differ).map(|(was, _)| was.step).or(shorter);
            let distances: Vec<f64> = recorded
                .trajectory
                .iter()
                .zip(mapped.result.trajectory())
                .map(|(was, is)| (was - is.pose.position()).norm())
                .collect();
            let mean = distances.iter().sum::<f64>() / distances.len().max(1) as f64;
            let apart = (!distances.is_empty()).then(|| (mean, distances.iter().copied().fold(0.0, f64::max)));
            Self {
                recorded: Side { device: &recorded.store().info.device, config: recorded_config, steps: was },
                replayed: Side { device: &info.device, config, steps: is },
                first_difference,
                apart,
            }
        }

        fn json(&self) -> serde_json::Value {
            json!({
                "recorded": self.recorded.json(),
                "replayed": self.replayed.json(),
                "first_step_that_differs": self.first_difference,
                "trajectories_apart_m": self.apart.map(|(mean, max)| json!({ "mean": mean, "max": max })),
            })
        }

        fn table(&self) -> String {
            let (was, is) = (self.recorded.rows(), self.replayed.rows());
            let mut table = format!("{:<34} {:>16} {:>16}\n", "", "recorded", "replayed");
            for ((name, was), (_, is)) in was.into_iter().zip(is) {
                let _ = writeln!(table, "{name:<34} {was:>16} {is:>16}");
            }
            let _ = match self.first_difference {
                Some(step) => writeln!(table, "{:<34} {step}", "first step that differs"),
                None => writeln!(table, "every step is the same, to the last bit"),
            };
            if let Some((mean, max)) = self.apart {
                let apart = "trajectories apart [m]";
                let _ = writeln!(table, "{apart:<34} {mean:.4} on average, {max:.4} at most");
            }
            let _ =
                writeln!(table, "recorded on the {}\nreplayed on the {}", self.recorded.device, self.replayed.device);
            table
        }
    }

    impl Side<'_> {
        fn mean(&self, of: impl Fn(&RecordedStep) -> f64) -> f64 {
            self.steps.iter().map(of).sum::<f64>() / self.steps.len().max(1) as f64
        }

        fn clusters(&self) -> usize {
            self.steps.last().map_or(0, |step| step.clusters)
        }

        /// Milliseconds a step, by stage.
        fn milliseconds(&self) -> [(&'static str, f64); 7] {
            std::array::from_fn(|stage| {
                let mean = self.mean(|step| step.times.seconds()[stage]);
                (StageTimes::NAMES[stage], 1e3 * mean)
            })
        }

        fn rows(&self) -> Vec<(String, String)> {
            let config = self.config;
            let mut rows = vec![
                ("particles".to_owned(), config.particles.to_string()),
                ("maps".to_owned(), config.maps.to_string()),
                ("seed".to_owned(), config.seed.to_string()),
                ("steps".to_owned(), self.steps.len().to_string()),
                (
                    "effective sample size, mean".to_owned(),
                    format!("{:.1}", self.mean(|step| step.effective_sample_size)),
                ),
                ("clusters after the last step".to_owned(), self.clusters().to_string()),
            ];
            let stages = self.milliseconds();
            rows.extend(stages.map(|(stage, mean)| (format!("{stage} [ms a step]"), format!("{mean:.2}"))));
            let all: f64 = stages.iter().map(|(_, mean)| mean).sum();
            rows.push(("all stages [ms a step]".to_owned(), format!("{all:.2}")));
            rows
        }

        fn json(&self) -> serde_json::Value {
            json!({
                "device": self.device,
                "particles": self.config.particles,
                "maps": self.config.maps,
                "seed": self.config.seed,
                "steps": self.steps.len(),
                "mean_effective_sample_size": self.mean(|step| step.effective_sample_size),
                "clusters": self.clusters(),
                "milliseconds_a_step": self.milliseconds().into_iter().collect::<std::collections::BTreeMap<_, _>>(),
            })
        }
    }
}
