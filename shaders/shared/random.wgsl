// Counter-based random numbers, Philox4x32-10. Twin of src/random.rs, the same bit for bit.

const DRAW_PROPOSAL = 1u;

// The 64 bits of a product, high word first: WGSL has no such product, so it is put together from halves.
fn multiply(a: u32, b: u32) -> vec2u {
    let a_low = a & 0xffffu;
    let a_high = a >> 16u;
    let b_low = b & 0xffffu;
    let b_high = b >> 16u;
    let low = a_low * b_low;
    let middle = a_high * b_low + (low >> 16u);
    let other = a_low * b_high + (middle & 0xffffu);
    return vec2u(a_high * b_high + (middle >> 16u) + (other >> 16u), a * b);
}

fn random_bits(particle: u32, draw: u32) -> vec4u {
    var counter = vec4u(job.step, particle, draw, 0u);
    var key = job.seed;
    for (var i = 0; i < 10; i++) {
        let first = multiply(0xD2511F53u, counter.x);
        let second = multiply(0xCD9E8D57u, counter.z);
        counter = vec4u(second.x ^ counter.y ^ key.x, second.y, first.x ^ counter.w ^ key.y, first.y);
        key += vec2u(0x9E3779B9u, 0xBB67AE85u);
    }
    return counter;
}

// Four independent standard normal numbers (Box-Muller).
fn random_normals(particle: u32, draw: u32) -> vec4f {
    let uniforms = (vec4f(random_bits(particle, draw) >> vec4u(9u)) + 0.5) * (1.0 / 8388608.0);
    let first = sqrt(-2.0 * ln(uniforms.x));
    let second = sqrt(-2.0 * ln(uniforms.z));
    let first_turn = sin_cos(TAU * uniforms.y);
    let second_turn = sin_cos(TAU * uniforms.w);
    return vec4f(first * first_turn.y, first * first_turn.x, second * second_turn.y, second * second_turn.x);
}
