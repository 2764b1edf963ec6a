//! Recordings of detections, and published sets made into them.

use crate::needs::data_folder;
use assert_cmd::cargo::cargo_bin;
use ipslam::detections::{Detection, Frame, Odometry, Recording, Sensors, Velocity};
use ipslam::geometry::{Pose, StampedPose, wrap_angle};
use ipslam::io::datasets::{self, Converted, Dataset, Options};
use ipslam::io::semantic::truth::{self, Ids};
use ipslam::io::semantic::{self, ReadRecording};
use ipslam::log::LogError;
use ipslam::metrics::trajectory::reference_errors;
use std::collections::HashMap;
use std::f64::consts::PI;
use std::io::Write as _;
use std::path::Path;
use std::process::Command;
use tempfile::TempDir;

const SENSORS: &str = "classes = [\"tree\", \"car\"]\n";
const ODOMETRY: &str = "t,v,omega\n0,1,0.5\n2,0,0\n";
const DETECTIONS: &str = "t,class,score,range,bearing\n0,tree,0.5,3,0.1\n0,car,,4,-0.2\n1,,,,\n";

/// A folder with these files in place of good ones.
fn folder(changes: &[(&str, &[u8])]) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let good = [("sensors.toml", SENSORS), ("odometry.csv", ODOMETRY), ("detections.csv", DETECTIONS)];
    for (name, text) in good.map(|(name, text)| (name, text.as_bytes())).iter().chain(changes) {
        std::fs::write(folder.path().join(name), text).unwrap();
    }
    folder
}

fn read(changes: &[(&str, &[u8])]) -> Result<ReadRecording, LogError> {
    semantic::read(folder(changes).path())
}

fn good() -> Recording {
    let odometry = [[0.0, 1.0, 0.5], [2.0, 0.0, 0.0]].map(|[stamp, forward, turn]| Velocity { stamp, forward, turn });
    let seen = |class, score, range, bearing| Detection { class, score, range, bearing };
    Recording {
        sensors: Sensors::new(vec!["tree".to_owned(), "car".to_owned()], 0.9),
        odometry: Odometry::Velocities(odometry.to_vec()),
        frames: vec![
            Frame { stamp: 0.0, detections: vec![seen(0, 0.5, 3.0, 0.1), seen(1, 1.0, 4.0, -0.2)] },
            Frame { stamp: 1.0, detections: Vec::new() },
        ],
    }
}

fn a_folder_is_read() {
    assert_eq!(read(&[]).unwrap(), ReadRecording { recording: good(), warnings: Vec::new() });
}

fn what_is_written_is_read_back() {
    let mut recording = good();
    recording.sensors.classes = vec!["chair, \"old\"".to_owned(), "#door".to_owned()];
    recording.sensors.confusion = vec![vec![0.7, 0.3], vec![0.1, 0.9]];
    recording.sensors.robot_from_sensor = Pose::new(0.2, -0.1, 3.0);
    recording.sensors.noise.position = 0.05;
    recording.sensors.view.max_range = 7.5;
    recording.frames[0].detections[0].range = 1.0 / 3.0;
    recording.frames[1].stamp = 1_134_864_645.903_21;
    let poses = [(0.1, Pose::new(1e-17, 2.0, PI)), (0.1, Pose::new(-3.0, 1e9, -0.1))];
    let poses = Odometry::Poses(poses.map(|(stamp, pose)| StampedPose { stamp, pose }).to_vec());
    for odometry in [recording.odometry.clone(), poses] {
        recording.odometry = odometry;
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("new/folder");
        for _ in 0..2 {
            semantic::write(&path, &recording).unwrap();
            assert_eq!(semantic::read(&path).unwrap().recording, recording);
        }
    }
    recording.frames[0].detections[0].class = 2;
    let folder = tempfile::tempdir().unwrap();
    let message = semantic::write(folder.path(), &recording).unwrap_err().to_string();
    assert!(message.contains("detections.csv") && message.contains("no class number 2"), "{message}");
    assert!(!folder.path().join("sensors.toml").exists());
}

fn other_programs_write_tables_in_other_ways() {
    let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
    packed.write_all(ODOMETRY.as_bytes()).unwrap();
    let changed: [(&str, &[u8]); 3] = [
        ("sensors.toml", b"\xef\xbb\xbfkind = \"range_bearing\"\r\nclasses = [ 'tree', 'car' ]\r\n"),
        ("odometry.csv", &packed.finish().unwrap()),
        (
            "detections.csv",
            b"\xef\xbb\xbf# by hand\r\n\"bearing\", range ,t,note,class,score\r\n\r\n 0.1,3.0,0.00,a,\"tree\",5e-1\r\n\
              -0.2,4,0,\"x, y\",car,\r\n,,1,,,",
        ),
    ];
    let ReadRecording { recording, warnings } = read(&changed).unwrap();
    assert_eq!(recording, good());
    assert_eq!(warnings, ["detections.csv: columns left out, of which nothing is known: note"]);
    // Scores may be left out altogether, and a bearing may be any angle.
    let without = "t,class,range,bearing\n0,tree,3,6.2\n";
    let seen = read(&[("detections.csv", without.as_bytes())]).unwrap().recording.frames[0].detections[0];
    assert!(seen.score == 1.0 && (seen.bearing - wrap_angle(6.2)).abs() < 1e-15, "{seen:?}");
}

fn what_is_odd_is_told_and_counted() {
    let changed: [(&str, &[u8]); 2] = [
        ("sensors.toml", b"classes = ['tree']\n[view]\nmax_range = 5.0\nmin_bearing = -1\n"),
        ("detections.csv", b"t,class,range,bearing\n-5,tree,4,0\n1,tree,6,0\n1,tree,4,-1.1\n1,tree,4,1\n9,tree,4,0\n"),
    ];
    let ReadRecording { recording, warnings } = read(&changed).unwrap();
    assert_eq!(warnings.len(), 3, "{warnings:?}");
    for (warning, words) in warnings.iter().zip(["1 frames come before", "1 frames come after", "2 detections"]) {
        assert!(warning.contains(words), "{warning}");
    }
    assert_eq!(recording.detections(), 5);
    let seen: Vec<_> = recording.frames[1].in_view(recording.sensors.view).map(|(number, _)| number).collect();
    assert_eq!(seen, [2]);
}

fn bad_input_is_told_with_file_line_and_remedy() {
    let long = [b"t,v,omega\n0,0,".as_slice(), &[b'1'; 70_000], b"\n"].concat();
    let header = "t,class,score,range,bearing\n";
    let rows = |rows: &str| format!("{header}{rows}").into_bytes();
    let cases: Vec<(&str, Vec<u8>, &str)> = vec![
        (
            "sensors.toml",
            b"classes = ['a']\n\n[noise]\nrnage = 1\n".to_vec(),
            ".toml:4: unknown field `rnage`, expected one of",
        ),
        (
            "sensors.toml",
            b"classes = ['a']\nkind = 'box'\n".to_vec(),
            ".toml:2: unknown variant `box`, expected `range_bearing`",
        ),
        ("sensors.toml", b"classes = ['a']\n[noise]\nrange = 'wide'\n".to_vec(), ".toml:3: invalid type"),
        (
            "sensors.toml",
            b"classes = ['a']\n[noise]\n\nrange = 0\n".to_vec(),
            ".toml:4: noise.range is 0, but has to be",
        ),
        ("sensors.toml", b"classes = ['a'\n".to_vec(), "sensors.toml:"),
        ("sensors.toml", b"# nothing\n".to_vec(), "classes is [], but has to be the names of one class or more"),
        ("sensors.toml", b"\nclasses = ['a', 'a']\n".to_vec(), ".toml:2: classes is `a` twice"),
        (
            "sensors.toml",
            b"classes = ['a', 'b']\nconfusion = [[1, 0]]\n".to_vec(),
            ".toml:2: confusion is of another size",
        ),
        (
            "sensors.toml",
            b"classes = ['a']\nlabel_accuracy = 90\n".to_vec(),
            ".toml:2: label_accuracy is 90, but has to be 0 to 1",
        ),
        (
            "sensors.toml",
            b"classes = ['a']\nlabel_accuracy = 0.9\nconfusion = [[1]]\n".to_vec(),
            ".toml:2: label_accuracy is 0.9",
        ),
        ("sensors.toml", b"classes = ['a']\nmounting.x = inf\n".to_vec(), ".toml:2: mounting.x is inf"),
        (
            "sensors.toml",
            b"classes = ['\xff']\n".to_vec(),
            "sensors.toml: byte 12 is no UTF-8; sensors.toml is a TOML text",
        ),
        ("odometry.csv", b"".to_vec(), "odometry.csv: it is empty; odometry has the columns t,v,omega"),
        ("odometry.csv", b"t,v,omega\n".to_vec(), "odometry.csv: it holds no row besides the header"),
        (
            "odometry.csv",
            b"0,1,2\n".to_vec(),
            "odometry.csv: line 1: `0,1,2` is no header of such a table; odometry has",
        ),
        ("odometry.csv", b"t;v;omega\n0;1;2\n".to_vec(), "is no header of such a table"),
        ("odometry.csv", b"t,v,v,omega\n0,1,2,3\n".to_vec(), "odometry.csv:1: two columns are called v"),
        (
            "odometry.csv",
            b"t,v,omega\n0,1,2\n# x\n1,nan,0\n".to_vec(),
            "odometry.csv:4: v is `nan`, which is not finite",
        ),
        ("odometry.csv", b"t,v,omega\n0,1\n".to_vec(), "odometry.csv:2: 2 columns, but the header has 3"),
        ("odometry.csv", b"t,v,omega\n0,1,2,3\n".to_vec(), "odometry.csv:2: 4 columns, but the header has 3"),
        ("odometry.csv", b"t,v,omega\n0,,0\n".to_vec(), "odometry.csv:2: v is empty; a number belongs there"),
        (
            "odometry.csv",
            b"t,x,y,heading\n0,0,0,north\n".to_vec(),
            "odometry.csv:2: heading is `north`, which is not a number",
        ),
        (
            "odometry.csv",
            b"t,v,omega\n2,0,0\n1,0,0\n".to_vec(),
            ".csv:3: its stamp, 1, lies before that of the row above, 2; sort",
        ),
        ("odometry.csv", b"t,v,omega\n0,\"1,0\n".to_vec(), "odometry.csv:2: a quotation mark is opened and not closed"),
        ("odometry.csv", long, "odometry.csv:2: the line is longer than"),
        ("odometry.csv", b"\x1f\x8b\x08\x00".to_vec(), "is the file complete?"),
        (
            "detections.csv",
            b"t,class\n0,tree\n".to_vec(),
            "detections.csv: line 1: `t,class` is no header of such a table; det",
        ),
        ("detections.csv", rows(""), "detections.csv: it holds no row besides the header"),
        ("detections.csv", rows("0,bush,1,2,0\n"), "csv:2: class is `bush`, which sensors.toml does not name; add it"),
        ("detections.csv", rows("0,tree,1,inf,0\n"), "detections.csv:2: range is `inf`, which is not finite"),
        ("detections.csv", rows("0,tree,1,-2,0\n"), "detections.csv:2: range is -2; a detection has a range above 0 m"),
        ("detections.csv", rows("0,tree,99,2,0\n"), "detections.csv:2: score is 99; scale scores to 0 ... 1"),
        (
            "detections.csv",
            rows("0,tree,1,2,-35\n"),
            "csv:2: bearing is -35, more than a full turn; bearings are in radians",
        ),
        ("detections.csv", rows("0,,,2,0\n"), "detections.csv:2: class is empty; name it, or leave"),
        (
            "detections.csv",
            rows("0,,,,\n0,tree,,2,0\n"),
            "csv:3: a row without a class tells of a frame that saw nothing",
        ),
        (
            "detections.csv",
            rows("0,tree,,2,0\n0,,,,\n"),
            "csv:3: a row without a class tells of a frame that saw nothing",
        ),
        (
            "detections.csv",
            rows("1,tree,,2,0\n0.5,tree,,2,0\n"),
            "csv:3: its stamp, 0.5, lies before that of the row above, 1",
        ),
        ("detections.csv", b"t,class,range,bearing\n\xff,tree,2,0\n".to_vec(), "detections.csv:2: t is"),
    ];
    for (name, text, expected) in cases {
        let message = read(&[(name, &text)]).unwrap_err().to_string();
        assert!(message.contains(expected) && message.contains(name), "{message:?} does not say {expected:?}");
    }
}

fn what_is_no_recording_is_told_with_what_is() {
    for missing in ["sensors.toml", "odometry.csv", "detections.csv"] {
        let folder = folder(&[]);
        std::fs::remove_file(folder.path().join(missing)).unwrap();
        let message = semantic::read(folder.path()).unwrap_err().to_string();
        assert!(
            message.contains(&format!("it has no {missing}; a recording of detections is a folder with")),
            "{message}"
        );
    }
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("victoria_park.txt");
    std::fs::write(&file, "").unwrap();
    let message = semantic::read(&file).unwrap_err().to_string();
    assert!(message.contains("this is no folder; a recording"), "{message}");
    let message = semantic::read(folder.path()).unwrap_err().to_string();
    assert!(message.contains("`ipslam convert FOLDER RECORDING`"), "{message}");
}

fn the_truth_is_beside_the_recording() {
    let folder = tempfile::tempdir().unwrap();
    let (recording, ids): (_, Ids) = (good(), vec![vec![None, Some(70)], vec![]]);
    let path = folder.path().join(truth::IDS);
    truth::write_ids(&path, &recording.frames, &ids).unwrap();
    assert_eq!(truth::read_ids(&path, &recording.frames).unwrap(), ids);
    std::fs::write(&path, "t,number,id\n0,1,3\n0,2,4\n").unwrap();
    let message = truth::read_ids(&path, &recording.frames).unwrap_err().to_string();
    assert!(message.contains("ids.csv:3: detection 2 of the frame at 0 is not in the recording"), "{message}");
    let landmark = truth::TrueLandmark { id: 9, class: 1, position: nalgebra::Point2::new(0.1, -2.0) };
    let path = folder.path().join(truth::LANDMARKS);
    truth::write_landmarks(&path, &[landmark], &recording.sensors.classes).unwrap();
    assert_eq!(truth::read_landmarks(&path, &recording.sensors.classes).unwrap(), [landmark]);
}

/// A made-up robot in the published form of MR.CLAM: barcodes are not subjects, and times are those of a clock.
fn mrclam_is_read_as_it_was_published() {
    let folder = tempfile::tempdir().unwrap();
    for (name, text) in [
        ("Barcodes.dat", "# Subject # Barcode #\n 2 14\n 7 6\n 8 41\n"),
        ("Landmark_Groundtruth.dat", "7 1.5 -2 0.001 0.001\n8 3 4 0.001 0.001\n"),
        ("Robot3_Odometry.dat", "# Time v w\n1288971843.000\t0.1\t0.2\n1288971843.015\t0 0\n"),
        ("Robot3_Groundtruth.dat", "1288971842.9 1 2 3\n"),
        (
            "Robot3_Measurement.dat",
            "1288971843.5 6 2.0 0.3\n1288971843.5 41 1.0 -0.1\n1288971843.7 14 1 0\n1288971844 99 1 0\n",
        ),
    ] {
        std::fs::write(folder.path().join(name), text).unwrap();
    }
    assert_eq!(datasets::recognise(folder.path()), Some(Dataset::MrClam));
    let options = Options { robot: Some(3), wrong_labels: Some(0.0), ..Options::default() };
    let Converted { recording, ids, trajectory, landmarks, notes } =
        Dataset::MrClam.read(folder.path(), &options).unwrap();
    let seen = |class, range, bearing| Detection { class, score: 1.0, range, bearing };
    let frame = |stamp, detections| Frame { stamp, detections };
    let expected = [frame(0.5, vec![seen(2, 1.0, -0.1), seen(1, 2.0, 0.3)]), frame(0.7, vec![]), frame(1.0, vec![])];
    assert_eq!(recording.frames, expected);
    assert_eq!(ids, [vec![Some(8), Some(7)], vec![], vec![]]);
    assert_eq!((trajectory[0].stamp, recording.odometry.span()), (-0.1, Some((0.0, 0.015))));
    assert_eq!(landmarks.iter().map(|landmark| landmark.class).collect::<Vec<_>>(), [1, 2]);
    assert_eq!(notes, ["1 detections left out: other robots", "1 detections left out: barcodes that were misread"]);
}

fn convert(set: Dataset, name: &str, options: &Options) -> Converted {
    let folder = data_folder().join("semantic").join(name);
    assert_eq!(datasets::recognise(&folder), Some(set), "{}", folder.display());
    let converted = set.read(&folder, options).unwrap();
    // What is converted is a recording without oddities.
    let made = tempfile::tempdir().unwrap();
    datasets::write(made.path(), &converted).unwrap();
    let ReadRecording { recording, warnings } = semantic::read(made.path()).unwrap();
    assert!(recording == converted.recording && warnings.is_empty(), "{warnings:?}");
    assert_eq!(truth::read_ids(&made.path().join(truth::IDS), &recording.frames).unwrap(), converted.ids);
    converted
}

/// Root mean square of dead reckoning against the truth, at the stamps of the truth.
fn dead_reckoning_error(converted: &Converted) -> f64 {
    let odometry = &converted.recording.odometry;
    let (start, end) = odometry.span().unwrap();
    let truth =
        converted.trajectory.iter().filter(|pose| (start..=end).contains(&pose.stamp)).copied().collect::<Vec<_>>();
    let reckoned = odometry.dead_reckoning(truth.iter().map(|pose| pose.stamp));
    reference_errors(&truth, &reckoned).absolute.unwrap().rmse
}

/// The middle of the absolute differences between detections and true landmarks seen from true poses: range, bearing.
fn median_errors(converted: &Converted) -> [f64; 2] {
    let landmarks: HashMap<u64, _> =
        converted.landmarks.iter().map(|landmark| (landmark.id, landmark.position)).collect();
    let Recording { frames, sensors, .. } = &converted.recording;
    let truth = ipslam::metrics::PoseLookup::new(&converted.trajectory);
    let mut errors = [Vec::new(), Vec::new()];
    for (frame, ids) in frames.iter().zip(&converted.ids) {
        let Some(pose) = truth.at(frame.stamp) else { continue };
        for (seen, id) in frame.detections.iter().zip(ids) {
            let at = (pose * sensors.robot_from_sensor).inverse() * landmarks[&id.unwrap()];
            errors[0].push((seen.range - at.coords.norm()).abs());
            errors[1].push(wrap_angle(seen.bearing - at.y.atan2(at.x)).abs());
        }
    }
    errors.map(|mut errors| {
        errors.sort_by(f64::total_cmp);
        errors[errors.len() / 2]
    })
}

/// The middle distance between where a frame sees a landmark and where the frame before saw it, joined by odometry.
fn median_step_error(converted: &Converted) -> f64 {
    let Recording { frames, odometry, .. } = &converted.recording;
    let at = |seen: &Detection| nalgebra::Point2::new(seen.range * seen.bearing.cos(), seen.range * seen.bearing.sin());
    let seen = |number: usize| frames[number].detections.iter().zip(&converted.ids[number]);
    let mut errors = Vec::new();
    for number in 1..frames.len() {
        let motion = odometry.motion(frames[number - 1].stamp, frames[number].stamp).start_from_end;
        let before: HashMap<_, _> = seen(number - 1).map(|(seen, id)| (*id, at(seen))).collect();
        let pairs = seen(number).filter(|(_, id)| id.is_some());
        errors.extend(pairs.filter_map(|(seen, id)| Some((motion * at(seen) - before.get(id)?).norm())));
    }
    errors.sort_by(f64::total_cmp);
    errors[errors.len() / 2]
}

fn mrclam_is_converted() {
    const FOLDER: &str = "mrclam/dataset7";
    // Frames, detections of tubes, dead reckoning [m]: counted and reckoned by a program in Python.
    let expected = [(2032, 2578, 2.84), (2585, 3818, 1.11), (2719, 4425, 1.87), (1463, 1822, 1.20), (2767, 3424, 1.06)];
    for (robot, (frames, detections, error)) in (1..).zip(expected) {
        let options = Options { robot: Some(robot), ..Options::default() };
        let converted = convert(Dataset::MrClam, FOLDER, &options);
        let recording = &converted.recording;
        assert_eq!((recording.frames.len(), recording.detections()), (frames, detections), "robot {robot}");
        let reckoned = dead_reckoning_error(&converted);
        assert!((reckoned - error).abs() < 0.02, "robot {robot}: {reckoned} m");
        let [range, bearing] = median_errors(&converted);
        assert!(range < 0.15 && bearing < 0.02, "robot {robot}: {range} m, {bearing} rad");
        let (first, last) = (converted.trajectory[0].stamp, converted.trajectory.last().unwrap().stamp);
        assert!((-9.0..=-6.0).contains(&first) && (891.0..=894.0).contains(&last), "robot {robot}: {first} to {last}");

        let class_of: HashMap<_, _> =
            converted.landmarks.iter().map(|landmark| (landmark.id, landmark.class)).collect();
        assert_eq!(class_of.len(), 15);
        let labels =
            recording.frames.iter().zip(&converted.ids).flat_map(|(frame, ids)| frame.detections.iter().zip(ids));
        let wrong: Vec<_> = labels.filter(|(seen, id)| seen.class != class_of[&id.unwrap()]).collect();
        let share = wrong.len() as f64 / detections as f64;
        assert!((share - 0.1).abs() < 0.02, "robot {robot}: {share} of the labels are wrong");
        let next = wrong.iter().filter(|(seen, id)| seen.class == (class_of[&id.unwrap()] + 1) % 3).count();
        let next = next as f64 / wrong.len() as f64;
        assert!((next - 0.5).abs() < 0.12, "robot {robot}: {next} of the wrong labels are the next class");
    }
    let with = |seed, wrong_labels| {
        let options = Options {
            robot: Some(2),
            seed: Some(seed),
            wrong_labels: Some(wrong_labels),
            classes: Some(5),
            rows: None,
        };
        convert(Dataset::MrClam, FOLDER, &options).recording.frames
    };
    assert!(with(1, 0.1) == with(1, 0.1) && with(1, 0.1) != with(2, 0.1) && with(1, 0.0) == with(2, 0.0));
}

fn lost_in_woods_is_converted() {
    let converted = convert(Dataset::LostInWoods, "lost_in_woods", &Options::default());
    let recording = &converted.recording;
    assert_eq!((recording.frames.len(), recording.detections(), converted.landmarks.len()), (12_609, 61_086, 17));
    assert_eq!(converted.trajectory.len(), 12_609 - 331);
    let (reckoned, [range, bearing]) = (dead_reckoning_error(&converted), median_errors(&converted));
    assert!((reckoned - 1.34).abs() < 0.02 && range < 0.03 && bearing < 0.02, "{reckoned} {range} {bearing}");
}

fn dlr_is_converted() {
    let converted = convert(Dataset::Dlr, "dlr", &Options::default());
    let Recording { frames, odometry, .. } = &converted.recording;
    assert_eq!((frames.len(), converted.recording.detections()), (3297, 14_745));
    assert_eq!(frames.iter().filter(|frame| frame.detections.is_empty()).count(), 84);
    assert_eq!(converted.ids.iter().flatten().filter(|id| id.is_none()).count(), 436);
    let way = odometry.motion(0.0, 1e9);
    assert!((way.distance - 505.0).abs() < 0.1, "{way:?}");
    // The camera looks ahead, and the robot drives ahead.
    assert!(frames.iter().flat_map(|frame| &frame.detections).all(|seen| seen.bearing.abs() < 1.1));
    let error = median_step_error(&converted);
    assert!(error < 0.03, "{error} m");
}

fn victoria_park_is_converted() {
    let converted = convert(Dataset::VictoriaPark, "victoria_park", &Options::default());
    let Recording { frames, odometry, .. } = &converted.recording;
    assert_eq!((frames.len(), converted.recording.detections(), odometry.len()), (3331, 3640, 6969));
    let trees: std::collections::HashSet<_> = converted.ids.iter().flatten().collect();
    assert_eq!(trees.len(), 151);
    let way = odometry.motion(0.0, 1e9);
    assert!((way.distance - 4026.6).abs() < 1.0, "{way:?}");
    let error = median_step_error(&converted);
    assert!(error < 0.1, "{error} m");
}

fn options_that_cannot_be_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let text = "ODOMETRY 0 1 1 0 0 1 0 0 1 0 1\nLANDMARK 1 2 3 4 1 0 1\n";
    std::fs::create_dir(folder.path().join("park")).unwrap();
    std::fs::write(folder.path().join("park/victoria_park.txt"), text).unwrap();
    let ipslam = |words: &[&str]| {
        let done =
            Command::new(cargo_bin("ipslam")).current_dir(folder.path()).arg("convert").args(words).output().unwrap();
        (done.status.code(), String::from_utf8(done.stderr).unwrap())
    };
    for (words, code, expected) in [
        (&["park", "out", "--robot", "2"][..], 2, "--robot is 2, but has to be left out"),
        (&["park", "out", "--classes", "0"], 2, "--classes is 0, but has to be 1 to 1000"),
        (
            &["park", "out", "--wrong-labels", "0.1"],
            2,
            "--wrong-labels is 0.1, but has to be 0 where there is one class",
        ),
        (&["park", "out", "--wrong-labels", "1.1", "--classes", "2"], 2, "--wrong-labels is 1.1, but has to be 0 to 1"),
        (&["park/victoria_park.txt", "out.clf", "--seed", "2"], 2, "options are for sets only"),
        (&["park", "park"], 1, "a recording needs a new folder"),
    ] {
        let (found, error) = ipslam(words);
        assert!(found == Some(code) && error.contains(expected), "{words:?} ended with {found:?}: {error}");
        assert!(!folder.path().join("out").exists(), "{words:?}");
    }
    let (code, said) = ipslam(&["park", "out", "--classes", "2"]);
    assert!(code == Some(0) && said.contains("out: 1 frames, 1 detections, 2 rows of odometry"), "{said}");
    assert_eq!(read_names(&folder.path().join("out")), ["detections.csv", "ids.csv", "odometry.csv", "sensors.toml"]);
    let seen = semantic::read(&folder.path().join("out")).unwrap().recording.frames[0].detections[0];
    assert!((seen.range - 5.0).abs() < 1e-12, "{seen:?}");
}

/// A robot stands still, and sees a door and a chair in each of twelve frames.
fn a_recording_is_mapped_to_files() {
    let rows = (0..12).map(|frame| format!("{frame},door,,3,0.2\n{frame},\"chair, old\",,4,-0.3\n"));
    let detections = format!("t,class,score,range,bearing\n{}", rows.collect::<String>());
    let sensors = b"classes = ['door', 'chair, old']\n";
    let folder = folder(&[
        ("sensors.toml", sensors),
        ("detections.csv", detections.as_bytes()),
        ("odometry.csv", b"t,v,omega\n0,0,0\n"),
    ]);
    let rows = (0..12).map(|frame| format!("{frame},0,7\n{frame},1,\n"));
    std::fs::write(folder.path().join("some-ids.csv"), format!("t,number,id\n{}", rows.collect::<String>())).unwrap();
    std::fs::write(folder.path().join("no-ids.csv"), "t,number,id\n").unwrap();
    let ipslam = |out: &str, words: &[&str]| {
        let mut command = Command::new(cargo_bin("ipslam"));
        command.current_dir(folder.path()).args(["semantic", ".", "--out", out]).args(words).output().unwrap()
    };
    let done = ipslam("out", &[]);
    let said = String::from_utf8(done.stdout).unwrap();
    assert!(done.status.success() && said.starts_with("2 landmarks from 24 detections in 12 keyframes"), "{said}");
    let out = folder.path().join("out");
    let names = [
        "covariances.csv",
        "landmarks.csv",
        "landmarks.json",
        "map.png",
        "map.svg",
        "summary.json",
        "trajectory.tum",
        "weights.csv",
    ];
    assert_eq!(read_names(&out), names);
    let text = |name: &str| std::fs::read_to_string(out.join(name)).unwrap();
    let table = text("landmarks.csv");
    assert!(
        table.starts_with("landmark,class,x,y,xx,xy,yy,weight\n") && table.contains(",\"chair, old\",3.82134"),
        "{table}"
    );
    assert_eq!(
        (table.lines().count(), text("weights.csv").lines().count(), text("covariances.csv").lines().count()),
        (3, 25, 13)
    );
    let summary: serde_json::Value = serde_json::from_str(&text("summary.json")).unwrap();
    assert_eq!(
        (&summary["verdict"], summary["doubts"].as_array().map(Vec::len)),
        (&"consistent".into(), Some(0)),
        "{summary}"
    );

    let done = ipslam("known", &["--known-ids", "some-ids.csv"]);
    let said = String::from_utf8(done.stdout).unwrap();
    assert!(done.status.success() && said.starts_with("1 landmarks from 12 detections in 12 keyframes"), "{said}");
    let done = ipslam("nothing", &["--known-ids", "no-ids.csv"]);
    let said = String::from_utf8(done.stderr).unwrap();
    assert!(done.status.code() == Some(1) && said.contains("whose object is known"), "{said}");
}

fn read_names(folder: &Path) -> Vec<String> {
    let mut names: Vec<_> =
        folder.read_dir().unwrap().map(|file| file.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

crate::needs::trials! {
    "semantic":
    Nothing {
        a_folder_is_read, what_is_written_is_read_back, other_programs_write_tables_in_other_ways,
        what_is_odd_is_told_and_counted, bad_input_is_told_with_file_line_and_remedy,
        what_is_no_recording_is_told_with_what_is, the_truth_is_beside_the_recording,
        mrclam_is_read_as_it_was_published, options_that_cannot_be_are_told, a_recording_is_mapped_to_files,
    }
    Data { mrclam_is_converted, lost_in_woods_is_converted, dlr_is_converted, victoria_park_is_converted }
}
