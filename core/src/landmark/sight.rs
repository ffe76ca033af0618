//! How a landmark is seen from a pose, and where it is if it is seen: range and bearing (thesis eq. 4.8–4.10, 4.12, 4.22, 4.23).
//!
//! Departures: `atan2` for the thesis' arctan, and the sensor may sit anywhere on the robot (`robot_from_lrf`).

use nalgebra::{Matrix2, Matrix2x3, Matrix3, Vector2, Vector3};

use super::{LandmarkConfig, RobotState, Sighting, wrap_angle};

/// The sensor: where it is on the robot, and how it errs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sensor {
    mount: Vector3<f64>,
    range_noise_m: f64,
    range_noise_share: f64,
    bearing_noise_rad: f64,
    hold_s: f64,
}

/// A landmark as it should be seen: range (m) and bearing (rad), and their Jacobians.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct View {
    /// Range, bearing.
    pub seen: Vector2<f64>,
    /// By the robot's x, y, heading (eq. 4.9, left).
    pub by_robot: Matrix2x3<f64>,
    /// By the landmark's x, y (eq. 4.9, right; 4.23).
    pub by_landmark: Matrix2<f64>,
}

/// A landmark where a sighting puts it: m, and the Jacobians (eq. 4.18, 4.19).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// In the map, m.
    pub at: Vector2<f64>,
    /// By the robot's x, y, heading.
    pub by_robot: Matrix2x3<f64>,
    /// By range and bearing.
    pub by_sighting: Matrix2<f64>,
}

impl Sensor {
    /// As configured.
    pub fn new(config: &LandmarkConfig) -> Self {
        let heading = f64::from(config.lrf_heading_deg).to_radians();
        Self {
            mount: Vector3::new(f64::from(config.lrf_x_m), f64::from(config.lrf_y_m), heading),
            range_noise_m: f64::from(config.range_noise_m),
            range_noise_share: f64::from(config.range_noise_share),
            bearing_noise_rad: f64::from(config.bearing_noise_deg).to_radians(),
            hold_s: f64::from(config.sighting_hold_s),
        }
    }

    /// Covariance of range and bearing (Q, eq. 4.11).
    ///
    /// * `since_s` — since the landmark was seen before. Errors that last for τ leave (1 − ρ)/(1 + ρ) of a sighting's weight, ρ = exp(−t/τ):
    ///   the information of a sampled first-order process. Held to at least a thousandth.
    pub fn noise(&self, range_m: f64, since_s: f64) -> Matrix2<f64> {
        let range = self.range_noise_m + self.range_noise_share * range_m;
        let bearing = self.bearing_noise_rad;
        Matrix2::new(range * range, 0.0, 0.0, bearing * bearing) * self.repeats(since_s)
    }

    /// The same of one sighting, which may tell its own.
    ///
    /// * `range_m` — as it is expected
    pub fn noise_of(&self, sighting: &Sighting, range_m: f64, since_s: f64) -> Matrix2<f64> {
        match sighting.noise {
            Some(own) => own * self.repeats(since_s),
            None => self.noise(range_m, since_s),
        }
    }

    fn repeats(&self, since_s: f64) -> f64 {
        if self.hold_s <= 0.0 {
            return 1.0;
        }
        let rho = libm::exp(-since_s.max(0.0) / self.hold_s);
        ((1.0 + rho) / (1.0 - rho).max(1e-3)).min(1e3)
    }

    /// The sensor's position seen from the robot's, in the map's directions; its heading in the map.
    fn lever(&self, heading: f64) -> (Vector2<f64>, f64) {
        let (sin, cos) = libm::sincos(heading);
        let [x, y, z] = self.mount.into();
        (Vector2::new(cos * x - sin * y, sin * x + cos * y), heading + z)
    }

    /// How the landmark at `landmark` is seen by `robot`; `None` if they are in one place.
    pub fn view(&self, robot: &RobotState, landmark: Vector2<f64>) -> Option<View> {
        let (lever, heading) = self.lever(robot.z);
        let d = landmark - Vector2::new(robot.x, robot.y) - lever;
        let squared = d.norm_squared();
        if squared.is_nan() || squared < 1e-12 {
            return None;
        }
        let range = libm::sqrt(squared);
        let seen = Vector2::new(range, wrap_angle(libm::atan2(d.y, d.x) - heading));
        let by_landmark = Matrix2::new(d.x / range, d.y / range, -d.y / squared, d.x / squared);
        // The lever turns with the robot.
        let turned = by_landmark * Vector2::new(lever.y, -lever.x);
        let by_robot = Matrix2x3::new(
            -by_landmark.m11,
            -by_landmark.m12,
            turned.x,
            -by_landmark.m21,
            -by_landmark.m22,
            turned.y - 1.0,
        );
        Some(View { seen, by_robot, by_landmark })
    }

    /// Where the landmark of `sighting` is if `robot` sees it so (eq. 4.12).
    pub fn place(&self, robot: &RobotState, sighting: &Sighting) -> Place {
        let (lever, heading) = self.lever(robot.z);
        let (sin, cos) = libm::sincos(heading + sighting.bearing_rad);
        let ray = Vector2::new(cos, sin) * sighting.range_m;
        let arm = lever + ray;
        Place {
            at: Vector2::new(robot.x, robot.y) + arm,
            by_robot: Matrix2x3::new(1.0, 0.0, -arm.y, 0.0, 1.0, arm.x),
            by_sighting: Matrix2::new(cos, -ray.y, sin, ray.x),
        }
    }
}

/// Sighting minus expectation; the bearing is wrapped.
pub fn innovation(sighting: &Sighting, view: &View) -> Vector2<f64> {
    Vector2::new(sighting.range_m - view.seen.x, wrap_angle(sighting.bearing_rad - view.seen.y))
}

/// νᵀ S⁻¹ ν and ln det S; `None` if S is not positive definite.
pub fn mahalanobis(innovation: Vector2<f64>, s: &Matrix2<f64>) -> Option<(f64, f64)> {
    let inverse = inverse(s)?;
    Some((innovation.dot(&(inverse * innovation)), libm::log(s.m11 * s.m22 - s.m12 * s.m21)))
}

/// Inverse of a positive definite matrix; `None` for any other.
pub fn inverse(s: &Matrix2<f64>) -> Option<Matrix2<f64>> {
    let determinant = s.m11 * s.m22 - s.m12 * s.m21;
    let is_positive = s.m11 > 0.0 && determinant > 0.0 && determinant.is_finite();
    is_positive.then(|| Matrix2::new(s.m22, -s.m12, -s.m21, s.m11) / determinant)
}

/// Factor on the noise of a sighting at squared distance `squared`: 1 up to `knee` deviations, then growing (Huber's weights).
pub fn huber(squared: f64, knee: f64) -> f64 {
    (libm::sqrt(squared.max(0.0)) / knee).max(1.0)
}

/// The pose block of a robot's covariance.
pub fn pose_block(covariance: &super::RobotCovariance) -> Matrix3<f64> {
    covariance.fixed_view::<3, 3>(0, 0).into_owned()
}
