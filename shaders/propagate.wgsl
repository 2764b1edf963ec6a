// A pose for each particle, drawn from the motion (eq. 17).
// Twin of src/evaluator/cpu/propagate.rs.

const MAX_TAIL = 30.0;

@compute @workgroup_size(64)
fn propagate(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) lane: u32) {
    let group = groups[workgroup.x];
    if lane >= group.count {
        return;
    }
    var noise = vec3f(0.0);
    if lane > 0u || group.exact_first == 0u {
        let drawn = random_normals(group.number + lane, job.draw);
        // Normal numbers over the size of another one are Cauchy's.
        let tail = select(1.0, min(1.0 / abs(drawn.w), MAX_TAIL), job.is_heavy_tailed == 1u);
        let normals = tail * drawn.xyz;
        let l = job.noise;
        noise = vec3f(
            l[0].x * normals.x,
            l[0].y * normals.x + l[0].z * normals.y,
            l[0].w * normals.x + l[1].x * normals.y + l[1].y * normals.z,
        );
    }
    let particle = group.first + lane;
    var mean = group.mean;
    if job.from_own_pose == 1u {
        mean = moved(poses[particle].xyz, group.mean);
    }
    poses[particle] = vec4f(moved(mean, noise), 0.0);
}
