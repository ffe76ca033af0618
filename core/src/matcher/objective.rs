//! What the search maximises, and the climb to its nearest summit.

use nalgebra::{Matrix3, Vector3};

use super::{MatcherConfig, Prediction};
use crate::geometry::{Point2, Pose2};
use crate::math::wrap_angle;
use crate::ndt::{Linearisation, NdtGrid};

/// Penalty for departing from the predicted motion, ½ Σ (δ/σ)², in the robot's frame.
#[derive(Clone, Copy)]
pub(super) struct Prior {
    pub(super) predicted: Pose2,
    /// 1/σ² for position and heading.
    pub(super) position: f32,
    pub(super) heading: f32,
}

impl Prior {
    pub(super) fn new(config: &MatcherConfig, prediction: &Prediction) -> Self {
        let times = &prediction.prior;
        let inverse_square =
            |times: f32, sigma: f32| if sigma > 0.0 { 1.0 / (times * times * sigma * sigma) } else { 0.0 };
        Self {
            predicted: prediction.map_from_robot,
            position: inverse_square(times.position, config.prior_position_m),
            heading: inverse_square(times.heading, config.prior_heading_deg.to_radians()),
        }
    }

    pub(super) fn departure(&self, pose: Pose2) -> Vector3<f32> {
        Vector3::new(
            pose.x - self.predicted.x,
            pose.y - self.predicted.y,
            wrap_angle(pose.heading - self.predicted.heading),
        )
    }

    pub(super) fn penalty(&self, pose: Pose2) -> f32 {
        let d = self.departure(pose);
        0.5 * (self.position * (d.x * d.x + d.y * d.y) + self.heading * d.z * d.z)
    }
}

/// What is maximised: score minus the prior's penalty.
#[derive(Clone, Copy)]
pub(super) struct Objective<'a, 'm> {
    pub(super) ndt: &'a NdtGrid<'m>,
    pub(super) points: &'a [Point2],
    /// How many points each of them stands for.
    pub(super) weight: f32,
    pub(super) prior: Prior,
}

impl<'a, 'm> Objective<'a, 'm> {
    pub(super) fn new(ndt: &'a NdtGrid<'m>, points: &'a [Point2], prior: Prior) -> Self {
        Self { ndt, points, weight: 1.0, prior }
    }

    /// About the same with fewer points.
    pub(super) fn of_some<'b>(&self, points: &'b [Point2]) -> Objective<'b, 'm>
    where
        'a: 'b,
    {
        let weight = self.points.len() as f32 / points.len().max(1) as f32;
        Objective { ndt: self.ndt, points, weight, prior: self.prior }
    }

    /// Its value at `pose`, or some value below `at_least` if it is below that.
    pub(super) fn value(&self, pose: Pose2, at_least: f32) -> f32 {
        let penalty = self.prior.penalty(pose);
        self.weight * self.ndt.search_score(self.points, pose, (at_least + penalty) / self.weight) - penalty
    }

    /// Climbs to the local maximum near `start` by damped Newton steps.
    pub(super) fn climb(&self, start: Pose2, steps: u16) -> Summit {
        let mut pose = start;
        let mut damping = 1e-3_f32;
        if steps == 0 {
            return Summit { pose, value: f32::NEG_INFINITY };
        }
        let mut at = self.ndt.linearise(self.points, pose);
        let mut value = at.score - self.prior.penalty(pose);
        for _ in 0..steps {
            let weights = Vector3::new(self.prior.position, self.prior.position, self.prior.heading);
            let gradient = at.gradient - weights.component_mul(&self.prior.departure(pose));
            let Some(step) = newton_step(&at, &weights, &gradient, damping) else { break };
            let next = Pose2::new(pose.x + step.x, pose.y + step.y, pose.heading + step.z);
            let there = self.ndt.linearise(self.points, next);
            let next_value = there.score - self.prior.penalty(next);
            if next_value > value {
                (pose, at, value) = (next, there, next_value);
                damping = (0.1 * damping).max(1e-5);
            } else {
                damping *= 10.0;
            }
            if step.x.abs() < 1e-4 && step.y.abs() < 1e-4 && step.z.abs() < 1e-5 {
                break;
            }
        }
        Summit { pose, value }
    }
}

/// Newton's step up the hill, with the Gauss–Newton matrix where the true one does not curve downwards all round.
fn newton_step(
    at: &Linearisation,
    prior: &Vector3<f32>,
    gradient: &Vector3<f32>,
    damping: f32,
) -> Option<Vector3<f32>> {
    let damped = |curvature: &Matrix3<f32>| {
        let curvature = curvature + Matrix3::from_diagonal(prior);
        let diagonal = curvature.diagonal() * damping + Vector3::repeat(1e-6);
        curvature + Matrix3::from_diagonal(&diagonal)
    };
    let factors = damped(&at.hessian).cholesky().or_else(|| damped(&at.information).cholesky())?;
    Some(factors.solve(gradient))
}

/// Where a climb ended.
#[derive(Clone, Copy)]
pub(super) struct Summit {
    pub(super) pose: Pose2,
    pub(super) value: f32,
}
