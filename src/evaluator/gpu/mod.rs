//! The evaluator on a GPU, through Vulkan, Metal or DirectX 12.
//!
//! A workgroup of 64 lanes has a group of up to 64 particles of one map. Where a group is full, a lane is a particle;
//! where it is not, or where there are few particles in all, the tiles of the scan are shared out as well. One submission does a whole step: what a kernel
//! leaves on the device is what the next one takes up, and poses, weights and modes alone are read back.
//!
//! Every cluster lives on the device, by slot of the pool; a step uploads those that are new, and for each map the list
//! of its slots.

use super::by_size::MANY;
use super::grouping::{ParticleGroup, by_place, in_order};
use super::pose::LocalPose;
use super::sighting::Sighting;
use super::table::{Changed, ClusterTable, Revision};
use super::{Advance, Evaluator, Mode, Propagation, Proposal, SLACK, Scene, Weighed};
use crate::gpu::buffers::{Buffer, Usage};
use crate::gpu::device::{Adapter, AdapterKind, Device};
use crate::gpu::submission::{Bindings, Pipeline, Submission};
use crate::gpu::{DeviceError, guarded};
use crate::likelihood::ClusterParams;
use crate::map::Slot;
use association::Association;
use buffers::{Buffers, phase_offset};
use kernels::{Kernel, Sharing};
use layout::{GROUP, Group, GroupBounds, Job, LIST_ROOM, ParticleMode, Phase};

pub mod association;
mod buffers;
pub mod kernels;
pub mod layout;

/// The evaluator on one device.
#[derive(Debug)]
pub struct GpuEvaluator {
    device: Device,
    /// In the order of [`Kernel::ALL`]; for each one that sees walls as they are, and one that sees thick ones.
    pipelines: [[Pipeline; 2]; 5],
    buffers: Buffers,
    bindings: Bindings,
    /// Since the first frame of detections.
    association: Option<Association>,
    /// What poses are read back through.
    read_poses: Buffer,
    /// What modes and candidate lists are read back through.
    read_more: Buffer,
    /// Revision of the table that the device has.
    revision: Option<Revision>,
}

/// One kernel of a submission.
#[derive(Clone, Copy)]
struct Dispatch {
    kernel: Kernel,
    phase: Phase,
    is_thick: bool,
}

impl Dispatch {
    /// A kernel that runs by itself: nothing climbs.
    fn once(kernel: Kernel, is_thick: bool) -> Self {
        Self { kernel, phase: Phase::new(true, false), is_thick }
    }
}

/// Where the particles of a submission come from.
#[derive(Clone, Copy)]
enum Particles<'a> {
    /// They are drawn.
    Drawn(&'a Propagation<'a>),
    /// They are here.
    At(&'a [LocalPose]),
    /// They are here, and move.
    Moving(&'a [LocalPose], &'a Advance),
}

impl GpuEvaluator {
    /// Opens a device and makes the kernels ready.
    ///
    /// # Errors
    /// The device cannot be opened, or its driver refuses a kernel.
    pub fn new(adapter: &Adapter) -> Result<Self, DeviceError> {
        guarded(&adapter.name, || Self::with_sources(adapter, Kernel::source))
    }

    /// The same with other texts for the kernels: for tests that have to see wrong ones fail.
    ///
    /// # Errors
    /// As for `new`.
    pub fn with_sources(adapter: &Adapter, source: impl Fn(Kernel, Sharing) -> String) -> Result<Self, DeviceError> {
        let device = adapter.open()?;
        let mut buffers = Buffers::new(&device)?;
        let bindings = Bindings::new(&device, &buffers.bound());
        let pipelines = Kernel::ALL.map(|kernel| {
            let source = source(kernel, sharing(adapter));
            Pipeline::with_constants(&device, &bindings, kernel.name(), source, "is_thick", [0.0, 1.0])
        });
        device.check()?;
        let (read_poses, read_more) = (
            Buffer::new(&device, "the poses to read", Usage::Readback),
            Buffer::new(&device, "what else is read", Usage::Readback),
        );
        Ok(Self { device, pipelines, buffers, bindings, association: None, read_poses, read_more, revision: None })
    }

    /// What the driver calls the device.
    pub fn name(&self) -> &str {
        &self.device.name
    }

    /// Ends the device, as a driver may at any time: every later call fails.
    pub fn destroy(&self) {
        self.device.destroy();
    }

    /// The candidate lists of poses that all are of the first map, in one group: for each tile the slots, or `None` where
    /// they did not fit and all are evaluated.
    ///
    /// # Errors
    /// The device failed.
    pub fn candidate_lists(
        &mut self,
        scene: &Scene<'_>,
        poses: &[LocalPose],
    ) -> Result<Vec<Option<Vec<Slot>>>, DeviceError> {
        self.upload_table(scene.table)?;
        let job = Job::evaluate(scene.tiles.len(), scene.table.log_outlier());
        let groups = [ParticleGroup { map: 0, particles: (0..poses.len() as u32).collect() }];
        let dispatch = Dispatch::once(Kernel::Cull, false);
        self.submit(scene, &job, Particles::At(poses), &groups, &[dispatch])?;
        let mut submission = Submission::new(&self.device);
        let count = scene.tiles.len() * (LIST_ROOM + 1);
        let copied = submission.copy::<u32>(&self.buffers.candidates, &mut self.read_more, count)?;
        submission.submit();
        let lists = copied.read(&self.device)?;
        let list = |list: &[u32]| list[1..].get(..list[0] as usize).map(<[u32]>::to_vec);
        Ok(lists.chunks(LIST_ROOM + 1).map(list).collect())
    }

    /// Uploads what has changed in the table since the device saw it.
    fn upload_table(&mut self, table: &ClusterTable) -> Result<(), DeviceError> {
        let Self { device, buffers, revision, .. } = self;
        let clusters = &mut buffers.clusters;
        let has_grown = clusters.hold(device, size_of_val(table.rows()) as u64)?;
        let is_next = revision.is_some_and(|revision| table.revision().follows(revision));
        match table.changed() {
            _ if *revision == Some(table.revision()) && !has_grown => {}
            Changed::Slots(slots) if is_next && !has_grown => {
                for (first, end) in runs(slots) {
                    clusters.write(device, first, &table.rows()[first..end]);
                }
            }
            _ => clusters.write(device, 0, table.rows()),
        }
        *revision = Some(table.revision());
        Ok(())
    }

    /// Number of groups that fit in one submission.
    fn groups_at_once(&self, scene: &Scene<'_>) -> usize {
        /// More is not worth the memory: so much keeps any device busy.
        const ENOUGH: u64 = 256 << 20;
        let room = self.device.largest_storage().min(ENOUGH) as usize;
        let longest_map = scene.maps.iter().map(|slots| size_of_val(slots.as_slice())).max().unwrap_or(0);
        let a_group = list_bytes(scene.tiles.len()).max(GROUP * size_of::<ParticleMode>()).max(longest_map);
        (room / a_group).clamp(1, self.device.most_workgroups())
    }

    /// Runs kernels over some groups in one submission. Leaves the pose of each particle with the log-likelihood there,
    /// and its mode where one was drawn from.
    fn submit(
        &mut self,
        scene: &Scene<'_>,
        job: &Job,
        particles: Particles<'_>,
        groups: &[ParticleGroup],
        dispatches: &[Dispatch],
    ) -> Result<(Vec<[f32; 4]>, Vec<ParticleMode>), DeviceError> {
        let Self { device, pipelines, buffers, bindings, read_poses, read_more, .. } = self;
        let count: usize = groups.iter().map(|group| group.particles.len()).sum();
        let (rows, slots) = group_rows(scene, particles, groups);
        buffers.job.write(device, 0, &[*job]);
        buffers.tiles.fill(device, scene.tiles)?;
        buffers.slots.fill(device, &slots)?;
        buffers.groups.fill(device, &rows)?;
        buffers.modes.hold(device, (count * size_of::<ParticleMode>()) as u64)?;
        buffers.candidates.hold(device, (groups.len() * list_bytes(scene.tiles.len())) as u64)?;
        buffers.bounds.hold(device, (groups.len() * size_of::<GroupBounds>()) as u64)?;
        buffers.poses.hold(device, (count * size_of::<[f32; 4]>()) as u64)?;
        if let Particles::At(poses) | Particles::Moving(poses, _) = particles {
            let of_groups = groups.iter().flat_map(|group| &group.particles).map(|&particle| poses[particle as usize]);
            let poses: Vec<[f32; 4]> = of_groups.map(|pose| [pose.x, pose.y, pose.heading, f32::NAN]).collect();
            buffers.poses.write(device, 0, &poses);
        }

        bindings.update(device, &mut buffers.bound());
        let mut submission = Submission::new(device);
        let kernels = dispatches.iter().map(|dispatch| {
            let pipeline = &pipelines[dispatch.kernel as usize][usize::from(dispatch.is_thick)];
            (pipeline, phase_offset(device, dispatch.phase))
        });
        submission.dispatch(bindings, groups.len(), kernels);
        let draws = dispatches.iter().any(|dispatch| dispatch.kernel == Kernel::Draw);
        let poses = submission.copy(&buffers.poses, read_poses, count)?;
        let modes = submission.copy(&buffers.modes, read_more, if draws { count } else { 0 })?;
        submission.submit();
        let read = (poses.read(device)?, modes.read(device)?);
        device.check()?;
        Ok(read)
    }
}

impl Evaluator for GpuEvaluator {
    fn propagate(&mut self, scene: &Scene<'_>, how: &Propagation<'_>) -> Result<Vec<Proposal>, DeviceError> {
        self.upload_table(scene.table)?;
        let job = Job::propagation(how, SLACK, scene.tiles.len(), scene.table.log_outlier());
        let mut dispatches = vec![Dispatch::once(Kernel::Propagate, false)];
        if how.iterations > 0 {
            dispatches.extend(climb(true, how.iterations / 2));
            dispatches.extend(climb(false, how.iterations));
            dispatches.push(Dispatch::once(Kernel::Draw, false));
        }
        let groups = in_order(how.starts.len(), how.particles_per_map, group_size(how.particles()));
        let mut proposals = Vec::with_capacity(how.particles());
        for groups in groups.chunks(self.groups_at_once(scene)) {
            let (poses, modes) = self.submit(scene, &job, Particles::Drawn(how), groups, &dispatches)?;
            if how.iterations == 0 {
                proposals.extend(poses.into_iter().map(undrawn));
            } else {
                proposals.extend(poses.into_iter().zip(modes).map(drawn));
            }
        }
        Ok(proposals)
    }

    fn weigh(&mut self, scene: &Scene<'_>, poses: &[LocalPose]) -> Result<Vec<f32>, DeviceError> {
        self.upload_table(scene.table)?;
        let job = Job::evaluate(scene.tiles.len(), scene.table.log_outlier());
        let dispatches = [Kernel::Cull, Kernel::Weigh].map(|kernel| Dispatch::once(kernel, false));
        let groups = by_place(scene.maps.len(), poses, group_size(poses.len()));
        let mut log_likelihoods = vec![0.0; poses.len()];
        for groups in groups.chunks(self.groups_at_once(scene)) {
            let (weighed, _) = self.submit(scene, &job, Particles::At(poses), groups, &dispatches)?;
            for (&particle, [.., log_likelihood]) in groups.iter().flat_map(|group| &group.particles).zip(weighed) {
                log_likelihoods[particle as usize] = log_likelihood;
            }
        }
        Ok(log_likelihoods)
    }

    fn advance(&mut self, scene: &Scene<'_>, how: &Advance, poses: &[LocalPose]) -> Result<Vec<Weighed>, DeviceError> {
        self.upload_table(scene.table)?;
        let job = Job::advance(how, scene.tiles.len(), scene.table.log_outlier());
        let [cull, weigh] = [Kernel::Cull, Kernel::Weigh].map(|kernel| Dispatch::once(kernel, true));
        let dispatches = [Dispatch::once(Kernel::Propagate, false), cull, weigh];
        let groups = in_order(1, poses.len(), group_size(poses.len()));
        let mut all = Vec::with_capacity(poses.len());
        for groups in groups.chunks(self.groups_at_once(scene)) {
            let (weighed, _) = self.submit(scene, &job, Particles::Moving(poses, how), groups, &dispatches)?;
            all.extend(
                weighed.into_iter().map(|[x, y, heading, log_likelihood]| Weighed {
                    pose: LocalPose { x, y, heading },
                    log_likelihood,
                }),
            );
        }
        Ok(all)
    }

    fn associate(&mut self, sighting: &Sighting<'_>, poses: &[LocalPose]) -> Result<Vec<f32>, DeviceError> {
        let association = match &mut self.association {
            Some(association) => association,
            none => none.insert(Association::new(&self.device)?),
        };
        association.associate(&self.device, sighting, poses)
    }
}

/// How many particles share a workgroup. Few particles leave most lanes of a device idle: then eight lanes share the tiles of each.
fn group_size(particles: usize) -> usize {
    if particles < MANY { GROUP / 8 } else { GROUP }
}

/// How lanes read shared clusters: a device in software does each load for one lane after the other.
fn sharing(adapter: &Adapter) -> Sharing {
    if adapter.kind == AdapterKind::Software && adapter.can_broadcast() { Sharing::Broadcasts } else { Sharing::Loads }
}

/// The kernels of a climb of at most `iterations` steps: an evaluation before each and one after the last.
fn climb(is_thick: bool, iterations: u32) -> impl Iterator<Item = Dispatch> {
    (0..=iterations).flat_map(move |iteration| {
        let phase = Phase::new(iteration == 0, iteration < iterations);
        [Kernel::Cull, Kernel::Refine].map(|kernel| Dispatch { kernel, phase, is_thick })
    })
}

/// The groups as the kernels see them, and the slots of their maps, one map after the other.
fn group_rows(scene: &Scene<'_>, particles: Particles<'_>, groups: &[ParticleGroup]) -> (Vec<Group>, Vec<Slot>) {
    let (mut slots, mut rows): (Vec<Slot>, Vec<Group>) = (Vec::new(), Vec::with_capacity(groups.len()));
    let (mut first, mut map) = (0, None);
    for group in groups {
        if map != Some(group.map) {
            map = Some(group.map);
            slots.extend(&scene.maps[group.map]);
        }
        let (count, slot_count) = (group.particles.len() as u32, scene.maps[group.map].len() as u32);
        let number = group.particles.first().copied().unwrap_or(0);
        let first_slot = slots.len() as u32 - slot_count;
        let mut row = Group { first, count, first_slot, slot_count, number, ..bytemuck::Zeroable::zeroed() };
        match particles {
            Particles::Drawn(how) => {
                let start = how.starts[group.map];
                row.mean = [start.mean.x, start.mean.y, start.mean.heading];
                row.prior = [start.prior.x, start.prior.y, start.prior.heading];
                row.exact_first = u32::from(how.exact_first && number as usize == group.map * how.particles_per_map);
            }
            Particles::Moving(_, how) => row.mean = how.motion,
            Particles::At(_) => {}
        }
        rows.push(row);
        first += count;
    }
    (rows, slots)
}

/// A particle drawn from the motion alone, in no map.
fn undrawn([x, y, heading, _]: [f32; 4]) -> Proposal {
    let pose = LocalPose { x, y, heading };
    Proposal { drawn: pose, mode: Mode { pose, ..Mode::default() } }
}

fn drawn(([x, y, heading, log_likelihood], mode): ([f32; 4], ParticleMode)) -> Proposal {
    let ParticleMode { information, log_posterior, drawn, .. } = mode;
    let mode = Mode { pose: LocalPose { x, y, heading }, log_likelihood, log_posterior, information };
    Proposal { drawn: LocalPose { x: drawn[0], y: drawn[1], heading: drawn[2] }, mode }
}

/// Bytes of the candidate lists of one group.
fn list_bytes(tiles: usize) -> usize {
    tiles.max(1) * (LIST_ROOM + 1) * size_of::<u32>()
}

/// Slots as ranges, from the first to one after the last: neighbours in one go, with a few between that have not
/// changed, which costs less than another write.
fn runs(slots: &[Slot]) -> Vec<(usize, usize)> {
    const GAP: usize = 512 / size_of::<ClusterParams>();
    let mut sorted: Vec<usize> = slots.iter().map(|&slot| slot as usize).collect();
    sorted.sort_unstable();
    let mut runs: Vec<(usize, usize)> = Vec::new();
    for slot in sorted {
        match runs.last_mut() {
            Some((_, end)) if slot <= *end + GAP => *end = (slot + 1).max(*end),
            _ => runs.push((slot, slot + 1)),
        }
    }
    runs
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_cover_every_slot_and_little_more() {
        assert_eq!(runs(&[]), []);
        assert_eq!(runs(&[5, 4, 900, 4, 10, 901]), [(4, 11), (900, 902)]);
    }
}
