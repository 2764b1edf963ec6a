//! `ipslam convert`: a log, a map or a trajectory in another format, or a published set of detections as a recording.

use super::UsageError;
use super::dataset::{DatasetArgs, convert_imu_tracks};
use super::interrupt;
use super::log::{is_standard_input, open_standard_input};
use super::say::say;
#[cfg(feature = "images")]
use super::{dataset::ensure_new, pictures::PicturesArgs};
use anyhow::{anyhow, bail, ensure};
use flate2::{Compression, write::GzEncoder};
use ipslam::clustering::ClusteringConfig;
use ipslam::grid::{FreeArea, OccupancyGrid, RESOLUTION, drawn};
use ipslam::io::carmen::CarmenWriter;
use ipslam::io::datasets::imu_tracks;
use ipslam::io::map_server::ReadGrid;
use ipslam::io::mcap::Topics;
#[cfg(feature = "images")]
use ipslam::io::pictures;
use ipslam::io::trajectory::{self, TrajectoryFormat};
use ipslam::io::{datasets, geojson, map_json, map_server, open_log, write_whole};
use ipslam::map::{LineMap, clusters_of_grid};
use ipslam::picture::Picture;
use std::io::Write;
use std::path::{Path, PathBuf};

const POSSIBLE: &str = "Formats, by the endings of the names:
  logs   in: CARMEN, plain or gzip, ROS bags; - for standard input (CARMEN, MCAP); out: .clf, .log, .clf.gz, .log.gz (CARMEN)
  maps   in: .json (map.json), .yaml (grid of ROS's map_server, with its PGM or PNG),
             .png (grid, with its YAML file beside it);
         out: .json, .yaml (and .pgm), .png (and .yaml), .geojson (walls), .svg (picture)
  paths  in and out: .tum, .kitti (stamps in .times.txt), .csv (poses.csv), .euroc.csv;
         in: .xyt, .csv of EuRoC

Folders, by the files in them, become recordings of detections (a new folder):
  MR.CLAM (--robot), Lost in the Woods, Victoria Park, DLR Spatial Cognition, Starry Night (--rows),
  KITTI tracking, KITTI odometry with simulated cars (--robot 5 or 6), SLAM with objects (Stata),
  the long office of TUM RGB-D with simulated odometry;
or of a camera with an inertial sensor: imu_tracks.csv of GTSAM (EuRoC);
or, with --detector, of pictures (pictures.toml)";

/// Writes a log, a map or a trajectory in another format, or a published set of detections as a recording.
#[derive(Debug, clap::Args)]
#[command(after_help = POSSIBLE)]
pub struct ConvertArgs {
    /// Log, map, trajectory or folder of a set to read; - for a CARMEN log or MCAP from standard input
    input: PathBuf,
    /// File to write, whose ending names the format; of a set, the folder to make
    output: PathBuf,
    #[command(flatten)]
    dataset: DatasetArgs,
    #[cfg(feature = "images")]
    #[command(flatten)]
    pictures: PicturesArgs,
}

/// What an ending stands for.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Format {
    Log,
    LogGzip,
    Json,
    MapServer,
    Png,
    GeoJson,
    Svg,
    Trajectory(TrajectoryFormat),
}

impl Format {
    fn of(path: &Path) -> Option<Self> {
        let name = path.file_name()?.to_string_lossy().to_lowercase();
        let endings = [
            (".clf", Self::Log),
            (".log", Self::Log),
            (".clf.gz", Self::LogGzip),
            (".log.gz", Self::LogGzip),
            (".json", Self::Json),
            (".yaml", Self::MapServer),
            (".yml", Self::MapServer),
            (".png", Self::Png),
            (".geojson", Self::GeoJson),
            (".svg", Self::Svg),
        ];
        let found = endings.iter().find(|(ending, _)| name.ends_with(ending)).map(|&(_, format)| format);
        found.or_else(|| TrajectoryFormat::of(path).map(Self::Trajectory))
    }

    fn is_log(self) -> bool {
        matches!(self, Self::Log | Self::LogGzip)
    }
}

/// A map as it was read.
enum Map {
    Clusters(LineMap),
    Grid(OccupancyGrid),
}

/// What is written would destroy what is read, by whichever name it goes.
pub fn refuse_input(what: &str, input: &Path, output: &Path) -> anyhow::Result<()> {
    // What is not there yet is no input.
    let is_input = same_file::is_same_file(input, output).unwrap_or(false);
    ensure!(!is_input, UsageError(format!("{}: this is the {what} that is read; name another file", output.display())));
    Ok(())
}

/// Reads the one and writes the other.
pub fn convert(args: &ConvertArgs) -> anyhow::Result<()> {
    let ConvertArgs { input, output, dataset, .. } = args;
    interrupt::watch()?;
    #[cfg(feature = "images")]
    if pictures::is_in(input) {
        ensure_new(output)?;
        return args.pictures.convert(input, output);
    }
    #[cfg(feature = "images")]
    args.pictures.refuse(input)?;
    if let Some(set) = datasets::recognise(input) {
        return dataset.convert(set, input, output);
    }
    if let Some(set) = datasets::recognise3(input) {
        return dataset.convert3(set, input, output);
    }
    if imu_tracks::is_in(input) && !dataset.are_given() {
        return convert_imu_tracks(input, output);
    }
    if dataset.are_given() {
        bail!(UsageError(format!(
            "{}: this is no folder of a set of detections, and options are for sets only\n{POSSIBLE}",
            input.display()
        )));
    }
    let format = Format::of(output).ok_or_else(|| {
        UsageError(format!("{}: the ending of this name is that of no known format\n{POSSIBLE}", output.display()))
    })?;
    // A PNG comes with a YAML file beside it.
    let written = [Some(output.clone()), (format == Format::Png).then(|| output.with_extension("yaml"))];
    written.iter().flatten().try_for_each(|output| refuse_input("file", input, output))?;
    let map = match Format::of(input) {
        Some(Format::Json) => Map::Clusters(map_json::read_map(input)?),
        Some(Format::MapServer) => Map::Grid(warned(map_server::read(input)?)),
        Some(Format::Png) => Map::Grid(warned(map_server::read_picture(input)?)),
        Some(Format::Trajectory(from)) => {
            let Format::Trajectory(to) = format else {
                bail!(UsageError(format!("{}: a trajectory makes another one only\n{POSSIBLE}", input.display())))
            };
            return convert_trajectory(input, from, output, to);
        }
        Some(Format::GeoJson | Format::Svg) => {
            bail!(UsageError(format!("{}: this format is only written\n{POSSIBLE}", input.display())))
        }
        // The name of a log may end in anything.
        Some(Format::Log | Format::LogGzip) | None if format.is_log() => return convert_log(input, output, format),
        Some(Format::Log | Format::LogGzip) | None => {
            let input = input.display();
            bail!(UsageError(format!(
                "{input} would be read as a log, and a log is made a map by `ipslam run {input}`\n{POSSIBLE}"
            )))
        }
    };
    match format {
        Format::Log | Format::LogGzip | Format::Trajectory(_) => {
            bail!(UsageError(format!("{}: a map makes neither log nor trajectory\n{POSSIBLE}", input.display())))
        }
        Format::MapServer => map_server::write(output, &map.grid()?)?,
        Format::Png => map_server::write_png(output, &map.grid()?)?,
        Format::Json => {
            let map = map.clusters();
            write_whole(output, |file| map_json::write_map(&map, file))?;
        }
        Format::GeoJson => write_whole(output, |file| geojson::write_walls(&map.clusters().clusters, file))?,
        Format::Svg => {
            let name = input.file_stem().unwrap_or_default().to_string_lossy().into_owned();
            let LineMap { clusters, .. } = map.clusters();
            let picture = Picture::new(name).note(format!("{} clusters", clusters.len())).clusters(&clusters);
            write_whole(output, |file| file.write_all(picture.to_svg().as_bytes()))?;
        }
    }
    Ok(())
}

/// Reads a grid, and says what is odd about it.
pub fn read_grid(path: &Path) -> anyhow::Result<OccupancyGrid> {
    Ok(warned(map_server::read(path)?))
}

fn warned(ReadGrid { grid, warnings }: ReadGrid) -> OccupancyGrid {
    warnings.iter().for_each(|warning| say!("warning: {warning}"));
    grid
}

fn convert_trajectory(input: &Path, from: TrajectoryFormat, output: &Path, to: TrajectoryFormat) -> anyhow::Result<()> {
    let poses = trajectory::read(input, from)?;
    let times = trajectory::times_path(input);
    if from == TrajectoryFormat::Kitti && !times.exists() {
        say!("note: {} is not there: poses are stamped 0, 1, 2, ... s", times.display());
    }
    Ok(trajectory::write(output, to, &poses)?)
}

impl Map {
    fn clusters(self) -> LineMap {
        match self {
            Self::Clusters(map) => map,
            Self::Grid(grid) => LineMap {
                clusters: clusters_of_grid(&grid, &ClusteringConfig::default()),
                free: FreeArea::from_grid(&grid, []),
            },
        }
    }

    fn grid(self) -> anyhow::Result<OccupancyGrid> {
        match self {
            Self::Clusters(LineMap { clusters, free }) => Ok(drawn(&clusters, free.as_ref(), RESOLUTION)?),
            Self::Grid(grid) => Ok(grid),
        }
    }
}

fn convert_log(input: &Path, output: &Path, format: Format) -> anyhow::Result<()> {
    let topics = Topics::default();
    let log =
        if is_standard_input(input) { open_standard_input(&topics, None) } else { Ok(open_log(input, &topics)?) }?;
    let mut entries = log.open()?;
    // A live log ends where a signal comes, and what has come is written.
    let is_given_up = || interrupt::happened() && !log.is_live();
    let written = write_whole(output, |file| {
        if format == Format::LogGzip {
            let mut packed = GzEncoder::new(file, Compression::default());
            write_log(&mut entries, &mut packed, is_given_up)?;
            packed.finish().map(|_| ())
        } else {
            write_log(&mut entries, file, is_given_up)
        }
    });
    if is_given_up() {
        return Ok(());
    }
    written?;
    let stats = entries.stats();
    match &stats.first_malformed {
        None => Ok(()),
        Some(first) => Err(anyhow!("{} lines were left out; the first one: {first}", stats.malformed)),
    }
}

/// Writes entries as a CARMEN log, until the user wants no more.
pub fn write_log(
    entries: &mut dyn Iterator<Item = Result<ipslam::log::LogEntry, ipslam::log::LogError>>,
    out: impl Write,
    is_given_up: impl Fn() -> bool,
) -> std::io::Result<()> {
    let mut writer = CarmenWriter::new(out);
    for entry in entries {
        if is_given_up() {
            return Err(std::io::ErrorKind::Interrupted.into());
        }
        writer.write(&entry.map_err(std::io::Error::other)?)?;
    }
    writer.finish().map(|_| ())
}
