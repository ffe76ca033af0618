//! Places whose ranges are known in advance, so that a scan can be held to them.

use lrfslam_core::scan::{Echo, RangeScan};
use lrfslam_core::time::Instant;
use lrfslam_firmware_sim::scene::Scene;

/// A round wall whose range tells the direction.
#[derive(Debug, Clone, Copy)]
pub struct Round;

impl Scene for Round {
    fn range_m(&self, _: Instant, bearing_rad: f64) -> Option<f64> {
        Some(round_m(bearing_rad))
    }
}

fn round_m(bearing_rad: f64) -> f64 {
    4.0 + 2.0 * bearing_rad.cos() + bearing_rad.sin()
}

/// True if every range of a scan is what [`Round`] has there, but for a hundredth of a metre.
pub fn is_round(scan: &RangeScan<'_>) -> bool {
    scan.beams.iter().all(|beam| match beam.echo {
        Echo::Hit(range_m) => (f64::from(range_m) - round_m(f64::from(beam.bearing_rad))).abs() < 0.01,
        Echo::Miss => false,
        Echo::Invalid => true,
    })
}

/// A wall all round that goes away from the laser, and is back every two seconds: its range tells when it was measured.
#[derive(Debug, Clone, Copy)]
pub struct Clockwork;

/// µs.
const PERIOD: i64 = 2_000_000;
/// At the beginning of each period, m; and how fast it goes away, m/µs.
const NEAREST_M: f64 = 0.5;
const SPEED: f64 = 3.0e-6;

impl Scene for Clockwork {
    fn range_m(&self, at: Instant, _: f64) -> Option<f64> {
        Some(NEAREST_M + SPEED * at.micros.rem_euclid(PERIOD) as f64)
    }
}

/// By how much the beams of a scan of [`Clockwork`] were stamped later than they were measured, µs, on average; up to a second either way.
/// `None` without a hit.
///
/// * `device_zero` — when the laser's time was zero, on the clock of the stamps
pub fn late_us(scan: &RangeScan<'_>, device_zero: Instant) -> Option<f64> {
    let late = |offset: i64, range_m: f32| {
        let measured = ((f64::from(range_m) - NEAREST_M) / SPEED) as i64;
        let stamped = scan.stamp.micros + offset - device_zero.micros;
        ((stamped - measured + PERIOD / 2).rem_euclid(PERIOD) - PERIOD / 2) as f64
    };
    let all: Vec<f64> = scan
        .beams
        .iter()
        .filter_map(|beam| match beam.echo {
            Echo::Hit(range_m) => Some(late(beam.offset.micros, range_m)),
            Echo::Miss | Echo::Invalid => None,
        })
        .collect();
    // The turn in which the wall comes back has both ends: the median is of neither.
    let mut sorted = all.clone();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied()
}
