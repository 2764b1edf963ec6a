//! Features that are followed from keyframe to keyframe: the geometric measurements of the paper's section 3.

use super::matching::match_features;
use super::orb::{Orb, OrbFeature};
use super::two_view::{Pair, TwoView, relative_pose};
use crate::geometry::Pinhole;
use crate::visual_inertial::Feature;
use image::GrayImage;

/// Of a picture.
const FEATURES: usize = 800;
/// Standard deviation of the place of a feature \[pixels of its level\]: corners are found to a pixel.
pub const SIGMA: f64 = 0.7;
/// Half of the features have moved so far since the last keyframe \[rad\]. So their distance shows, and most are still in view.
const MOVED: f64 = 0.015;

/// What a keyframe shows.
#[derive(Clone, Debug, PartialEq)]
pub struct Keyframe {
    /// All features; those of one track show the same point.
    pub features: Vec<Feature>,
    /// Of each feature the size of its level's pixels.
    pub scales: Vec<f64>,
    /// The motion since the last keyframe; none at the first, and where too few features agree.
    pub motion: Option<TwoView>,
}

/// Follows features through the pictures of one camera.
#[derive(Clone, Debug)]
pub struct Tracker {
    camera: Pinhole,
    orb: Orb,
    /// Features of the last keyframe, and their tracks.
    last: Vec<(OrbFeature, u64)>,
    tracks: u64,
    keyframes: u32,
}

impl Tracker {
    /// Nothing seen yet.
    pub fn new(camera: Pinhole) -> Self {
        Self { camera, orb: Orb::new(), last: Vec::new(), tracks: 0, keyframes: 0 }
    }

    /// Takes the next picture; none where the camera has hardly moved since the last keyframe.
    pub fn add(&mut self, picture: &GrayImage) -> Option<Keyframe> {
        let features = self.orb.features(picture, FEATURES);
        let last: Vec<OrbFeature> = self.last.iter().map(|(feature, _)| *feature).collect();
        let matches = match_features(&last, &features);
        let pairs: Vec<Pair> = matches.iter().map(|&(one, other)| self.pair(&last[one], &features[other])).collect();
        if !pairs.is_empty() && !moved(&pairs) {
            return None;
        }
        let motion = relative_pose(&pairs, 0, self.keyframes);
        let mut tracks = vec![None; features.len()];
        if let Some(motion) = &motion {
            let right = matches.iter().zip(&motion.agrees).filter(|(_, agrees)| **agrees);
            right.for_each(|(&(one, other), _)| tracks[other] = Some(self.last[one].1));
        }
        let numbered = features.into_iter().zip(tracks).map(|(feature, track)| {
            let new = self.tracks;
            self.tracks += u64::from(track.is_none());
            (feature, track.unwrap_or(new))
        });
        self.last = numbered.collect();
        self.keyframes += 1;
        let features = self.last.iter().map(|&(OrbFeature { pixel, .. }, track)| Feature { track, pixel }).collect();
        Some(Keyframe { features, scales: self.last.iter().map(|(feature, _)| feature.scale).collect(), motion })
    }

    fn pair(&self, first: &OrbFeature, second: &OrbFeature) -> Pair {
        let [fu, fv] = self.camera.focal;
        let sigma = SIGMA * first.scale.max(second.scale) / fu.min(fv);
        Pair { first: self.camera.ray(first.pixel), second: self.camera.ray(second.pixel), sigma }
    }
}

/// Whether half of the pairs have moved far enough.
fn moved(pairs: &[Pair]) -> bool {
    let far = pairs.iter().filter(|pair| pair.first.coords.angle(&pair.second.coords) > MOVED).count();
    2 * far >= pairs.len()
}
