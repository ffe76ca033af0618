//! A circle through the near side of something round: least squares over ranges and over the two edges.
//!
//! A short arc of a circle says little of its radius, which an algebraic fit makes too small. Here the beams that just met it and those that
//! just missed it say how wide it is, and what is known of its radius beforehand counts as one more measurement. Gauss-Newton in range and
//! bearing of the centre and the radius; the inverse of its normal matrix is the covariance.

use nalgebra::{Matrix2, Matrix3, Vector3};

use super::chi_squared;
use super::wrap_angle;
use crate::scan::{Beam, Echo};

/// Beams that met it, in order of bearing, and where its edges must be.
#[derive(Debug, Clone, Copy)]
pub struct Arc<'a> {
    /// Each a hit.
    pub beams: &'a [Beam],
    /// The edge on the right, rad: half way to the beam that missed it.
    pub begin_rad: f64,
    /// The edge on the left, rad.
    pub end_rad: f64,
    /// From the beams that missed it to those that met it, right and left, rad: the edges are known to half of that.
    pub steps_rad: [f64; 2],
    /// About how far it is, m.
    pub range_m: f64,
    /// Deviation of a range, m.
    pub noise_m: f64,
}

/// What is known of a radius.
#[derive(Debug, Clone, Copy)]
pub struct Radius {
    /// m.
    pub mean_m: f64,
    /// m.
    pub deviation_m: f64,
}

/// A circle in the lrf frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Circle {
    /// Distance of its centre, m.
    pub range_m: f64,
    /// Bearing of its centre, rad.
    pub bearing_rad: f64,
    /// Its radius, m.
    pub radius_m: f64,
    /// Covariance of range (m) and bearing (rad) of the centre.
    pub covariance: Matrix2<f64>,
}

/// Steps of Gauss-Newton at most; a handful are enough.
const STEPS: usize = 12;
/// Beams that graze it farther from its centre than this share of its radius say little of its range, and that wrongly.
const GRAZING: f64 = 0.9;
/// The fit may be so many deviations of the normal distribution too bad.
const MISFIT_DEVIATIONS: f64 = 3.0;

/// Normal equations of one step, and how well the circle fits.
struct Normal {
    matrix: Matrix3<f64>,
    side: Vector3<f64>,
    squared: f64,
    residuals: usize,
}

impl Normal {
    fn add(&mut self, by: Vector3<f64>, off: f64, deviation: f64) {
        let weight = 1.0 / (deviation * deviation);
        self.matrix += by * by.transpose() * weight;
        self.side += by * (off * weight);
        self.squared += off * off * weight;
        self.residuals += 1;
    }
}

/// Fits a circle; `None` if none fits, or numbers are not finite.
pub fn fit(arc: &Arc<'_>, radius: &Radius) -> Option<Circle> {
    let middle = 0.5 * (arc.begin_rad + arc.end_rad);
    let half = 0.5 * (arc.end_rad - arc.begin_rad);
    if !(half > 0.0 && half < 1.2 && arc.range_m > 0.0) {
        return None;
    }
    // The edges say how wide it is, as it is seen from here.
    let start = (arc.range_m * libm::sin(half) / (1.0 - libm::sin(half)).max(0.1)).clamp(1e-3, 4.0 * radius.mean_m);
    let mut at = Vector3::new(arc.range_m + start, 0.0, start);
    for _ in 0..STEPS {
        let normal = equations(arc, radius, middle, &at);
        let step = normal.matrix.try_inverse()? * normal.side;
        at += step;
        at.z = at.z.clamp(1e-3, 10.0 * radius.mean_m);
        at.x = at.x.max(at.z * 1.01 + 1e-3);
        if !at.iter().all(|number| number.is_finite()) {
            return None;
        }
        if step.norm() < 1e-7 {
            break;
        }
    }
    let normal = equations(arc, radius, middle, &at);
    let covariance = normal.matrix.try_inverse()?.fixed_view::<2, 2>(0, 0).into_owned();
    let freedoms = normal.residuals.checked_sub(3)?.max(1);
    let fits = normal.squared <= chi_squared(freedoms, MISFIT_DEVIATIONS);
    fits.then(|| Circle { range_m: at.x, bearing_rad: wrap_angle(middle + at.y), radius_m: at.z, covariance })
}

/// * `at` — range of the centre, its bearing from `middle`, radius
fn equations(arc: &Arc<'_>, radius: &Radius, middle: f64, at: &Vector3<f64>) -> Normal {
    let [range, bearing, r] = (*at).into();
    let mut normal = Normal { matrix: Matrix3::zeros(), side: Vector3::zeros(), squared: 0.0, residuals: 0 };
    for beam in arc.beams {
        let Echo::Hit(measured) = beam.echo else { continue };
        let (sin, cos) = libm::sincos(f64::from(beam.bearing_rad) - middle - bearing);
        let across = range * sin;
        if across.abs() > GRAZING * r {
            continue;
        }
        let depth = libm::sqrt(r * r - across * across);
        let by = Vector3::new(cos + across * sin / depth, across - across * range * cos / depth, -r / depth);
        normal.add(by, f64::from(measured) - (range * cos - depth), arc.noise_m);
    }
    // Half the angle under which it is seen, and its slopes.
    let half = libm::asin((r / range).min(0.99));
    let by_radius = 1.0 / libm::sqrt((range * range - r * r).max(1e-9));
    let by_range = -r / range * by_radius;
    let [right, left] = arc.steps_rad.map(|step| step / libm::sqrt(12.0));
    normal.add(Vector3::new(by_range, 1.0, by_radius), arc.end_rad - middle - bearing - half, left);
    normal.add(Vector3::new(-by_range, 1.0, -by_radius), arc.begin_rad - middle - bearing + half, right);
    normal.add(Vector3::new(0.0, 0.0, 1.0), radius.mean_m - r, radius.deviation_m);
    normal
}
