// Lanes that evaluate the same list load four of its clusters at a time and broadcast them, and likewise the points of a
// tile. A device in software loads for one lane after the other, and would spend most of its
// time on that. Subgroups have eight lanes or more; where one of their lanes comes here, the first eight do.

fn points_shared(tile: u32, pose: vec3f, turn: vec2f, lane: u32) -> Points {
    let row = lane / 4u % 2u;
    let column = lane % 4u;
    let x = vec2f(tiles[tile].x[row][column], tiles[tile].x[row + 2u][column]);
    let y = vec2f(tiles[tile].y[row][column], tiles[tile].y[row + 2u][column]);
    return points_at(
        array<vec4f, 4>(
            vec4f(subgroupBroadcast(x.x, 0u), subgroupBroadcast(x.x, 1u), subgroupBroadcast(x.x, 2u), subgroupBroadcast(x.x, 3u)),
            vec4f(subgroupBroadcast(x.x, 4u), subgroupBroadcast(x.x, 5u), subgroupBroadcast(x.x, 6u), subgroupBroadcast(x.x, 7u)),
            vec4f(subgroupBroadcast(x.y, 0u), subgroupBroadcast(x.y, 1u), subgroupBroadcast(x.y, 2u), subgroupBroadcast(x.y, 3u)),
            vec4f(subgroupBroadcast(x.y, 4u), subgroupBroadcast(x.y, 5u), subgroupBroadcast(x.y, 6u), subgroupBroadcast(x.y, 7u)),
        ),
        array<vec4f, 4>(
            vec4f(subgroupBroadcast(y.x, 0u), subgroupBroadcast(y.x, 1u), subgroupBroadcast(y.x, 2u), subgroupBroadcast(y.x, 3u)),
            vec4f(subgroupBroadcast(y.x, 4u), subgroupBroadcast(y.x, 5u), subgroupBroadcast(y.x, 6u), subgroupBroadcast(y.x, 7u)),
            vec4f(subgroupBroadcast(y.y, 0u), subgroupBroadcast(y.y, 1u), subgroupBroadcast(y.y, 2u), subgroupBroadcast(y.y, 3u)),
            vec4f(subgroupBroadcast(y.y, 4u), subgroupBroadcast(y.y, 5u), subgroupBroadcast(y.y, 6u), subgroupBroadcast(y.y, 7u)),
        ),
        pose,
        turn,
    );
}

fn evaluate_shared(list: List, points: Points, lane: u32) -> Best {
    var best = all_outliers();
    for (var first = 0u; first < list.count; first += 4u) {
        // Past the end the last one comes again, which changes no maximum.
        let slot = slot_of(list, min(first + lane % 4u, list.count - 1u));
        let mine = half_of(slot, lane);
        compare(&best, points, broadcast0(mine), subgroupBroadcast(slot, 0u));
        compare(&best, points, broadcast1(mine), subgroupBroadcast(slot, 1u));
        compare(&best, points, broadcast2(mine), subgroupBroadcast(slot, 2u));
        compare(&best, points, broadcast3(mine), subgroupBroadcast(slot, 3u));
    }
    return best;
}
