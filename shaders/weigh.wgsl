// The log-likelihood of the scan from each particle's pose (eq. 18). A workgroup a group.
// Twin of src/evaluator/cpu/weigh.rs.

var<workgroup> sums: array<f32, 64>;

@compute @workgroup_size(64)
fn weigh(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) lane: u32) {
    let group = groups[workgroup.x];
    let mine = share(group, lane);
    let pose = poses[mine.particle].xyz;
    let turn = sin_cos(pose.z);
    var sum = 0.0;
    if group.count > 32u {
        // All lanes, idle ones too, evaluate the same tile.
        for (var tile = 0u; tile < job.tile_count; tile++) {
            let list = list_of(workgroup.x, group, tile);
            sum += sum_of(tile, evaluate_shared(list, points_shared(tile, pose, turn, lane), lane));
        }
    } else if mine.is_active {
        for (var tile = mine.first_tile; tile < job.tile_count; tile += mine.tile_stride) {
            let list = list_of(workgroup.x, group, tile);
            sum += sum_of(tile, evaluate_alone(list, points_alone(tile, pose, turn)));
        }
    }
    sums[lane] = sum;
    workgroupBarrier();
    if mine.is_active && mine.first_tile == 0u {
        for (var other = lane + mine.width; other < 64u; other += mine.width) {
            sum += sums[other];
        }
        poses[mine.particle].w = sum;
    }
}
