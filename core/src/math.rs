//! Scalar functions in `f32` with stated error bounds, identical to the last bit on every target.
//!
//! libm's `sinf` and `cosf` compute in `f64`, which is software on a single-precision microcontroller (over 1000
//! instructions); these stay in `f32`. Only IEEE additions, multiplications, comparisons and integer conversions
//! are used, so that no target can round differently.

use core::f32::consts::{FRAC_2_PI, FRAC_PI_2, FRAC_PI_4, LOG2_E, PI};

/// 1.5 × 2²³: adding it rounds to an integer, which then stands in the low bits.
const ROUNDER: f32 = 12_582_912.0;

/// π/2 split in three `f32` parts whose products with small integers are exact (Cody & Waite 1980).
const HALF_PI_PARTS: [f32; 3] = [1.570_312_5, 4.837_513e-4, 7.549_79e-8];

/// Sine and cosine of `angle` (rad), absolute error below 1.5e-7 for |angle| ≤ 1000.
///
/// Reduction to [−π/4, π/4] by Cody and Waite, then the minimax polynomials of Cephes' `sinf` and `cosf`.
/// Larger angles lose accuracy gradually; NaN and infinities give NaN.
pub fn sin_cos(angle: f32) -> (f32, f32) {
    let quadrant = round_to_int(angle * FRAC_2_PI);
    let k = quadrant as f32;
    let r = ((angle - k * HALF_PI_PARTS[0]) - k * HALF_PI_PARTS[1]) - k * HALF_PI_PARTS[2];
    let z = r * r;
    let sin = r + r * z * (-1.666_665_5e-1 + z * (8.332_161e-3 - z * 1.951_529_6e-4));
    let cos = 1.0 - 0.5 * z + z * z * (4.166_664_6e-2 + z * (-1.388_731_6e-3 + z * 2.443_315_7e-5));
    match quadrant & 3 {
        0 => (sin, cos),
        1 => (cos, -sin),
        2 => (-sin, -cos),
        _ => (-cos, sin),
    }
}

/// Largest integer not above `x`, for |x| < 2²² (an integer may give itself or the one below).
///
/// No conversion and no branch, so that loops of it vectorise.
#[inline(always)]
pub fn floor(x: f32) -> i32 {
    ((x - 0.5 + ROUNDER).to_bits() as i32).wrapping_sub(ROUNDER.to_bits() as i32)
}

/// The value of [low, high] nearest to `x`; `f32::clamp` without its panic where `low` is not below `high`.
pub fn clamp(x: f32, low: f32, high: f32) -> f32 {
    if x < low {
        low
    } else if x > high {
        high
    } else {
        x
    }
}

/// Nearest integer, ties away from zero; saturates, NaN gives 0.
#[inline]
pub fn round_to_int(x: f32) -> i32 {
    (if x < 0.0 { x - 0.5 } else { x + 0.5 }) as i32
}

/// e^x for x ≤ 0 with relative error below 3e-7 plus that of one rounded product (6e-8 · |x|); 0 below −87; 1 for x > 0; NaN gives 0.
#[inline]
pub fn exp_neg(x: f32) -> f32 {
    exp2_neg(x * LOG2_E)
}

/// 2^x for x ≤ 0 with relative error below 3e-7; 0 for x < −125 and for NaN; 1 for x > 0. No branch in it, so that loops of it vectorise.
///
/// Split into integer and fraction in [−½, ½]; the polynomial is the Taylor series of 2^f to the sixth order.
#[inline]
pub fn exp2_neg(x: f32) -> f32 {
    let inside = if x > -125.0 { x } else { -125.0 };
    let inside = if inside < 0.0 { inside } else { 0.0 };
    let rounded = inside + ROUNDER;
    let f = inside - (rounded - ROUNDER);
    let p = 1.540_353e-4;
    let p = p * f + 1.333_355_8e-3;
    let p = p * f + 9.618_129e-3;
    let p = p * f + 5.550_411e-2;
    let p = p * f + 2.402_265e-1;
    let p = p * f + core::f32::consts::LN_2;
    let p = p * f + 1.0;
    let scale = f32::from_bits(rounded.to_bits().wrapping_add(127) << 23);
    if x >= -125.0 { p * scale } else { 0.0 }
}

/// Angle wrapped into (−π, π]. Non-finite input gives NaN.
pub fn wrap_angle(angle: f32) -> f32 {
    if angle > -PI && angle <= PI {
        return angle;
    }
    if !angle.is_finite() {
        return f32::NAN;
    }
    let wrapped = libm::remainderf(angle, 2.0 * PI);
    if wrapped <= -PI { PI } else { wrapped }
}

/// √(x² + y²), without the overflow guard (and the cost) of the general function.
#[inline]
pub fn hypot(x: f32, y: f32) -> f32 {
    libm::sqrtf(x * x + y * y)
}

/// Angle of (`x`, `y`) from the x axis, rad in [−π, π], absolute error below 3e-7; 0 at the origin. NaN, and two infinities, give NaN.
/// For coordinates below 1e38.
///
/// Reduction to [−π/8, π/8], then the minimax polynomial of Cephes' `atanf`.
#[inline]
pub fn atan2(y: f32, x: f32) -> f32 {
    const TAN_PI_8: f32 = 0.414_213_56;
    let is_steep = y.abs() > x.abs();
    let (long, short) = if is_steep { (y.abs(), x.abs()) } else { (x.abs(), y.abs()) };
    let is_wide = short > TAN_PI_8 * long;
    let t = if is_wide {
        (short - long) / (short + long)
    } else if long == 0.0 {
        0.0
    } else {
        short / long
    };
    let z = t * t;
    let p = 8.053_744_5e-2;
    let p = p * z - 1.387_768_6e-1;
    let p = p * z + 1.997_771e-1;
    let p = p * z - 3.333_295e-1;
    let within = t + t * z * p + if is_wide { FRAC_PI_4 } else { 0.0 };
    let upper = if is_steep { FRAC_PI_2 - within } else { within };
    let half = if x < 0.0 { PI - upper } else { upper };
    half.copysign(y)
}

/// Uniform draw in [0, 1) with 24 random bits, from one word of `rng`.
#[inline]
pub fn uniform(rng: &mut impl rand_core::Rng) -> f32 {
    (rng.next_u32() >> 8) as f32 * (1.0 / 16_777_216.0)
}

/// Standard normal draw by Marsaglia's polar method; at most 64 tries (it needs 1.27 on average), then 0.
pub fn normal(rng: &mut impl rand_core::Rng) -> f32 {
    for _ in 0..64 {
        let u = 2.0 * uniform(rng) - 1.0;
        let v = 2.0 * uniform(rng) - 1.0;
        let s = u * u + v * v;
        if s > 0.0 && s < 1.0 {
            return u * libm::sqrtf(-2.0 * libm::logf(s) / s);
        }
    }
    0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sin_cos_keep_their_error_bound() {
        let mut worst = 0.0_f64;
        for i in -400_000..=400_000 {
            let angle = i as f32 * 2.5e-3;
            let (s, c) = sin_cos(angle);
            let (es, ec) = (libm::sin(f64::from(angle)), libm::cos(f64::from(angle)));
            worst = worst.max((f64::from(s) - es).abs()).max((f64::from(c) - ec).abs());
        }
        assert!(worst < 1.5e-7, "worst error {worst:e}");
    }

    #[test]
    fn atan2_keeps_its_error_bound_and_its_ends() {
        let mut worst = 0.0_f64;
        for i in -400_000..=400_000 {
            let (angle, size) = (i as f32 * 7.8e-6, 1.0e-3 * (1 + i % 7 * i % 7) as f32);
            let (x, y) = (size * libm::cosf(angle), size * libm::sinf(angle));
            worst = worst.max((f64::from(atan2(y, x)) - libm::atan2(f64::from(y), f64::from(x))).abs());
        }
        assert!(worst < 3e-7, "worst error {worst:e}");
        assert_eq!([atan2(0.0, 0.0), atan2(0.0, 1.0), atan2(0.0, -1.0), atan2(-0.0, -1.0)], [0.0, 0.0, PI, -PI]);
        assert_eq!([atan2(1.0, 0.0), atan2(-1.0, 0.0), atan2(1.0, f32::INFINITY)], [FRAC_PI_2, -FRAC_PI_2, 0.0]);
        assert!(atan2(f32::NAN, 1.0).is_nan() && atan2(1.0, f32::NAN).is_nan());
    }

    #[test]
    fn exp_keeps_its_error_bound_and_its_ends() {
        let mut worst = 0.0_f64;
        for i in 0..=1_000_000 {
            let x = -120.0 * i as f32 / 1e6;
            let exact = libm::exp2(f64::from(x));
            worst = worst.max((f64::from(exp2_neg(x)) - exact).abs() / exact);
        }
        assert!(worst < 3e-7, "worst error {worst:e}");
        assert_eq!(exp_neg(0.0), 1.0);
        assert_eq!(exp_neg(f32::NEG_INFINITY), 0.0);
        assert_eq!(exp_neg(f32::NAN), 0.0);
        assert_eq!(exp_neg(3.0), 1.0);
    }

    #[test]
    fn wrap_angle_is_half_open() {
        assert_eq!(wrap_angle(PI), PI);
        assert_eq!(wrap_angle(-PI), PI);
        assert!((wrap_angle(3.0 * PI + 0.25) - (0.25 - PI)).abs() < 1e-6);
        assert!(wrap_angle(f32::INFINITY).is_nan());
    }

    #[test]
    fn normal_draws_have_unit_variance() {
        use rand_core::SeedableRng;
        let mut rng = rand_pcg::Pcg32::seed_from_u64(7);
        let draws: [f32; 20_000] = core::array::from_fn(|_| normal(&mut rng));
        let mean = draws.iter().sum::<f32>() / 20_000.0;
        let variance = draws.iter().map(|d| (d - mean) * (d - mean)).sum::<f32>() / 20_000.0;
        assert!(mean.abs() < 0.03 && (variance - 1.0).abs() < 0.05, "{mean} {variance}");
    }
}
