//! A robot that drives in circles among landmarks, with exactly the noise that the filters are told of.

use nalgebra::Vector2;

use super::super::sight::Sensor;
use super::super::travel::Travel;
use super::super::*;
use crate::math::{normal, uniform};
use crate::random::RandomStream;

pub const LANDMARKS: usize = 16;
/// Farther landmarks are not seen, m.
const SIGHT_M: f64 = 5.0;

/// Noise as it is: nothing lasts, nothing is left out.
pub fn config() -> LandmarkConfig {
    LandmarkConfig {
        alpha_1: 0.05,
        alpha_2: 0.01,
        alpha_3: 0.05,
        alpha_4: 0.1,
        control_hold_s: 0.0,
        distance_scale_deviation: 0.05,
        turn_scale_deviation: 0.05,
        range_noise_m: 0.05,
        bearing_noise_deg: 1.0,
        gate_deviations: 10.0,
        huber_deviations: 1000.0,
        ..LandmarkConfig::default()
    }
}

pub struct World {
    pub config: LandmarkConfig,
    pub robot: RobotState,
    pub landmarks: [Vector2<f64>; LANDMARKS],
    sensor: Sensor,
    rng: RandomStream,
}

impl World {
    pub fn new(config: &LandmarkConfig, seed: u64) -> Self {
        let mut rng = RandomStream::new(seed, 0, 0);
        let mut place = || f64::from(uniform(&mut rng)) * 12.0;
        let landmarks = core::array::from_fn(|_| Vector2::new(place() - 6.0, place() - 2.0));
        let mut draw = |deviation: f32| 1.0 + f64::from(deviation) * f64::from(normal(&mut rng));
        let scales = [draw(config.distance_scale_deviation), draw(config.turn_scale_deviation)];
        let robot = RobotState::new(0.0, 0.0, 0.0, scales[0], scales[1]);
        Self { config: *config, robot, landmarks, sensor: Sensor::new(config), rng }
    }

    fn normal(&mut self) -> f64 {
        f64::from(normal(&mut self.rng))
    }

    /// Drives a tenth of a second; returns what is reported of it.
    pub fn drive(&mut self) -> Control {
        let control = Control::Velocity { forward_m_s: 1.0, turn_rad_s: 0.25, seconds: 0.1 };
        let mut travel = Travel::new(&control, &self.config).unwrap();
        let [distance_scale, turn_scale] = [self.robot[3], self.robot[4]];
        // The report is scaled by the filter, the noise is not.
        travel.distance_m += self.normal() * libm::sqrt(travel.distance_variance) / distance_scale;
        travel.turn_rad += self.normal() * libm::sqrt(travel.turn_variance) / turn_scale;
        self.robot = travel.moved(&self.robot);
        self.robot[2] = wrap_angle(self.robot[2] + self.normal() * libm::sqrt(travel.heading_variance));
        control
    }

    /// What is seen now, by identity.
    pub fn look(&mut self) -> heapless::Vec<Sighting, LANDMARKS> {
        let mut seen = heapless::Vec::new();
        for (identity, landmark) in (0_u16..).zip(self.landmarks) {
            let Some(view) = self.sensor.view(&self.robot, landmark) else { continue };
            let noise = self.sensor.noise(view.seen.x, f64::INFINITY);
            let range_m = view.seen.x + self.normal() * libm::sqrt(noise.m11);
            let bearing_rad = wrap_angle(view.seen.y + self.normal() * libm::sqrt(noise.m22));
            if view.seen.x < SIGHT_M && range_m > 0.0 {
                let _ = seen.push(Sighting { range_m, bearing_rad, identity: Some(identity), noise: None });
            }
        }
        seen
    }

    /// Squared normalised error of the pose: chi-squared with 3 degrees of freedom, if the filter is consistent.
    pub fn squared_error(&self, robot: &RobotState, covariance: &RobotCovariance) -> f64 {
        let mut off = (robot - self.robot).fixed_rows::<3>(0).into_owned();
        off[2] = wrap_angle(off[2]);
        let block = covariance.fixed_view::<3, 3>(0, 0).into_owned();
        block.try_inverse().map_or(f64::NAN, |inverse| off.dot(&(inverse * off)))
    }
}

/// Memory of an EKF for the world's landmarks.
pub struct EkfPools {
    pub mean: Vec<f64>,
    pub covariance: Vec<f64>,
    pub work: Vec<[f64; 4]>,
    pub landmarks: Vec<super::super::ekf::Landmark>,
}

impl EkfPools {
    pub fn new(landmarks: usize) -> Self {
        let [order, triangle, records] = super::super::ekf::EkfMemory::lengths(landmarks);
        Self {
            mean: vec![0.0; order],
            covariance: vec![0.0; triangle],
            work: vec![[0.0; 4]; order],
            landmarks: vec![Default::default(); records],
        }
    }

    pub fn memory(&mut self) -> super::super::ekf::EkfMemory<'_> {
        super::super::ekf::EkfMemory {
            mean: &mut self.mean,
            covariance: &mut self.covariance,
            work: &mut self.work,
            landmarks: &mut self.landmarks,
        }
    }
}
