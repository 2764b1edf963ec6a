// Eight lanes load half a cluster each and broadcast it. The number of a lane has to be a constant.

// This lane's half: the first four lanes have those of the first half, in the order of their slots.
fn half_of(slot: u32, lane: u32) -> vec4f {
    let number = lane / 4u % 2u;
    let half = clusters[slot][number];
    return select(half, thickened(half), number == 1u);
}

fn broadcast0(mine: vec4f) -> ClusterParams {
    return cluster_of(subgroupBroadcast(mine, 0u), subgroupBroadcast(mine, 4u));
}

fn broadcast1(mine: vec4f) -> ClusterParams {
    return cluster_of(subgroupBroadcast(mine, 1u), subgroupBroadcast(mine, 5u));
}

fn broadcast2(mine: vec4f) -> ClusterParams {
    return cluster_of(subgroupBroadcast(mine, 2u), subgroupBroadcast(mine, 6u));
}

fn broadcast3(mine: vec4f) -> ClusterParams {
    return cluster_of(subgroupBroadcast(mine, 3u), subgroupBroadcast(mine, 7u));
}
