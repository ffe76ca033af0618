//! One run of either filter over a drive.

use std::time::Instant as Clock;

use lrfslam_core::landmark::fast::FastParticle;
use lrfslam_core::landmark::{Association, Fate, LandmarkConfig, RobotState, SightingCounts};
use lrfslam_core::time::Instant;
use nalgebra::{Matrix2, Matrix3, Vector2};
use serde::Serialize;

use super::errors::pose_at;
use super::filter::{Memory, Slam, Started};
use super::hindsight::hindsight;
use super::settle::settle;
use super::smooth::smoothed;
use super::{Drive, What};
use crate::pose_f64::PoseF64;
use crate::trajectory::TimedPose;

/// Poses of the path lie at least so far apart in time, µs.
const PATH_STEP_MICROS: i64 = 50_000;

/// Which filter, and how large.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Filter {
    /// EKF-SLAM.
    Ekf,
    /// FastSLAM.
    Fastslam {
        /// How many.
        particles: u16,
    },
}

/// A landmark as it was found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MapLandmark {
    /// Which one it is of all that an EKF began.
    pub number: u16,
    /// What the sensor calls it; none if association is unknown, for others may have been taken for it.
    pub identity: Option<u16>,
    /// Sightings that were used.
    pub sightings: u16,
    /// In the map, m.
    pub at: Vector2<f64>,
    /// Covariance, m².
    pub covariance: Matrix2<f64>,
}

/// What a filter says at the end.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Estimate {
    /// Poses as they were believed when they were current.
    pub online: Vec<TimedPose>,
    /// Poses as they are believed at the end, smoothed in the map; with FastSLAM and unknown association, those of the heaviest particle.
    pub path: Vec<TimedPose>,
    /// Landmarks as they are believed at the end, fitted together with the path; as the filter has them, where `path` is not smoothed.
    pub landmarks: Vec<MapLandmark>,
    /// Landmarks as the filter has them.
    pub online_landmarks: Vec<MapLandmark>,
    /// True over reported distance.
    pub distance_scale: f64,
    /// True over reported turn.
    pub turn_scale: f64,
}

impl Estimate {
    /// The best path that there is.
    pub fn best_path(&self) -> &[TimedPose] {
        if self.path.is_empty() { &self.online } else { &self.path }
    }
}

/// A run: estimate, counts, cost.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct LandmarkRun {
    /// What came out.
    pub estimate: Estimate,
    /// What became of the sightings; of the heaviest particle with FastSLAM.
    pub counts: SightingCounts,
    /// Controls taken.
    pub controls: u64,
    /// Batches of sightings taken.
    pub batches: u64,
    /// Time spent in the filter, s.
    pub wall_s: f64,
    /// Memory lent to it, bytes.
    pub memory_bytes: usize,
}

/// A run on its way, after a batch of sightings.
pub struct Glance<'r> {
    /// When.
    pub stamp: Instant,
    /// Of the events so many are done; 1 at the end, before path and landmarks are fitted.
    pub share: f64,
    /// Batches of sightings so far.
    pub batches: u64,
    /// Poses so far, as they were believed when they were current.
    pub path: &'r [TimedPose],
    slam: &'r Slam<'r>,
}

impl<'r> Glance<'r> {
    fn at(stamp: Instant, share: f64, run: &'r LandmarkRun, slam: &'r Slam<'r>) -> Self {
        Self { stamp, share, batches: run.batches, path: &run.estimate.online, slam }
    }

    /// Where the robot is now, and the covariance of x, y and heading.
    pub fn robot(&self) -> (RobotState, Matrix3<f64>) {
        let covariance = match self.slam {
            Slam::Ekf(slam) => slam.robot_covariance(),
            Slam::Fast(slam) => slam.covariance(),
        };
        (self.slam.robot(), covariance.fixed_view::<3, 3>(0, 0).into_owned())
    }

    /// Landmarks; those of the heaviest particle with FastSLAM.
    pub fn landmarks(&self) -> Vec<MapLandmark> {
        self.slam.landmarks()
    }

    /// Poses and weights of the particles; an EKF has none.
    pub fn particles(&self) -> &[FastParticle] {
        match self.slam {
            Slam::Ekf(_) => &[],
            Slam::Fast(slam) => slam.particles(),
        }
    }
}

/// Runs `filter` over `drive`; `None` if the memory for so many landmarks is no memory at all.
///
/// * `landmarks_max` — room for so many; `seed` — of the random numbers, an EKF has none
/// * `watch` — sees the run after every batch, and at the end; the run stops when it says `false`
pub fn run(
    drive: &Drive,
    config: &LandmarkConfig,
    filter: Filter,
    landmarks_max: usize,
    seed: u64,
    mut watch: impl FnMut(&Glance<'_>) -> bool,
) -> Option<LandmarkRun> {
    let mut memory = Memory::new(filter, landmarks_max);
    let mut state = memory.start(config, filter, seed)?;
    let began = Clock::now();
    let mut run = LandmarkRun { memory_bytes: state.bytes, ..LandmarkRun::default() };
    let mut last: Option<Instant> = None;
    let mut told = Told::default();
    for (index, event) in drive.events.iter().enumerate() {
        let mut fates = Vec::new();
        match &event.what {
            What::Control(control) => {
                state.slam.predict(control);
                run.controls += 1;
            }
            What::Sightings(sightings) => {
                fates.resize(sightings.len(), Fate::Refused);
                add(&mut run.counts, state.slam.observe(sightings, &mut fates));
                run.batches += 1;
                state.paths.resampled(&state.slam);
                let share = index as f64 / drive.events.len() as f64;
                if !watch(&Glance::at(event.stamp, share, &run, &state.slam)) {
                    break;
                }
            }
        }
        told.states.push(state.slam.robot());
        told.fates.push(fates);
        if last.is_none_or(|last| event.stamp.micros - last.micros >= PATH_STEP_MICROS) {
            last = Some(event.stamp);
            run.estimate.online.push(timed(event.stamp, &state.slam.robot()));
            state.paths.record(event.stamp, &state.slam);
        }
    }
    run.wall_s = began.elapsed().as_secs_f64();
    if let Some(stamp) = last.filter(|_| told.states.len() == drive.events.len()) {
        watch(&Glance::at(stamp, 1.0, &run, &state.slam));
    }
    told.conclude(drive, config, filter, &state, &mut run.estimate);
    Some(run)
}

/// What the filter said on the way, for each event.
#[derive(Default)]
struct Told {
    states: Vec<RobotState>,
    fates: Vec<Vec<Fate>>,
}

impl Told {
    /// What the filter says at the end, and then path and landmarks in hindsight.
    fn conclude(
        &mut self,
        drive: &Drive,
        config: &LandmarkConfig,
        filter: Filter,
        state: &Started<'_>,
        estimate: &mut Estimate,
    ) {
        let robot = state.slam.robot();
        (estimate.distance_scale, estimate.turn_scale) = (robot[3], robot[4]);
        estimate.landmarks = state.slam.landmarks();
        if config.association != Association::Known {
            estimate.landmarks.iter_mut().for_each(|landmark| landmark.identity = None);
        }
        estimate.online_landmarks.clone_from(&estimate.landmarks);
        estimate.path = state.paths.of(&state.slam);
        if config.association != Association::Known {
            self.follow(drive, &estimate.path);
        }
        self.look_back(drive, config, filter, estimate);
    }

    /// Path and landmarks in hindsight: the path in the filter's map, then both together, then the path in the map found so.
    ///
    /// Nothing changes if the drive was not at its end, or the map is too large for it and nobody knows what sightings were
    /// taken for: without identities, FastSLAM's particles choose each for itself.
    fn look_back(&self, drive: &Drive, config: &LandmarkConfig, filter: Filter, estimate: &mut Estimate) {
        let is_known = config.association == Association::Known;
        if estimate.landmarks.is_empty() || self.states.len() != drive.events.len() {
            return;
        }
        // Particles choose each for itself: what sightings are of is found by place alone.
        let fates = (!is_known && filter == Filter::Ekf).then_some(&self.fates[..]);
        let settled = match is_known {
            true => None,
            false => settle(drive, config, &estimate.landmarks, &self.states, fates),
        };
        let path = match settled {
            Some(settled) => {
                estimate.landmarks = settled.landmarks;
                settled.path
            }
            None if !is_known && filter != Filter::Ekf => return,
            None => self.fitted(drive, config, fates, &mut estimate.landmarks),
        };
        let stamps = drive.events.iter().map(|event| event.stamp);
        estimate.path = thinned(stamps.zip(&path).map(|(stamp, robot)| timed(stamp, robot)).collect());
    }

    /// The path, with sightings taken for what the filter took them for, or for what they tell; landmarks are fitted with it.
    fn fitted(
        &self,
        drive: &Drive,
        config: &LandmarkConfig,
        fates: Option<&[Vec<Fate>]>,
        landmarks: &mut Vec<MapLandmark>,
    ) -> Vec<RobotState> {
        let path = smoothed(drive, config, landmarks, &self.states, fates);
        let Some(fit) = hindsight(drive, config, landmarks, &path, fates) else { return path };
        *landmarks = fit.landmarks;
        smoothed(drive, config, landmarks, &path, fates)
    }

    /// Puts the robot on `path`, which has a pose every now and then.
    fn follow(&mut self, drive: &Drive, path: &[TimedPose]) {
        for (event, state) in drive.events.iter().zip(&mut self.states) {
            if let Some(pose) = pose_at(path, event.stamp) {
                (state[0], state[1], state[2]) = (pose.x, pose.y, pose.heading);
            }
        }
    }
}

fn add(sum: &mut SightingCounts, counts: SightingCounts) {
    sum.matched += counts.matched;
    sum.began += counts.began;
    sum.refused += counts.refused;
    sum.full += counts.full;
    sum.removed += counts.removed;
}

fn timed(stamp: Instant, robot: &RobotState) -> TimedPose {
    TimedPose { stamp, map_from_robot: PoseF64::new(robot[0], robot[1], robot[2]).to_f32() }
}

/// Poses so far apart as the path's are.
fn thinned(path: Vec<TimedPose>) -> Vec<TimedPose> {
    let mut last: Option<Instant> = None;
    let is_due = move |pose: &TimedPose| {
        let is_due = last.is_none_or(|last| pose.stamp.micros - last.micros >= PATH_STEP_MICROS);
        if is_due {
            last = Some(pose.stamp);
        }
        is_due
    };
    path.into_iter().filter(is_due).collect()
}
