// The log-likelihood of a frame's detections from a pose, over all one-to-one assignments to the landmarks of its map; twin of
// src/evaluator/cpu/associate.rs. A workgroup has one particle: lanes share out the sets of detections, and eight landmarks by
// eight detections at a time.
//
// Every struct has a twin of the same name and fields in src/evaluator/sighting.rs or src/evaluator/gpu/association.rs.

struct AssociationJob {
    sensor: vec2f,
    min_range: f32,
    seen_count: u32,
    max_ranges: array<vec4f, 32>,
}

struct Seen {
    x: f32,
    y: f32,
    xx: f32,
    xy: f32,
    yy: f32,
    log_null: f32,
    padding: array<f32, 2>,
}

struct LandmarkRow {
    x: f32,
    y: f32,
    xx: f32,
    xy: f32,
    yy: f32,
    log_detected: f32,
    log_missed: f32,
    padding: f32,
    log_label: array<f32, 8>,
}

@group(0) @binding(0) var<uniform> job: AssociationJob;
@group(0) @binding(1) var<storage, read> seen: array<Seen>;
@group(0) @binding(2) var<storage, read> landmarks: array<LandmarkRow>;
// Of each particle the first landmark of its map, and how many there are.
@group(0) @binding(3) var<storage, read> spans: array<vec2u>;
// x, y, heading; and the log-likelihood from there.
@group(0) @binding(4) var<storage, read_write> particles: array<vec4f>;

const SECTORS = 128u;
// ln of what cannot be.
const NEVER = -1e30;
// A pair that is less likely than none by this changes no sum.
const LEAST_PAIR = -17.0;
const LN_TAU = 1.8378771;

// F of the landmarks so far, of each subset; and of those with one more.
var<workgroup> sums: array<array<f32, 256>, 2>;
var<workgroup> pairs: array<f32, 64>;
var<workgroup> parts: array<vec2f, 64>;

@compute @workgroup_size(64)
fn associate(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) lane: u32) {
    let span = spans[workgroup.x];
    let pose = particles[workgroup.x].xyz;
    let turn = sin_cos(pose.z);
    let sets = 1u << job.seen_count;
    for (var subset = lane; subset < sets; subset += 64u) {
        sums[0][subset] = select(NEVER, 0.0, subset == 0u);
    }
    var now = 0u;
    // The part of a lane in what all assignments have in common.
    var constant = 0.0;
    for (var first = 0u; first < span.y; first += 8u) {
        let detection = lane % 8u;
        let number = first + lane / 8u;
        var pair = NEVER;
        if number < span.y {
            let landmark = landmarks[span.x + number];
            let missed = select(0.0, landmark.log_missed, is_in_view(landmark, pose, turn));
            if detection == 0u {
                constant += missed;
            }
            if detection < job.seen_count {
                pair = log_density(seen[detection], landmark, pose, turn) + landmark.log_label[detection]
                    + landmark.log_detected - missed - seen[detection].log_null;
            }
        }
        pairs[lane] = pair;
        workgroupBarrier();
        for (var row = 0u; row < min(span.y - first, 8u); row++) {
            for (var subset = lane; subset < sets; subset += 64u) {
                sums[1u - now][subset] = grown(now, 8u * row, subset);
            }
            now = 1u - now;
            workgroupBarrier();
        }
    }
    if lane < job.seen_count {
        constant += seen[lane].log_null;
    }
    var part = NEVER;
    for (var subset = lane; subset < sets; subset += 64u) {
        let larger = max(part, sums[now][subset]);
        part = larger + ln(exp_of(part - larger) + exp_of(sums[now][subset] - larger));
    }
    parts[lane] = vec2f(part, constant);
    workgroupBarrier();
    if lane == 0u {
        var largest = NEVER;
        for (var other = 0u; other < 64u; other++) {
            largest = max(largest, parts[other].x);
        }
        var sum = 0.0;
        var constants = 0.0;
        for (var other = 0u; other < 64u; other++) {
            sum += exp_of(parts[other].x - largest);
            constants += parts[other].y;
        }
        particles[workgroup.x].w = constants + largest + ln(sum);
    }
}

// F of a subset with one landmark more, whose pairs begin at `first`.
fn grown(now: u32, first: u32, subset: u32) -> f32 {
    let before = sums[now][subset];
    var largest = before;
    for (var k = 0u; k < job.seen_count; k++) {
        if ((subset >> k) & 1u) == 1u && pairs[first + k] > LEAST_PAIR {
            largest = max(largest, sums[now][subset & ~(1u << k)] + pairs[first + k]);
        }
    }
    var sum = exp_of(before - largest);
    for (var k = 0u; k < job.seen_count; k++) {
        if ((subset >> k) & 1u) == 1u && pairs[first + k] > LEAST_PAIR {
            sum += exp_of(sums[now][subset & ~(1u << k)] + pairs[first + k] - largest);
        }
    }
    return largest + ln(sum);
}

// ln N(z_k; l_j, R_k + the covariance of the landmark); `turn` holds sine and cosine.
fn log_density(seen: Seen, landmark: LandmarkRow, pose: vec3f, turn: vec2f) -> f32 {
    let dx = pose.x + turn.y * seen.x - turn.x * seen.y - landmark.x;
    let dy = pose.y + turn.x * seen.x + turn.y * seen.y - landmark.y;
    let both = 2.0 * turn.x * turn.y * seen.xy;
    let xx = turn.y * turn.y * seen.xx - both + turn.x * turn.x * seen.yy + landmark.xx;
    let yy = turn.x * turn.x * seen.xx + both + turn.y * turn.y * seen.yy + landmark.yy;
    let xy = turn.x * turn.y * (seen.xx - seen.yy) + (turn.y * turn.y - turn.x * turn.x) * seen.xy + landmark.xy;
    let determinant = xx * yy - xy * xy;
    let square = (yy * dx * dx - 2.0 * xy * dx * dy + xx * dy * dy) / determinant;
    return -0.5 * (square + ln(determinant)) - LN_TAU;
}

fn is_in_view(landmark: LandmarkRow, pose: vec3f, turn: vec2f) -> bool {
    let dx = landmark.x - pose.x;
    let dy = landmark.y - pose.y;
    let x = turn.y * dx + turn.x * dy - job.sensor.x;
    let y = turn.y * dy - turn.x * dx - job.sensor.y;
    let sector = sector_of(x, y);
    let farthest = job.max_ranges[sector / 4u][sector % 4u];
    let square = x * x + y * y;
    return square <= farthest * farthest && square >= job.min_range * job.min_range;
}

// The sector of a direction: even in y / (|x| + |y|), counter-clockwise from straight ahead.
fn sector_of(x: f32, y: f32) -> u32 {
    let sum = abs(x) + abs(y);
    var turned = 0.0;
    if sum > 0.0 {
        turned = y / sum;
    }
    if x < 0.0 {
        turned = 2.0 - turned;
    } else if turned < 0.0 {
        turned = 4.0 + turned;
    }
    return min(u32(turned * (f32(SECTORS) / 4.0)), SECTORS - 1u);
}
