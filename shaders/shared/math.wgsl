// Logarithm, exponential, sine and cosine by polynomials: those of a device may be coarse. Twin of src/math.rs.

const TAU = 6.28318530717958647692;
const SQRT_2 = 1.41421356237309504880;

fn sin_cos(angle: f32) -> vec2f {
    let quadrant = round(angle * 0.636619772367581343);
    let rest = ((angle - quadrant * 1.5703125) - quadrant * 4.837513e-4) - quadrant * 7.54979e-8;
    let square = rest * rest;
    let sine = rest + rest * square * (-1.6666655e-1 + square * (8.332161e-3 + square * -1.9515296e-4));
    let cosine = 1.0 - 0.5 * square
        + square * square * (4.1666646e-2 + square * (-1.3887316e-3 + square * 2.4433157e-5));
    switch (i32(quadrant) & 3) {
        case 0: { return vec2f(sine, cosine); }
        case 1: { return vec2f(cosine, -sine); }
        case 2: { return vec2f(-sine, -cosine); }
        default: { return vec2f(-cosine, sine); }
    }
}

fn wrap(angle: f32) -> f32 {
    return angle - TAU * round(angle * (1.0 / TAU));
}

// Of a positive normal number.
fn ln(value: f32) -> f32 {
    let bits = bitcast<u32>(value);
    var exponent = i32(bits >> 23u) - 126;
    var mantissa = bitcast<f32>((bits & 0x007fffffu) | 0x3f000000u);
    if mantissa < 0.70710678118654752 {
        mantissa += mantissa;
        exponent -= 1;
    }
    let x = mantissa - 1.0;
    var polynomial = 7.0376836e-2;
    polynomial = polynomial * x - 1.151461e-1;
    polynomial = polynomial * x + 1.1676999e-1;
    polynomial = polynomial * x - 1.2420141e-1;
    polynomial = polynomial * x + 1.4249323e-1;
    polynomial = polynomial * x - 1.6668058e-1;
    polynomial = polynomial * x + 2.0000715e-1;
    polynomial = polynomial * x - 2.4999994e-1;
    polynomial = polynomial * x + 3.333333e-1;
    let square = x * x;
    let low = polynomial * x * square - 2.1219444e-4 * f32(exponent) - 0.5 * square;
    return x + low + 0.6933594 * f32(exponent);
}

// e to a power that is not positive; 0 below -87.
fn exp_of(power: f32) -> f32 {
    if power < -87.0 {
        return 0.0;
    }
    let exponent = round(power * 1.44269504088896341);
    let rest = (power - exponent * 0.6933594) + exponent * 2.1219444e-4;
    var polynomial = 1.9875691e-4;
    polynomial = polynomial * rest + 1.3981999e-3;
    polynomial = polynomial * rest + 8.333452e-3;
    polynomial = polynomial * rest + 4.1665796e-2;
    polynomial = polynomial * rest + 1.6666666e-1;
    polynomial = polynomial * rest + 0.5;
    let mantissa = polynomial * rest * rest + rest + 1.0;
    return mantissa * bitcast<f32>(u32(i32(exponent) + 127) << 23u);
}

// A pose (x, y, heading) after a motion (forward, sideways, turn) of the robot.
fn moved(pose: vec3f, motion: vec3f) -> vec3f {
    let turn = sin_cos(pose.z);
    return vec3f(
        pose.x + turn.y * motion.x - turn.x * motion.y,
        pose.y + turn.x * motion.x + turn.y * motion.y,
        pose.z + motion.z,
    );
}
