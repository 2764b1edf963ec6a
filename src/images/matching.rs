//! Which features of two pictures look alike.

use super::orb::{OrbFeature, distance};

/// Of two patches that have nothing to do with each other half of the 256 comparisons differ, 128 ± 8; of a pair at most so
/// many, eight standard deviations less.
const MAX_DISTANCE: u32 = 64;
/// The distance to the second best has to be larger than that to the best by this factor (D. Lowe, IJCV 60(2), 2004).
const DISTINCT: f64 = 1.25;
/// The second best is another corner if it is farther away \[pixels of its level\]: a corner shows on several levels.
const SAME_CORNER: f64 = 8.0;

/// Pairs of features, each the other's best, and by far; in the order of the first.
pub fn match_features(first: &[OrbFeature], second: &[OrbFeature]) -> Vec<(usize, usize)> {
    let forward = best_of_each(first, second);
    let back = best_of_each(second, first);
    let mutual =
        |(one, best): (usize, &Option<usize>)| best.filter(|&other| back[other] == Some(one)).map(|other| (one, other));
    forward.iter().enumerate().filter_map(mutual).collect()
}

fn best_of_each(features: &[OrbFeature], among: &[OrbFeature]) -> Vec<Option<usize>> {
    let best_of = |feature: &OrbFeature| {
        let distances: Vec<u32> = among.iter().map(|other| distance(&feature.descriptor, &other.descriptor)).collect();
        let (best, &least) = distances.iter().enumerate().min_by_key(|(_, distance)| **distance)?;
        let is_other = |place: usize| {
            let (one, other) = (&among[best], &among[place]);
            (one.pixel - other.pixel).norm() > SAME_CORNER * one.scale.max(other.scale)
        };
        let limit = DISTINCT * f64::from(least);
        let is_unclear = |(place, &distance): (usize, &u32)| f64::from(distance) <= limit && is_other(place);
        let is_clear = least <= MAX_DISTANCE && !distances.iter().enumerate().any(is_unclear);
        is_clear.then_some(best)
    };
    features.iter().map(best_of).collect()
}
