//! Where a particle may have gone: a motion to sample from, given what was measured and its noise.
//!
//! The low level's is [`ScanMatchingMotion`] (thesis table 4.7). The thesis' models of wheel odometry (eq. 4.46) and of commanded velocities
//! (table 4.1) are not here: a robot's odometry, where there is one, predicts the match instead.
//!
//! A model is made for one step and sampled once for each particle, with that sample's own random stream.

use nalgebra::{Matrix3, Vector3};
use rand_core::Rng;

use crate::geometry::{Point2, Pose2};
use crate::math::{normal, sin_cos};

/// A motion that can be sampled.
pub trait Motion {
    /// A pose that the robot may have now if it was at `map_from_robot` before.
    fn sample(&self, map_from_robot: Pose2, rng: &mut impl Rng) -> Pose2;

    /// True where the scene leaves an axis undetermined: every particle is a guess of its own.
    fn is_open(&self) -> bool {
        false
    }

    /// True where nothing tells the speed: it goes on as it was, for the whole stretch.
    fn carries_speed(&self) -> bool {
        false
    }

    /// The same if the speed carried on is off by so many standard deviations.
    fn sample_at_speed(&self, map_from_robot: Pose2, _speed: f32, rng: &mut impl Rng) -> Pose2 {
        self.sample(map_from_robot, rng)
    }
}

crate::config! {
    /// Motion model from scan matching (thesis table 4.7): standard deviations of the matcher's errors, for one step of the filter. The thesis measures
    /// them and states no numbers. Only errors that add up belong here: those that a later match in the same map corrects would shake particles off
    /// the matched path. `lrfslam calibrate` tells the two apart. On the
    /// Intel log it finds 0.0002 m, 0.0002 m, 0.004 degrees; a quarter of that and less is the default, since the laser cannot tell such particles apart and their
    /// noise is what remains of the choice.
    pub struct ScanMatchingMotionConfig {
        /// Forward, m.
        forward_m: f32 = 0.00005, in 0.0..=1.0;
        /// Lateral, m.
        lateral_m: f32 = 0.00005, in 0.0..=1.0;
        /// Heading, degrees.
        heading_deg: f32 = 0.0005, in 0.0..=45.0;
        /// Along an axis that the scene leaves undetermined, m, instead of believing the matcher. Fitted: 0.013 on Intel, 0.022 on ACES. The
        /// thesis: 0, none.
        undetermined_m: f32 = 0.0125, in 0.0..=2.0;
    }
}

/// What a scan match says about a motion, in the frame of the robot before it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct MatchedMotion {
    /// Pose of the robot now, seen from where it was.
    pub previous_from_robot: Pose2,
    /// Unit vector about which the scene says nothing.
    pub undetermined: Option<Point2>,
}

impl MatchedMotion {
    /// The same in the robot's frame from what a matcher found in its map: poses before and now, and the axis there.
    pub fn from_map(map_from_previous: Pose2, map_from_robot: Pose2, undetermined: Option<Point2>) -> Self {
        let (sin, cos) = sin_cos(-map_from_previous.heading);
        Self {
            previous_from_robot: map_from_previous.between(map_from_robot),
            undetermined: undetermined
                .map(|axis| Point2::new(cos * axis.x - sin * axis.y, sin * axis.x + cos * axis.y)),
        }
    }
}

/// Table 4.7: the matched displacement with Gaussian noise on each of its three numbers.
///
/// Departures: noise may be correlated (widened along an undetermined axis); lines 4–7 of the table,
/// d cos(θ + atan2(Δŷ, Δx̂)), are a rotation by θ and are written as one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScanMatchingMotion {
    displacement: Pose2,
    /// Part of the displacement that one standard deviation of the speed carried on adds or takes away; zero where it is not carried.
    speed: Point2,
    /// Lower triangle with L Lᵀ = covariance of the noise.
    noise: Matrix3<f32>,
    is_open: bool,
}

impl ScanMatchingMotion {
    /// The model for one match.
    pub fn new(config: &ScanMatchingMotionConfig, matched: &MatchedMotion) -> Self {
        let displacement = matched.previous_from_robot;
        let deviations = Vector3::new(config.forward_m, config.lateral_m, config.heading_deg.to_radians());
        let mut covariance = Matrix3::from_diagonal(&deviations.component_mul(&deviations));
        if let Some(axis) = matched.undetermined {
            let along = Vector3::new(axis.x, axis.y, 0.0) * config.undetermined_m;
            covariance += along * along.transpose();
        }
        let (speed, noise) = (Point2::default(), lower_triangle(&covariance));
        Self { displacement, speed, noise, is_open: matched.undetermined.is_some() }
    }

    /// The same where matches are against the last scans: along an undetermined axis the speed may be wrong, and goes on to be.
    #[must_use]
    pub(crate) fn with_speed_of(self, matched: &MatchedMotion) -> Self {
        let along =
            |axis: Point2| axis * (CARRIED_SPEED * (axis.x * self.displacement.x + axis.y * self.displacement.y));
        Self { speed: matched.undetermined.map_or(self.speed, along), ..self }
    }
}

/// Error that a usual step of a filter adds where nothing but the last scans is matched against, m …
const DRIFT_M: f32 = 0.0015;
/// … and degrees: chosen so that particles cover the drift of simulated loops, with laser noise of 5 to 40 mm.
const DRIFT_DEG: f32 = 0.02;

/// Share of a speed carried on that it is off by. Chosen.
const CARRIED_SPEED: f32 = 0.03;

impl ScanMatchingMotionConfig {
    /// The noise where matches are against the last scans, so that their errors add up; `steps` usual ones are taken together.
    pub(crate) fn drifting(&self, steps: f32) -> Self {
        let add = |sigma: f32, drift: f32| libm::sqrtf(sigma * sigma + steps.max(1.0) * drift * drift);
        Self {
            forward_m: add(self.forward_m, DRIFT_M),
            lateral_m: add(self.lateral_m, DRIFT_M),
            heading_deg: add(self.heading_deg, DRIFT_DEG),
            ..*self
        }
    }
}

impl Motion for ScanMatchingMotion {
    fn sample(&self, map_from_robot: Pose2, rng: &mut impl Rng) -> Pose2 {
        self.sample_at_speed(map_from_robot, 0.0, rng)
    }

    fn is_open(&self) -> bool {
        self.is_open
    }

    fn carries_speed(&self) -> bool {
        self.speed != Point2::default()
    }

    fn sample_at_speed(&self, map_from_robot: Pose2, speed: f32, rng: &mut impl Rng) -> Pose2 {
        let draws = Vector3::new(normal(rng), normal(rng), normal(rng));
        let noise = self.noise * draws;
        let Pose2 { x, y, heading } = self.displacement;
        map_from_robot
            * Pose2::new(x + speed * self.speed.x + noise.x, y + speed * self.speed.y + noise.y, heading + noise.z)
    }
}

/// Cholesky's factor; columns without variance of their own stay zero.
fn lower_triangle(a: &Matrix3<f32>) -> Matrix3<f32> {
    let root = |square: f32| if square > 0.0 { libm::sqrtf(square) } else { 0.0 };
    let over = |value: f32, pivot: f32| if pivot > 0.0 { value / pivot } else { 0.0 };
    let l11 = root(a.m11);
    let (l21, l31) = (over(a.m21, l11), over(a.m31, l11));
    let l22 = root(a.m22 - l21 * l21);
    let l32 = over(a.m32 - l31 * l21, l22);
    let l33 = root(a.m33 - l31 * l31 - l32 * l32);
    Matrix3::new(l11, 0.0, 0.0, l21, l22, 0.0, l31, l32, l33)
}

#[cfg(test)]
mod tests;
