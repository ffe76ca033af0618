//! Landmarks as they are believed at the end: path, landmarks and scales of the odometry by least squares over the whole drive.
//!
//! A filter linearises once, about what it believed then, and a particle's early poses never change again. Here everything that was reported and
//! seen is fitted together, by steps of Levenberg & Marquardt on sparse normal equations. They start from the filter's map and its
//! [smoothed path](super::smooth); what sightings were taken for stays (Dellaert & Kaess, IJRR 25(12), 2006).
//!
//! * Unknowns: a pose at each batch of sightings, two numbers of each landmark, two scales.
//! * The map's frame is that of the start, which is certain.

use lrfslam_core::landmark::sight::{Sensor, huber, innovation, inverse, mahalanobis};
use lrfslam_core::landmark::travel::{Travel, start_covariance};
use lrfslam_core::landmark::{
    Fate, LandmarkConfig, ROBOT, RobotCovariance, RobotState, Sighting, chi_squared, wrap_angle,
};
use nalgebra::{DMatrix, Matrix3, Matrix3x2, SMatrix, SVector, Vector2, Vector3};
use nalgebra_sparse::factorization::CscCholesky;
use nalgebra_sparse::{CooMatrix, CscMatrix};

use super::smooth::landmark_of;
use super::{Drive, MapLandmark, What};
use crate::pose_f64::PoseF64;

/// Larger maps stay as the filter left them: the cost of a step grows with batches · landmarks².
const LANDMARKS_MAX: usize = 100;
/// Steps at most.
const STEPS_MAX: usize = 30;
/// Damping of the first step, as a share of the diagonal; a step that helps makes it a tenth, one that does not ten times as large.
const DAMPING: f64 = 1e-6;
/// A change below this is none, m and rad.
const CHANGE_MIN: f64 = 1e-5;
/// Variance of a pose that no motion led to, m² and rad²: the robot stood.
const STANDING: f64 = 1e-8;
/// Information of a number that is certain.
const CERTAIN: f64 = 1e12;
/// Numbers that all poses share: two scales.
const SHARED: usize = 2;

/// What was fitted.
#[derive(Debug, Clone)]
pub struct Fit {
    /// The landmarks, with their covariances.
    pub landmarks: Vec<MapLandmark>,
    /// Covariance of all their x and y, m².
    pub covariance: DMatrix<f64>,
}

/// The landmarks of path and landmarks fitted together; `None` if nothing was seen, there are more than a hundred landmarks, or the equations have no solution.
///
/// * `path` — the robot after each event; `map` — as the filter left it
/// * `fates` — for each event, which landmarks its sightings were taken for; without them, identities say it
pub fn hindsight(
    drive: &Drive,
    config: &LandmarkConfig,
    map: &[MapLandmark],
    path: &[RobotState],
    fates: Option<&[Vec<Fate>]>,
) -> Option<Fit> {
    if map.is_empty() || map.len() > LANDMARKS_MAX {
        return None;
    }
    let problem = Problem::new(drive, config, map, fates);
    let mut best = problem.start(map, path)?;
    let mut equations = problem.equations(&best);
    let mut damping = DAMPING;
    for _ in 0..STEPS_MAX {
        let change = equations.solve(damping)?;
        if change.amax() < CHANGE_MIN {
            break;
        }
        let next = best.changed(&change);
        let after = problem.equations(&next);
        if after.cost < equations.cost {
            (best, equations) = (next, after);
            damping *= 0.1;
        } else {
            damping *= 10.0;
        }
    }
    let covariance = equations.covariance(3 * best.poses.len(), 2 * map.len())?;
    let of = |(index, (landmark, at)): (usize, (&MapLandmark, &Vector2<f64>))| {
        let covariance = covariance.fixed_view::<2, 2>(2 * index, 2 * index).into_owned();
        MapLandmark { at: *at, covariance, ..*landmark }
    };
    let landmarks = map.iter().zip(&best.landmarks).enumerate().map(of).collect();
    Some(Fit { landmarks, covariance })
}

/// The unknowns.
#[derive(Clone)]
struct Unknowns {
    poses: Vec<Vector3<f64>>,
    landmarks: Vec<Vector2<f64>>,
    /// Scale of distances, scale of turns.
    shared: Vector2<f64>,
}

impl Unknowns {
    fn changed(&self, change: &DMatrix<f64>) -> Self {
        let mut numbers = change.iter().copied();
        let mut next = self.clone();
        let places = next.poses.iter_mut().flat_map(|pose| pose.iter_mut());
        let places = places.chain(next.landmarks.iter_mut().flat_map(|landmark| landmark.iter_mut()));
        for (place, number) in places.chain(next.shared.iter_mut()).zip(&mut numbers) {
            *place += number;
        }
        next.poses.iter_mut().for_each(|pose| pose.z = wrap_angle(pose.z));
        next
    }

    fn robot(&self, pose: Vector3<f64>) -> RobotState {
        RobotState::new(pose.x, pose.y, pose.z, self.shared.x, self.shared.y)
    }
}

/// A landmark seen at a pose.
struct Seen {
    pose: usize,
    landmark: usize,
    sighting: Sighting,
    since_s: f64,
}

struct Problem<'a> {
    config: &'a LandmarkConfig,
    sensor: Sensor,
    landmarks: usize,
    /// Of each pose its event, and what led to it from the one before.
    poses: Vec<(usize, Vec<Travel>)>,
    seen: Vec<Seen>,
}

impl<'a> Problem<'a> {
    fn new(drive: &Drive, config: &'a LandmarkConfig, map: &[MapLandmark], fates: Option<&[Vec<Fate>]>) -> Self {
        let (mut poses, mut seen, mut travels) = (Vec::new(), Vec::new(), Vec::new());
        let mut seen_s = vec![f64::NEG_INFINITY; map.len()];
        for (index, event) in drive.events.iter().enumerate() {
            match &event.what {
                What::Control(control) => travels.extend(Travel::new(control, config)),
                What::Sightings(sightings) => {
                    let t = event.stamp.as_secs_f64();
                    for (place, sighting) in sightings.iter().enumerate() {
                        let Some(landmark) = landmark_of(map, fates, sighting, (index, place)) else { continue };
                        let since_s = t - seen_s[landmark];
                        seen.push(Seen { pose: poses.len(), landmark, sighting: *sighting, since_s });
                        seen_s[landmark] = t;
                    }
                    poses.push((index, std::mem::take(&mut travels)));
                }
            }
        }
        Self { config, sensor: Sensor::new(config), landmarks: map.len(), poses, seen }
    }

    fn start(&self, map: &[MapLandmark], path: &[RobotState]) -> Option<Unknowns> {
        let (first, last) = (path.first()?, path.last()?);
        // What smoothing moved the start by, all is moved back.
        let start = PoseF64::new(first[0], first[1], first[2]);
        let moved = |x, y, heading| {
            let pose = start.between(PoseF64::new(x, y, heading));
            Vector3::new(pose.x, pose.y, pose.heading)
        };
        let pose =
            |(event, _): &(usize, Vec<Travel>)| path.get(*event).map(|robot| moved(robot[0], robot[1], robot[2]));
        Some(Unknowns {
            poses: self.poses.iter().map(pose).collect::<Option<_>>()?,
            landmarks: map.iter().map(|landmark| moved(landmark.at.x, landmark.at.y, 0.0).xy()).collect(),
            shared: Vector2::new(last[3], last[4]),
        })
    }

    fn equations(&self, at: &Unknowns) -> Equations {
        let mut equations = Equations::new(3 * at.poses.len() + 2 * self.landmarks + SHARED);
        let shared = 3 * at.poses.len() + 2 * self.landmarks;
        for (index, (_, travels)) in self.poses.iter().enumerate() {
            self.add_motion(&mut equations, at, index, travels);
        }
        for seen in &self.seen {
            self.add_sighting(&mut equations, at, seen);
        }
        let scales = start_covariance(self.config);
        let off = at.shared - Vector2::new(1.0, 1.0);
        for (index, variance) in [scales.m44, scales.m55].into_iter().enumerate() {
            let information = if variance > 0.0 { 1.0 / variance } else { CERTAIN };
            equations.add(
                [shared + index],
                &SMatrix::identity(),
                &SVector::from([off[index]]),
                &[[information]].into(),
            );
        }
        equations
    }

    /// The pose as the one before and the motion between expect it; the first comes from the map's origin.
    fn add_motion(&self, equations: &mut Equations, at: &Unknowns, index: usize, travels: &[Travel]) {
        let before = index.checked_sub(1).map(|before| at.poses[before]);
        let mut robot = at.robot(before.unwrap_or_default());
        let (mut jacobian, mut covariance) = (RobotCovariance::identity(), RobotCovariance::zeros());
        for travel in travels {
            let (step, noise) = travel.jacobian_and_noise(&robot);
            robot = travel.moved(&robot);
            jacobian = step * jacobian;
            covariance = step * covariance * step.transpose() + noise;
        }
        let of_pose = covariance.fixed_view::<3, 3>(0, 0) + Matrix3::identity() * STANDING;
        let Some(information) = of_pose.try_inverse() else { return };
        let mut off = at.poses[index] - robot.fixed_rows::<3>(0);
        off.z = wrap_angle(off.z);
        let by_scales: Matrix3x2<f64> = -jacobian.fixed_view::<3, 2>(0, 3).into_owned();
        let shared = 3 * at.poses.len() + 2 * self.landmarks;
        let here = 3 * index;
        if before.is_some() {
            let mut by_all = SMatrix::<f64, 3, 8>::zeros();
            by_all.fixed_view_mut::<3, 3>(0, 0).copy_from(&-jacobian.fixed_view::<3, 3>(0, 0).into_owned());
            by_all.fixed_view_mut::<3, 3>(0, 3).copy_from(&Matrix3::identity());
            by_all.fixed_view_mut::<3, 2>(0, 6).copy_from(&by_scales);
            let columns = [here - 3, here - 2, here - 1, here, here + 1, here + 2, shared, shared + 1];
            equations.add(columns, &by_all, &off, &information);
        } else {
            let mut by_all = SMatrix::<f64, 3, ROBOT>::identity();
            by_all.fixed_view_mut::<3, 2>(0, 3).copy_from(&by_scales);
            equations.add([here, here + 1, here + 2, shared, shared + 1], &by_all, &off, &information);
        }
    }

    /// The sighting as pose and landmark expect it; gross errors are left out, as by the filters.
    fn add_sighting(&self, equations: &mut Equations, at: &Unknowns, seen: &Seen) {
        let pose = at.poses[seen.pose];
        let Some(view) = self.sensor.view(&at.robot(pose), at.landmarks[seen.landmark]) else { return };
        let noise = self.sensor.noise_of(&seen.sighting, view.seen.x, seen.since_s);
        let off = innovation(&seen.sighting, &view);
        let gate = chi_squared(2, f64::from(self.config.gate_deviations)) * f64::from(self.config.new_landmark_gates);
        let knee = f64::from(self.config.huber_deviations);
        let loss = |squared: f64| if squared > knee * knee { knee * (2.0 * squared.sqrt() - knee) } else { squared };
        let (Some((squared, _)), Some(information)) = (mahalanobis(off, &noise), inverse(&noise)) else { return };
        if squared > gate {
            equations.cost += loss(gate);
            return;
        }
        let mut by_all = SMatrix::<f64, 2, 5>::zeros();
        by_all.fixed_view_mut::<2, 3>(0, 0).copy_from(&view.by_robot);
        by_all.fixed_view_mut::<2, 2>(0, 3).copy_from(&view.by_landmark);
        let weight = huber(squared, knee);
        let (here, landmark) = (3 * seen.pose, 3 * at.poses.len() + 2 * seen.landmark);
        let columns = [here, here + 1, here + 2, landmark, landmark + 1];
        equations.add(columns, &by_all, &-off, &(information / weight));
        equations.cost += loss(squared) - squared / weight;
    }
}

/// Normal equations and the robust cost that they are of.
struct Equations {
    matrix: CooMatrix<f64>,
    diagonal: Vec<f64>,
    right: DMatrix<f64>,
    cost: f64,
}

impl Equations {
    fn new(size: usize) -> Self {
        Self {
            matrix: CooMatrix::new(size, size),
            diagonal: vec![0.0; size],
            right: DMatrix::zeros(size, 1),
            cost: 0.0,
        }
    }

    /// Adds eᵀ Ω e of the error e = `off` + `jacobian` · change.
    fn add<const ROWS: usize, const COLUMNS: usize>(
        &mut self,
        columns: [usize; COLUMNS],
        jacobian: &SMatrix<f64, ROWS, COLUMNS>,
        off: &SVector<f64, ROWS>,
        information: &SMatrix<f64, ROWS, ROWS>,
    ) {
        let weighted = jacobian.transpose() * information;
        let (block, right) = (weighted * jacobian, weighted * off);
        for (row, place) in columns.into_iter().enumerate() {
            for (column, other) in columns.into_iter().enumerate() {
                self.matrix.push(place, other, block[(row, column)]);
            }
            self.right[place] -= right[row];
            self.diagonal[place] += block[(row, row)];
        }
        self.cost += off.dot(&(information * off));
    }

    /// * `damping` — added to the diagonal, as a share of it
    fn solve(&self, damping: f64) -> Option<DMatrix<f64>> {
        let mut matrix = self.matrix.clone();
        for (place, number) in self.diagonal.iter().enumerate() {
            matrix.push(place, place, damping * number);
        }
        let factor = CscCholesky::factor(&CscMatrix::from(&matrix)).ok()?;
        Some(factor.solve(&self.right)).filter(|change| change.iter().all(|number| number.is_finite()))
    }

    /// Covariance of so many numbers, the first of which is `first`.
    fn covariance(&self, first: usize, numbers: usize) -> Option<DMatrix<f64>> {
        let factor = CscCholesky::factor(&CscMatrix::from(&self.matrix)).ok()?;
        let mut block = DMatrix::zeros(numbers, numbers);
        for number in 0..numbers {
            let mut unit = DMatrix::zeros(self.right.nrows(), 1);
            unit[(first + number, 0)] = 1.0;
            block.set_column(number, &factor.solve(&unit).column(0).rows(first, numbers));
        }
        Some((&block + block.transpose()) * 0.5)
    }
}
