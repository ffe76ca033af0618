//! A simulated drive among landmarks: a robot goes round in a park of posts, with the noise that its configuration tells, and twice the way.

use lrfslam_core::landmark::sight::Sensor;
use lrfslam_core::landmark::travel::Travel;
use lrfslam_core::landmark::{Control, LandmarkConfig, RobotState, Sighting, wrap_angle};
use lrfslam_core::math::{normal, uniform};
use lrfslam_core::random::RandomStream;
use lrfslam_core::time::Instant;
use nalgebra::Vector2;

use super::{Drive, Event, TrueLandmark, What};
use crate::pose_f64::PoseF64;
use crate::trajectory::TimedPose;

/// Farther posts are not seen, m.
const SIGHT_M: f64 = 10.0;
/// Half the angle of view, rad.
const VIEW_RAD: f64 = 1.6;
/// The way: a loop of this radius, m.
const RADIUS_M: f64 = 12.0;
/// From control to control, s.
const STEP_S: f64 = 0.1;

/// A drive of two rounds among `landmarks` posts.
///
/// * `seed` — of world and noise; the same seed gives the same drive
pub fn drive(landmarks: usize, seed: u64) -> Drive {
    let config = config();
    let rng = &mut RandomStream::new(seed, 0, 0);
    let mut draw = |low: f64, high: f64| low + (high - low) * f64::from(uniform(rng));
    let posts: Vec<TrueLandmark> = (0..u16::try_from(landmarks).unwrap_or(u16::MAX))
        .map(|identity| {
            let (angle, radius) = (draw(0.0, std::f64::consts::TAU), RADIUS_M + draw(-5.0, 5.0));
            TrueLandmark { identity, x: radius * angle.sin(), y: RADIUS_M - radius * angle.cos() }
        })
        .collect();
    let (sensor, mut robot) = (Sensor::new(&config), RobotState::new(0.0, 0.0, 0.0, 0.96, 1.04));
    let (mut events, mut truth) = (Vec::new(), Vec::new());
    let steps = (2.0 * std::f64::consts::TAU * RADIUS_M / STEP_S) as i64;
    for step in 1..=steps {
        let stamp = Instant::from_micros(step * 100_000);
        let control = Control::Velocity { forward_m_s: 1.0 / 0.96, turn_rad_s: 1.0 / RADIUS_M / 1.04, seconds: STEP_S };
        if let Some(mut travel) = Travel::new(&control, &config) {
            travel.distance_m += f64::from(normal(rng)) * travel.distance_variance.sqrt() / robot[3];
            travel.turn_rad += f64::from(normal(rng)) * travel.turn_variance.sqrt() / robot[4];
            robot = travel.moved(&robot);
        }
        events.push(Event { stamp, what: What::Control(control) });
        truth.push(TimedPose { stamp, map_from_robot: PoseF64::new(robot[0], robot[1], robot[2]).to_f32() });
        if step % 2 == 0 {
            let seen = posts.iter().filter_map(|post| look(&sensor, &robot, post, rng)).collect();
            events.push(Event { stamp, what: What::Sightings(seen) });
        }
    }
    let name = format!("simulated, {landmarks} landmarks, seed {seed}");
    let (has_headings, has_identities, detect) = (true, true, None);
    Drive { name, events, truth, has_headings, landmarks: posts, config, detect, has_identities }
}

fn look(sensor: &Sensor, robot: &RobotState, post: &TrueLandmark, rng: &mut RandomStream) -> Option<Sighting> {
    let view = sensor.view(robot, Vector2::new(post.x, post.y))?;
    let noise = sensor.noise(view.seen.x, f64::INFINITY);
    let range_m = view.seen.x + f64::from(normal(rng)) * noise.m11.sqrt();
    let bearing_rad = wrap_angle(view.seen.y + f64::from(normal(rng)) * noise.m22.sqrt());
    let is_seen = view.seen.x < SIGHT_M && view.seen.y.abs() < VIEW_RAD && range_m > 0.0;
    is_seen.then_some(Sighting { range_m, bearing_rad, identity: Some(post.identity), noise: None })
}

fn config() -> LandmarkConfig {
    LandmarkConfig { alpha_3: 0.02, alpha_4: 0.1, control_hold_s: 0.0, ..LandmarkConfig::default() }
}
