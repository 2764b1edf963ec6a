// Candidate lists: which clusters can explain a point of a tile, from any pose of a group. A workgroup a group.
// Twin of src/evaluator/cpu/cull.rs.

var<workgroup> low: array<vec3f, 64>;
var<workgroup> high: array<vec3f, 64>;

// Room for the rounding of coordinates, in metres.
const ROUNDING = 1e-3;
const FAR = 1e30;

fn offset(pose: vec3f, origin: vec3f) -> vec3f {
    return vec3f(pose.xy - origin.xy, wrap(pose.z - origin.z));
}

// Whether a cluster can be likelier than an outlier somewhere in a circle.
fn reaches(cluster: ClusterParams, centre: vec2f, radius: f32) -> bool {
    let along = abs(dot(cluster.along, vec3f(centre, 1.0)));
    let across = abs(dot(cluster.across, vec3f(centre, 1.0)));
    let beyond = max(along - cluster.half_length - radius * length(cluster.along.xy), 0.0);
    let off = max(across - radius * length(cluster.across.xy), 0.0);
    return cluster.log_peak - beyond * beyond - off * off > job.log_outlier;
}

// A list in the making, and the circle that it is for.
struct Enlisted {
    centre: vec2f,
    radius: f32,
    start: u32,
    count: u32,
    // Lanes past the last tile go along to the next multiple of eight, and write nothing.
    is_written: bool,
}

fn enlist(list: ptr<function, Enlisted>, cluster: ClusterParams, slot: u32) {
    if reaches(cluster, (*list).centre, (*list).radius) {
        if (*list).count < LIST_ROOM && (*list).is_written {
            candidates[(*list).start + 1u + (*list).count] = slot;
        }
        (*list).count += 1u;
    }
}

fn next_multiple_of_8(number: u32) -> u32 {
    return (number + 7u) & ~7u;
}

@compute @workgroup_size(64)
fn cull(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) lane: u32) {
    let group = groups[workgroup.x];
    let known = bounds[workgroup.x];
    let origin = poses[group.first].xyz;

    // A box around all poses that still climb.
    low[lane] = vec3f(FAR);
    high[lane] = vec3f(-FAR);
    if lane < group.count && is_climbing(group.first + lane) {
        let off = offset(poses[group.first + lane].xyz, origin);
        low[lane] = off;
        high[lane] = off;
    }
    // What this group's lanes read of other memory they have read before one of them writes it, too.
    storageBarrier();
    workgroupBarrier();
    for (var half = 32u; half > 0u; half /= 2u) {
        if lane < half {
            low[lane] = min(low[lane], low[lane + half]);
            high[lane] = max(high[lane], high[lane + half]);
        }
        workgroupBarrier();
    }
    let lowest = low[0];
    let highest = high[0];
    if lowest.x > highest.x {
        return;
    }
    let from_known = offset(origin, known.middle);
    let is_covered = all(abs(from_known + lowest) <= known.half) && all(abs(from_known + highest) <= known.half);
    if phase.restart == 0u && is_covered {
        return;
    }
    let middle = origin + 0.5 * (lowest + highest);
    let half = 0.5 * (highest - lowest) + job.slack;
    if lane == 0u {
        bounds[workgroup.x] = GroupBounds(middle, half);
    }

    let turn = sin_cos(middle.z);
    for (var tile = lane; tile < next_multiple_of_8(job.tile_count); tile += 64u) {
        let mine = min(tile, job.tile_count - 1u);
        let centre = tiles[mine].centre;
        let there = middle.xy + vec2f(turn.y * centre.x - turn.x * centre.y, turn.x * centre.x + turn.y * centre.y);
        let radius = tiles[mine].radius + length(half.xy) + length(centre) * half.z + ROUNDING;
        let start = (workgroup.x * job.tile_count + mine) * (LIST_ROOM + 1u);
        var list = Enlisted(there, radius, start, 0u, tile < job.tile_count);
        enlist_all(group, &list, lane);
        if list.is_written {
            candidates[start] = list.count;
        }
    }
}
