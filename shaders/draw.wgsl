// A pose around the mode of each particle's posterior, from the Laplace approximation.
// Twin of src/evaluator/cpu/draw.rs.

@compute @workgroup_size(64)
fn draw(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) lane: u32) {
    let group = groups[workgroup.x];
    if lane >= group.count {
        return;
    }
    let particle = group.first + lane;
    var drawn = poses[particle].xyz;
    let cholesky = cholesky_of(modes[particle].information);
    if cholesky.exists {
        let normals = random_normals(group.number + lane, DRAW_PROPOSAL).xyz;
        drawn = moved(drawn, solve_transposed(cholesky, normals * job.spread));
    }
    modes[particle].drawn = vec4f(drawn, 0.0);
}
