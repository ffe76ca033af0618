//! One step of the robot with its noise and Jacobians: velocity (thesis table 4.1) and odometry (eq. 4.4, 4.46), with scales as states.
//!
//! Both drive an arc of length d and angle b: the chord d · sin(b/2)/(b/2) in the direction θ + b/2. That is table 4.1 with v̂ Δt = d and
//! ω̂ Δt = b, without its division by ω̂; for small b it is eq. (4.46) with C = 0.

use nalgebra::Matrix5;

use super::{Control, LandmarkConfig, RobotCovariance, RobotState, wrap_angle};

/// What the robot reported, and the variances of what it did.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Travel {
    /// Reported length of the arc, m.
    pub distance_m: f64,
    /// Reported angle of the arc, rad.
    pub turn_rad: f64,
    /// How long it took, s.
    pub seconds: f64,
    /// Variance of the length, m².
    pub distance_variance: f64,
    /// Variance of the angle, rad².
    pub turn_variance: f64,
    /// Variance of a rotation at the end, rad² (γ̂ of table 4.1).
    pub heading_variance: f64,
}

impl Travel {
    /// Of `control`, by table 4.1: deviations linear in |v| and |ω|; `None` if a number is not finite or time runs back.
    ///
    /// Departure: an error lasts for `control_hold_s`, where it is longer than the step: then variances of a way do not depend on its number of steps.
    pub fn new(control: &Control, config: &LandmarkConfig) -> Option<Self> {
        let (distance_m, turn_rad, seconds) = match *control {
            Control::Velocity { forward_m_s, turn_rad_s, seconds } => {
                (forward_m_s * seconds, turn_rad_s * seconds, seconds)
            }
            Control::Odometry { distance_m, turn_rad, seconds } => (distance_m, turn_rad, seconds),
        };
        if !(distance_m.is_finite() && turn_rad.is_finite() && seconds.is_finite() && seconds >= 0.0) {
            return None;
        }
        let repeats = if seconds > 0.0 { (f64::from(config.control_hold_s) / seconds).max(1.0) } else { 1.0 };
        let variance = |of_distance: f32, of_turn: f32| {
            let deviation = f64::from(of_distance) * distance_m.abs() + f64::from(of_turn) * turn_rad.abs();
            deviation * deviation * repeats
        };
        Some(Self {
            distance_m,
            turn_rad,
            seconds,
            distance_variance: variance(config.alpha_1, config.alpha_2) + squared(config.step_noise_m),
            turn_variance: variance(config.alpha_3, config.alpha_4) + squared(config.step_noise_deg.to_radians()),
            heading_variance: variance(config.alpha_5, config.alpha_6),
        })
    }

    /// The robot's state after the step, without noise.
    pub fn moved(&self, robot: &RobotState) -> RobotState {
        let [x, y, heading, distance_scale, turn_scale] = (*robot).into();
        let (distance, turn) = (distance_scale * self.distance_m, turn_scale * self.turn_rad);
        let (sin, cos) = libm::sincos(heading + 0.5 * turn);
        let chord = distance * half_sinc(turn).0;
        RobotState::new(x + chord * cos, y + chord * sin, wrap_angle(heading + turn), distance_scale, turn_scale)
    }

    /// Jacobian of [`moved`](Self::moved) by the state (eq. 4.5), and the covariance of the step's noise in it (eq. 4.6, 4.7).
    pub fn jacobian_and_noise(&self, robot: &RobotState) -> (RobotCovariance, RobotCovariance) {
        let [_, _, heading, distance_scale, turn_scale] = (*robot).into();
        let (distance, turn) = (distance_scale * self.distance_m, turn_scale * self.turn_rad);
        let (sin, cos) = libm::sincos(heading + 0.5 * turn);
        let (sinc, slope) = half_sinc(turn);
        let chord = distance * sinc;
        // By the length and the angle of the arc.
        let by_distance = RobotState::new(sinc * cos, sinc * sin, 0.0, 0.0, 0.0);
        let by_turn = RobotState::new(
            distance * slope * cos - 0.5 * chord * sin,
            distance * slope * sin + 0.5 * chord * cos,
            1.0,
            0.0,
            0.0,
        );
        let mut jacobian = Matrix5::identity();
        (jacobian.m13, jacobian.m23) = (-chord * sin, chord * cos);
        jacobian.fixed_view_mut::<3, 1>(0, 3).copy_from(&(by_distance.fixed_rows::<3>(0) * self.distance_m));
        jacobian.fixed_view_mut::<3, 1>(0, 4).copy_from(&(by_turn.fixed_rows::<3>(0) * self.turn_rad));
        let mut noise = by_distance * by_distance.transpose() * self.distance_variance
            + by_turn * by_turn.transpose() * self.turn_variance;
        noise.m33 += self.heading_variance;
        (jacobian, noise)
    }
}

/// sin(b/2)/(b/2) and its derivative by b; by their series near 0.
fn half_sinc(b: f64) -> (f64, f64) {
    if b.abs() < 1e-3 {
        return (1.0 - b * b / 24.0, -b / 12.0 + b * b * b / 480.0);
    }
    let (sin, cos) = libm::sincos(0.5 * b);
    let sinc = sin / (0.5 * b);
    (sinc, (cos - sinc) / b)
}

fn squared(deviation: f32) -> f64 {
    f64::from(deviation) * f64::from(deviation)
}

/// The covariance of a robot at the start: where it is, is the map's origin; its scales are not known.
pub fn start_covariance(config: &LandmarkConfig) -> RobotCovariance {
    let [of_distance, of_turn] = [config.distance_scale_deviation, config.turn_scale_deviation].map(squared);
    RobotCovariance::from_diagonal(&RobotState::new(0.0, 0.0, 0.0, of_distance, of_turn))
}
