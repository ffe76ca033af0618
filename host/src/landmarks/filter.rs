//! Either filter over its memory, and the paths of particles.

use lrfslam_core::landmark::ekf::{EkfMemory, EkfSlam, Landmark};
use lrfslam_core::landmark::fast::{FastLandmark, FastMemory, FastParticle, FastSlam};
use lrfslam_core::landmark::{Control, Fate, LandmarkConfig, RobotState, Sighting, SightingCounts};
use lrfslam_core::time::Instant;

use super::{Filter, MapLandmark};
use crate::pose_f64::PoseF64;
use crate::trajectory::TimedPose;

/// Memory of a filter.
pub(super) struct Memory {
    numbers: [Vec<f64>; 2],
    work: Vec<[f64; 4]>,
    records: Vec<Landmark>,
    particles: Vec<FastParticle>,
    maps: Vec<FastLandmark>,
}

impl Memory {
    pub fn new(filter: Filter, landmarks_max: usize) -> Self {
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

    pub fn start(&mut self, config: &LandmarkConfig, filter: Filter, seed: u64) -> Option<Started<'_>> {
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

/// A filter that has begun.
pub(super) struct Started<'m> {
    pub slam: Slam<'m>,
    pub paths: Paths,
    pub bytes: usize,
}

/// Either filter.
pub(super) enum Slam<'m> {
    Ekf(EkfSlam<'m>),
    Fast(FastSlam<'m>),
}

impl Slam<'_> {
    pub fn predict(&mut self, control: &Control) {
        match self {
            Self::Ekf(slam) => slam.predict(control),
            Self::Fast(slam) => slam.predict(control),
        };
    }

    /// * `fates` — told by an EKF
    pub fn observe(&mut self, sightings: &[Sighting], fates: &mut [Fate]) -> SightingCounts {
        match self {
            Self::Ekf(slam) => slam.observe(sightings, fates),
            Self::Fast(slam) => slam.observe(sightings),
        }
    }

    pub fn robot(&self) -> RobotState {
        match self {
            Self::Ekf(slam) => slam.robot(),
            Self::Fast(slam) => slam.mean(),
        }
    }

    pub fn landmarks(&self) -> Vec<MapLandmark> {
        let of = |record: Landmark, at, covariance| MapLandmark {
            number: record.number,
            identity: record.identity,
            sightings: record.sightings,
            at,
            covariance,
        };
        match self {
            Self::Ekf(slam) => slam.landmarks().map(|(record, at, covariance)| of(record, at, covariance)).collect(),
            // Particles do not number what they begin.
            Self::Fast(slam) => (0..)
                .zip(slam.landmarks(slam.best()))
                .map(|(number, l)| of(Landmark { number, ..l.record }, l.at, l.covariance))
                .collect(),
        }
    }
}

/// Paths of all particles: poses by index at each time, and where an index came from at each resampling.
#[derive(Default)]
pub(super) struct Paths {
    steps: Vec<Step>,
}

enum Step {
    Poses(Instant, Vec<PoseF64>),
    Parents(Vec<u16>),
}

impl Paths {
    pub fn record(&mut self, stamp: Instant, slam: &Slam<'_>) {
        if let Slam::Fast(slam) = slam {
            let pose = |p: &FastParticle| PoseF64::new(p.robot[0], p.robot[1], p.robot[2]);
            self.steps.push(Step::Poses(stamp, slam.particles().iter().map(pose).collect()));
        }
    }

    pub fn resampled(&mut self, slam: &Slam<'_>) {
        if let Slam::Fast(slam) = slam
            && slam.has_resampled()
        {
            self.steps.push(Step::Parents(slam.particles().iter().map(|particle| particle.parent).collect()));
        }
    }

    /// The path of the heaviest.
    pub fn of(&self, slam: &Slam<'_>) -> Vec<TimedPose> {
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
