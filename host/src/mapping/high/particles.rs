//! Particles at the high level (thesis §3.2.3.4, figure 4.19): each is a history of where the segments lie, with its own map.
//!
//! Segment → every particle's end is perturbed by what the segment before may have drifted → the segment's scans are weighed
//! along it against the particle's map → resampling → the scans are printed. It is core's filter, whose steps are segments here.
//!
//! Departures from the thesis: the drift is that which the low level's own doubts add up to
//! ([`Segment::covariance`](super::segment::Segment)) and not a constant, and the trajectory is the low level's corrected one, not a sample of several.

use lrfslam_core::geometry::Pose2;
use lrfslam_core::low_slam::{LowSlam, LowSlamConfig, LowSlamConfigs, LowSlamMemoryError, Stretch};
use lrfslam_core::math::normal;
use lrfslam_core::motion::Motion;
use lrfslam_core::perception::PerceptionConfig;
use lrfslam_core::rays::RayCapacityError;
use lrfslam_core::scan::Beam;
use lrfslam_core::slam::SlamConfig;
use lrfslam_core::sweep::Sweep;
use nalgebra::{Matrix3, Vector3};
use rand_core::Rng;

use super::placing::apart;
use super::segment::Segment;
use crate::mapping::genealogy::Genealogy;
use crate::mapping::memory::{ParticlePools, SIDE, WindowSlots};
use crate::mapping::threads::weigh_on_threads;
use crate::pose_f64::PoseF64;
use crate::scans::store::ScanStore;

/// Particles kept at most. Source: the original.
const PARTICLES: u16 = 50;
/// Poses tried for each particle kept. Source: the original.
const SAMPLES_PER_PARTICLE: u16 = 10;
/// The laser's σ in the segments' maps, m. Source: the thesis (4.5.2); the original: 0.41.
const SIGMA_M: f32 = 0.07;
/// The log-likelihood of a segment is multiplied by this: its scans all share what the map is off. Chosen; the thesis: 1.
const GAIN: f32 = 0.1;
/// Of a segment, scans this far apart are weighed and printed, m …
const SCAN_STEP_M: f32 = 0.3;
/// … or so far turned, degrees. Chosen; the thesis: all.
const SCAN_STEP_DEG: f32 = 15.0;
/// Standard deviations of the drift sampled, in those that the low level's doubts add up to, which are on the safe side: particles that
/// nothing has told apart yet wander off by what they are sampled with. Chosen.
const DRIFT_SIGMAS: f32 = 0.2;

/// What core's particle filter works with at the high level; `slam` is the low level's.
pub fn filter_config(slam: &SlamConfig) -> LowSlamConfigs {
    LowSlamConfigs {
        filter: LowSlamConfig {
            particles: PARTICLES,
            particles_min: PARTICLES,
            samples_per_particle: SAMPLES_PER_PARTICLE,
        },
        closes_loops: false,
        perception: PerceptionConfig { sigma_m: SIGMA_M, gain: GAIN, ..slam.perception },
        ..slam.low_slam()
    }
}

/// A particle filter whose steps are segments: each particle is a history of where they lie, with its own map.
#[derive(Debug)]
pub struct HighParticles<'m> {
    filter: LowSlam<'m, SIDE>,
    windows: &'m mut [WindowSlots],
    genealogy: Genealogy,
    /// What the segment before may have drifted by, in the axes of its end.
    drift: Drift,
}

impl<'m> HighParticles<'m> {
    /// Particles that have seen no segment yet.
    ///
    /// # Errors
    /// If the memory does not fit the configuration.
    pub fn new(filter: &LowSlamConfigs, seed: u64, memory: &'m mut ParticlePools) -> Result<Self, LowSlamMemoryError> {
        let (lent, windows) = memory.lend();
        let filter = LowSlam::new(filter, seed, lent)?;
        Ok(Self { filter, windows, genealogy: Genealogy::default(), drift: Drift(Matrix3::zeros()) })
    }

    /// Takes the next segment; returns where all segments end in the history of the most likely particle.
    ///
    /// # Errors
    /// If a scan has more beams than there is memory for.
    pub fn add(&mut self, segment: &Segment, scans: &ScanStore) -> Result<Vec<PoseF64>, RayCapacityError> {
        let (step_m, step_rad) = (SCAN_STEP_M, SCAN_STEP_DEG.to_radians());
        let kept = segment.poses.with_scans().map(|(pose, scan)| (pose.start_from_robot, scan));
        let mut stretch = SegmentScans { kept: apart(kept, step_m, step_rad).collect(), scans, beams: Vec::new() };
        let end = segment.start_from_end;
        let (windows, drift) = (&mut *self.windows, self.drift);
        let report = self.filter.step_along(&mut stretch, end.to_f32(), &drift, |weighing, samples, own| {
            weigh_on_threads(weighing, samples, own, windows);
        })?;
        self.drift = Drift::at_end_of(segment);
        self.genealogy.add(self.filter.particles());
        Ok(self.genealogy.path(report.best).into_iter().map(PoseF64::from).collect())
    }
}

/// Gaussian drift: a factor of its covariance (x, y, heading; m, m, rad).
#[derive(Debug, Clone, Copy)]
struct Drift(Matrix3<f32>);

impl Drift {
    fn at_end_of(segment: &Segment) -> Self {
        let (sin, cos) = segment.start_from_end.heading.sin_cos();
        let turned = Matrix3::new(cos, sin, 0.0, -sin, cos, 0.0, 0.0, 0.0, 1.0);
        let covariance = turned * segment.covariance * turned.transpose() + Matrix3::from_diagonal_element(1e-12);
        let factor = covariance.cholesky().map(|cholesky| cholesky.l());
        Self(factor.map_or_else(Matrix3::zeros, |factor| factor.map(|entry| DRIFT_SIGMAS * entry as f32)))
    }
}

impl Motion for Drift {
    fn sample(&self, map_from_robot: Pose2, rng: &mut impl Rng) -> Pose2 {
        let noise = self.0 * Vector3::new(normal(rng), normal(rng), normal(rng));
        map_from_robot * Pose2::new(noise.x, noise.y, noise.z)
    }
}

/// The scans of a segment that are looked at.
struct SegmentScans<'s> {
    kept: Vec<(Pose2, u32)>,
    scans: &'s ScanStore,
    beams: Vec<Beam>,
}

impl Stretch for SegmentScans<'_> {
    fn len(&self) -> usize {
        self.kept.len()
    }

    fn scan(&mut self, index: usize) -> Option<(Pose2, Sweep<'_>)> {
        let (start_from_robot, scan) = *self.kept.get(index)?;
        Some((start_from_robot, self.scans.sweep(scan as usize, &mut self.beams)?))
    }
}
