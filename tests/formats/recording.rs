//! Recordings are read back with Rerun's own reader and compared with what was reported.
use ipslam::config::{Config, SlamConfig};
use ipslam::geometry::Pose;
use ipslam::map::LineMap;
use ipslam::pipeline::RunInfo;
use ipslam::ppca::Cluster;
use ipslam::record::rerun::{Level, RecordError, RerunObserver, blueprint};
use ipslam::report::{Estimate, Event, Observer, ReportedParticle, RunResult, StageTimes, StepReport};
use ipslam::scan::Scan;
use ipslam::tracking::OdometryErrors;
use nalgebra::{Isometry2, Point2, Vector2};
use rerun::blueprint::components::ViewClass;
use rerun::components::{ClearIsRecursive, Color, LineStrip2D, Position2D, Scalar, Scale3D, Vector2D};
use rerun::{
    Arrows2D, ChunkStore, ChunkStoreConfig, Clear, Component, ComponentDescriptor, LineStrips2D, Points2D, Scalars,
    StoreKind, Transform3D,
};
use std::path::Path;

/// Coordinates are recorded in single precision, within 50 m of the origin here: 50 m · 2^-24.
const TOLERANCE: f64 = 3e-6;

/// What a path holds of one component: step, seconds and values of every row, in the order of the steps.
type Rows<C> = Vec<(i64, f64, Vec<C>)>;

struct Recording {
    data: ChunkStore,
    blueprint: ChunkStore,
}

impl Recording {
    fn read(path: &Path) -> Self {
        let mut file = std::fs::File::open(path).unwrap();
        let stores = ChunkStore::from_rrd_reader(&ChunkStoreConfig::ALL_DISABLED, &mut file).unwrap();
        let of = |kind| {
            let mut found = stores.iter().filter(|(id, _)| id.kind() == kind).map(|(_, store)| store.clone());
            let store = found.next().unwrap_or_else(|| panic!("the file holds no {kind:?}"));
            assert!(found.next().is_none(), "the file holds one {kind:?}");
            store
        };
        Self { data: of(StoreKind::Recording), blueprint: of(StoreKind::Blueprint) }
    }

    fn rows<C: Component>(&self, path: &str, descriptor: ComponentDescriptor) -> Rows<C> {
        let mut rows = Vec::new();
        let chunks = self.data.iter_physical_chunks().filter(|chunk| chunk.entity_path() == &path.into());
        for chunk in chunks.filter(|chunk| !chunk.is_static()) {
            let steps = chunk.iter_component_indices(blueprint::STEP_TIMELINE.into(), descriptor.component);
            let times = chunk.iter_component_indices(blueprint::TIME_TIMELINE.into(), descriptor.component);
            let values = chunk.iter_component::<C>(descriptor.component);
            for (((step, _), (time, _)), values) in steps.zip(times).zip(values) {
                rows.push((step.as_i64(), time.as_f64() / 1e9, values.as_slice().to_vec()));
            }
        }
        rows.sort_by_key(|row| row.0);
        rows
    }

    fn points(&self, path: &str) -> Rows<Position2D> {
        self.rows(path, Points2D::descriptor_positions())
    }

    fn strips(&self, path: &str) -> Rows<LineStrip2D> {
        self.rows(path, LineStrips2D::descriptor_strips())
    }

    fn scalars(&self, path: &str) -> Vec<(i64, Vec<f64>)> {
        let rows: Rows<Scalar> = self.rows(path, Scalars::descriptor_scalars());
        rows.into_iter().map(|(step, _, values)| (step, values.iter().map(|value| value.0.0).collect())).collect()
    }
}

/// Compares positions, number by number.
fn compare(found: &[[f32; 2]], expected: &[[f64; 2]]) -> Result<(), String> {
    if found.len() != expected.len() {
        return Err(format!("{} positions, not {}", found.len(), expected.len()));
    }
    for (i, (found, expected)) in found.iter().zip(expected).enumerate() {
        let apart = [0, 1].map(|axis| (f64::from(found[axis]) - expected[axis]).abs());
        if !apart.iter().all(|&apart| apart <= TOLERANCE) {
            return Err(format!(
                "position {i}: {found:?} is not {expected:?}, {apart:?} apart, tolerance {TOLERANCE:e}"
            ));
        }
    }
    Ok(())
}

fn positions(points: &[Position2D]) -> Vec<[f32; 2]> {
    points.iter().map(|point| point.0.0).collect()
}

fn corners(strip: &LineStrip2D) -> Vec<[f32; 2]> {
    strip.0.iter().map(|corner| corner.0).collect()
}

/// The oracle for poses: nalgebra's rigid motions.
fn motion(pose: Pose) -> Isometry2<f64> {
    Isometry2::new(Vector2::new(pose.x, pose.y), pose.heading)
}

fn xy(isometry: Isometry2<f64>) -> [f64; 2] {
    [isometry.translation.x, isometry.translation.y]
}

fn info() -> RunInfo {
    let config = SlamConfig { seed: 77, ..SlamConfig::paper() };
    RunInfo { log: "a test".to_owned(), device: "CPU".to_owned(), config: Config::Slam(config), continues: None }
}

/// A drive along an arc, in a world where odometry starts elsewhere, turned, and drifts.
fn true_pose(step: u32) -> Pose {
    let s = f64::from(step);
    Pose::new(1.0 + 0.2 * s, -2.0 + 0.001 * s * s, 0.3 + 0.01 * s)
}

fn odometry(step: u32) -> Pose {
    let s = f64::from(step);
    Pose::new(-7.0 - 0.19 * s, 3.0 - 0.1 * s, -2.5 + 0.013 * s)
}

/// A wall along (0.6, 0.8): λ₁ = 0.75 m², so it ends 1.5 m either side of its centre.
fn wall(x: f64) -> Cluster {
    Cluster {
        mean: Point2::new(x, 4.0),
        direction: Vector2::new(0.6, 0.8),
        along_variance: 0.75,
        across_variance: 0.0004,
        count: 50.0,
    }
}

/// Stamps of the steps; the third one goes backwards.
fn stamp(step: u32) -> f64 {
    1e9 + if step == 2 { 0.25 } else { 0.5 * f64::from(step) }
}

fn record(observer: &mut RerunObserver, step: u32, map: &[Cluster]) {
    let particle = |i: u32| ReportedParticle {
        world_from_robot: Pose::new(f64::from(i) * 0.1, f64::from(step), 0.0),
        weight: [0.2, 0.75, 0.05][i as usize],
    };
    observer.on_event(&Event::Step(&StepReport {
        step,
        stamp: stamp(step),
        scan: &Scan {
            stamp: stamp(step),
            points: vec![Point2::new(2.0, 0.5), Point2::new(-1.0, 3.0)],
            ..Scan::default()
        },
        scan_clusters: &[wall(2.0)],
        odom_from_robot: odometry(step),
        world_from_robot: true_pose(step),
        particles: &[particle(0), particle(1), particle(2)],
        map,
        effective_sample_size: 1.5 + f64::from(step),
        resampled: step % 2 == 1,
        parents: &[2, 0, 1],
        confidence: None,
        times: StageTimes {
            cluster: 0.1,
            track: 0.2,
            propagate: 0.3,
            weigh: 0.5,
            resample: 0.6,
            estimate: 0.55,
            merge: 0.7 + f64::from(step),
        },
    }));
}

fn result(steps: u32) -> RunResult {
    let estimate = |i: u32| Estimate {
        stamp: stamp(i),
        odom_from_robot: odometry(i),
        world_from_robot: Some(true_pose(i)),
        covariance: None,
        confidence: None,
    };
    let map = LineMap { clusters: vec![wall(0.0), wall(5.0), wall(10.0)], free: None };
    RunResult {
        map,
        poses: (0..steps).map(estimate).collect(),
        refused_odometry: Vec::new(),
        odometry_errors: OdometryErrors::default(),
        gyro: None,
        loops: Vec::new(),
        earlier: Vec::new(),
        looked_through: 0.0,
        objects: None,
    }
}

/// Records `steps` steps, the map changing at the fourth, and reads the file.
fn recorded(steps: u32) -> Recording {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.rrd");
    let mut observer = RerunObserver::to_file(&path, &info(), Level::Full).unwrap();
    for step in 0..steps {
        let map = [wall(0.0), wall(5.0)];
        record(&mut observer, step, if step < 3 { &map[..1] } else { &map });
    }
    observer.on_event(&Event::Finished { result: &result(steps), is_smoothed: true });
    assert_eq!(observer.failure(), None);
    // The observer still lives: the file has to be complete without its end.
    Recording::read(&path)
}

fn the_comparison_rejects_a_moved_point() {
    let expected = [[1.0, 2.0], [3.0, 4.0]];
    compare(&[[1.0, 2.0], [3.0, 4.0]], &expected).unwrap();
    for wrong in [[3.0, 4.00001], [2.99999, 4.0], [f32::NAN, 4.0]] {
        compare(&[[1.0, 2.0], wrong], &expected).unwrap_err();
    }
    compare(&[[1.0, 2.0]], &expected).unwrap_err();
}

fn steps_come_back() {
    let recording = recorded(5);
    let scans = recording.points(blueprint::SCAN_POINTS);
    let times: Vec<f64> = scans.iter().map(|row| row.1).collect();
    assert_eq!(times, [0.0, 0.5, 0.5, 1.5, 2.0], "time stands still where a stamp goes backwards");
    assert_eq!(scans.iter().map(|row| row.0).collect::<Vec<_>>(), [0, 1, 2, 3, 4]);
    for (step, (_, _, points)) in (0..).zip(&scans) {
        let world = [Point2::new(2.0, 0.5), Point2::new(-1.0, 3.0)].map(|point| {
            let moved = motion(true_pose(step)) * point;
            [moved.x, moved.y]
        });
        compare(&positions(points), &world).unwrap();
    }

    let robots: Rows<Vector2D> = recording.rows(blueprint::ROBOT, Arrows2D::descriptor_vectors());
    assert_eq!(robots.len(), 5);
    for (step, (_, _, vectors)) in (0..).zip(&robots) {
        let (sin, cos) = true_pose(step).heading.sin_cos();
        compare(&[vectors[0].0.0], &[[cos, sin]]).unwrap();
    }

    let seconds = recording.scalars(blueprint::SECONDS);
    assert_eq!(seconds[3], (3, vec![0.1, 0.2, 0.3, 0.5, 0.55, 0.6, 3.7]));
    assert_eq!(seconds.len(), 5);
    let sizes = recording.scalars(blueprint::EFFECTIVE_SAMPLE_SIZE);
    assert_eq!(sizes, [1.5, 2.5, 3.5, 4.5, 5.5].map(|size| (size as i64 - 1, vec![size])));
    assert_eq!(recording.scalars(blueprint::RESAMPLED), [(1, vec![2.5]), (3, vec![4.5])]);
    let clusters: Vec<f64> = recording.scalars(blueprint::CLUSTERS).iter().map(|row| row.1[0]).collect();
    assert_eq!(clusters, [1.0, 1.0, 1.0, 2.0, 2.0]);
}

fn the_likeliest_particle_is_the_brightest_and_on_top() {
    let recording = recorded(2);
    let particles = recording.points(blueprint::PARTICLES);
    let colours: Rows<Color> = recording.rows(blueprint::PARTICLES, Points2D::descriptor_colors());
    assert_eq!((particles.len(), colours.len()), (2, 2));
    compare(&positions(&particles[1].2), &[[0.2, 1.0], [0.0, 1.0], [0.1, 1.0]]).unwrap();
    let brightness: Vec<u32> =
        colours[1].2.iter().map(|colour| colour.to_array()[..3].iter().map(|&c| u32::from(c)).sum()).collect();
    assert!(brightness[0] < brightness[1] && brightness[1] < brightness[2], "{brightness:?}");
}

fn many_particles_are_sampled() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.rrd");
    let mut observer = RerunObserver::to_file(&path, &info(), Level::Full).unwrap();
    let particles: Vec<_> = (0..10_000)
        .map(|i| ReportedParticle { world_from_robot: Pose::new(f64::from(i), 0.0, 0.0), weight: 1e-4 })
        .collect();
    observer.on_event(&Event::Step(&StepReport {
        step: 0,
        stamp: 0.0,
        scan: &Scan::default(),
        scan_clusters: &[],
        odom_from_robot: Pose::IDENTITY,
        world_from_robot: Pose::IDENTITY,
        particles: &particles,
        map: &[],
        effective_sample_size: 10_000.0,
        resampled: false,
        parents: &[],
        confidence: None,
        times: StageTimes::default(),
    }));
    drop(observer);
    let shown = Recording::read(&path).points(blueprint::PARTICLES);
    let expected: Vec<_> = (0..2000).map(|i| [5.0 * f64::from(i), 0.0]).collect();
    compare(&positions(&shown[0].2), &expected).unwrap();
}

/// λ₁ = 0.75 along (0.6, 0.8) ends √(3 · 0.75) = 1.5 m from the centre: (0.9, 1.2) either way.
fn the_map_is_recorded_where_it_changes() {
    let recording = recorded(5);
    let maps = recording.strips(blueprint::MAP_CLUSTERS);
    assert_eq!(maps.iter().map(|row| (row.0, row.2.len())).collect::<Vec<_>>(), [(0, 1), (3, 2), (5, 3)]);
    for (wall, strip) in maps[2].2.iter().enumerate() {
        let x = 5.0 * wall as f64;
        compare(&corners(strip), &[[x - 0.9, 2.8], [x + 0.9, 5.2]]).unwrap();
    }

    let ellipses = recording.strips(blueprint::MAP_ELLIPSES);
    assert_eq!(ellipses.iter().map(|row| (row.0, row.2.len())).collect::<Vec<_>>(), [(0, 1), (5, 3)]);
    let precision = wall(5.0).covariance().try_inverse().unwrap();
    let ring = corners(&ellipses[1].2[1]);
    assert!(ring.len() > 8 && ring.first() == ring.last());
    for corner in ring {
        let offset = Vector2::new(f64::from(corner[0]) - 5.0, f64::from(corner[1]) - 4.0);
        let sigmas = (offset.transpose() * precision * offset)[0].sqrt();
        assert!((sigmas - 1.0).abs() < 1e-3, "{corner:?} is {sigmas} standard deviations from the centre");
    }
}

fn trails_are_whole_and_cost_the_same_every_step() {
    let steps = 200;
    let recording = recorded(steps);
    let world_from_odom = motion(true_pose(0)) * motion(odometry(0)).inverse();
    let way: Vec<_> = (0..steps).map(|step| xy(motion(true_pose(step)))).collect();
    let drifting: Vec<_> = (0..steps).map(|step| xy(world_from_odom * motion(odometry(step)))).collect();
    assert!((drifting[0][0] - way[0][0]).hypot(drifting[0][1] - way[0][1]) < 1e-12, "both start at one place");

    for (trail, expected) in [(blueprint::TRAIL, &way), (blueprint::ODOMETRY_TRAIL, &drifting)] {
        let (mut joined, mut rows, mut longest) = (Vec::new(), 0, 0);
        for piece in 0.. {
            let pieces = recording.strips(&format!("{trail}/{piece}"));
            let Some((_, _, last)) = pieces.last() else { break };
            rows += pieces.len();
            longest = longest.max(last[0].0.len());
            let corners = corners(&last[0]);
            assert!(joined.is_empty() || joined.last() == corners.first(), "pieces touch");
            joined.extend(&corners[usize::from(piece > 0)..]);
        }
        compare(&joined, expected).unwrap();
        assert_eq!(rows, steps as usize, "{trail}");
        assert!(longest <= 64, "{longest}");
    }

    for (path, expected) in [(blueprint::TRAJECTORY, &way), (blueprint::ODOMETRY, &drifting)] {
        let found = recording.strips(path);
        assert_eq!(found.iter().map(|row| row.0).collect::<Vec<_>>(), [i64::from(steps)]);
        compare(&corners(&found[0].2[0]), expected).unwrap();
    }
    let cleared: Rows<ClearIsRecursive> = recording.rows(blueprint::STEP, Clear::descriptor_is_recursive());
    assert_eq!(cleared.iter().map(|row| row.0).collect::<Vec<_>>(), [i64::from(steps)]);
}

fn the_layout_travels_with_the_data() {
    let recording = recorded(1);
    let class = rerun::external::re_sdk_types::blueprint::archetypes::ViewBlueprint::descriptor_class_identifier();
    let mut views: Vec<String> = recording
        .blueprint
        .iter_physical_chunks()
        .flat_map(|chunk| {
            chunk
                .iter_component::<ViewClass>(class.component)
                .flat_map(|row| row.as_slice().to_vec())
                .collect::<Vec<_>>()
        })
        .map(|view| view.0.to_string())
        .collect();
    views.sort();
    assert_eq!(views, ["2D", "TextDocument", "TimeSeries", "TimeSeries", "TimeSeries"]);
}

/// In a 2-D view y points down, so the world is turned around as a whole.
fn the_world_is_shown_with_y_up() {
    let recording = recorded(1);
    let scale = Transform3D::descriptor_scale().component;
    let world = recording.data.iter_physical_chunks().filter(|chunk| chunk.entity_path() == &blueprint::WORLD.into());
    let scales: Vec<Scale3D> = world
        .flat_map(|chunk| {
            chunk.iter_component::<Scale3D>(scale).flat_map(|row| row.as_slice().to_vec()).collect::<Vec<_>>()
        })
        .collect();
    assert_eq!(scales, [Scale3D::from([1.0, -1.0, 1.0])]);
}

fn a_file_that_cannot_be_made_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("missing").join("run.rrd");
    let error = RerunObserver::to_file(&path, &info(), Level::Full).err().expect("there is no such folder");
    assert!(matches!(error, RecordError::File { .. }));
    let text = error.to_string();
    assert!(text.contains(path.to_str().unwrap()) && text.contains("choose a folder"), "{text}");
}

#[cfg(target_os = "linux")]
fn a_full_disk_is_an_error() {
    let error =
        RerunObserver::to_file(Path::new("/dev/full"), &info(), Level::Light).err().expect("nothing can be written");
    assert!(matches!(error, RecordError::File { .. }), "{error}");
}

/// A pipe whose reader goes away stands for a disk that fills up.
#[cfg(unix)]
fn a_failure_during_the_run_is_kept_and_stops_nothing() {
    use std::io::Read as _;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("pipe");
    assert!(std::process::Command::new("mkfifo").arg(&path).status().unwrap().success());
    let (stop, stopped) = std::sync::mpsc::channel();
    let reader = std::thread::spawn({
        let path = path.clone();
        move || {
            let mut pipe = std::fs::File::open(path).unwrap();
            while stopped.try_recv().is_err() {
                // How much is of no interest.
                let _some = pipe.read(&mut [0; 4096]).unwrap();
            }
        }
    });
    let mut observer = RerunObserver::to_file(&path, &info(), Level::Full).unwrap();
    assert_eq!(observer.failure(), None);
    stop.send(()).unwrap();
    for step in 0..250 {
        record(&mut observer, step, &[wall(0.0)]);
    }
    observer.on_event(&Event::Finished { result: &result(250), is_smoothed: true });
    reader.join().unwrap();
    let failure = observer.failure().expect("the pipe was closed");
    assert!(failure.contains("broke off at step") && failure.contains("is the disk full?"), "{failure}");
}

fn an_address_of_no_viewer_is_an_error() {
    let error = RerunObserver::connect(Some("not an address"), &info(), Level::Light).err().expect("no address");
    assert!(matches!(error, RecordError::Address { .. }), "{error}");
    // The port of the discard service, where nobody listens.
    let error =
        RerunObserver::connect(Some("rerun+http://127.0.0.1:9/proxy"), &info(), Level::Light).err().expect("no viewer");
    assert!(matches!(error, RecordError::NoViewer { .. }), "{error}");
    assert!(error.to_string().contains("start one"), "{error}");
}

crate::needs::trials! {
    "recording":
    Nothing { the_comparison_rejects_a_moved_point, steps_come_back, the_likeliest_particle_is_the_brightest_and_on_top, many_particles_are_sampled, the_map_is_recorded_where_it_changes, trails_are_whole_and_cost_the_same_every_step, the_layout_travels_with_the_data, the_world_is_shown_with_y_up, a_file_that_cannot_be_made_is_an_error, a_full_disk_is_an_error, a_failure_during_the_run_is_kept_and_stops_nothing, an_address_of_no_viewer_is_an_error }
}
