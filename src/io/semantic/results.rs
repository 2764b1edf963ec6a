//! What `ipslam semantic` found, as files that `docs/formats.md` describes.

use crate::io::table::quoted;
use crate::semantic::{Landmark, Mapped, SemanticMap, Square, Weight, World};
use serde_json::json;
use std::collections::BTreeMap;
use std::fmt::Write as _;

/// Names of the files and what is in them.
pub fn files<W: World>(classes: &[String], map: &SemanticMap<W>) -> [(&'static str, String); 4] {
    let [json, csv] = landmark_files(classes, &map.landmarks);
    [json, csv, ("covariances.csv", covariances(map)), ("weights.csv", weights(map))]
}

/// The same of landmarks alone.
pub fn landmark_files<W: World>(classes: &[String], landmarks: &[Landmark<W>]) -> [(&'static str, String); 2] {
    [("landmarks.json", landmarks_json(classes, landmarks)), ("landmarks.csv", landmarks_csv(classes, landmarks))]
}

fn landmarks_json<W: World>(classes: &[String], landmarks: &[Landmark<W>]) -> String {
    let landmarks = landmarks.iter().enumerate().map(|(number, landmark)| {
        let probabilities: BTreeMap<&str, f64> =
            classes.iter().map(String::as_str).zip(landmark.classes.iter().copied()).collect();
        let position: W::Numbers = landmark.position.into();
        let rows: Vec<&[f64]> = landmark.covariance.entries().chunks(W::POINT).collect();
        json!({
            "landmark": number,
            "class": classes.get(landmark.class()),
            "position": position.as_ref(),
            "covariance": rows,
            "classes": probabilities,
            "weight": landmark.weight,
        })
    });
    format!("{:#}\n", json!({ "landmarks": landmarks.collect::<Vec<_>>() }))
}

fn landmarks_csv<W: World>(classes: &[String], landmarks: &[Landmark<W>]) -> String {
    let axes = &["x", "y", "z"][..W::POINT];
    let mut text = format!("landmark,class,{},{},weight\n", axes.join(","), pairs(axes));
    for (number, landmark) in landmarks.iter().enumerate() {
        let class = classes.get(landmark.class()).map_or("", String::as_str);
        let position: W::Numbers = landmark.position.into();
        let position: Vec<String> = position.as_ref().iter().map(|number| format!("{number:.6}")).collect();
        let (position, covariance) = (position.join(","), upper_triangle(landmark.covariance.entries(), W::POINT));
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{number},{},{position},{covariance},{:.6}", quoted(class), landmark.weight);
    }
    text
}

/// Of each pose of the trajectory, the upper triangle of its covariance.
fn covariances<W: World>(map: &SemanticMap<W>) -> String {
    let axes: &[&str] = if W::POSE == 3 { &["x", "y", "h"] } else { &["x", "y", "z", "rx", "ry", "rz"] };
    let mut text = format!("t,{}\n", pairs(axes));
    for Mapped { stamp, covariance, .. } in &map.keyframes {
        let _ = writeln!(text, "{stamp},{}", upper_triangle(covariance.entries(), W::POSE));
    }
    text
}

/// Names of the columns of an upper triangle.
fn pairs(axes: &[&str]) -> String {
    let of_row = |(row, first): (usize, &&str)| axes[row..].iter().map(|second| format!("{first}{second}")).collect();
    let names: Vec<Vec<String>> = axes.iter().enumerate().map(of_row).collect();
    names.concat().join(",")
}

fn upper_triangle(entries: &[f64], size: usize) -> String {
    let of_row = |row: usize| (row..size).map(move |column| format!("{:.6e}", entries[row + size * column])).collect();
    let numbers: Vec<Vec<String>> = (0..size).map(of_row).collect();
    numbers.concat().join(",")
}

fn weights<W: World>(map: &SemanticMap<W>) -> String {
    let stamps: BTreeMap<Option<usize>, f64> =
        map.keyframes.iter().map(|keyframe| (keyframe.frame, keyframe.stamp)).collect();
    let mut text = "t,number,landmark,weight\n".to_owned();
    for Weight { frame, detection, landmark, weight } in &map.weights {
        let stamp = stamps.get(&Some(*frame)).copied().unwrap_or(f64::NAN);
        let _ = writeln!(text, "{stamp},{detection},{landmark},{weight:.6}");
    }
    text
}
