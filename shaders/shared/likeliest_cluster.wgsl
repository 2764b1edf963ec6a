// Twin of src/evaluator/cpu/likeliest.rs.

// The highest ln p of each point so far, and the slot of the cluster that gives it: the first of the likeliest.
struct Best {
    density0: vec4f,
    density1: vec4f,
    density2: vec4f,
    density3: vec4f,
    slot0: vec4u,
    slot1: vec4u,
    slot2: vec4u,
    slot3: vec4u,
}

fn all_outliers() -> Best {
    let density = vec4f(job.log_outlier);
    let none = vec4u(NONE);
    return Best(density, density, density, density, none, none, none, none);
}

fn compare(best: ptr<function, Best>, points: Points, cluster: ClusterParams, slot: u32) {
    let density0 = log_density(cluster, points.x0, points.y0);
    let density1 = log_density(cluster, points.x1, points.y1);
    let density2 = log_density(cluster, points.x2, points.y2);
    let density3 = log_density(cluster, points.x3, points.y3);
    (*best).slot0 = select((*best).slot0, vec4u(slot), density0 > (*best).density0);
    (*best).slot1 = select((*best).slot1, vec4u(slot), density1 > (*best).density1);
    (*best).slot2 = select((*best).slot2, vec4u(slot), density2 > (*best).density2);
    (*best).slot3 = select((*best).slot3, vec4u(slot), density3 > (*best).density3);
    (*best).density0 = max((*best).density0, density0);
    (*best).density1 = max((*best).density1, density1);
    (*best).density2 = max((*best).density2, density2);
    (*best).density3 = max((*best).density3, density3);
}
