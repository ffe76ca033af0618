//! One cell: running sums of its points, and the normal distribution they make.

use super::NdtConfig;
use crate::geometry::Point2;
use crate::math::exp2_neg;

/// Fixed-point units along a cell's side.
const UNITS_PER_CELL: f32 = 2048.0;
/// Bit of a cell's count that says that the cell stays as it is.
const FROZEN: u32 = 1 << 31;
/// −½ log₂ e: turns a squared Mahalanobis distance into the exponent of a power of two.
const MINUS_HALF_LOG2_E: f32 = -0.5 * core::f32::consts::LOG2_E;

/// Running sums of the points in one cell, as fixed-point offsets from its centre.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct CellSums {
    count: u32,
    x: i32,
    y: i32,
    xx: i32,
    xy: i32,
    yy: i32,
}

impl CellSums {
    pub(super) const EMPTY: Self = Self { count: 0, x: 0, y: 0, xx: 0, xy: 0, yy: 0 };

    /// Adds (`sign` 1) or removes (−1) a point at (`u`, `v`) cells from the cell's centre.
    ///
    /// Offsets are at most 1025 units, so 240 squares stay below 2³¹.
    pub(super) fn update(&mut self, u: f32, v: f32, sign: i32) {
        let (x, y) = ((u * UNITS_PER_CELL) as i32, (v * UNITS_PER_CELL) as i32);
        self.count = self.count.saturating_add_signed(sign);
        for (sum, term) in [
            (&mut self.x, x),
            (&mut self.y, y),
            (&mut self.xx, x.wrapping_mul(x)),
            (&mut self.xy, x.wrapping_mul(y)),
            (&mut self.yy, y.wrapping_mul(y)),
        ] {
            *sum = sum.wrapping_add(term.wrapping_mul(sign));
        }
    }

    /// From now on no point is added or removed, if there are `points_min`.
    pub(super) fn freeze(&mut self, points_min: u16) {
        if self.count >= u32::from(points_min) {
            self.count |= FROZEN;
        }
    }

    /// True if no point may be added or removed.
    pub(super) fn is_frozen(&self) -> bool {
        self.count & FROZEN != 0
    }

    /// Halves the evidence once it has reached `count_max` points.
    pub(super) fn fade(&mut self, count_max: u16) {
        if self.count >= u32::from(count_max) {
            self.count /= 2;
            for sum in [&mut self.x, &mut self.y, &mut self.xx, &mut self.xy, &mut self.yy] {
                *sum /= 2;
            }
        }
    }

    /// Mean and covariance, guarded; an empty distribution if there are too few points.
    pub(super) fn gaussian(&self, config: &NdtConfig, centre: Point2) -> Gaussian {
        if self.count < u32::from(config.points_min) {
            return Gaussian::EMPTY;
        }
        let unit = config.cell_size_m / UNITS_PER_CELL;
        let n = self.count as f32;
        let (mx, my) = (self.x as f32 / n, self.y as f32 / n);
        let scale = unit * unit * n / (n - 1.0);
        let noise = config.noise_m * config.noise_m;
        let xx = (self.xx as f32 / n - mx * mx).max(0.0) * scale + noise;
        let yy = (self.yy as f32 / n - my * my).max(0.0) * scale + noise;
        let xy = (self.xy as f32 / n - mx * my) * scale;
        let mean = Point2::new(centre.x + mx * unit, centre.y + my * unit);
        match scaled_inverse(xx, xy, yy, config.eigenvalue_ratio_min) {
            Some(scaled) => Gaussian { mean, scaled, weight: 1.0 },
            None => Gaussian::EMPTY,
        }
    }
}

/// A cell's normal distribution, ready to be evaluated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Gaussian {
    /// q: mean, map frame, m.
    pub(super) mean: Point2,
    /// Σ⁻¹ as (xx, 2 xy, yy), times −½ log₂ e; 1/m².
    pub(super) scaled: [f32; 3],
    /// 1 for a cell that counts, 0 for one that does not.
    pub(super) weight: f32,
}

impl Gaussian {
    /// A cell that does not count; all zero, so that static pools cost no flash.
    pub(super) const EMPTY: Self = Self { mean: Point2::new(0.0, 0.0), scaled: [0.0; 3], weight: 0.0 };

    /// exp(−½ dᵀ Σ⁻¹ d) for a point at `d` from the mean.
    pub(super) fn density(&self, d: Point2) -> f32 {
        let [xx, xy2, yy] = self.scaled;
        self.weight * exp2_neg(d.x * (xx * d.x + xy2 * d.y) + yy * d.y * d.y)
    }

    /// Σ⁻¹ as (xx, xy, yy), 1/m².
    pub(super) fn information(&self) -> [f32; 3] {
        let [xx, xy2, yy] = self.scaled;
        [xx / MINUS_HALF_LOG2_E, 0.5 * xy2 / MINUS_HALF_LOG2_E, yy / MINUS_HALF_LOG2_E]
    }

    /// What the cell says about each direction, 0 to 1, as (xx, xy, yy); see `NdtGrid::constraint`.
    pub(super) fn worth(&self, config: &NdtConfig) -> [f32; 3] {
        let [xx, xy, yy] = self.information();
        let (half_trace, half_difference) = (0.5 * (xx + yy), 0.5 * (xx - yy));
        let radius = libm::sqrtf(half_difference * half_difference + xy * xy);
        let noise = config.noise_m.max(0.01);
        let even_spread = config.cell_size_m * config.cell_size_m / 12.0 + noise * noise;
        let worth = |information: f32| noise * noise * (information - 1.0 / even_spread).max(0.0);
        let (normal, along) = (worth(half_trace + radius), worth(half_trace - radius));
        let (mean, spread) = (0.5 * (normal + along), 0.5 * (normal - along));
        let (cos2, sin2) = if radius > 0.0 { (half_difference / radius, xy / radius) } else { (1.0, 0.0) };
        [mean + spread * cos2, spread * sin2, mean - spread * cos2]
    }
}

/// −½ log₂ e Σ⁻¹ with the smaller eigenvalue raised to `ratio_min` of the larger; `None` if Σ vanishes.
fn scaled_inverse(xx: f32, xy: f32, yy: f32, ratio_min: f32) -> Option<[f32; 3]> {
    let half_trace = 0.5 * (xx + yy);
    let half_difference = 0.5 * (xx - yy);
    let radius = libm::sqrtf(half_difference * half_difference + xy * xy);
    let large = half_trace + radius;
    let small = (half_trace - radius).max(ratio_min * large);
    if !(small > 1e-12 && large.is_finite()) {
        return None;
    }
    // Direction of the larger eigenvalue as (cos 2a, sin 2a).
    let (cos2, sin2) = if radius > 0.0 { (half_difference / radius, xy / radius) } else { (1.0, 0.0) };
    let (mean, spread) = (0.5 * (1.0 / large + 1.0 / small), 0.5 * (1.0 / large - 1.0 / small));
    Some([
        MINUS_HALF_LOG2_E * (mean + spread * cos2),
        MINUS_HALF_LOG2_E * (2.0 * spread * sin2),
        MINUS_HALF_LOG2_E * (mean - spread * cos2),
    ])
}
