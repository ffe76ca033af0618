//! Victoria Park (Nebot): a car among trees, which a laser on its front sees; GPS where the sky is open.
//!
//! Files: `inputs.dat` (t, speed of the left rear wheel in m/s, steering angle in rad), `measurements.dat` (t, range, bearing from the
//! right, diameter), `gps.dat` (t, x, y); plain or gzip.
#![cfg_attr(not(test), deny(clippy::indexing_slicing))]

use std::f64::consts::FRAC_PI_2;
use std::path::Path;

use anyhow::ensure;
use lrfslam_core::geometry::Pose2;
use lrfslam_core::landmark::{Association, LandmarkConfig, Sighting};
use lrfslam_core::time::Instant;

use super::mrclam::{find, in_order, numbers};
use super::{Drive, Velocity, batches, merge};
use crate::trajectory::TimedPose;

/// Between the axles, m.
const WHEELBASE_M: f64 = 2.83;
/// From the middle of the rear axle to the wheel whose speed is measured, m.
const HALF_TRACK_M: f64 = 0.76;
/// The laser, from the middle of the rear axle: forward and left, m.
const LASER_M: [f32; 2] = [3.78, 0.5];

/// Reads the drive.
///
/// # Errors
/// If a file is missing or a line is wrong.
pub fn read(place: &Path) -> anyhow::Result<Drive> {
    let inputs = numbers(&find(place, "inputs.dat")?, "t speed steering")?;
    let seen = numbers(&find(place, "measurements.dat")?, "t range bearing diameter")?;
    let velocities: Vec<Velocity> = in_order(inputs).map(velocity).collect();
    let sightings = in_order(seen).map(|[t, range_m, bearing_rad, _diameter_m]| {
        let sighting = Sighting { range_m, bearing_rad: bearing_rad - FRAC_PI_2, identity: None, noise: None };
        (t, sighting)
    });
    let events = merge(&velocities, batches(sightings));
    ensure!(!events.is_empty(), "{}: neither inputs nor measurements", place.display());
    let truth = match find(place, "gps.dat") {
        Ok(path) => in_order(numbers(&path, "t x y")?).map(fix).collect(),
        Err(_) => Vec::new(),
    };
    let name = format!("{}, Victoria Park", place.display());
    Ok(Drive {
        name,
        events,
        truth,
        has_headings: false,
        landmarks: Vec::new(),
        config: config(),
        detect: None,
        has_identities: false,
    })
}

/// Of the middle of the rear axle: the measured wheel is on the inside of a left turn.
fn velocity([t, wheel_m_s, steering_rad]: [f64; 3]) -> Velocity {
    let tangent = steering_rad.tan();
    let forward_m_s = wheel_m_s / (1.0 - HALF_TRACK_M * tangent / WHEELBASE_M);
    Velocity { t, forward_m_s, turn_rad_s: forward_m_s * tangent / WHEELBASE_M }
}

fn fix([t, x, y]: [f64; 3]) -> TimedPose {
    TimedPose { stamp: Instant::from_secs_f64(t), map_from_robot: Pose2::new(x as f32, y as f32, 0.0) }
}

fn config() -> LandmarkConfig {
    LandmarkConfig {
        alpha_1: 0.1,
        alpha_2: 0.1,
        alpha_3: 0.02,
        alpha_4: 0.2,
        control_hold_s: 0.1,
        range_noise_m: 0.3,
        range_noise_share: 0.0,
        bearing_noise_deg: 1.5,
        lrf_x_m: LASER_M[0],
        lrf_y_m: LASER_M[1],
        association: Association::Joint,
        new_landmark_gates: 4.0,
        confirm_sightings: 5,
        confirm_batches: 60,
        ..LandmarkConfig::default()
    }
}
