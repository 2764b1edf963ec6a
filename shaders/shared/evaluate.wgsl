// Evaluates the points of one tile from one pose against the tile's candidates (eq. 18).

const NONE = 0xffffffffu;

// The share of a group's work that a lane does: one of the particles, and every `tile_stride`-th tile.
struct Share {
    particle: u32,
    is_active: bool,
    width: u32,
    first_tile: u32,
    tile_stride: u32,
}

fn share(group: Group, lane: u32) -> Share {
    var width = 64u;
    while width / 2u >= group.count && width > 1u {
        width /= 2u;
    }
    let particle = lane % width;
    let is_active = particle < group.count;
    return Share(group.first + min(particle, group.count - 1u), is_active, width, lane / width, 64u / width);
}

// Candidates of a tile: slots[first + k], or where they did not fit in a list, all slots of the map.
struct List {
    first: u32,
    count: u32,
    is_whole_map: bool,
}

fn list_of(group_number: u32, group: Group, tile: u32) -> List {
    let start = (group_number * job.tile_count + tile) * (LIST_ROOM + 1u);
    let count = candidates[start];
    if count > LIST_ROOM {
        return List(group.first_slot, group.slot_count, true);
    }
    return List(start + 1u, count, false);
}

fn slot_of(list: List, number: u32) -> u32 {
    if list.is_whole_map {
        return slots[list.first + number];
    }
    return candidates[list.first + number];
}

// The points of a tile in the evaluator's frame.
struct Points {
    x0: vec4f,
    x1: vec4f,
    x2: vec4f,
    x3: vec4f,
    y0: vec4f,
    y1: vec4f,
    y2: vec4f,
    y3: vec4f,
}

// Points of the robot's frame, from a pose and the sine and cosine of its heading.
fn points_at(x: array<vec4f, 4>, y: array<vec4f, 4>, pose: vec3f, turn: vec2f) -> Points {
    return Points(
        pose.x + turn.y * x[0] - turn.x * y[0],
        pose.x + turn.y * x[1] - turn.x * y[1],
        pose.x + turn.y * x[2] - turn.x * y[2],
        pose.x + turn.y * x[3] - turn.x * y[3],
        pose.y + turn.x * x[0] + turn.y * y[0],
        pose.y + turn.x * x[1] + turn.y * y[1],
        pose.y + turn.x * x[2] + turn.y * y[2],
        pose.y + turn.x * x[3] + turn.y * y[3],
    );
}

fn points_alone(tile: u32, pose: vec3f, turn: vec2f) -> Points {
    return points_at(tiles[tile].x, tiles[tile].y, pose, turn);
}

// ln p of four points in one cluster.
fn log_density(cluster: ClusterParams, x: vec4f, y: vec4f) -> vec4f {
    let along = fma(vec4f(cluster.along.x), x, fma(vec4f(cluster.along.y), y, vec4f(cluster.along.z)));
    let across = fma(vec4f(cluster.across.x), x, fma(vec4f(cluster.across.y), y, vec4f(cluster.across.z)));
    let beyond = max(abs(along) - cluster.half_length, vec4f(0.0));
    return fma(-across, across, fma(-beyond, beyond, vec4f(cluster.log_peak)));
}

// Evaluates a list that this lane reads by itself.
fn evaluate_alone(list: List, points: Points) -> Best {
    var best = all_outliers();
    for (var number = 0u; number < list.count; number++) {
        let slot = slot_of(list, number);
        compare(&best, points, cluster_at(slot), slot);
    }
    return best;
}

// Which four of the points of a tile count.
fn counts(tile_count: u32, first: u32) -> vec4<bool> {
    return vec4u(first, first + 1u, first + 2u, first + 3u) < vec4u(tile_count);
}

// Σ max ln p over the points of a tile.
fn sum_of(tile: u32, best: Best) -> f32 {
    let count = tiles[tile].count;
    let none = vec4f(0.0);
    let sum = select(none, best.density0, counts(count, 0u)) + select(none, best.density1, counts(count, 4u))
        + select(none, best.density2, counts(count, 8u)) + select(none, best.density3, counts(count, 12u));
    return sum.x + sum.y + sum.z + sum.w;
}
