//! SLAM on point landmarks: reflectors, posts, trunks, barcodes (thesis §4.1 and §4.2).
//!
//! [`Control`] → [`Travel`](travel::Travel) → robot's pose; [`Sighting`] → landmark → pose and map. Two filters have the same inputs:
//! [`EkfSlam`](ekf::EkfSlam), one Gaussian over robot and all landmarks, and [`FastSlam`](fast::FastSlam), particles that each have a map.
//!
//! Sightings come from a file, or from a laser by [`detect`](mod@detect).
//!
//! * Both estimate two scales of the odometry beside the pose: true distance over reported distance, and the same for turns.
//! * Numbers are `f64`: what landmarks have in common leaves a covariance near singular, which `f32` cannot hold.
//! * Memory is lent by the caller, its size is fixed, and no input makes it grow; a full pool is counted, not a fault.
//! * The same inputs and seed give the same bits on every machine.
//!
//! Frames are those of the [crate]: map, robot, lrf. Angles are radians, in (−π, π].

pub mod assignment;
pub mod belief;
pub mod circle;
pub mod covariance;
pub mod detect;
pub mod ekf;
pub mod fast;
pub mod sight;
pub mod travel;

use core::f64::consts::PI;

use nalgebra::{Matrix2, SMatrix, SVector};

/// Numbers of the robot in a state: x, y (m), heading (rad), scale of distances, scale of turns.
pub const ROBOT: usize = 5;
/// State of the robot, see [`ROBOT`].
pub type RobotState = SVector<f64, ROBOT>;
/// Its covariance.
pub type RobotCovariance = SMatrix<f64, ROBOT, ROBOT>;

/// What moved the robot since the last control, as it was commanded or measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Control {
    /// Velocities held for a time (thesis eq. 4.1, left): forward m/s, counter-clockwise rad/s, s.
    Velocity {
        /// Forward, m/s.
        forward_m_s: f64,
        /// Counter-clockwise, rad/s.
        turn_rad_s: f64,
        /// How long, s.
        seconds: f64,
    },
    /// Odometry (thesis eq. 4.1, right): way driven and angle turned, with the time it took.
    Odometry {
        /// Forward, m.
        distance_m: f64,
        /// Counter-clockwise, rad.
        turn_rad: f64,
        /// How long, s; only the clock of correlated errors needs it.
        seconds: f64,
    },
}

/// A landmark seen: in polar coordinates of the lrf frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sighting {
    /// Distance, m, over 0.
    pub range_m: f64,
    /// Counter-clockwise from forward, rad.
    pub bearing_rad: f64,
    /// Which landmark it is, if the sensor tells.
    pub identity: Option<u16>,
    /// Covariance of range (m) and bearing (rad), if it is known of this sighting; else that of the configuration.
    pub noise: Option<Matrix2<f64>>,
}

/// What became of a sighting.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Fate {
    /// Not used: between landmarks, too far from the one it claims to be, or not finite.
    #[default]
    Refused,
    /// Of the landmark of this [number](ekf::Landmark::number); with FastSLAM, of this index in its particle's map.
    Matched(u16),
    /// Began the landmark of this number, or index.
    Began(u16),
    /// Would have begun a landmark, but there is no room.
    Full,
}

/// What a batch of sightings did, by [`Fate`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SightingCounts {
    /// Of a landmark that was known.
    pub matched: u32,
    /// Of a new one.
    pub began: u32,
    /// Not used.
    pub refused: u32,
    /// No room for a new one.
    pub full: u32,
    /// Landmarks taken out: nobody saw them again, or what claimed to be them never fitted.
    pub removed: u32,
}

impl SightingCounts {
    /// Counts `fate`.
    pub fn count(&mut self, fate: Fate) {
        match fate {
            Fate::Matched(_) => self.matched += 1,
            Fate::Began(_) => self.began += 1,
            Fate::Refused => self.refused += 1,
            Fate::Full => self.full += 1,
        }
    }
}

crate::config_choice! {
    /// Who says which landmark a sighting is of.
    pub enum Association {
        /// The sensor: sightings have identities.
        Known = "known",
        /// The nearest landmark in Mahalanobis' distance, each sighting for itself.
        Nearest = "nearest",
        /// The most sightings that fit together (JCBB, Neira & Tardós 2001); FastSLAM takes the nearest, since each particle knows its pose.
        Joint = "joint",
    }
    choices "\"known\", \"nearest\" or \"joint\""
}

crate::config! {
    /// Landmark SLAM: noise of motion and sensor, association, upkeep of the map.
    pub struct LandmarkConfig {
        /// α1 of table 4.1: deviation of the forward velocity per forward velocity.
        alpha_1: f32 = 0.1, in 0.0..=10.0;
        /// α2: deviation of the forward velocity per turning velocity, m/rad.
        alpha_2: f32 = 0.01, in 0.0..=10.0;
        /// α3: deviation of the turning velocity per forward velocity, rad/m.
        alpha_3: f32 = 0.2, in 0.0..=10.0;
        /// α4: deviation of the turning velocity per turning velocity.
        alpha_4: f32 = 0.2, in 0.0..=10.0;
        /// α5: deviation of the final rotation per forward velocity, rad/m.
        alpha_5: f32 = 0.0, in 0.0..=10.0;
        /// α6: deviation of the final rotation per turning velocity.
        alpha_6: f32 = 0.0, in 0.0..=10.0;
        /// An error of velocity or odometry lasts so long, s: 0 draws each step anew, as the thesis does; then noise depends on the rate of controls.
        control_hold_s: f32 = 0.1, in 0.0..=100.0;
        /// Each control errs by this in distance beside, m: what matching errs by.
        step_noise_m: f32 = 0.0, in 0.0..=10.0;
        /// And by this in turning, degrees.
        step_noise_deg: f32 = 0.0, in 0.0..=90.0;
        /// Deviation of the scale of distances at the start; 0 keeps it at 1.
        distance_scale_deviation: f32 = 0.1, in 0.0..=1.0;
        /// Deviation of the scale of turns at the start; 0 keeps it at 1.
        turn_scale_deviation: f32 = 0.1, in 0.0..=1.0;
        /// Deviation of a range, m.
        range_noise_m: f32 = 0.05, in 0.0001..=10.0;
        /// More of it per metre of range.
        range_noise_share: f32 = 0.0, in 0.0..=1.0;
        /// Deviation of a bearing, degrees.
        bearing_noise_deg: f32 = 1.0, in 0.001..=90.0;
        /// The error of one landmark's sighting lasts so long, s: 0 for white noise. Sightings that follow faster count for less.
        sighting_hold_s: f32 = 0.0, in 0.0..=100.0;
        /// Where the sensor is on the robot: forward, m.
        lrf_x_m: f32 = 0.0, in -10.0..=10.0;
        /// Left, m.
        lrf_y_m: f32 = 0.0, in -10.0..=10.0;
        /// Counter-clockwise, degrees.
        lrf_heading_deg: f32 = 0.0, in -180.0..=180.0;
        /// Who says which landmark a sighting is of.
        association: Association = Association::Known;
        /// A sighting fits a landmark up to this quantile of the normal distribution: 2.33 lets 1 % of the true ones go.
        gate_deviations: f32 = 2.33, in 0.0..=10.0;
        /// A sighting begins a landmark if its squared distance to each is so many gates.
        new_landmark_gates: f32 = 3.0, in 1.0..=1000.0;
        /// From here on a sighting that fits badly counts for less, in deviations (Huber); large: never.
        huber_deviations: f32 = 1.5, in 0.5..=1000.0;
        /// A landmark stays if it was seen so many times; only with unknown association.
        confirm_sightings: u16 = 3, in 1..=1000;
        /// It has so many batches of sightings for that.
        confirm_batches: u16 = 30, in 1..=60_000;
        /// So many misfits in a row, and more than it ever had fits, take a landmark out.
        misfits_max: u16 = 8, in 1..=1000;
        /// Invariant EKF (right-invariant error): does not take the heading to be known better than it can be.
        invariant: bool = true;
        /// FastSLAM proposes poses by what is seen (2.0); false proposes them by motion alone (1.0, thesis table 4.2).
        fast_proposal: bool = true;
        /// FastSLAM 2.0: share of the kernel that each drawn pose stands for; 0 takes drawn poses for certain.
        fast_kernel: f32 = 0.0, in 0.0..=10.0;
        /// FastSLAM: share of sightings that say nothing.
        outlier_share: f32 = 0.02, in 0.0..=0.9;
    }
}

/// Angle wrapped into (−π, π]. Non-finite input gives NaN.
pub fn wrap_angle(angle: f64) -> f64 {
    if angle > -PI && angle <= PI {
        return angle;
    }
    let wrapped = libm::remainder(angle, 2.0 * PI);
    if wrapped <= -PI { PI } else { wrapped }
}

/// Quantile of chi-squared with `freedoms` degrees at the normal quantile `deviations` (Wilson & Hilferty 1931): within 1 % from 2 degrees on.
pub fn chi_squared(freedoms: usize, deviations: f64) -> f64 {
    let n = freedoms.max(1) as f64;
    let root = 1.0 - 2.0 / (9.0 * n) + deviations * libm::sqrt(2.0 / (9.0 * n));
    n * root * root * root
}

#[cfg(test)]
mod tests;
