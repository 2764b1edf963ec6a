// What the host and the kernels share. Every struct has a twin of the same name and fields in
// src/evaluator/gpu/layout.rs, src/evaluator/tiles.rs or src/likelihood.rs.

struct ClusterParams {
    along: vec3f,
    half_length: f32,
    across: vec3f,
    log_peak: f32,
}

struct Tile {
    x: array<vec4f, 4>,
    y: array<vec4f, 4>,
    centre: vec2f,
    radius: f32,
    count: u32,
}

// Particles of one map that lie close together, one workgroup's work.
struct Group {
    first: u32,
    count: u32,
    first_slot: u32,
    slot_count: u32,
    mean: vec3f,
    // Whether the first of them starts at the mean itself.
    exact_first: u32,
    prior: vec3f,
    // Number of the first of them among all particles of the step.
    number: u32,
}

struct ParticleMode {
    information: array<f32, 6>,
    log_posterior: f32,
    state: u32,
    drawn: vec4f,
}

struct GroupBounds {
    middle: vec3f,
    half: vec3f,
}

struct Job {
    seed: vec2u,
    step: u32,
    draw: u32,
    noise: array<vec4f, 2>,
    prior_information: array<vec4f, 2>,
    slack: vec3f,
    spread: f32,
    tile_count: u32,
    log_outlier: f32,
    // Particles start from where they are, and the mean of their group is a motion.
    from_own_pose: u32,
    // Standard deviation across thick walls at least.
    capture_sigma: f32,
    // The noise of the motion has the tails of Cauchy's distribution.
    is_heavy_tailed: u32,
    padding0: u32,
    padding1: u32,
    padding2: u32,
}

struct Phase {
    // Every particle starts to climb; lists of before are worth nothing.
    restart: u32,
    // A step may follow the evaluation.
    may_step: u32,
}

// Whether walls are thick. It is fixed when a pipeline is made: asked for each cluster it would cost a fifth of a climb.
override is_thick = false;

@group(0) @binding(0) var<uniform> job: Job;
@group(0) @binding(1) var<uniform> phase: Phase;
@group(0) @binding(2) var<storage, read> tiles: array<Tile>;
// ClusterParams by slot, in halves that can be loaded one by one: along and half_length, across and log_peak.
@group(0) @binding(3) var<storage, read> clusters: array<array<vec4f, 2>>;
@group(0) @binding(4) var<storage, read> slots: array<u32>;
@group(0) @binding(5) var<storage, read> groups: array<Group>;
// x, y, heading; and the log-likelihood of the scan from there.
@group(0) @binding(6) var<storage, read_write> poses: array<vec4f>;
@group(0) @binding(7) var<storage, read_write> modes: array<ParticleMode>;
// A list for each tile of each group: how many, then their slots.
@group(0) @binding(8) var<storage, read_write> candidates: array<u32>;
@group(0) @binding(9) var<storage, read_write> bounds: array<GroupBounds>;

// States of a climb.
const CLIMBING = 0u;
const LAST_EVALUATION = 1u;
const SETTLED = 2u;

// Room of a candidate list. Where more clusters reach a tile, all clusters of the map are evaluated.
const LIST_ROOM = 63u;

fn cluster_of(along: vec4f, across: vec4f) -> ClusterParams {
    return ClusterParams(along.xyz, along.w, across.xyz, across.w);
}

// The second half of a cluster; where walls are thick its standard deviation is at least theirs.
fn thickened(across: vec4f) -> vec4f {
    if !is_thick {
        return across;
    }
    let thinner = min(1.0 / (SQRT_2 * job.capture_sigma * length(across.xy)), 1.0);
    return vec4f(across.xyz * thinner, across.w + ln(thinner));
}

fn cluster_at(slot: u32) -> ClusterParams {
    return cluster_of(clusters[slot][0], thickened(clusters[slot][1]));
}

fn is_climbing(particle: u32) -> bool {
    return phase.restart == 1u || modes[particle].state != SETTLED;
}
