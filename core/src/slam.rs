//! The whole SLAM that runs on the robot: laser odometry moves the particles of DP-SLAM, whose maps then judge it.
//!
//! scan → [`LaserOdometry`] → displacement with its doubts → [`ScanMatchingMotion`] → [`LowSlam`] → pose of the best particle.
//!
//! The filter takes a step once the robot has moved far enough; between its steps the pose follows the laser odometry. A scan that the
//! odometry does not believe is not shown to the filter.
//!
//! After every step the odometry goes on from the particles' mean, so that the map it matches against grows along their path. Were
//! it left alone, the particles' noise would add up over the run: nothing would ever bring them back to where their map fits. The mean
//! and not the best one: where the laser cannot tell particles apart the best is chosen by chance.

mod config;
mod pools;

pub use config::SlamConfig;
pub use pools::{SlamPools, SmallPools};

use crate::distributed_map::{DistributedMap, Window};
use crate::filter::PointCapacityError;
use crate::geometry::{Point2, Pose2};
use crate::grid::Occupancy;
use crate::laser_odometry::{self, LaserOdometry, OdometryMemory};
use crate::low_slam::{self, LowSlam, LowSlamMemory, LowSlamMemoryError, Weighing};
use crate::motion::{MatchedMotion, ScanMatchingMotion, ScanMatchingMotionConfig};
use crate::ndt::NdtMemoryError;
use crate::particles::Sample;
use crate::rays::RayCapacityError;
use crate::scan::RangeScan;
use crate::sweep::Sweep;

crate::config! {
    /// When the particle filter takes a step.
    pub struct StepConfig {
        /// After this much travel, m. The thesis: 0, with every scan; the original: 0.05.
        distance_m: f32 = 0.1, in 0.0..=10.0;
        /// … or this much rotation, degrees. The original: 1.7.
        rotation_deg: f32 = 4.0, in 0.0..=180.0;
    }
}

impl StepConfig {
    /// True if the robot has `moved` enough since the last step for another one.
    pub fn is_due(&self, moved: Pose2) -> bool {
        moved.position().norm() >= self.distance_m || moved.heading.abs() >= self.rotation_deg.to_radians()
    }

    /// How many steps due as soon as they can be `moved` is as long as; 1 if steps are due at once.
    fn usual_steps(&self, moved: Pose2) -> f32 {
        let [distance, rotation] =
            [(moved.position().norm(), self.distance_m), (moved.heading.abs(), self.rotation_deg.to_radians())]
                .map(|(moved, due)| if due > 0.0 { moved / due } else { 1.0 });
        distance.max(rotation)
    }
}

/// Squares along the side of a tile of [`SlamPools`].
pub const TILE_SIDE: usize = 8;

/// Memory that a [`Slam`] works in, lent by the caller; fixed arrays of it are [`SlamPools`].
#[derive(Debug)]
pub struct SlamMemory<'m, const SIDE: usize> {
    /// Of laser odometry.
    pub odometry: OdometryMemory<'m>,
    /// Of the particles.
    pub particles: LowSlamMemory<'m, SIDE>,
}

/// The memory lent to a [`Slam`] does not suit its configuration.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SlamMemoryError {
    /// The matcher's.
    #[error(transparent)]
    Ndt(#[from] NdtMemoryError),
    /// The particles'.
    #[error(transparent)]
    Particles(#[from] LowSlamMemoryError),
}

/// The scan is larger than the memory lent.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ScanCapacityError {
    /// For points.
    #[error(transparent)]
    Points(#[from] PointCapacityError),
    /// For rays.
    #[error(transparent)]
    Rays(#[from] RayCapacityError),
}

/// What one scan did.
#[derive(Debug, Clone, Copy)]
pub struct StepReport {
    /// Where the robot is, in the map of the best particle; its path may change when another becomes the best.
    pub map_from_robot: Pose2,
    /// Matching.
    pub odometry: laser_odometry::OdometryReport,
    /// The filter's step, if it took one.
    pub filter: Option<low_slam::FilterReport>,
}

/// See the [module](self).
#[derive(Debug)]
pub struct Slam<'m, const SIDE: usize> {
    config: StepConfig,
    motion: ScanMatchingMotionConfig,
    odometry: LaserOdometry<'m>,
    filter: LowSlam<'m, SIDE>,
    /// The particles hold the robot on old ground, and the odometry is left alone.
    closes_loops: bool,
    /// Mean pose of the particles at the filter's last step, from where the odometry went on.
    map_from_step: Option<Pose2>,
    /// Pose of the best one.
    map_from_best: Pose2,
    /// Its index among the particles.
    best: usize,
    /// Axis in the odometry's map that some scan since then left undetermined.
    undetermined: Option<Point2>,
}

impl<'m, const SIDE: usize> Slam<'m, SIDE> {
    /// A robot at its map's origin that has seen nothing yet.
    ///
    /// * `seed` — of all random numbers: the same seed, configuration and scans give the same bits, whatever the memory if it is enough
    ///
    /// # Errors
    /// [`SlamMemoryError`] if the memory does not suit the configuration.
    pub fn new(config: &SlamConfig, seed: u64, memory: SlamMemory<'m, SIDE>) -> Result<Self, SlamMemoryError> {
        Ok(Self {
            config: config.steps,
            motion: config.motion,
            odometry: LaserOdometry::new(&config.laser_odometry(), seed, memory.odometry)?,
            filter: LowSlam::new(&config.low_slam(), seed, memory.particles)?,
            closes_loops: config.low_slam().closes_loops,
            map_from_step: None,
            map_from_best: Pose2::IDENTITY,
            best: 0,
            undetermined: None,
        })
    }

    /// The particles and their maps.
    pub fn filter(&self) -> &LowSlam<'m, SIDE> {
        &self.filter
    }

    /// Index of the best particle among the [filter](Self::filter)'s.
    pub fn best(&self) -> usize {
        self.best
    }

    /// What the best particle's map says of the square that holds `point`, map frame, m.
    ///
    /// The map is that of the last step of the filter. Cost: see [`DistributedMap::square_at`].
    pub fn occupancy_at(&self, point: Point2) -> Occupancy {
        self.filter.square_at(self.best, point).occupancy()
    }

    /// The laser odometry.
    pub fn odometry(&self) -> &LaserOdometry<'m> {
        &self.odometry
    }

    /// Somebody else finds a robot that may be anywhere; see [`LaserOdometry::leave_returns`].
    pub fn leave_returns(&mut self) {
        self.odometry.leave_returns();
    }

    /// The particles' maps, to let go and take back tiles.
    pub fn map_mut(&mut self) -> &mut DistributedMap<'m, SIDE> {
        self.filter.map_mut()
    }

    /// Puts the robot at `map_from_robot` and forgets the map; to be followed by [`refer_to`](Self::refer_to) for every scan of the new one.
    ///
    /// For a high level that has corrected the map: all particles go on from one pose, in one map.
    pub fn restart_at(&mut self, map_from_robot: Pose2) {
        self.odometry.restart_at(map_from_robot);
        self.filter.restart_at(map_from_robot);
        self.begin_at(map_from_robot);
    }

    /// The same with the map of `drawn`, of the same configuration, which has been [told](Self::refer_to) it since it was
    /// [begun anew](Self::restart_at), and gets this one's for it. So a large map can be drawn beside the one in use, bit by bit.
    pub fn go_on_in(&mut self, drawn: &mut Self, map_from_robot: Pose2) {
        self.odometry.go_on_in(&mut drawn.odometry, map_from_robot);
        self.filter.go_on_in(&mut drawn.filter, map_from_robot);
        self.begin_at(map_from_robot);
    }

    fn begin_at(&mut self, map_from_robot: Pose2) {
        self.map_from_step = Some(map_from_robot);
        self.map_from_best = map_from_robot;
        self.best = 0;
        self.undetermined = None;
    }

    /// Extends the new map by a scan that was taken at `map_from_scan`; returns how many points and squares found no room.
    ///
    /// # Errors
    /// [`ScanCapacityError`] if the scan is larger than the memory lent.
    pub fn refer_to(&mut self, sweep: &Sweep<'_>, map_from_scan: Pose2) -> Result<u32, ScanCapacityError> {
        Ok(self.odometry.refer_to(sweep, map_from_scan)? + self.filter.refer_to(sweep, map_from_scan)?)
    }

    /// Takes the next scan, by the laser alone and on one thread.
    ///
    /// * `robot_from_lrf` — where the laser sits on the robot
    ///
    /// # Errors
    /// [`ScanCapacityError`] if the scan is larger than the memory lent.
    pub fn step(&mut self, scan: &RangeScan<'_>, robot_from_lrf: Pose2) -> Result<StepReport, ScanCapacityError> {
        self.step_with(scan, robot_from_lrf, None, |weighing, samples, window| weighing.weigh_all(samples, window))
    }

    /// Takes the next scan.
    ///
    /// * `robot_from_lrf` — where the laser sits on the robot
    /// * `displacement` — the robot's displacement since the last scan by odometry, if there is any
    /// * `weigh` — see [`LowSlam::step_with`]; on one thread, [`Weighing::weigh_all`]
    ///
    /// # Errors
    /// [`ScanCapacityError`] if the scan is larger than the memory lent.
    pub fn step_with(
        &mut self,
        scan: &RangeScan<'_>,
        robot_from_lrf: Pose2,
        displacement: Option<Pose2>,
        weigh: impl FnMut(&Weighing<'_, 'm, SIDE>, &mut [Sample], &mut Window<'m>),
    ) -> Result<StepReport, ScanCapacityError> {
        let odometry = self.odometry.step(scan, robot_from_lrf, displacement)?;
        let matched = &odometry.matched;
        let map_from_robot = matched.map_from_robot;
        let previous = self.map_from_step.unwrap_or(map_from_robot);
        self.undetermined = matched.undetermined.or(self.undetermined);
        let is_due = self.map_from_step.is_none() || self.config.is_due(previous.between(map_from_robot));
        if odometry.is_lost || !is_due {
            let map_from_robot = self.map_from_best * previous.between(map_from_robot);
            return Ok(StepReport { map_from_robot, odometry, filter: None });
        }
        let motion = MatchedMotion::from_map(previous, map_from_robot, self.undetermined);
        let motion = self.motion(previous.between(map_from_robot), &motion);
        let sweep = Sweep { scan: *scan, robot_from_lrf, motion: odometry.motion };
        let filter = self.filter.step_with(&sweep, &motion, weigh)?;
        if !self.closes_loops {
            self.odometry.correct(filter.mean_map_from_robot);
        }
        self.map_from_step = Some(self.odometry.map_from_robot());
        self.map_from_best = filter.map_from_robot;
        self.best = filter.best;
        self.undetermined = None;
        Ok(StepReport { map_from_robot: filter.map_from_robot, odometry, filter: Some(filter) })
    }

    /// Of the particles, in a step of the filter.
    fn motion(&self, moved: Pose2, matched: &MatchedMotion) -> ScanMatchingMotion {
        if !self.closes_loops {
            return ScanMatchingMotion::new(&self.motion, matched);
        }
        let noise = self.motion.drifting(self.config.usual_steps(moved));
        ScanMatchingMotion::new(&noise, matched).with_speed_of(matched)
    }
}

#[cfg(test)]
mod tests;
