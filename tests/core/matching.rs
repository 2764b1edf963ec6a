//! The rules of III-D, by hand and against the slowest algorithm that does the same.

use crate::wall;
use ipslam::ablation::MatchingRule;
use ipslam::map::matching::{MatchingConfig, line_distance, match_clusters, paper_distance};
use ipslam::ppca::Cluster;
use nalgebra::{Point2, Vector2};
use proptest::prelude::*;

/// A cluster of standard deviation `sigma` along `degrees`, thin across.
fn cluster(x: f64, y: f64, degrees: f64, sigma: f64) -> Cluster {
    let (sin, cos) = degrees.to_radians().sin_cos();
    Cluster {
        mean: Point2::new(x, y),
        direction: Vector2::new(cos, sin),
        along_variance: sigma * sigma,
        across_variance: 1e-4,
        count: 50.0,
    }
}

const MAX_ANGLE: f64 = std::f64::consts::FRAC_PI_3;
const PAPER: MatchingConfig = MatchingConfig { max_angle: MAX_ANGLE, max_distance: 0.5, max_gap: 0.0 };

#[test]
fn directions_more_than_60_degrees_apart_do_not_match() {
    let a = cluster(0.0, 0.0, 10.0, 1.0);
    for (degrees, close) in [
        (10.0, true),
        (69.9, true),
        (70.1, false),
        (-49.9, true),
        (-50.1, false),
        (100.0, false),
        (190.0, true), // a direction has no sign
        (249.9, true),
        (250.1, false),
    ] {
        let distance = paper_distance(&a, &cluster(0.1, 0.0, degrees, 1.0), MAX_ANGLE);
        assert_eq!(distance.is_finite(), close, "{degrees}°: {distance}");
    }
}

#[test]
fn the_metric_is_that_of_the_place() {
    let a = cluster(0.0, 0.0, 0.0, 1.0);
    let tilted = 0.5 * (0.3 + f64::abs(1.2 * 30f64.to_radians().sin() - 0.3 * 30f64.to_radians().cos()));
    for (b, expected, what) in [
        (cluster(1.5, 0.2, 0.0, 1.0), 0.2, "near: distance from the line"),
        (cluster(1.5, -0.2, 180.0, 1.0), 0.2, "near, turned round"),
        (cluster(1.2, 0.3, 30.0, 1.0), tilted, "near and tilted: mean of both distances"),
        (cluster(3.0, 4.0, 0.0, 1.0), 5.0, "far: distance of the centres"),
        (cluster(1.5, 0.0, 0.0, 0.6), 0.0, "within the sum of the standard deviations, 1.6"),
        (cluster(1.5, 0.0, 0.0, 0.4), 1.5, "beyond their sum, 1.4"),
    ] {
        for (a, b) in [(&a, &b), (&b, &a)] {
            let found = paper_distance(a, b, MAX_ANGLE);
            assert!((found - expected).abs() < 1e-12, "{what}: {found}, not {expected}");
        }
    }
}

/// Again and again the closest pair of clusters that are still free, looked for among all.
fn slow_greedy(map: &[Cluster], scan: &[Cluster]) -> Vec<Option<usize>> {
    let mut matches = vec![None; scan.len()];
    loop {
        let mut closest = (PAPER.max_distance, None);
        for s in (0..scan.len()).filter(|&s| matches[s].is_none()) {
            for m in (0..map.len()).filter(|&m| !matches.contains(&Some(m))) {
                let distance = paper_distance(&map[m], &scan[s], MAX_ANGLE);
                if distance < closest.0 {
                    closest = (distance, Some((s, m)));
                }
            }
        }
        let Some((s, m)) = closest.1 else { return matches };
        matches[s] = Some(m);
    }
}

fn clusters(most: usize) -> impl Strategy<Value = Vec<Cluster>> {
    let one = (-1.0..1.0, -1.0..1.0, 0.0..180.0, 0.1..0.8);
    proptest::collection::vec(one.prop_map(|(x, y, degrees, sigma)| cluster(x, y, degrees, sigma)), 0..most)
}

proptest! {
    #[test]
    fn greedy_takes_the_closest_pair_first(map in clusters(8), scan in clusters(8)) {
        let matches = match_clusters(&map, &scan, &PAPER, MatchingRule::Paper);
        prop_assert_eq!(&matches, &slow_greedy(&map, &scan));
        let mut taken: Vec<usize> = matches.iter().flatten().copied().collect();
        taken.sort_unstable();
        prop_assert!(taken.windows(2).all(|pair| pair[0] < pair[1]), "{:?} is not one to one", matches);
    }
}

/// First come is not first served: the pair of smallest distance is.
#[test]
fn the_closer_scan_cluster_gets_the_map_cluster() {
    let map = [cluster(0.0, 0.0, 0.0, 1.0)];
    let scan = [cluster(0.0, 0.2, 0.0, 1.0), cluster(0.0, 0.1, 0.0, 1.0)];
    assert_eq!(match_clusters(&map, &scan, &PAPER, MatchingRule::Paper), [None, Some(0)]);
    assert_eq!(match_clusters::<Cluster>(&[], &scan, &PAPER, MatchingRule::Paper), [None, None]);
    assert!(match_clusters(&map, &[], &PAPER, MatchingRule::Paper).is_empty());
}

#[test]
fn several_pieces_of_a_wall_match_it_by_the_collinear_rule() {
    let config = MatchingConfig::default();
    let map = [wall([0.0, 0.0], [4.0, 0.0], 0.01, 100.0), wall([0.0, 2.0], [4.0, 2.0], 0.01, 100.0)];
    let pieces = [
        wall([0.5, 0.01], [1.5, 0.01], 0.01, 30.0),
        wall([3.5, 0.0], [2.0, 0.0], 0.01, 30.0),
        wall([4.2, 0.0], [5.0, 0.0], 0.01, 30.0),
        wall([1.0, 1.95], [3.0, 1.95], 0.01, 30.0),
    ];
    assert_eq!(match_clusters(&map, &pieces, &config, MatchingRule::Collinear), [Some(0), Some(0), Some(0), Some(1)]);
    let strangers = [
        wall([4.4, 0.0], [5.0, 0.0], 0.01, 30.0), // a gap of 0.4 m
        wall([1.0, 0.3], [3.0, 0.3], 0.01, 30.0), // another line
        wall([1.0, 0.0], [1.5, 0.4], 0.01, 30.0), // 39° off
    ];
    assert_eq!(match_clusters(&map, &strangers, &config, MatchingRule::Collinear), [None; 3]);
}

/// Points of a wall that lie half a metre apart do not tell whether it ends.
#[test]
fn a_wall_of_few_points_goes_on_to_the_next() {
    let config = MatchingConfig::default();
    let map = [wall([0.0, 0.0], [4.0, 0.0], 0.01, 8.0)];
    for (begin, expected) in [(4.7, Some(0)), (4.9, None)] {
        let next = [wall([begin, 0.0], [begin + 1.0, 0.0], 0.01, 30.0)];
        assert_eq!(match_clusters(&map, &next, &config, MatchingRule::Collinear), [expected], "{begin}");
        assert_eq!(match_clusters(&next, &map, &config, MatchingRule::Collinear), [expected], "{begin}");
    }
}

proptest! {
    /// Which of two clusters is in the map does not matter, nor which way a direction points.
    /// What is left aside at little cost would not have matched.
    #[test]
    fn collinear_matches_are_those_of_brute_force(map in clusters(12), scan in clusters(6), gap in 0.0..0.2f64) {
        let config = MatchingConfig { max_gap: gap, ..MatchingConfig::default() };
        for (cluster, found) in scan.iter().zip(match_clusters(&map, &scan, &config, MatchingRule::Collinear)) {
            let distances = map.iter().map(|candidate| line_distance(candidate, cluster, &config));
            let best = distances.enumerate().filter(|(_, d)| d.is_finite()).min_by(|a, b| a.1.total_cmp(&b.1));
            prop_assert_eq!(found, best.map(|(index, _)| index));
        }
    }

    #[test]
    fn line_distance_is_symmetric(pair in clusters(3)) {
        prop_assume!(pair.len() == 2);
        let config = MatchingConfig { max_angle: 1.0, max_distance: 0.5, ..MatchingConfig::default() };
        let turned = Cluster { direction: -pair[1].direction, ..pair[1] };
        let distance = line_distance(&pair[0], &pair[1], &config);
        for other in [line_distance(&pair[1], &pair[0], &config), line_distance(&pair[0], &turned, &config)] {
            prop_assert!(distance == other || (distance - other).abs() < 1e-12, "{} {}", distance, other);
        }
    }
}
