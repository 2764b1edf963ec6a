// Lanes that evaluate the same list each load its clusters: what one has loaded the others find in the cache.

fn points_shared(tile: u32, pose: vec3f, turn: vec2f, lane: u32) -> Points {
    return points_alone(tile, pose, turn);
}

fn evaluate_shared(list: List, points: Points, lane: u32) -> Best {
    return evaluate_alone(list, points);
}
