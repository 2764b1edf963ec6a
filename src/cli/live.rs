//! `ipslam live`: a node of ROS 2. A robot drives; trajectory, map and pose are published meanwhile, and written at the end.

use super::UsageError;
use super::backend::{BackendArgs, Chosen};
use super::configuration::ConfigArgs;
use super::continued::grid_of;
use super::interrupt;
use super::known_map::{known_map, pose, spread};
use super::localize::LocalizationJob;
use super::output::{OutArgs, write_map};
use super::recording::RecordingArgs;
use super::run::{GridArgs, Job, Printed};
use super::say::say;
use super::threads::ThreadArgs;
use super::truth::TruthArgs;
use anyhow::Context as _;
use ipslam::config::{Config, SlamConfig};
use ipslam::geometry::Pose;
use ipslam::io::Stream;
use ipslam::io::mcap::{McapLog, Topics};
use ipslam::live::{LiveError, LiveLocalization, LiveMapping, Names, Network, Node};
use ipslam::localization::InitialPose;
use ipslam::pipeline::RunInfo;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

/// Maps where a robot drives, or finds it in a map, as a node of ROS 2; ROS does not have to be installed.
///
/// Takes scans, odometry and transforms; gives map -> odom on /tf, and the topics map, pose, walls and /diagnostics. Ctrl-C ends it
/// and writes what `ipslam run` or `ipslam localize` writes. An empty message on save_map writes the map so far.
#[derive(Debug, clap::Args)]
pub struct LiveArgs {
    /// Find the robot in this map: map.json of a run, or the YAML file of an occupancy grid (ROS map_server); topic initialpose says
    /// where it is
    #[arg(long, value_name = "MAP")]
    map: Option<PathBuf>,
    /// Where the robot is at first, in the map's frame; without it, it may be anywhere
    #[arg(long, value_name = "X,Y,HEADING", allow_hyphen_values = true, value_parser = pose, requires = "map")]
    start: Option<Pose>,
    /// How well that is known: standard deviations in metres and radians
    #[arg(long, value_name = "METRES,RADIANS", value_parser = spread, default_value = "0.5,0.26", requires = "start")]
    start_spread: [f64; 2],
    /// Topic of the laser scans; again for each further laser of the robot
    #[arg(long, value_name = "TOPIC", default_value = "scan")]
    scan_topic: Vec<String>,
    /// Topic of the odometry messages; where none come, odometry is the transform odom -> robot on /tf
    #[arg(long, value_name = "TOPIC", default_value = "odom")]
    odom_topic: String,
    /// Topic of the inertial sensor, whose gyroscope measures turns; or none [default: imu and imu/data, whichever comes]
    #[arg(long, value_name = "TOPIC|none")]
    imu: Option<String>,
    /// Name space of the node and its topics
    #[arg(long, value_name = "NAME", default_value = "/")]
    namespace: String,
    /// Domain of DDS, 0 to 232 [default: ROS_DOMAIN_ID, or 0]
    #[arg(long, value_name = "NUMBER", value_parser = domain)]
    domain: Option<u16>,
    /// Frame of the map
    #[arg(long, value_name = "FRAME", default_value = "map")]
    map_frame: String,
    #[command(flatten)]
    out: OutArgs,
    #[command(flatten)]
    config: ConfigArgs,
    #[command(flatten)]
    threads: ThreadArgs,
    #[command(flatten)]
    grid: GridArgs,
    #[command(flatten)]
    backend: BackendArgs,
    #[command(flatten)]
    recording: RecordingArgs,
    /// Print the summary as JSON
    #[arg(long)]
    json: bool,
}

fn domain(text: &str) -> Result<u16, String> {
    let domain = text.parse().ok().filter(|&domain: &u16| domain <= 232);
    domain.ok_or_else(|| format!("`{text}` is no domain of DDS, a number from 0 to 232"))
}

/// That of the option, or else of the environment.
fn chosen_domain(option: Option<u16>) -> anyhow::Result<u16> {
    let variable = std::env::var("ROS_DOMAIN_ID").unwrap_or_default();
    match option {
        Some(option) => Ok(option),
        None if variable.is_empty() => Ok(0),
        None => Ok(domain(&variable).map_err(|error| UsageError(format!("ROS_DOMAIN_ID: {error}")))?),
    }
}

/// Where inertial sensors are published by convention.
const IMU: [&str; 2] = ["imu", "imu/data"];
/// Without a scan for so long there is something to say.
const PATIENCE: Duration = Duration::from_secs(5);
/// How often it is asked for.
const TICK: Duration = Duration::from_millis(200);
/// Topics that are listed.
const SHOWN: usize = 20;

/// Maps or finds the robot until a signal comes. What went wrong while it could go on is returned as a list.
pub fn live(args: &LiveArgs) -> anyhow::Result<Vec<anyhow::Error>> {
    match &args.map {
        None => args.map(),
        Some(map) => args.localize(map),
    }
}

impl LiveArgs {
    fn map(&self) -> anyhow::Result<Vec<anyhow::Error>> {
        let config = self.config.over(SlamConfig::default())?;
        self.threads.start()?;
        let mut outputs = self.out.open("live")?;
        let Some(Joined { mut node, source, _watch }) = self.join()? else { return Ok(Vec::new()) };
        let Chosen { evaluator, name: device } = self.backend.choose()?;
        let info = RunInfo { log: "live".to_owned(), device, config: Config::Slam(config), continues: None };
        let mut observers = self.recording.observers(&info, None)?;
        let shared = node.shared().clone();
        let no_truth = TruthArgs::default();
        let job = Job {
            source: &source,
            detections: None,
            info: &info,
            config: &config,
            max_scans: None,
            truth: &no_truth.read()?,
            cell_size: self.grid.cell_size,
            earlier_grid: None,
            align: false,
            smooth: true,
            printed: Some(if self.json { Printed::Json } else { Printed::Table }),
            dropped: &|| shared.now().dropped,
        };
        let folder = outputs.path("saved");
        let save = Box::new(move |result, grid| match write_map(&folder, result, &grid) {
            Ok(()) => say!("the map so far is in {}", folder.display()),
            Err(error) => say!("the map so far cannot be saved: {error:#}"),
        });
        let slam = job.slam(evaluator);
        let mut mapping = LiveMapping::new(&mut node, source.frames().clone(), slam, self.grid.cell_size, save)?;
        if job.run_by(&mut mapping, &mut observers, &mut outputs)?.counts.scans > 0 {
            outputs.finish();
        }
        Ok(std::mem::take(&mut outputs.errors))
    }

    fn localize(&self, path: &Path) -> anyhow::Result<Vec<anyhow::Error>> {
        let config = self.config.of_localization()?;
        self.threads.start()?;
        let map = known_map(path)?;
        let grid = grid_of(path, &map, self.grid.cell_size)?;
        let mut outputs = self.out.open("live-localized")?;
        let Some(Joined { mut node, source, _watch }) = self.join()? else { return Ok(Vec::new()) };
        let Chosen { evaluator, name: device } = self.backend.choose()?;
        let info = RunInfo { log: "live".to_owned(), device, config: Config::Localization(config), continues: None };
        let mut observers = self.recording.observers(&info, None)?;
        let shared = node.shared().clone();
        let job = LocalizationJob {
            map: path,
            source: &source,
            info: &info,
            config: &config,
            skip: 0.0,
            reference: None,
            json: self.json,
            dropped: &|| shared.now().dropped,
        };
        let [position_sigma, heading_sigma] = self.start_spread;
        let initial =
            self.start.map(|world_from_robot| InitialPose { world_from_robot, position_sigma, heading_sigma });
        let filter = job.filter(map, initial, evaluator)?;
        let mut localization = LiveLocalization::new(&mut node, source.frames().clone(), filter, &grid)?;
        job.run_by(&mut localization, &mut observers, &mut outputs)?;
        Ok(std::mem::take(&mut outputs.errors))
    }

    /// Joins the robot's network and waits for the first seconds of scans; `None` where a signal came before.
    fn join(&self) -> anyhow::Result<Option<Joined>> {
        let names = Names {
            domain: chosen_domain(self.domain)?,
            namespace: format!("/{}", self.namespace.trim_matches('/')),
            scan: self.scan_topic.clone(),
            odometry: self.odom_topic.clone(),
            imu: match self.imu.as_deref() {
                None => IMU.map(str::to_owned).to_vec(),
                Some("none") => Vec::new(),
                Some(topic) => vec![topic.to_owned()],
            },
            map_frame: self.map_frame.clone(),
        };
        let topics =
            Topics { scan: names.scan.iter().map(|topic| names.absolute(topic)).collect(), ..Topics::default() };
        let mut node = Node::new(names).map_err(usage)?;
        interrupt::watch()?;
        let bag = node.subscribe().map_err(usage)?;
        let stream = Stream::new("live", bag, interrupt::happened).context("messages cannot be kept")?;
        let (listed, odometry) = (topics.scan.join(", "), node.names().absolute(&self.odom_topic));
        say!("waiting for scans on {listed}, odometry on {odometry} or /tf, in domain {}", node.names().domain);
        let watch = Watch::over(&node, listed)?;
        let planned = McapLog::of_stream(PathBuf::from("ROS 2"), stream, &topics);
        if interrupt::happened() && node.shared().now().last_scan.is_none() {
            say!("interrupted before the first scan: there is nothing to write");
            return Ok(None);
        }
        let source = planned?;
        match &source.frames().odom {
            Some(odom) => say!("odometry is of {odom} -> {}", source.frames().robot),
            None => say!(
                "no odometry on {odometry} or /tf: the scans alone have to do, and {} -> {} is published",
                self.map_frame,
                source.frames().robot
            ),
        }
        Ok(Some(Joined { node, source, _watch: watch }))
    }
}

/// A name that cannot be is an option's.
fn usage(error: LiveError) -> anyhow::Error {
    match error {
        LiveError::Name(_) => UsageError(error.to_string()).into(),
        other => other.into(),
    }
}

/// A node on the network of a robot that scans.
struct Joined {
    node: Node,
    source: McapLog,
    _watch: Watch,
}

/// Says, on a thread of its own, where no scans come; until it is dropped.
struct Watch(Arc<AtomicBool>);

impl Watch {
    /// `listed` are the topics of the scans.
    fn over(node: &Node, listed: String) -> std::io::Result<Self> {
        let is_over = Arc::<AtomicBool>::default();
        let (shared, network, ends) = (node.shared().clone(), node.network(), Arc::clone(&is_over));
        thread::Builder::new().name("watch".to_owned()).spawn(move || {
            let (began, mut is_said) = (Instant::now(), false);
            while !ends.load(Ordering::Relaxed) && !interrupt::happened() {
                let since = shared.now().last_scan.unwrap_or(began).elapsed();
                if since < PATIENCE {
                    is_said = false;
                } else if !std::mem::replace(&mut is_said, true) {
                    say!(
                        "no scan on {listed} for {} s; topics that are there: {}",
                        PATIENCE.as_secs(),
                        topics(&network)
                    );
                }
                thread::sleep(TICK);
            }
        })?;
        Ok(Self(is_over))
    }
}

impl Drop for Watch {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// The topics of a network, for an error.
fn topics(network: &Network) -> String {
    let topics = network.topics();
    let shown: Vec<String> = topics.iter().take(SHOWN).map(|(topic, kind)| format!("{topic} ({kind})")).collect();
    match topics.len() {
        0 => "none (is the domain right, and does the network let multicast through?)".to_owned(),
        count if count > SHOWN => format!("{}, and {} more", shown.join(", "), count - SHOWN),
        _ => shown.join(", "),
    }
}
