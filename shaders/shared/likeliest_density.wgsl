// Twin of src/evaluator/cpu/likeliest.rs.

// The highest ln p of each point so far, whichever cluster gives it.
struct Best {
    density0: vec4f,
    density1: vec4f,
    density2: vec4f,
    density3: vec4f,
}

fn all_outliers() -> Best {
    let density = vec4f(job.log_outlier);
    return Best(density, density, density, density);
}

fn compare(best: ptr<function, Best>, points: Points, cluster: ClusterParams, slot: u32) {
    (*best).density0 = max((*best).density0, log_density(cluster, points.x0, points.y0));
    (*best).density1 = max((*best).density1, log_density(cluster, points.x1, points.y1));
    (*best).density2 = max((*best).density2, log_density(cluster, points.x2, points.y2));
    (*best).density3 = max((*best).density3, log_density(cluster, points.x3, points.y3));
}
