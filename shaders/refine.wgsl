// One Gauss-Newton step of each particle up its posterior: eq. 18 together with eq. 17. A workgroup a group.
//
// Each dispatch evaluates the scan at the pose of the particle, writes the quadratic model there, and moves the particle to
// its maximum, unless it has settled.
// Twin of src/evaluator/cpu/refine.rs.

// Σ max ln p; gradient; information: xx, xy, xh, yy, yh, hh.
struct Sums {
    log_likelihood: f32,
    gradient: vec3f,
    squares: vec3f,
    products: vec3f,
}

var<workgroup> partial: array<Sums, 64>;

// Longest step, and one that moves next to nothing: metres, metres, radians.
const MAX_STEP = vec3f(0.3, 0.3, 0.15);
const PRIOR_TAIL = 5.68775;
const CONVERGED = vec3f(5e-4, 5e-4, 2e-4);

fn add(a: Sums, b: Sums) -> Sums {
    return Sums(
        a.log_likelihood + b.log_likelihood,
        a.gradient + b.gradient,
        a.squares + b.squares,
        a.products + b.products,
    );
}

// A pose, and the sine and cosine of its heading.
struct Robot {
    pose: vec3f,
    turn: vec2f,
}

// What four offsets a x + b y + c from their likeliest clusters pull the robot by.
fn pull(robot: Robot, x: vec4f, y: vec4f, a: vec4f, b: vec4f, c: vec4f) -> Sums {
    let offset = a * x + b * y + c;
    let forward = a * robot.turn.y + b * robot.turn.x;
    let sideways = b * robot.turn.y - a * robot.turn.x;
    let turn = b * (x - robot.pose.x) - a * (y - robot.pose.y);
    return Sums(
        0.0,
        -2.0 * vec3f(dot(offset, forward), dot(offset, sideways), dot(offset, turn)),
        2.0 * vec3f(dot(forward, forward), dot(sideways, sideways), dot(turn, turn)),
        2.0 * vec3f(dot(forward, sideways), dot(forward, turn), dot(sideways, turn)),
    );
}

struct Axes {
    along: vec3f,
    across: vec3f,
}

// An outlier does not pull, nor does the end of a segment: it is where the wall was last seen.
fn axes(slot: u32) -> Axes {
    if slot == NONE {
        return Axes(vec3f(0.0), vec3f(0.0));
    }
    let cluster = cluster_at(slot);
    return Axes(select(vec3f(0.0), cluster.along, cluster.half_length == 0.0), cluster.across);
}

fn pull_of_four(robot: Robot, x: vec4f, y: vec4f, best: vec4u, does_count: vec4<bool>) -> Sums {
    let winners = select(vec4u(NONE), best, does_count);
    let p = axes(winners.x);
    let q = axes(winners.y);
    let r = axes(winners.z);
    let s = axes(winners.w);
    let along = pull(
        robot, x, y,
        vec4f(p.along.x, q.along.x, r.along.x, s.along.x),
        vec4f(p.along.y, q.along.y, r.along.y, s.along.y),
        vec4f(p.along.z, q.along.z, r.along.z, s.along.z),
    );
    let across = pull(
        robot, x, y,
        vec4f(p.across.x, q.across.x, r.across.x, s.across.x),
        vec4f(p.across.y, q.across.y, r.across.y, s.across.y),
        vec4f(p.across.z, q.across.z, r.across.z, s.across.z),
    );
    return add(along, across);
}

fn sums_of(tile: u32, robot: Robot, points: Points, best: Best) -> Sums {
    let count = tiles[tile].count;
    var sums = pull_of_four(robot, points.x0, points.y0, best.slot0, counts(count, 0u));
    sums = add(sums, pull_of_four(robot, points.x1, points.y1, best.slot1, counts(count, 4u)));
    sums = add(sums, pull_of_four(robot, points.x2, points.y2, best.slot2, counts(count, 8u)));
    sums = add(sums, pull_of_four(robot, points.x3, points.y3, best.slot3, counts(count, 12u)));
    sums.log_likelihood = sum_of(tile, best);
    return sums;
}

struct Prior {
    log_density: f32,
    gradient: vec3f,
    squares: vec3f,
    products: vec3f,
}

// The log of the prior around a pose, but for a constant.
fn prior_at(pose: vec3f, mean: vec3f) -> Prior {
    let mean_turn = sin_cos(mean.z);
    let apart = pose.xy - mean.xy;
    let turn = wrap(pose.z - mean.z);
    let off = vec3f(
        mean_turn.y * apart.x + mean_turn.x * apart.y,
        mean_turn.y * apart.y - mean_turn.x * apart.x,
        turn,
    );
    let sin = sin_cos(turn).x;
    let cos = sin_cos(turn).y;
    let first = job.prior_information[0];
    let second = job.prior_information[1];
    let xx = first.x;
    let xy = first.y;
    let xh = first.z;
    let yy = first.w;
    let yh = second.x;
    let hh = second.y;
    let pull = vec3f(
        dot(vec3f(xx, xy, xh), off),
        dot(vec3f(xy, yy, yh), off),
        dot(vec3f(xh, yh, hh), off),
    );
    // Cauchy's robust density: -c²/2 ln(1 + d²/c²) in place of -d²/2, whose weight falls with d².
    let tail = 1.0 + dot(pull, off) / PRIOR_TAIL;
    let weight = 1.0 / tail;
    return Prior(
        -0.5 * PRIOR_TAIL * ln(tail),
        -weight * vec3f(cos * pull.x + sin * pull.y, cos * pull.y - sin * pull.x, pull.z),
        weight * vec3f(
            cos * cos * xx + 2.0 * cos * sin * xy + sin * sin * yy,
            sin * sin * xx - 2.0 * cos * sin * xy + cos * cos * yy,
            hh,
        ),
        weight * vec3f(
            cos * sin * (yy - xx) + (cos * cos - sin * sin) * xy,
            cos * xh + sin * yh,
            cos * yh - sin * xh,
        ),
    );
}

@compute @workgroup_size(64)
fn refine(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) lane: u32) {
    let group = groups[workgroup.x];
    let mine = share(group, lane);
    let is_climber = mine.is_active && is_climbing(mine.particle);
    let pose = poses[mine.particle].xyz;
    let robot = Robot(pose, sin_cos(pose.z));
    var sums = Sums();
    if group.count > 32u {
        // All lanes, idle ones too, evaluate the same tile.
        for (var tile = 0u; tile < job.tile_count; tile++) {
            let points = points_shared(tile, pose, robot.turn, lane);
            let best = evaluate_shared(list_of(workgroup.x, group, tile), points, lane);
            sums = add(sums, sums_of(tile, robot, points, best));
        }
    } else if is_climber {
        for (var tile = mine.first_tile; tile < job.tile_count; tile += mine.tile_stride) {
            let points = points_alone(tile, pose, robot.turn);
            let best = evaluate_alone(list_of(workgroup.x, group, tile), points);
            sums = add(sums, sums_of(tile, robot, points, best));
        }
    }
    partial[lane] = sums;
    // What this group's lanes read of other memory they have read before one of them writes it, too.
    storageBarrier();
    workgroupBarrier();
    if !is_climber || mine.first_tile != 0u {
        return;
    }
    for (var other = lane + mine.width; other < 64u; other += mine.width) {
        sums = add(sums, partial[other]);
    }
    let prior = prior_at(pose, group.prior);
    let gradient = sums.gradient + prior.gradient;
    let squares = sums.squares + prior.squares;
    let products = sums.products + prior.products;
    let information = array<f32, 6>(squares.x, products.x, products.y, squares.y, products.z, squares.z);
    let cholesky = cholesky_of(information);
    var state = SETTLED;
    var next = pose;
    let is_last = phase.restart == 0u && modes[mine.particle].state == LAST_EVALUATION;
    if phase.may_step == 1u && cholesky.exists && !is_last {
        let whole = solve(cholesky, gradient);
        let shrink = MAX_STEP / max(abs(whole), vec3f(1e-12));
        let taken = whole * min(1.0, min(shrink.x, min(shrink.y, shrink.z)));
        state = select(CLIMBING, LAST_EVALUATION, all(abs(taken) < CONVERGED));
        next = moved(pose, taken);
    }
    poses[mine.particle] = vec4f(next, sums.log_likelihood);
    modes[mine.particle].information = information;
    modes[mine.particle].log_posterior = sums.log_likelihood + prior.log_density;
    modes[mine.particle].state = state;
}
