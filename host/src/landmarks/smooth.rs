//! The path of a run as it is believed at the end: smoothed in the final map.
//!
//! A filter forgets where it was, or remembers it badly. Here the robot alone is estimated again, with the landmarks where the filter left them: forwards by a Kalman
//! filter, backwards by Rauch, Tung & Striebel (AIAA J. 3(8), 1965), linearised about the path found so far, three times: Gauss-Newton
//! for the path (Bell, SIAM J. Optimization 4(3), 1994). Costs O(events); what past poses would still change in the map is left out.

use lrfslam_core::landmark::sight::{Sensor, huber, innovation, inverse, mahalanobis};
use lrfslam_core::landmark::travel::{Travel, start_covariance};
use lrfslam_core::landmark::{
    Fate, LandmarkConfig, ROBOT, RobotCovariance, RobotState, Sighting, chi_squared, wrap_angle,
};
use nalgebra::{SMatrix, Vector2};

use super::{Drive, MapLandmark, What};

/// Times that the path is linearised anew.
const ITERATIONS: usize = 3;
/// How far the start may lie from the map's origin: the map moved while it was made. m and rad.
const START_DEVIATION: f64 = 0.3;

/// What one event leaves for the way back.
#[derive(Clone)]
struct Step {
    /// Predicted by the last event's motion, before what is seen now.
    predicted: (RobotState, RobotCovariance),
    /// After what is seen now.
    filtered: (RobotState, RobotCovariance),
    /// From the step before.
    jacobian: RobotCovariance,
}

/// The smoothed path, a pose for each event.
///
/// * `online` — the filter's own state after each event: the path is linearised about it at first
/// * `fates` — for each event, which landmarks its sightings were taken for; without them, identities say it
pub fn smoothed(
    drive: &Drive,
    config: &LandmarkConfig,
    map: &[MapLandmark],
    online: &[RobotState],
    fates: Option<&[Vec<Fate>]>,
) -> Vec<RobotState> {
    let smoother = Smoother { config, sensor: Sensor::new(config), map, fates };
    let mut about = online.to_vec();
    for _ in 0..ITERATIONS {
        let next = backwards(&smoother.forwards(drive, &about));
        if next.iter().any(|robot| !robot.iter().all(|number| number.is_finite())) {
            break;
        }
        about = next;
    }
    about
}

struct Smoother<'a> {
    config: &'a LandmarkConfig,
    sensor: Sensor,
    map: &'a [MapLandmark],
    fates: Option<&'a [Vec<Fate>]>,
}

impl Smoother<'_> {
    /// * `about` — the path to linearise about
    fn forwards(&self, drive: &Drive, about: &[RobotState]) -> Vec<Step> {
        let mut robot = RobotState::new(0.0, 0.0, 0.0, 1.0, 1.0);
        let mut covariance = start_covariance(self.config);
        for row in 0..3 {
            covariance[(row, row)] = START_DEVIATION * START_DEVIATION;
        }
        let mut seen_s = vec![f64::NEG_INFINITY; self.map.len()];
        let mut steps: Vec<Step> = Vec::with_capacity(drive.events.len());
        for (index, event) in drive.events.iter().enumerate() {
            let mut jacobian = RobotCovariance::identity();
            if let What::Control(control) = &event.what
                && let Some(travel) = Travel::new(control, self.config)
            {
                let from = index.checked_sub(1).and_then(|before| about.get(before)).copied().unwrap_or(robot);
                let (by_state, noise) = travel.jacobian_and_noise(&from);
                let moved = travel.moved(&from) + by_state * difference(&robot, &from);
                (robot, jacobian) = (moved, by_state);
                covariance = by_state * covariance * by_state.transpose() + noise;
            }
            let predicted = (robot, covariance);
            if let What::Sightings(sightings) = &event.what {
                let t = event.stamp.as_secs_f64();
                let at = about.get(index).copied().unwrap_or(robot);
                for (place, sighting) in sightings.iter().enumerate() {
                    let Some(landmark) = landmark_of(self.map, self.fates, sighting, (index, place)) else { continue };
                    self.correct(&mut robot, &mut covariance, (sighting, landmark), &at, (t, &mut seen_s));
                }
            }
            steps.push(Step { predicted, filtered: (robot, covariance), jacobian });
        }
        steps
    }

    fn correct(
        &self,
        robot: &mut RobotState,
        covariance: &mut RobotCovariance,
        (sighting, index): (&Sighting, usize),
        about: &RobotState,
        (t, seen_s): (f64, &mut [f64]),
    ) {
        let gate = chi_squared(2, f64::from(self.config.gate_deviations)) * f64::from(self.config.new_landmark_gates);
        let landmark = &self.map[index];
        let since = t - seen_s[index];
        let Some((off, by_robot, s)) = self.expect(robot, covariance, sighting, about, landmark, since) else { return };
        let Some((squared, _)) = mahalanobis(off, &s).filter(|(squared, _)| *squared <= gate) else { return };
        let noise = self.sensor.noise_of(sighting, sighting.range_m, since);
        let weight = huber(squared, f64::from(self.config.huber_deviations));
        let s = s + noise * (weight - 1.0);
        let Some(inverse) = inverse(&s) else { return };
        let cross = *covariance * by_robot.transpose();
        *robot += cross * (inverse * off);
        // Joseph's form.
        let gain = cross * inverse;
        let rest = RobotCovariance::identity() - gain * by_robot;
        *covariance = rest * *covariance * rest.transpose() + gain * noise * weight * gain.transpose();
        *covariance = (*covariance + covariance.transpose()) * 0.5;
        seen_s[index] = t;
    }

    /// Innovation, Jacobian and innovation covariance, linearised about a pose.
    fn expect(
        &self,
        robot: &RobotState,
        covariance: &RobotCovariance,
        sighting: &Sighting,
        about: &RobotState,
        landmark: &MapLandmark,
        since_s: f64,
    ) -> Option<(Vector2<f64>, SMatrix<f64, 2, ROBOT>, nalgebra::Matrix2<f64>)> {
        let view = self.sensor.view(about, landmark.at)?;
        let mut by_robot = SMatrix::<f64, 2, ROBOT>::zeros();
        by_robot.fixed_view_mut::<2, 3>(0, 0).copy_from(&view.by_robot);
        let off = innovation(sighting, &view) - by_robot * difference(robot, about);
        let s = by_robot * covariance * by_robot.transpose() + self.sensor.noise_of(sighting, view.seen.x, since_s);
        Some((Vector2::new(off.x, wrap_angle(off.y)), by_robot, s))
    }
}

/// Which landmark of the map a sighting is of: as the filter took it, not chosen anew.
pub(super) fn landmark_of(
    map: &[MapLandmark],
    fates: Option<&[Vec<Fate>]>,
    sighting: &Sighting,
    (event, place): (usize, usize),
) -> Option<usize> {
    let Some(fates) = fates else {
        let identity = sighting.identity?;
        return map.iter().position(|landmark| landmark.identity == Some(identity));
    };
    match fates.get(event)?.get(place)? {
        Fate::Matched(number) | Fate::Began(number) => map.iter().position(|landmark| landmark.number == *number),
        Fate::Refused | Fate::Full => None,
    }
}

/// a − b, its heading the short way round.
fn difference(a: &RobotState, b: &RobotState) -> RobotState {
    let mut difference = a - b;
    difference[2] = wrap_angle(difference[2]);
    difference
}

fn backwards(steps: &[Step]) -> Vec<RobotState> {
    let mut path: Vec<RobotState> = steps.iter().map(|step| step.filtered.0).collect();
    for index in (0..steps.len().saturating_sub(1)).rev() {
        let (now, next) = (&steps[index], &steps[index + 1]);
        // A little on the diagonal: steps without noise of their own leave it singular.
        let raised = next.predicted.1 + RobotCovariance::identity() * 1e-10;
        let Some(inverse) = raised.try_inverse() else { continue };
        let gain = now.filtered.1 * next.jacobian.transpose() * inverse;
        path[index] = now.filtered.0 + gain * difference(&path[index + 1], &next.predicted.0);
        path[index][2] = wrap_angle(path[index][2]);
    }
    path
}
