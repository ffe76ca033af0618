//! Scans in, poses, segments and the map out: what robots do between the laser and the link.

use super::pools::TILE_SIDE;
use crate::config::RobotConfig;
use crate::wire::message::{PARTICLES_MAX, PathNode, ScanPose, Segment};
use lrfslam_core::distributed_map::{DistributedMap, Window};
use lrfslam_core::laser_odometry::{LaserOdometry, OdometryMemory};
use lrfslam_core::low_slam::{LowSlam, LowSlamMemory, LowSlamMemoryError, Weighing};
use lrfslam_core::ndt::NdtMemoryError;
use lrfslam_core::particles::{Particle, Sample};
use lrfslam_core::random::RandomStream;
use lrfslam_core::scan::RangeScan;
use lrfslam_core::slam::{ScanCapacityError, Slam, StepReport};
use lrfslam_core::time::Instant;

/// Memory that a [`Mapping`] works in, lent by the caller.
#[derive(Debug)]
pub struct MappingMemory<'m> {
    /// Of laser odometry.
    pub odometry: OdometryMemory<'m>,
    /// Of the particles.
    pub particles: LowSlamMemory<'m, TILE_SIDE>,
}

/// The configuration does not suit the memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum MappingError {
    /// The matcher's.
    #[error(transparent)]
    Ndt(#[from] NdtMemoryError),
    /// The particles'.
    #[error(transparent)]
    Particles(#[from] LowSlamMemoryError),
}

/// What one scan did.
#[derive(Debug, Clone, Copy)]
pub struct Mapped {
    /// Of the scan.
    pub stamp: Instant,
    /// The steps of odometry and filter.
    pub report: StepReport,
    /// What the host is told.
    pub pose: ScanPose,
}

/// The SLAM with its random numbers, and with what the host is to be told of it.
#[derive(Debug)]
pub struct Mapping<'m> {
    config: RobotConfig,
    slam: Slam<'m, TILE_SIDE>,
    rng: RandomStream,
    lineage: Lineage,
    best: u8,
    scans: u32,
}

/// Where the particles come from since the last segment.
#[derive(Debug, Clone)]
struct Lineage {
    /// Of each particle, its ancestor's index then.
    ancestors: [u8; PARTICLES_MAX],
    step: u32,
    told_step: u32,
    stamp: Instant,
}

impl Lineage {
    fn advance(&mut self, particles: &[Particle], stamp: Instant) {
        let before = self.ancestors;
        for (ancestor, particle) in self.ancestors.iter_mut().zip(particles) {
            *ancestor = before.get(usize::from(particle.parent)).copied().unwrap_or_default();
        }
        self.step = self.step.saturating_add(1);
        self.stamp = stamp;
    }

    fn close(&mut self) {
        for (ancestor, index) in self.ancestors.iter_mut().zip(0..) {
            *ancestor = index;
        }
        self.told_step = self.step;
    }
}

impl<'m> Mapping<'m> {
    /// A robot at its map's origin that has seen nothing yet. It takes [`PARTICLES_MAX`] particles at most.
    ///
    /// # Errors
    /// [`MappingError`] if the memory does not fit the configuration.
    pub fn new(config: &RobotConfig, memory: MappingMemory<'m>) -> Result<Self, MappingError> {
        let mut low_slam = config.low_slam();
        low_slam.filter.particles = low_slam.filter.particles.min(PARTICLES_MAX as u16);
        let odometry = LaserOdometry::new(&config.laser_odometry(), memory.odometry)?;
        let filter = LowSlam::new(&low_slam, config.seed, memory.particles)?;
        let mut lineage = Lineage { ancestors: [0; PARTICLES_MAX], step: 0, told_step: 0, stamp: Instant::default() };
        lineage.close();
        Ok(Self {
            config: *config,
            slam: Slam::new(&config.steps, &config.motion, odometry, filter),
            rng: RandomStream::new(config.seed, 0, 0),
            lineage,
            best: 0,
            scans: 0,
        })
    }

    /// The configuration it was made with.
    pub fn config(&self) -> &RobotConfig {
        &self.config
    }

    /// The SLAM itself.
    pub fn slam(&self) -> &Slam<'m, TILE_SIDE> {
        &self.slam
    }

    /// The particles' maps, to let go and take back tiles.
    pub(super) fn map_mut(&mut self) -> &mut DistributedMap<'m, TILE_SIDE> {
        self.slam.map_mut()
    }

    /// Maps a scan.
    ///
    /// # Errors
    /// [`ScanCapacityError`] if it has more beams than there is memory for.
    pub fn add_scan(&mut self, scan: &RangeScan<'_>) -> Result<Mapped, ScanCapacityError> {
        self.add_scan_with(scan, |weighing, samples, window| weighing.weigh_all(samples, window))
    }

    /// Maps a scan; for `weigh` see [`LowSlam::step_with`].
    ///
    /// # Errors
    /// [`ScanCapacityError`] if it has more beams than there is memory for.
    pub fn add_scan_with(
        &mut self,
        scan: &RangeScan<'_>,
        weigh: impl FnMut(&Weighing<'_, 'm, TILE_SIDE>, &mut [Sample], &mut Window<'m>),
    ) -> Result<Mapped, ScanCapacityError> {
        let mounting = self.config.robot_from_lrf;
        let report = self.slam.step_with(scan, mounting, None, &mut self.rng, weigh)?;
        if let Some(filter) = &report.filter {
            self.best = filter.best as u8;
            self.lineage.advance(self.slam.filter().particles(), scan.stamp);
        }
        let best = self.slam.filter().particles().get(usize::from(self.best));
        let at_step = best.map(|particle| particle.map_from_robot).unwrap_or_default();
        let moved = at_step.between(report.map_from_robot);
        self.scans = self.scans.saturating_add(1);
        let matched = &report.odometry.matched;
        let pose = ScanPose {
            stamp: scan.stamp,
            number: self.scans,
            step: self.lineage.step,
            moved,
            odometry: matched.map_from_robot,
            undetermined: matched.undetermined,
            is_lost: report.odometry.is_lost,
        };
        Ok(Mapped { stamp: scan.stamp, report, pose })
    }

    /// Steps that the filter has taken.
    pub fn steps(&self) -> u32 {
        self.lineage.step
    }

    /// The most likely particle.
    pub fn best(&self) -> Option<&Particle> {
        self.slam.filter().particles().get(usize::from(self.best))
    }

    /// What the particles' paths have become since the last segment that was [told](Self::segment_told), if anything.
    pub fn segment(&self) -> Option<Segment> {
        let Lineage { ancestors, step, told_step, stamp } = &self.lineage;
        let particles = self.slam.filter().particles().iter().zip(ancestors);
        let particles =
            particles.map(|(particle, parent)| PathNode { parent: *parent, map_from_robot: particle.map_from_robot });
        (step != told_step).then(|| Segment {
            step: *step,
            since_step: *told_step,
            stamp: *stamp,
            best: self.best,
            particles: particles.collect(),
        })
    }

    /// The last segment is on its way; the next one begins at its end.
    pub fn segment_told(&mut self) {
        self.lineage.close();
    }
}
