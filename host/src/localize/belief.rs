//! How sure a place is: what the scans say for it and against it, and how far the position may be off if it is right.

use lrfslam_core::geometry::Pose2;
use nalgebra::{Matrix3, Vector3};

use super::RIGHT_WITHIN_M;
use crate::mapping::high::drift_variances;
use crate::places::submap::Agreement;

/// Log odds do not go farther than this: no number of scans makes a place surer than 99.3 %, and none less sure than the opposite.
const LOG_ODDS_MAX: f32 = 5.0;

/// Certainty of a place that was found, or given by the user: chosen.
pub(super) const FOUND_CERTAINTY: f32 = 0.95;
/// Standard deviation of the position of such a place, m …
const FOUND_SIGMA_M: f64 = 0.15;
/// … and of its heading, rad.
const FOUND_SIGMA_RAD: f64 = 0.03;
/// Share of the points in known places that lie on walls at which a scan neither confirms nor refutes the place: chosen.
const NEUTRAL_SHARE: f32 = 0.9;
/// How fast scans change the certainty: log odds per metre driven and unit of that share. Chosen.
const EVIDENCE_PER_M: f32 = 10.0;
/// Spread of the map's own error, m: what no scan can undo …
const MAP_SIGMA_M: f32 = 0.02;
/// … and the variance of its heading, rad². Chosen.
const MAP_VARIANCE_RAD2: f64 = 1e-5;
/// The matches' variances are taken this many times as large as each match says: one match errs much as the next. Chosen.
const MATCH_INFLATION: f32 = 4.0;
/// With a smaller share of its points on the map's walls a match says nothing about the position.
const ON_WALLS_MIN: f32 = 0.05;

/// See the [module](self).
#[derive(Debug, Clone, Copy)]
pub(super) struct Belief {
    log_odds: f32,
    covariance: Matrix3<f64>,
}

impl Belief {
    /// A place that has just been found, with the given certainty.
    pub(super) fn new(certainty: f32) -> Self {
        let variances = Vector3::new(FOUND_SIGMA_M.powi(2), FOUND_SIGMA_M.powi(2), FOUND_SIGMA_RAD.powi(2));
        Self { log_odds: (certainty / (1.0 - certainty)).ln(), covariance: Matrix3::from_diagonal(&variances) }
    }

    /// Probability that the place is right, wherever exactly.
    pub(super) fn place_certainty(&self) -> f32 {
        1.0 / (1.0 + (-self.log_odds).exp())
    }

    /// Probability that the position is right to within [`RIGHT_WITHIN_M`]: of the place, times that of a circle under the normal
    /// distribution of the position, taken as round.
    pub(super) fn certainty(&self) -> f32 {
        let variance = 0.5 * (self.covariance[(0, 0)] + self.covariance[(1, 1)]);
        let within = f64::from(RIGHT_WITHIN_M).powi(2);
        self.place_certainty() * (1.0 - (-0.5 * within / variance.max(1e-9)).exp()) as f32
    }

    /// Covariance of (x, y, heading), if the place is right.
    pub(super) fn covariance(&self) -> Matrix3<f64> {
        self.covariance
    }

    /// The robot has moved by `step`, from the heading `heading_rad`.
    pub(super) fn drift(&mut self, step: Pose2, heading_rad: f32) {
        let (sin, cos) = f64::from(heading_rad).sin_cos();
        let (x, y) = (f64::from(step.x), f64::from(step.y));
        let carried = Matrix3::new(1.0, 0.0, -(sin * x + cos * y), 0.0, 1.0, cos * x - sin * y, 0.0, 0.0, 1.0);
        let (position, heading) = drift_variances(step);
        let noise = Matrix3::from_diagonal(&Vector3::new(position, position, heading));
        self.covariance = carried * self.covariance * carried.transpose() + noise;
    }

    /// A scan was matched with the given covariance; `agreement` is how it lies on the map's walls, `moved_m` the way since the last one.
    ///
    /// What lies where the map knows nothing says nothing about the place.
    pub(super) fn observe(&mut self, agreement: Agreement, matched: &Matrix3<f32>, moved_m: f32) {
        let agreeing = 1.0 - agreement.contradicting;
        let evidence = EVIDENCE_PER_M * moved_m * agreement.known * (agreeing - NEUTRAL_SHARE);
        self.log_odds = (self.log_odds + evidence).clamp(-LOG_ODDS_MAX, LOG_ODDS_MAX);
        if agreement.on_walls < ON_WALLS_MIN {
            return;
        }
        let floor = f64::from(MAP_SIGMA_M).powi(2);
        let floor = Matrix3::from_diagonal(&Vector3::new(floor, floor, MAP_VARIANCE_RAD2));
        let measured = matched.cast::<f64>() * f64::from(MATCH_INFLATION / agreement.on_walls) + floor;
        let gain = (self.covariance + measured).try_inverse().map(|inverse| self.covariance * inverse);
        if let Some(gain) = gain {
            // The map's own error is the same from scan to scan: it is not averaged away.
            let fused = (Matrix3::identity() - gain) * self.covariance;
            self.covariance = fused
                .zip_map(&fused.transpose(), |a, b| 0.5 * (a + b))
                .zip_map(&floor, |a, b| if b > 0.0 { a.max(b) } else { a });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn driven(on_walls: f32, contradicting: f32, metres: u32) -> f32 {
        driven_knowing(on_walls / (1.0 - contradicting), on_walls, contradicting, metres)
    }

    fn driven_knowing(known: f32, on_walls: f32, contradicting: f32, metres: u32) -> f32 {
        let mut belief = Belief::new(FOUND_CERTAINTY);
        let matched = Matrix3::from_diagonal_element(1e-4);
        for _ in 0..10 * metres {
            belief.drift(Pose2::new(0.1, 0.0, 0.0), 0.3);
            belief.observe(Agreement { on_walls, contradicting, known }, &matched, 0.1);
        }
        belief.certainty()
    }

    #[test]
    fn walls_where_the_map_is_free_refute_a_place_and_unknown_ones_do_not() {
        assert!(driven(0.95, 0.02, 20) > 0.98);
        assert!(driven(0.5, 0.4, 20) < 0.02);
        assert!(driven(0.3, 0.02, 20) > 0.9, "seven of ten points lie where the map ends");
        let (one_against, none) = (driven_knowing(0.01, 0.0, 1.0, 8), driven(0.0, 0.0, 8));
        assert!(one_against > 0.9 * none, "one point of a hundred does not make the robot lost: {one_against} {none}");
    }

    #[test]
    fn a_position_gets_less_sure_where_nothing_is_known() {
        let (near, far) = (driven(0.0, 0.0, 5), driven(0.0, 0.0, 500));
        assert!(far < 0.7 * near, "{near} {far}");
    }
}
