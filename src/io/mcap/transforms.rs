//! The transforms of a bag: those that never change make the tree of frames, and one that does may be the odometry.

use super::frames::Frames;
use super::messages::{StampedTransform, Transforms};
use nalgebra::Isometry3;
use std::collections::BTreeMap;

/// Pairs of moving frames, at most; a damaged file could hold any number.
const MAX_PAIRS: usize = 10_000;
/// A transform that is sent as often and never changes is no odometry: the robot would have stood all the time.
const ALWAYS_THE_SAME: u64 = 20;
/// Transforms that an error lists.
const SHOWN: usize = 20;

/// Whether a topic holds transforms that never change.
pub(super) fn is_static(topic: &str) -> bool {
    last_name(topic) == "tf_static"
}

fn last_name(name: &str) -> &str {
    name.rsplit('/').next().unwrap_or(name)
}

/// The transforms that were seen.
#[derive(Default)]
pub(super) struct SeenTransforms {
    fixed: Frames,
    /// Those that are sent again and again.
    repeated: BTreeMap<Repeated, Repetition>,
}

/// A transform that is sent again and again, by its names.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Repeated {
    pub(super) topic: String,
    pub(super) parent: String,
    pub(super) child: String,
}

#[derive(Clone, Copy)]
struct Repetition {
    first: Isometry3<f64>,
    is_constant: bool,
    times: u64,
}

impl SeenTransforms {
    pub(super) fn add(&mut self, topic: &str, message: &Transforms) {
        for stamped in &message.transforms {
            let Ok(parent_from_child) = stamped.transform.isometry() else { continue };
            if is_static(topic) {
                self.fixed.insert(stamped.header.frame(), stamped.child_frame(), parent_from_child);
            } else {
                self.repeat(topic, stamped, parent_from_child);
            }
        }
    }

    fn repeat(&mut self, topic: &str, stamped: &StampedTransform, parent_from_child: Isometry3<f64>) {
        let [topic, parent, child] = [topic, stamped.header.frame(), stamped.child_frame()].map(str::to_owned);
        let name = Repeated { topic, parent, child };
        if self.repeated.len() < MAX_PAIRS || self.repeated.contains_key(&name) {
            let new = Repetition { first: parent_from_child, is_constant: true, times: 0 };
            let repetition = self.repeated.entry(name).or_insert(new);
            repetition.is_constant &= repetition.first == parent_from_child;
            repetition.times += 1;
        }
    }

    /// What never moves: static transforms, and those between frames of the robot that are sent again and again and never
    /// change.
    pub(super) fn fixed(&self) -> Frames {
        let mut fixed = Frames::default();
        for (Repeated { parent, child, .. }, repetition) in &self.repeated {
            let is_of_world = ["odom", "map", "world"].iter().any(|name| last_name(parent).contains(name));
            if repetition.is_constant && !is_of_world {
                fixed.insert(parent, child, repetition.first);
            }
        }
        fixed.extend(&self.fixed);
        fixed
    }

    /// The transform that moves the robot, on this topic or on any: from a frame named for odometry (REP 105: `odom`).
    /// `Ok(None)` where the bag has none; `Err` holds why none can be chosen.
    pub(super) fn odometry(
        &self,
        topic: Option<&str>,
        laser: &str,
        fixed: &Frames,
    ) -> Result<Option<&Repeated>, String> {
        let root = |frame| fixed.root(frame).map(|(root, _)| root);
        let mut pairs: BTreeMap<(&str, &str), &Repeated> = BTreeMap::new();
        for (name, repetition) in &self.repeated {
            let moves = !repetition.is_constant || repetition.times < ALWAYS_THE_SAME;
            if last_name(&name.parent).contains("odom") && moves && topic.is_none_or(|topic| topic == name.topic) {
                pairs.insert((&name.parent, &name.child), name);
            }
        }
        let several = pairs.len() > 1;
        if several {
            // Of several robots the one that carries the laser.
            pairs.retain(|(_, child), _| root(child) == root(laser));
        }
        match &pairs.values().collect::<Vec<_>>()[..] {
            [only] => Ok(Some(only)),
            [] if topic.is_none() && !several => Ok(None),
            _ => Err(format!(
                "no single transform from a frame `odom` to the robot of the laser `{laser:.50}`; choose odometry by \
                 --odom-topic; there are: {}",
                self.listed()
            )),
        }
    }

    fn listed(&self) -> String {
        let shown = |Repeated { topic, parent, child }: &Repeated| format!("{parent} -> {child} on {topic}");
        self.repeated.keys().take(SHOWN).map(shown).collect::<Vec<_>>().join(", ")
    }
}
