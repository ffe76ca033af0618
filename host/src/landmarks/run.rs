//! One run of either filter over a drive.

use std::time::Instant as Clock;

use lrfslam_core::landmark::ekf::{EkfMemory, EkfSlam, Landmark};
use lrfslam_core::landmark::fast::{FastLandmark, FastMemory, FastParticle, FastSlam};
use lrfslam_core::landmark::{Association, Control, Fate, LandmarkConfig, RobotState, Sighting, SightingCounts};
use lrfslam_core::time::Instant;
use nalgebra::{Matrix2, Vector2};
use serde::Serialize;

use super::hindsight::hindsight;
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

/// Runs `filter` over `drive`; `None` if the memory for so many landmarks is no memory at all.
///
/// * `landmarks_max` — room for so many; `seed` — of the random numbers, an EKF has none
/// * `watch` — is told of every batch: when, and the share of the events that is done
pub fn run(
    drive: &Drive,
    config: &LandmarkConfig,
    filter: Filter,
    landmarks_max: usize,
    seed: u64,
    mut watch: impl FnMut(Instant, f64) -> bool,
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
                if !watch(event.stamp, index as f64 / drive.events.len() as f64) {
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
    let robot = state.slam.robot();
    (run.estimate.distance_scale, run.estimate.turn_scale) = (robot[3], robot[4]);
    run.estimate.landmarks = state.slam.landmarks();
    if config.association != Association::Known {
        run.estimate.landmarks.iter_mut().for_each(|landmark| landmark.identity = None);
    }
    run.estimate.online_landmarks.clone_from(&run.estimate.landmarks);
    if !told.look_back(drive, config, filter, &mut run.estimate) {
        run.estimate.path = state.paths.of(&state.slam);
    }
    Some(run)
}

/// What the filter said on the way, for each event.
#[derive(Default)]
struct Told {
    states: Vec<RobotState>,
    fates: Vec<Vec<Fate>>,
}

impl Told {
    /// Path and landmarks in hindsight: the path in the filter's map, then both together, then the path in the map found so.
    ///
    /// False, and nothing has changed, if the drive was not at its end, or nobody knows what sightings were taken for: without identities,
    /// FastSLAM's particles choose each for itself.
    fn look_back(&self, drive: &Drive, config: &LandmarkConfig, filter: Filter, estimate: &mut Estimate) -> bool {
        let is_known = config.association == Association::Known;
        let is_told = is_known || filter == Filter::Ekf;
        let is_whole = !estimate.landmarks.is_empty() && self.states.len() == drive.events.len();
        if !(is_told && is_whole) {
            return false;
        }
        let fates = (!is_known).then_some(&self.fates[..]);
        let mut path = smoothed(drive, config, &estimate.landmarks, &self.states, fates);
        if let Some(found) = hindsight(drive, config, &estimate.landmarks, &path, fates) {
            estimate.landmarks = found;
            path = smoothed(drive, config, &estimate.landmarks, &path, fates);
        }
        let stamps = drive.events.iter().map(|event| event.stamp);
        estimate.path = thinned(stamps.zip(&path).map(|(stamp, robot)| timed(stamp, robot)).collect());
        true
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

/// Memory of a filter.
struct Memory {
    numbers: [Vec<f64>; 2],
    work: Vec<[f64; 4]>,
    records: Vec<Landmark>,
    particles: Vec<FastParticle>,
    maps: Vec<FastLandmark>,
}

impl Memory {
    fn new(filter: Filter, landmarks_max: usize) -> Self {
        let mut new = Self {
            numbers: [Vec::new(), Vec::new()],
            work: Vec::new(),
            records: Vec::new(),
            particles: Vec::new(),
            maps: Vec::new(),
        };
        match filter {
            Filter::Ekf => {
                let [order, triangle, records] = EkfMemory::lengths(landmarks_max);
                new.numbers = [vec![0.0; order], vec![0.0; triangle]];
                new.work = vec![[0.0; 4]; order];
                new.records = vec![Landmark::default(); records];
            }
            Filter::Fastslam { particles } => {
                new.particles = vec![FastParticle::UNUSED; usize::from(particles)];
                new.maps = vec![FastLandmark::default(); usize::from(particles) * landmarks_max];
            }
        }
        new
    }

    fn start(&mut self, config: &LandmarkConfig, filter: Filter, seed: u64) -> Option<Started<'_>> {
        let bytes = size_of_val(&*self.numbers[0])
            + size_of_val(&*self.numbers[1])
            + size_of_val(&*self.work)
            + size_of_val(&*self.records)
            + size_of_val(&*self.particles)
            + size_of_val(&*self.maps);
        let [mean, covariance] = &mut self.numbers;
        let slam = match filter {
            Filter::Ekf => {
                let memory = EkfMemory { mean, covariance, work: &mut self.work, landmarks: &mut self.records };
                Slam::Ekf(EkfSlam::new(config, memory)?)
            }
            Filter::Fastslam { .. } => {
                let memory = FastMemory { particles: &mut self.particles, landmarks: &mut self.maps };
                Slam::Fast(FastSlam::new(config, seed, memory)?)
            }
        };
        Some(Started { slam, paths: Paths::default(), bytes })
    }
}

struct Started<'m> {
    slam: Slam<'m>,
    paths: Paths,
    bytes: usize,
}

/// Either filter.
enum Slam<'m> {
    Ekf(EkfSlam<'m>),
    Fast(FastSlam<'m>),
}

impl Slam<'_> {
    fn predict(&mut self, control: &Control) {
        match self {
            Self::Ekf(slam) => slam.predict(control),
            Self::Fast(slam) => slam.predict(control),
        };
    }

    /// * `fates` — told by an EKF
    fn observe(&mut self, sightings: &[Sighting], fates: &mut [Fate]) -> SightingCounts {
        match self {
            Self::Ekf(slam) => slam.observe(sightings, fates),
            Self::Fast(slam) => slam.observe(sightings),
        }
    }

    fn robot(&self) -> RobotState {
        match self {
            Self::Ekf(slam) => slam.robot(),
            Self::Fast(slam) => slam.mean(),
        }
    }

    fn landmarks(&self) -> Vec<MapLandmark> {
        let of = |record: Landmark, at, covariance| MapLandmark {
            number: record.number,
            identity: record.identity,
            sightings: record.sightings,
            at,
            covariance,
        };
        match self {
            Self::Ekf(slam) => slam.landmarks().map(|(record, at, covariance)| of(record, at, covariance)).collect(),
            Self::Fast(slam) => slam.landmarks(slam.best()).iter().map(|l| of(l.record, l.at, l.covariance)).collect(),
        }
    }
}

/// Paths of all particles: poses by index at each time, and where an index came from at each resampling.
#[derive(Default)]
struct Paths {
    steps: Vec<Step>,
}

enum Step {
    Poses(Instant, Vec<PoseF64>),
    Parents(Vec<u16>),
}

impl Paths {
    fn record(&mut self, stamp: Instant, slam: &Slam<'_>) {
        if let Slam::Fast(slam) = slam {
            let pose = |p: &FastParticle| PoseF64::new(p.robot[0], p.robot[1], p.robot[2]);
            self.steps.push(Step::Poses(stamp, slam.particles().iter().map(pose).collect()));
        }
    }

    fn resampled(&mut self, slam: &Slam<'_>) {
        if let Slam::Fast(slam) = slam
            && slam.has_resampled()
        {
            self.steps.push(Step::Parents(slam.particles().iter().map(|particle| particle.parent).collect()));
        }
    }

    /// The path of the heaviest.
    fn of(&self, slam: &Slam<'_>) -> Vec<TimedPose> {
        let Slam::Fast(slam) = slam else { return Vec::new() };
        let mut index = slam.best();
        let mut path = Vec::new();
        for step in self.steps.iter().rev() {
            match step {
                Step::Parents(parents) => index = parents.get(index).map_or(0, |parent| usize::from(*parent)),
                Step::Poses(stamp, poses) => {
                    path.extend(poses.get(index).map(|pose| TimedPose { stamp: *stamp, map_from_robot: pose.to_f32() }))
                }
            }
        }
        path.reverse();
        path
    }
}
