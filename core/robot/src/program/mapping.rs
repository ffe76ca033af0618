//! Scans in, poses, segments and the map out: what robots do between the laser and the link.

use super::square;
use crate::config::RobotConfig;
use crate::wire::message::{PARTICLES_MAX, PathNode, ScanPose, Segment};
use lrfslam_core::distributed_map::{DistributedMap, Window};
use lrfslam_core::low_slam::Weighing;
use lrfslam_core::particles::{Particle, Sample};
use lrfslam_core::scan::RangeScan;
use lrfslam_core::slam::{ScanCapacityError, Slam, SlamMemory, SlamMemoryError, StepReport, TILE_SIDE};
use lrfslam_core::time::Instant;

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

/// The SLAM with what the host is to be told of it.
#[derive(Debug)]
pub struct Mapping<'m> {
    config: RobotConfig,
    slam: Slam<'m, TILE_SIDE>,
    lineage: Lineage,
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
    /// [`SlamMemoryError`] if the memory does not fit the configuration.
    pub fn new(config: &RobotConfig, memory: SlamMemory<'m, TILE_SIDE>) -> Result<Self, SlamMemoryError> {
        let mut slam_config = config.slam;
        slam_config.particles.particles = slam_config.particles.particles.min(PARTICLES_MAX as u16);
        let mut slam = Slam::new(&slam_config, config.seed, memory)?;
        square::reserve(&mut slam, &slam_config);
        let mut lineage = Lineage { ancestors: [0; PARTICLES_MAX], step: 0, told_step: 0, stamp: Instant::default() };
        lineage.close();
        Ok(Self { config: *config, slam, lineage, scans: 0 })
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

    /// Maps a scan; for `weigh` see [`Slam::step_with`].
    ///
    /// # Errors
    /// [`ScanCapacityError`] if it has more beams than there is memory for.
    pub fn add_scan_with(
        &mut self,
        scan: &RangeScan<'_>,
        weigh: impl FnMut(&Weighing<'_, 'm, TILE_SIDE>, &mut [Sample], &mut Window<'m>),
    ) -> Result<Mapped, ScanCapacityError> {
        let mounting = self.config.robot_from_lrf;
        let report = self.slam.step_with(scan, mounting, None, weigh)?;
        if report.filter.is_some() {
            self.lineage.advance(self.slam.filter().particles(), scan.stamp);
        }
        let at_step = self.best().map(|particle| particle.map_from_robot).unwrap_or_default();
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
        self.slam.filter().particles().get(self.slam.best())
    }

    /// What the particles' paths have become since the last segment that was [told](Self::segment_told), if anything.
    pub fn segment(&self) -> Option<Segment> {
        let Lineage { ancestors, step, told_step, stamp } = &self.lineage;
        if step == told_step {
            return None;
        }
        let mut particles = heapless::Vec::new();
        for (particle, parent) in self.slam.filter().particles().iter().zip(ancestors) {
            // As many as there are ancestors, for which there is room.
            let _ = particles.push(PathNode { parent: *parent, map_from_robot: particle.map_from_robot });
        }
        Some(Segment { step: *step, since_step: *told_step, stamp: *stamp, best: self.slam.best() as u8, particles })
    }

    /// The last segment is on its way; the next one begins at its end.
    pub fn segment_told(&mut self) {
        self.lineage.close();
    }
}
