//! What a run writes, as programs that know nothing of ipslam read it.

use crate::needs::python;
use assert_cmd::cargo::cargo_bin;
use ipslam::grid::Cell;
use ipslam::io::mcap::McapWriter;
use ipslam::io::{map_json, map_server, tum};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::LazyLock;
use tempfile::TempDir;

/// The outputs of a short run.
static RUN: LazyLock<TempDir> = LazyLock::new(|| {
    let folder = tempfile::tempdir().unwrap();
    let words = ["run", "--maps", "4", "--particles", "4", "--max-scans", "60", "--backend", "cpu", "--out", "out"];
    let done = Command::new(cargo_bin("ipslam")).current_dir(folder.path()).args(words).output().unwrap();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    folder
});

fn output(name: &str) -> PathBuf {
    let path = RUN.path().join("out").join(name);
    assert!(path.is_file(), "{} is missing", path.display());
    path
}

/// Runs a script on files.
fn run(python: &Path, script: &str, files: &[&Path]) -> Output {
    Command::new(python).args(["-c", script]).args(files).output().unwrap()
}

/// What a script prints, as JSON.
fn read_by(python: &Path, script: &str, files: &[&Path]) -> Value {
    let done = run(python, script, files);
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    serde_json::from_slice(&done.stdout).unwrap()
}

fn evo_reads_the_trajectory() {
    const SCRIPT: &str = "
import json, sys
from evo.tools import file_interface
trajectory = file_interface.read_tum_trajectory_file(sys.argv[1])
_, checks = trajectory.check()
yaw = [float(angles[2]) for angles in trajectory.get_orientations_euler()]
print(json.dumps({'checks': checks, 'stamps': trajectory.timestamps.tolist(), 'yaw': yaw,
                  'xyz': trajectory.positions_xyz.tolist(), 'length': trajectory.path_length}))
";
    let python = python();
    let path = output("trajectory.tum");
    let (ours, read) = (tum::read(&path).unwrap(), read_by(&python, SCRIPT, &[&path]));
    // Its check of stamps asks for rising ones, but odometry and laser of one moment have the same.
    for check in ["array shapes", "quaternions", "nr. of stamps"] {
        assert_eq!(read["checks"][check], "ok", "{check}");
    }
    assert_eq!(read["checks"]["SE(3) conform"], "yes");
    assert!(ours.len() > 100, "{} poses", ours.len());
    assert_eq!(read["stamps"].as_array().unwrap().len(), ours.len());
    let number = |value: &Value| value.as_f64().unwrap();
    let mut farthest: f64 = 0.0;
    for (index, at) in ours.iter().enumerate() {
        assert_eq!(number(&read["stamps"][index]), at.stamp);
        let [x, y, z] = [0, 1, 2].map(|axis| number(&read["xyz"][index][axis]));
        let turn = ipslam::geometry::wrap_angle(number(&read["yaw"][index]) - at.pose.heading);
        assert!((x - at.pose.x).abs().max((y - at.pose.y).abs()).max(z.abs()) < 1e-8, "pose {index}");
        assert!(turn.abs() < 1e-8, "pose {index} is turned by {turn}");
        farthest = farthest.max(x.hypot(y));
    }
    // The robot did move, so a reader of nothing would not pass.
    assert!(farthest > 0.5 && number(&read["length"]) >= farthest, "{farthest} m");
}

/// A bag is written as messages come, so that it has no end; what there is of it is read.
fn mcap_reads_messages_as_they_come() {
    const SCRIPT: &str = "
import json, sys
from mcap.exceptions import EndOfFile
from mcap.stream_reader import StreamReader
read = []
try:
    for record in StreamReader(open(sys.argv[1], 'rb')).records:
        read.append({key: value.hex() if isinstance(value, bytes) else value for key, value in vars(record).items()})
except EndOfFile:
    pass
print(json.dumps(read))
";
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("live.mcap");
    let mut bag = McapWriter::new(std::fs::File::create(&path).unwrap()).unwrap();
    let topics = [("/scan", "sensor_msgs/msg/LaserScan"), ("/tf", "tf2_msgs/msg/TFMessage")];
    let [scan, tf] = topics.map(|(topic, message_type)| bag.add_topic(topic, message_type).unwrap());
    bag.write(tf, 7, &[0, 1, 0, 0, 0xab]).unwrap();
    bag.write(scan, 1_700_000_000_000_000_009, &[]).unwrap();
    let read = read_by(&python(), SCRIPT, &[&path]);
    assert_eq!((read.as_array().unwrap().len(), &read[0]["profile"]), (1 + 2 * 2 + 2, &Value::from("ros2")));
    for (index, (topic, message_type)) in topics.into_iter().enumerate() {
        let [schema, channel] = [&read[1 + 2 * index], &read[2 + 2 * index]];
        assert_eq!((&schema["name"], &schema["encoding"]), (&message_type.into(), &"ros2msg".into()));
        assert_eq!((&channel["topic"], &channel["message_encoding"]), (&topic.into(), &"cdr".into()));
        assert_eq!(channel["schema_id"], schema["id"]);
    }
    for (message, channel, time, data) in
        [(&read[5], &read[4], 7_u64, "00010000ab"), (&read[6], &read[2], 1_700_000_000_000_000_009, "")]
    {
        assert_eq!((&message["channel_id"], &message["data"]), (&channel["id"], &data.into()));
        assert_eq!((&message["log_time"], &message["publish_time"]), (&time.into(), &time.into()));
    }
}

fn yaml_and_pgm_are_read_as_map_server_does() {
    // The rules of Nav2's map_server for mode trinary, written out again.
    const SCRIPT: &str = "
import json, os, sys, yaml
from PIL import Image
told = yaml.safe_load(open(sys.argv[1]))
assert told['mode'] == 'trinary' and told['negate'] == 0
image = Image.open(os.path.join(os.path.dirname(sys.argv[1]), told['image']))
assert image.mode == 'L' and image.format == 'PPM'
width, height = image.size
def cell(pixel):
    occupancy = 1 - pixel / 255
    return 2 if occupancy > told['occupied_thresh'] else 1 if occupancy < told['free_thresh'] else 0
rows = [''.join(str(cell(image.getpixel((x, y)))) for x in range(width)) for y in reversed(range(height))]
shades = sorted(colour for _, colour in image.getcolors())
print(json.dumps({'resolution': told['resolution'], 'origin': told['origin'], 'rows': rows, 'shades': shades}))
";
    let python = python();
    let path = output("map.yaml");
    let (ours, read) = (map_server::read(&path).unwrap().grid, read_by(&python, SCRIPT, &[&path, &output("map.pgm")]));
    let corner = ours.world_from_grid();
    assert_eq!(read["resolution"], 0.05);
    assert_eq!(read["origin"], serde_json::json!([corner.x, corner.y, corner.heading]));
    assert_eq!(read["shades"], serde_json::json!([0, 205, 254]));
    let digit = |cell: &Cell| match cell {
        Cell::Unknown => '0',
        Cell::Free => '1',
        Cell::Occupied => '2',
    };
    let rows = ours.cells().chunks(ours.width() as usize).map(|row| row.iter().map(digit).collect::<String>());
    let rows: Vec<String> = rows.collect();
    assert_eq!(read["rows"], serde_json::json!(rows));
    // Upside down it would be another map.
    assert_ne!(read["rows"], serde_json::json!(rows.iter().rev().collect::<Vec<_>>()));
    // Where the robot drove is free, but for its start, which lies behind the laser.
    let driven = tum::read(&output("trajectory.tum")).unwrap();
    let free = driven.iter().filter(|at| ours.at(at.pose.position()) == Cell::Free).count();
    assert!(free as f64 > 0.95 * driven.len() as f64, "{free} of {} poses are in free cells", driven.len());
}

fn the_map_is_what_its_schema_says() {
    const SCRIPT: &str = "
import json, sys, jsonschema
schema, instance = (json.load(open(path)) for path in sys.argv[1:])
jsonschema.Draft202012Validator.check_schema(schema)
jsonschema.Draft202012Validator(schema).validate(instance)
";
    let python = python();
    let schema = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/map.schema.json");
    let path = output("map.json");
    let checked = |path: &Path| {
        let done = run(&python, SCRIPT, &[&schema, path]);
        (done.status.success(), String::from_utf8_lossy(&done.stderr).into_owned())
    };
    let (valid, error) = checked(&path);
    assert!(valid, "{error}");
    let saved = map_json::read_map(&path).unwrap();
    assert!(!saved.clusters.is_empty() && saved.free.is_some());

    // What the program refuses the schema refuses as well.
    let good: Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    let broken = RUN.path().join("broken.json");
    for (pointer, value) in [
        ("/version", Value::from(2)),
        ("/clusters/0/count", Value::from(-1)),
        ("/clusters/0/mean", Value::from(vec![1.0])),
        ("/free/cell_size", Value::from(0)),
        ("/free/rows", Value::from(vec![vec![vec![-1, 2]]])),
        ("/free/world_from_grid/x", Value::Null),
    ] {
        let mut edited = good.clone();
        *edited.pointer_mut(pointer).unwrap() = value;
        std::fs::write(&broken, edited.to_string()).unwrap();
        let (valid, error) = checked(&broken);
        assert!(!valid && error.contains("ValidationError"), "{pointer}: {error}");
        assert!(map_json::read_map(&broken).is_err(), "{pointer}");
    }
}

fn geojson_and_shapely_read_the_walls() {
    const SCRIPT: &str = "
import json, sys, geojson, shapely.geometry
collection = geojson.load(open(sys.argv[1]))
assert isinstance(collection, geojson.FeatureCollection) and collection.is_valid, collection.errors()
lines = [shapely.geometry.shape(feature['geometry']) for feature in collection['features']]
assert all(line.geom_type == 'LineString' and line.is_valid for line in lines)
print(json.dumps({'frame': collection['frame'], 'ends': [list(line.coords) for line in lines],
                  'properties': [feature['properties'] for feature in collection['features']]}))
";
    let python = python();
    let read = read_by(&python, SCRIPT, &[&output("walls.geojson")]);
    assert!(read["frame"].as_str().unwrap().contains("not longitude and latitude"));
    let map = map_json::read_map(&output("map.json")).unwrap().clusters;
    assert_eq!(read["ends"].as_array().unwrap().len(), map.len());
    assert!(map.len() > 3, "{} walls", map.len());
    for (index, cluster) in map.iter().enumerate() {
        let number = |value: &Value| value.as_f64().unwrap();
        for (end, expected) in cluster.endpoints().iter().enumerate() {
            let [x, y] = [0, 1].map(|axis| number(&read["ends"][index][end][axis]));
            assert!((x - expected.x).abs().max((y - expected.y).abs()) < 1e-6, "wall {index}: six digits are kept");
        }
        assert!((number(&read["properties"][index]["count"]) - cluster.count).abs() < 1e-9);
        let thickness = number(&read["properties"][index]["std_across"]);
        assert!((thickness - cluster.across_variance.sqrt()).abs() < 1e-9);
    }
}

crate::needs::trials! {
    "readers":
    Python { evo_reads_the_trajectory, mcap_reads_messages_as_they_come, yaml_and_pgm_are_read_as_map_server_does, the_map_is_what_its_schema_says, geojson_and_shapely_read_the_walls }
}
