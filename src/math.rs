//! Logarithm, exponential, sine and cosine in f32 by polynomials, and angles; twin of `shaders/shared/math.wgsl`.
//!
//! What a device brings along may be coarse (WGSL asks of sin and cos no more than 2⁻¹¹, half a centimetre at a wall ten
//! metres off), and differs from device to device.
//!
//! The polynomials are minimax fits in the form of Cephes (S. L. Moshier, Methods and Programs for Mathematical
//! Functions, 1989); errors stay below 2e-7, relative for logarithm and exponential, absolute for sine and cosine.

/// Sine and cosine of an angle of at most a few hundred turns.
pub fn sin_cos(angle: f32) -> (f32, f32) {
    // π/2 in three parts, so that the remainder keeps all its bits.
    const PARTS: [f32; 3] = [1.570_312_5, 4.837_513e-4, 7.549_79e-8];
    let quadrant = (angle * std::f32::consts::FRAC_2_PI).round();
    let rest = ((angle - quadrant * PARTS[0]) - quadrant * PARTS[1]) - quadrant * PARTS[2];
    let square = rest * rest;
    let sine = rest + rest * square * (-1.666_665_5e-1 + square * (8.332_161e-3 + square * -1.951_529_6e-4));
    let cosine =
        1.0 - 0.5 * square + square * square * (4.166_664_6e-2 + square * (-1.388_731_6e-3 + square * 2.443_315_7e-5));
    match quadrant as i32 & 3 {
        0 => (sine, cosine),
        1 => (cosine, -sine),
        2 => (-sine, -cosine),
        _ => (-cosine, sine),
    }
}

/// The same angle in [-π, π].
pub fn wrap(angle: f32) -> f32 {
    angle - std::f32::consts::TAU * (angle * (1.0 / std::f32::consts::TAU)).round()
}

/// Natural logarithm of a positive normal number.
pub fn ln(value: f32) -> f32 {
    let bits = value.to_bits();
    let mut exponent = (bits >> 23) as i32 - 126;
    // In [1/2, 1), then in [1/√2, √2).
    let mut mantissa = f32::from_bits((bits & 0x007f_ffff) | 0x3f00_0000);
    if mantissa < std::f32::consts::FRAC_1_SQRT_2 {
        mantissa += mantissa;
        exponent -= 1;
    }
    let x = mantissa - 1.0;
    let mut polynomial = 7.037_683_6e-2;
    for coefficient in COEFFICIENTS {
        polynomial = polynomial * x + coefficient;
    }
    let square = x * x;
    let exponent = exponent as f32;
    // ln 2 in two parts.
    let low = polynomial * x * square - 2.121_944_4e-4 * exponent - 0.5 * square;
    x + low + 0.693_359_4 * exponent
}

/// e to a power that is not positive; 0 below -87.
pub fn exp(power: f32) -> f32 {
    if power < -87.0 {
        return 0.0;
    }
    let exponent = (power * std::f32::consts::LOG2_E).round();
    // ln 2 in two parts, so that the remainder keeps all its bits.
    let rest = (power - exponent * 0.693_359_4) + exponent * 2.121_944_4e-4;
    let mut polynomial = 1.987_569_1e-4;
    for coefficient in [1.398_199_9e-3, 8.333_452e-3, 4.166_579_6e-2, 1.666_666_6e-1, 0.5] {
        polynomial = polynomial * rest + coefficient;
    }
    let mantissa = polynomial * rest * rest + rest + 1.0;
    mantissa * f32::from_bits(((exponent as i32 + 127) as u32) << 23)
}

const COEFFICIENTS: [f32; 8] = [
    -1.151_461e-1,
    1.167_699_9e-1,
    -1.242_014_1e-1,
    1.424_932_3e-1,
    -1.666_805_8e-1,
    2.000_071_5e-1,
    -2.499_999_4e-1,
    3.333_333e-1,
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sine_and_cosine_are_those_of_f64() {
        let mut worst: f64 = 0.0;
        for i in -400_000..=400_000 {
            let angle = i as f32 * 1e-4;
            let (sine, cosine) = sin_cos(angle);
            let (expected_sine, expected_cosine) = f64::from(angle).sin_cos();
            worst = worst.max((f64::from(sine) - expected_sine).abs()).max((f64::from(cosine) - expected_cosine).abs());
        }
        println!("worst error up to 40 rad: {worst:.1e}");
        assert!(worst < 2e-7, "{worst:e}");
    }

    #[test]
    fn exponential_is_that_of_f64() {
        let mut worst: f64 = 0.0;
        for i in 0..=870_000 {
            let power = i as f32 * -1e-4;
            let expected = f64::from(power).exp();
            worst = worst.max((f64::from(exp(power)) - expected).abs() / expected);
        }
        println!("worst relative error down to -87: {worst:.1e}");
        assert!(worst < 2e-7, "{worst:e}");
        assert_eq!((exp(0.0), exp(-1e30)), (1.0, 0.0));
    }

    #[test]
    fn logarithm_is_that_of_f64() {
        let mut worst: f64 = 0.0;
        for i in 1..1_000_000u32 {
            let value = crate::random::uniform(i.wrapping_mul(4_294_967));
            let expected = f64::from(value).ln();
            worst = worst.max((f64::from(ln(value)) - expected).abs() / expected.abs().max(1e-3));
        }
        for value in [f32::MIN_POSITIVE, 1.0, 2.0, 1e30, 0.999_999_94, 1.000_000_1] {
            let expected = f64::from(value).ln();
            assert!((f64::from(ln(value)) - expected).abs() <= 2e-7 * expected.abs(), "{value}: {}", ln(value));
        }
        println!("worst relative error in (0, 1): {worst:.1e}");
        assert!(worst < 2e-7, "{worst:e}");
    }
}
