//! What `ipslam semantic` found, as files that `docs/formats.md` describes.

use crate::detections::Recording;
use crate::io::table::quoted;
use crate::semantic::{Mapped, SemanticMap, Weight};
use serde_json::json;
use std::collections::BTreeMap;
use std::fmt::Write as _;

/// Names of the files and what is in them.
pub fn files(recording: &Recording, map: &SemanticMap) -> [(&'static str, String); 4] {
    let classes = &recording.sensors.classes[..];
    [
        ("landmarks.json", landmarks_json(classes, map)),
        ("landmarks.csv", landmarks(classes, map)),
        ("covariances.csv", covariances(map)),
        ("weights.csv", weights(recording, map)),
    ]
}

fn landmarks_json(classes: &[String], map: &SemanticMap) -> String {
    let landmarks = map.landmarks.iter().enumerate().map(|(number, landmark)| {
        let probabilities: BTreeMap<&str, f64> =
            classes.iter().map(String::as_str).zip(landmark.classes.iter().copied()).collect();
        let [[xx, xy], [_, yy]] = landmark.covariance.data.0;
        json!({
            "landmark": number,
            "class": classes.get(landmark.class()),
            "position": [landmark.position.x, landmark.position.y],
            "covariance": [[xx, xy], [xy, yy]],
            "classes": probabilities,
            "weight": landmark.weight,
        })
    });
    format!("{:#}\n", json!({ "landmarks": landmarks.collect::<Vec<_>>() }))
}

fn landmarks(classes: &[String], map: &SemanticMap) -> String {
    let mut text = "landmark,class,x,y,xx,xy,yy,weight\n".to_owned();
    for (number, landmark) in map.landmarks.iter().enumerate() {
        let class = classes.get(landmark.class()).map_or("", String::as_str);
        let (x, y) = (landmark.position.x, landmark.position.y);
        let [[xx, xy], [_, yy]] = landmark.covariance.data.0;
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "{number},{},{x:.6},{y:.6},{xx:.6e},{xy:.6e},{yy:.6e},{:.6}",
            quoted(class),
            landmark.weight
        );
    }
    text
}

/// Of each pose of the trajectory, the upper triangle of its covariance.
fn covariances(map: &SemanticMap) -> String {
    let mut text = "t,xx,xy,xh,yy,yh,hh\n".to_owned();
    for Mapped { stamp, covariance: c, .. } in &map.keyframes {
        let [xx, xy, xh] = [c[(0, 0)], c[(0, 1)], c[(0, 2)]];
        let [yy, yh, hh] = [c[(1, 1)], c[(1, 2)], c[(2, 2)]];
        let _ = writeln!(text, "{stamp},{xx:.6e},{xy:.6e},{xh:.6e},{yy:.6e},{yh:.6e},{hh:.6e}");
    }
    text
}

fn weights(recording: &Recording, map: &SemanticMap) -> String {
    let mut text = "t,number,landmark,weight\n".to_owned();
    for Weight { frame, detection, landmark, weight } in &map.weights {
        let stamp = recording.frames.get(*frame).map_or(f64::NAN, |frame| frame.stamp);
        let _ = writeln!(text, "{stamp},{detection},{landmark},{weight:.6}");
    }
    text
}
