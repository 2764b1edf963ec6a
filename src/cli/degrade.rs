//! `ipslam degrade`: a log made harder.

use super::UsageError;
use super::convert::{refuse_input, write_log};
use super::interrupt;
use super::say::{print_line, say};
use anyhow::ensure;
use clap::Parser;
use ipslam::io::mcap::Topics;
use ipslam::io::{open_log, write_whole};
use ipslam::log::{LogEntry, LogSource};
use ipslam::simulate::Damage;
use std::path::PathBuf;

/// Writes a log with worse odometry, fewer scans or worse ones. An entry for each laser reading, with its stamp: so what is known of
/// the true path of the log, relations or a reference, holds for the harder one.
#[derive(Debug, clap::Args)]
pub struct DegradeArgs {
    /// CARMEN log, plain or gzip, or ROS bag
    log: PathBuf,
    /// CARMEN log to write
    out: PathBuf,
    /// Replace that file
    #[arg(long)]
    force: bool,
    /// Topic of the laser scans in a bag
    #[arg(long, value_name = "TOPIC")]
    scan_topic: Vec<String>,
    /// Topic of the odometry in a bag
    #[arg(long, value_name = "TOPIC")]
    odom_topic: Option<String>,
    /// Seed of all that is drawn
    #[arg(long, default_value_t = 1)]
    seed: u64,
    #[command(flatten)]
    damage: DamageArgs,
}

/// What is made worse.
#[derive(Clone, Debug, clap::Args)]
pub struct DamageArgs {
    /// Noise of odometry: X times 0.1 of the distance forward, 0.05 of it sideways, 0.1 of the turn and 0.02 rad a metre
    #[arg(long, value_name = "X", allow_negative_numbers = true)]
    noise: Option<f64>,
    /// Distances of odometry times F, turns times T
    #[arg(long, value_name = "F,T", value_parser = pair, allow_hyphen_values = true)]
    scale: Option<(f64, f64)>,
    /// N times wheels spin for 2 s: distances 1.5 times as long, turns 0.3 rad too large in all
    #[arg(long, value_name = "N")]
    slip: Option<u32>,
    /// N times, for 2 s, odometry reports the motion as its reverse
    #[arg(long, value_name = "N")]
    backwards: Option<u32>,
    /// N times one reading of odometry is 5 m and 1 rad off
    #[arg(long, value_name = "N")]
    spike: Option<u32>,
    /// N times odometry starts again at the origin
    #[arg(long, value_name = "N")]
    reset: Option<u32>,
    /// Every pose of odometry is the origin
    #[arg(long)]
    no_odometry: bool,
    /// Odometry lags behind the scans [seconds]
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true)]
    late: Option<f64>,
    /// Only every N-th scan, of those that --blank and --sparse leave
    #[arg(long, value_name = "N")]
    skip: Option<u32>,
    /// Only one scan after each D metres or A radians
    #[arg(long, value_name = "D,A", value_parser = pair, allow_hyphen_values = true)]
    sparse: Option<(f64, f64)>,
    /// N times no scan for 15 s
    #[arg(long, value_name = "N")]
    blank: Option<u32>,
    /// Only beams in the middle of the sweep return, over this angle
    #[arg(long, value_name = "DEGREES", allow_negative_numbers = true)]
    fov: Option<f64>,
    /// Gaussian noise of ranges [metres]
    #[arg(long, value_name = "METRES", allow_negative_numbers = true)]
    range_noise: Option<f64>,
    /// This share of the ranges becomes any from 0.3 to 10 m
    #[arg(long, value_name = "SHARE", allow_negative_numbers = true)]
    random: Option<f64>,
    /// N people walk along, 0.8 to 2 m off, all the time
    #[arg(long, value_name = "N")]
    crowd: Option<u32>,
}

fn pair(text: &str) -> Result<(f64, f64), String> {
    let numbers = text.split_once(',').and_then(|(a, b)| Some((a.trim().parse().ok()?, b.trim().parse().ok()?)));
    numbers.ok_or_else(|| "two numbers with a comma between are needed, as 1.05,0.9".to_owned())
}

impl DamageArgs {
    /// The same as numbers.
    pub fn damage(&self) -> Damage {
        let none = Damage::default();
        let (scale_distance, scale_turn) = self.scale.unwrap_or((none.scale_distance, none.scale_turn));
        let (sparse_distance, sparse_turn) = self.sparse.unwrap_or((none.sparse_distance, none.sparse_turn));
        Damage {
            noise: self.noise.unwrap_or(none.noise),
            scale_distance,
            scale_turn,
            slip: self.slip.unwrap_or(none.slip),
            backwards: self.backwards.unwrap_or(none.backwards),
            spike: self.spike.unwrap_or(none.spike),
            reset: self.reset.unwrap_or(none.reset),
            no_odometry: self.no_odometry,
            late: self.late.unwrap_or(none.late),
            skip: self.skip.unwrap_or(none.skip),
            sparse_distance,
            sparse_turn,
            blank: self.blank.unwrap_or(none.blank),
            field_of_view: self.fov.map_or(none.field_of_view, f64::to_radians),
            range_noise: self.range_noise.unwrap_or(none.range_noise),
            random: self.random.unwrap_or(none.random),
            crowd: self.crowd.unwrap_or(none.crowd),
        }
    }

    /// That of a text that names the options without their hyphens: `noise 4 skip 4`.
    pub fn parse(text: &str) -> Result<Self, String> {
        #[derive(Parser)]
        #[command(no_binary_name = true, disable_help_flag = true)]
        struct Words {
            #[command(flatten)]
            args: DamageArgs,
        }
        let is_name = |word: &str| word.starts_with(|first: char| first.is_ascii_alphabetic());
        let words = text.split_whitespace();
        let words = words.map(|word| if is_name(word) { format!("--{word}") } else { word.to_owned() });
        let args = Words::try_parse_from(words).map_err(|error| error.kind().to_string())?.args;
        if args.damage() == Damage::default() {
            return Err("nothing that makes a log harder".to_owned());
        }
        Ok(args)
    }
}

/// Writes the harder log, and says what it holds.
pub fn degrade(args: &DegradeArgs) -> anyhow::Result<()> {
    let DegradeArgs { log, out, force, scan_topic, odom_topic, seed, damage } = args;
    refuse_input("log", log, out)?;
    let is_free = *force || !out.exists();
    ensure!(is_free, UsageError(format!("{}: it is there already: replace it with --force", out.display())));
    let damage = damage.damage();
    // What cannot be is refused before a long log is read.
    damage.apply(Vec::new(), *seed)?;
    interrupt::watch()?;
    let topics = Topics { scan: scan_topic.clone(), odometry: odom_topic.clone(), ..Topics::default() };
    let harder = damage.apply(entries(&*open_log(log, &topics)?)?, *seed)?;
    if interrupt::happened() {
        return Ok(());
    }
    let scans = |entries: &[LogEntry]| entries.iter().filter(|entry| matches!(entry, LogEntry::Laser(_))).count();
    let (kept, readings) = (scans(&harder), harder.iter().filter(|entry| entry.is_reading()).count());
    ensure!(readings > 0, "{}: no laser reading in this log", log.display());
    let written = write_whole(out, |file| write_log(&mut harder.into_iter().map(Ok), file, interrupt::happened));
    if interrupt::happened() {
        return Ok(());
    }
    written?;
    print_line!("{}: {kept} of {readings} scans", out.display());
    Ok(())
}

/// All of a log; what could not be read of it is said.
pub fn entries(source: &dyn LogSource) -> anyhow::Result<Vec<LogEntry>> {
    let mut reader = source.open()?;
    let entries = reader.by_ref().take_while(|_| !interrupt::happened()).collect::<Result<_, _>>()?;
    if let Some(first) = &reader.stats().first_malformed {
        say!("warning: {} lines were left out; the first one: {first}", reader.stats().malformed);
    }
    Ok(entries)
}
