//! One cell: running sums of its points, and the normal distribution they make. All in units of the cell's side, from its centre.

use super::NdtConfig;
use crate::geometry::Point2;
use crate::math::{exp2_neg, floor};

/// Fixed-point units along a cell's side.
const UNITS_PER_CELL: f32 = 256.0;
/// The same for a mean: a cell is all of an `i16`.
const MEAN_UNITS_PER_CELL: f32 = 65_536.0;
/// Bit of the number of points seen in a cell that says that the cell stays as it is.
const FROZEN: u8 = 1 << 7;
/// −½ log₂ e: turns a squared Mahalanobis distance into the exponent of a power of two.
const MINUS_HALF_LOG2_E: f32 = -0.5 * core::f32::consts::LOG2_E;
/// Points that a cell needs before it counts. Source: thesis 2.3.3.
pub(super) const POINTS_MIN: u8 = 3;
/// Points at which a cell's sums are halved, so that old evidence fades: 255 points half a cell from its centre would fill a sum.
const COUNT_MAX: u8 = 240;
/// What a ray that goes through a cell takes away: a point, and one of so many. Chosen.
const WEAKEN_SHARE: u8 = 32;
/// The smaller eigenvalue of a covariance is at least this share of the larger. Source: Biber & Straßer 2003.
const EIGENVALUE_RATIO_MIN: f32 = 0.001;
/// An axis of a distribution with this standard deviation, or less, says all about its direction that an axis can, m.
pub(crate) const SHARP_M: f32 = 0.04;
/// A wall at 45° to a cell's sides that goes through it may seem to go so much farther, cells: its mean is a little off, which tells where a corner is
/// cut, and not at all on a wall parallel to a side. Chosen.
const CHORD_OFF: f32 = 0.1;

/// A signed integer of three bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Int24([u8; 3]);

impl Int24 {
    const ZERO: Self = Self([0; 3]);

    /// The upper byte of `value` is lost.
    fn of(value: i32) -> Self {
        let [low, middle, high, _] = value.to_le_bytes();
        Self([low, middle, high])
    }

    fn get(self) -> i32 {
        let [low, middle, high] = self.0;
        i32::from_le_bytes([0, low, middle, high]) >> 8
    }
}

/// What becomes of a point in a cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Change {
    /// It was seen.
    Add,
    /// It is supposed: added as long as fewer than [`POINTS_MIN`] were seen in the cell. Else those beside far hits would weigh more than the hits, and
    /// what rays have worn off would come back.
    Fill,
    /// It was added, and goes.
    Remove,
}

/// A point in a cell, in units from its centre.
#[derive(Debug, Clone, Copy)]
pub(super) struct CellOffset {
    x: i32,
    y: i32,
}

impl CellOffset {
    /// Of a point at (`u`, `v`) cells from the cell's centre.
    pub(super) fn new(u: f32, v: f32) -> Self {
        Self { x: floor(u * UNITS_PER_CELL + 0.5), y: floor(v * UNITS_PER_CELL + 0.5) }
    }
}

/// Running sums of the points in one cell, as fixed-point offsets from its centre: 16 bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct CellSums {
    count: u8,
    /// So many were seen, [`POINTS_MIN`] at most, and [`FROZEN`].
    seen: u8,
    x: i16,
    y: i16,
    xx: Int24,
    xy: Int24,
    yy: Int24,
}

impl CellSums {
    pub(super) const EMPTY: Self =
        Self { count: 0, seen: 0, x: 0, y: 0, xx: Int24::ZERO, xy: Int24::ZERO, yy: Int24::ZERO };

    /// Adds or removes a point. Halves the evidence once it has reached [`COUNT_MAX`] points.
    ///
    /// Offsets are at most 129 units, so that 240 of them stay below 2¹⁵ and 240 squares below 2²³.
    pub(super) fn update(&mut self, CellOffset { x, y }: CellOffset, change: Change) {
        match change {
            Change::Add => self.seen = self.seen.saturating_add(1).min(POINTS_MIN),
            Change::Fill if self.seen >= POINTS_MIN => return,
            Change::Fill | Change::Remove => {}
        }
        let sign: i8 = if change == Change::Remove { -1 } else { 1 };
        self.count = self.count.saturating_add_signed(sign);
        for (sum, term) in [(&mut self.x, x), (&mut self.y, y)] {
            *sum = sum.wrapping_add((term as i16).wrapping_mul(i16::from(sign)));
        }
        let products = [x.wrapping_mul(x), x.wrapping_mul(y), y.wrapping_mul(y)];
        for (sum, term) in [&mut self.xx, &mut self.xy, &mut self.yy].into_iter().zip(products) {
            *sum = Int24::of(sum.get().wrapping_add(term.wrapping_mul(i32::from(sign))));
        }
        self.fade();
    }

    /// True if no point is in it.
    pub(super) fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// True if it counts, and would without what is supposed.
    #[cfg(feature = "witnesses")]
    pub(super) fn is_seen(&self) -> bool {
        self.count >= POINTS_MIN && self.seen & !FROZEN >= POINTS_MIN
    }

    /// From now on no point is added or removed, if there are [`POINTS_MIN`].
    pub(super) fn freeze(&mut self) {
        if self.count >= POINTS_MIN {
            self.seen |= FROZEN;
        }
    }

    /// True if no point may be added or removed.
    pub(super) fn is_frozen(&self) -> bool {
        self.seen & FROZEN != 0
    }

    fn fade(&mut self) {
        if self.count >= COUNT_MAX {
            self.count /= 2;
            (self.x, self.y) = (self.x / 2, self.y / 2);
            for sum in [&mut self.xx, &mut self.xy, &mut self.yy] {
                *sum = Int24::of(sum.get() / 2);
            }
        }
    }

    /// Takes a share of the points away, one at least; mean and spread stay. A cell of [`COUNT_MAX`] points is gone after some 60 times.
    pub(super) fn weaken(&mut self) {
        let left = self.count.saturating_sub(1 + self.count / WEAKEN_SHARE);
        let share = f32::from(left) / f32::from(self.count.max(1));
        let part = |sum: i32| floor(sum as f32 * share + 0.5);
        self.count = left;
        (self.x, self.y) = (part(i32::from(self.x)) as i16, part(i32::from(self.y)) as i16);
        for sum in [&mut self.xx, &mut self.xy, &mut self.yy] {
            *sum = Int24::of(part(sum.get()));
        }
    }

    /// Mean and covariance, guarded; an empty distribution if there are too few points.
    pub(super) fn gaussian(&self, config: &NdtConfig) -> Gaussian {
        if self.count < POINTS_MIN {
            return Gaussian::EMPTY;
        }
        let n = f32::from(self.count);
        let (mx, my) = (f32::from(self.x) / n, f32::from(self.y) / n);
        let scale = n / (n - 1.0) / (UNITS_PER_CELL * UNITS_PER_CELL);
        let noise = config.noise_m / config.cell_size_m;
        let spread = |squares: Int24, mean: f32| (squares.get() as f32 / n - mean * mean).max(0.0) * scale;
        let (xx, yy) = (spread(self.xx, mx) + noise * noise, spread(self.yy, my) + noise * noise);
        let xy = (self.xy.get() as f32 / n - mx * my) * scale;
        // The conversion saturates.
        let mean = [mx, my].map(|mean| floor(mean * (MEAN_UNITS_PER_CELL / UNITS_PER_CELL) + 0.5) as f32 as i16);
        scaled_inverse(xx, xy, yy, EIGENVALUE_RATIO_MIN).map_or(Gaussian::EMPTY, |scaled| Gaussian { mean, scaled })
    }
}

/// A cell's normal distribution, ready to be evaluated: 16 bytes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Gaussian {
    /// q: mean, in 1/65536 of a cell's side from the cell's centre.
    pub(super) mean: [i16; 2],
    /// Σ⁻¹ as (xx, 2 xy, yy), times −½ log₂ e: the first is below 0, or the cell does not count.
    pub(super) scaled: [f32; 3],
}

impl Gaussian {
    /// A cell that does not count; all zero, so that static pools cost no flash.
    pub(super) const EMPTY: Self = Self { mean: [0; 2], scaled: [0.0; 3] };

    /// False for a cell with too few points.
    #[inline(always)]
    pub(super) fn counts(&self) -> bool {
        self.scaled[0] < 0.0
    }

    /// Mean, cells from the cell's centre.
    #[inline(always)]
    pub(super) fn mean(&self) -> [f32; 2] {
        let [x, y] = self.mean;
        [in_cells(i32::from(x)), in_cells(i32::from(y))]
    }

    /// exp(−½ dᵀ Σ⁻¹ d) for a point at `d` from the mean, cells.
    #[inline(always)]
    pub(super) fn density(&self, d: Point2) -> f32 {
        density(self.scaled, d.x, d.y)
    }

    /// Σ⁻¹ as (xx, xy, yy), per squared cell.
    pub(super) fn information(&self) -> [f32; 3] {
        let [xx, xy2, yy] = self.scaled;
        [xx / MINUS_HALF_LOG2_E, 0.5 * xy2 / MINUS_HALF_LOG2_E, yy / MINUS_HALF_LOG2_E]
    }

    /// What the cell says about each direction, 0 to 1, as (xx, xy, yy); see `NdtGrid::constraint`.
    #[inline(never)]
    pub(super) fn worth(&self, config: &NdtConfig) -> [f32; 3] {
        let [xx, xy, yy] = self.information();
        let (half_trace, half_difference) = (0.5 * (xx + yy), 0.5 * (xx - yy));
        let radius = libm::sqrtf(half_difference * half_difference + xy * xy);
        let (noise, sharp) = (config.noise_m / config.cell_size_m, SHARP_M / config.cell_size_m);
        let worth = |information: f32, whole: f32| {
            let even_spread = whole * whole * (1.0 / 12.0) + noise * noise;
            (sharp * sharp * (information - 1.0 / even_spread)).clamp(0.0, 1.0)
        };
        let (cos2, sin2) = if radius > 0.0 { (half_difference / radius, xy / radius) } else { (1.0, 0.0) };
        let (normal, along) = (worth(half_trace + radius, 1.0), worth(half_trace - radius, self.chord(cos2, sin2)));
        let (mean, spread) = (0.5 * (normal + along), 0.5 * (normal - along));
        [mean + spread * cos2, spread * sin2, mean - spread * cos2]
    }

    /// How long the cell cuts a wall through its mean, cells, but for what the mean may be off; the wall's normal has the direction (cos 2a, sin 2a).
    fn chord(&self, cos2: f32, sin2: f32) -> f32 {
        let [x, y] = self.mean();
        // Mirrored, so that the wall goes up to the right.
        let y = if sin2 > 0.0 { -y } else { y };
        let (right, up) = (libm::sqrtf((0.5 - 0.5 * cos2).max(0.0)), libm::sqrtf((0.5 + 0.5 * cos2).max(0.0)));
        let forward = ((0.5 - x) / right).min((0.5 - y) / up);
        let back = ((0.5 + x) / right).min((0.5 + y) / up);
        (forward + back - CHORD_OFF * sin2.abs()).max(0.0)
    }
}

/// A coordinate of a mean, cells from the cell's centre.
#[inline(always)]
pub(super) fn in_cells(mean: i32) -> f32 {
    mean as f32 * (1.0 / MEAN_UNITS_PER_CELL)
}

/// [`Gaussian::density`] of its `scaled`; 0 for a cell that does not count.
#[inline(always)]
pub(super) fn density([xx, xy2, yy]: [f32; 3], dx: f32, dy: f32) -> f32 {
    let density = exp2_neg(dx * (xx * dx + xy2 * dy) + yy * dy * dy);
    if xx < 0.0 { density } else { 0.0 }
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
