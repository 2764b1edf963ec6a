// The cluster of one of the first four lanes, in all lanes. The number of the lane has to be written out.

fn told0(mine: ClusterParams) -> ClusterParams {
    return ClusterParams(
        subgroupBroadcast(mine.along, 0u),
        subgroupBroadcast(mine.half_length, 0u),
        subgroupBroadcast(mine.across, 0u),
        subgroupBroadcast(mine.log_peak, 0u),
    );
}

fn told1(mine: ClusterParams) -> ClusterParams {
    return ClusterParams(
        subgroupBroadcast(mine.along, 1u),
        subgroupBroadcast(mine.half_length, 1u),
        subgroupBroadcast(mine.across, 1u),
        subgroupBroadcast(mine.log_peak, 1u),
    );
}

fn told2(mine: ClusterParams) -> ClusterParams {
    return ClusterParams(
        subgroupBroadcast(mine.along, 2u),
        subgroupBroadcast(mine.half_length, 2u),
        subgroupBroadcast(mine.across, 2u),
        subgroupBroadcast(mine.log_peak, 2u),
    );
}

fn told3(mine: ClusterParams) -> ClusterParams {
    return ClusterParams(
        subgroupBroadcast(mine.along, 3u),
        subgroupBroadcast(mine.half_length, 3u),
        subgroupBroadcast(mine.across, 3u),
        subgroupBroadcast(mine.log_peak, 3u),
    );
}
