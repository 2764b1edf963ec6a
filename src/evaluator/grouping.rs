//! Groups of particles: of one map, and close together, so that they can share candidate lists.

use super::pose::LocalPose;
use rayon::prelude::*;
use std::f32::consts::PI;

/// Particles of one map, by their numbers among all particles.
#[derive(Clone, Debug, PartialEq)]
pub struct ParticleGroup {
    /// Their map.
    pub map: usize,
    /// Who they are.
    pub particles: Vec<u32>,
}

/// Groups in the order of the particles: those of the first map come first, as many of each map.
pub fn in_order(maps: usize, particles_per_map: usize, size: usize) -> Vec<ParticleGroup> {
    let of_map = |map: usize| {
        let first = (map * particles_per_map) as u32;
        let particles: Vec<u32> = (first..first + particles_per_map as u32).collect();
        chunks(map, &particles, size)
    };
    (0..maps).flat_map(of_map).collect()
}

/// The same, with the particles of a map ordered by where they are, so that several places are several groups.
pub fn by_place(maps: usize, poses: &[LocalPose], size: usize) -> Vec<ParticleGroup> {
    let mut groups = in_order(maps, poses.len() / maps.max(1), usize::MAX);
    for group in &mut groups {
        if group.particles.len() > size {
            let placed = group.particles.par_iter().map(|&particle| (place(poses[particle as usize]), particle));
            let mut placed: Vec<(u64, u32)> = placed.collect();
            placed.par_sort_unstable();
            group.particles = placed.into_iter().map(|(_, particle)| particle).collect();
        }
    }
    groups.into_iter().flat_map(|group| chunks(group.map, &group.particles, size)).collect()
}

/// Orders what has poses by where they are, so that neighbours lie close together.
pub fn sort_by_place<T: Send>(items: &mut [T], pose: impl Fn(&T) -> LocalPose + Sync) {
    items.par_sort_by_cached_key(|item| place(pose(item)));
}

fn chunks(map: usize, particles: &[u32], size: usize) -> Vec<ParticleGroup> {
    particles.chunks(size).map(|chunk| ParticleGroup { map, particles: chunk.to_vec() }).collect()
}

/// Position and heading on one curve (Z-order) of cells: neighbours on it are close together.
fn place(pose: LocalPose) -> u64 {
    /// Size of a cell: a turn moves a wall 10 m off as far as a step does.
    const CELL: f32 = 0.1;
    const TURN: f32 = 0.01;
    const MIDDLE: f32 = 1_048_576.0;
    let cells = [pose.x / CELL + MIDDLE, pose.y / CELL + MIDDLE, (crate::math::wrap(pose.heading) + PI) / TURN];
    // 21 bits each.
    let [x, y, heading] = cells.map(|cell| u64::from(cell as u32 & 0x1f_ffff));
    (0..21).fold(0, |key, bit| {
        let bits = |value: u64| value >> bit & 1;
        key | bits(x) << (3 * bit) | bits(y) << (3 * bit + 1) | bits(heading) << (3 * bit + 2)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_particle_is_in_one_group_of_its_map() {
        for (maps, particles_per_map, size) in [(1, 1, 16), (3, 7, 4), (2, 64, 64), (5, 97, 16), (0, 4, 4)] {
            let poses: Vec<LocalPose> = (0..maps * particles_per_map)
                .map(|i| LocalPose { x: (i * 37 % 11) as f32, y: (i * 53 % 13) as f32, heading: i as f32 })
                .collect();
            for groups in [in_order(maps, particles_per_map, size), by_place(maps, &poses, size)] {
                let mut seen: Vec<u32> = groups.iter().flat_map(|group| group.particles.clone()).collect();
                seen.sort_unstable();
                assert!(seen.iter().copied().eq(0..(maps * particles_per_map) as u32));
                for ParticleGroup { map, particles } in groups {
                    assert!(
                        particles.len() <= size && particles.iter().all(|&p| p as usize / particles_per_map == map)
                    );
                }
            }
        }
    }

    /// Two modes in turn, ten metres apart: no group has particles of both.
    #[test]
    fn places_are_kept_apart() {
        let poses: Vec<LocalPose> =
            (0..256).map(|i| LocalPose { x: if i % 2 == 0 { 1.0 } else { 11.0 }, y: 0.0, heading: 0.5 }).collect();
        let groups = by_place(1, &poses, 16);
        assert_eq!(groups.len(), 16);
        assert!(groups.iter().all(|group| group.particles.iter().all(|p| p % 2 == group.particles[0] % 2)));
        assert!(in_order(1, 256, 16).iter().all(|group| group.particles[0] % 2 != group.particles[1] % 2));
    }
}
