// The Cholesky factor L Lᵀ = A of a symmetric 3x3 matrix (xx, xy, xh, yy, yh, hh). Twin of src/evaluator/cholesky.rs.

struct Cholesky {
    exists: bool,
    l00: f32,
    l10: f32,
    l11: f32,
    l20: f32,
    l21: f32,
    l22: f32,
}

fn cholesky_of(a: array<f32, 6>) -> Cholesky {
    let l00 = sqrt(a[0]);
    let l10 = a[1] / l00;
    let l20 = a[2] / l00;
    let square11 = a[3] - l10 * l10;
    let l11 = sqrt(square11);
    let l21 = (a[4] - l20 * l10) / l11;
    let square22 = a[5] - l20 * l20 - l21 * l21;
    return Cholesky(a[0] > 0.0 && square11 > 0.0 && square22 > 0.0, l00, l10, l11, l20, l21, sqrt(square22));
}

// The x of Lᵀ x = b.
fn solve_transposed(l: Cholesky, b: vec3f) -> vec3f {
    let z = b.z / l.l22;
    let y = (b.y - l.l21 * z) / l.l11;
    return vec3f((b.x - l.l10 * y - l.l20 * z) / l.l00, y, z);
}

// The x of A x = b.
fn solve(l: Cholesky, b: vec3f) -> vec3f {
    let x = b.x / l.l00;
    let y = (b.y - l.l10 * x) / l.l11;
    return solve_transposed(l, vec3f(x, y, (b.z - l.l20 * x - l.l21 * y) / l.l22));
}
