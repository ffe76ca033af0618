//! A map under way: scans in; trajectory, map, picture and report out, as often as they are asked for.
//!
//! What `lrfslam map`, `run`, `replay` and `attach` share; they differ in where the scans come from, and the last in who places them: a
//! [`LowLevel`] on this computer, or a robot's.

mod saving;
mod showing;
mod whereabouts;

use std::path::Path;
use std::time::{Duration as WallDuration, Instant as WallInstant};

use anyhow::Context as _;
use lrfslam_core::geometry::Pose2;
use lrfslam_core::laser_odometry;
use lrfslam_core::matcher::Match;
use lrfslam_core::scan::RangeScan;
use lrfslam_core::slam::StepReport;
use lrfslam_core::sweep::Sweep;
use lrfslam_core::time::Instant;
use lrfslam_robot::wire::message::{FromRobot, ScanPose};

pub use self::saving::About;
pub use self::showing::Beside;
pub use self::whereabouts::Whereabouts;
use crate::mapping::high::{HighCounts, HighParticles, HighSlam};
use crate::mapping::mapper::Mapper;
use crate::mapping::{LowLevel, LowPose, MapperMemory, MappingConfig, ParticlePools};
use crate::maps::occupancy::OccupancyMap;
use crate::output::Aside;
use crate::pose_f64::PoseF64;
use crate::robot::{RobotMap, Sweeps};
use crate::runs::bag::RunBag;

use crate::mapping::saved_map::{self, SavedMap};
use crate::results::quality::{Fit, Fits};
use crate::results::report::BeamCounts;
use crate::results::step_table::StepTable;
use crate::scans::store::ScanStore;
use crate::trajectory::TimedPose;

/// Where the robot was at a scan, seen from where it was at a step of the filter; of matching alone, from the origin.
#[derive(Debug, Clone, Copy)]
struct ScanPlace {
    stamp: Instant,
    step: usize,
    step_from_robot: Pose2,
    fit: Fit,
}

/// A map of scans that this computer places.
pub type MapRun<'m> = Run<'m, Mapper<'m>>;

/// The memory that a [`MapRun`] works in; that of its particles is fixed from the start.
#[derive(Debug)]
pub struct RunMemory {
    mapper: MapperMemory,
    /// Of the high level's particles, if it has any.
    high: Option<ParticlePools>,
}

impl RunMemory {
    /// As much as `config` says. `threads` share the work, at least one; results do not depend on them.
    pub fn new(config: &MappingConfig, threads: usize) -> Self {
        let high = config.high_particles().map(|filter| ParticlePools::new(&filter, &config.memory, threads));
        Self { mapper: config.mapper_memory(threads), high }
    }
}

/// See the [module](self).
#[derive(Debug)]
pub struct Run<'m, L> {
    config: MappingConfig,
    seed: u64,
    low: L,
    high: Option<HighSlam<'m>>,
    /// Drawn on the way by matching alone, whose path does not change.
    map: OccupancyMap,
    /// Those that a map is drawn from again: at the end, from where the best particle was, or later; a high level keeps its own.
    scans: ScanStore,
    /// The place at which each of these was taken.
    drawn: Vec<usize>,
    /// A robot's, until their poses come.
    sweeps: Sweeps,
    /// Without a high level, which knows them itself.
    places: Vec<ScanPlace>,
    fits: Fits,
    /// Stamps of the first and the last scan.
    ends: Option<[Instant; 2]>,
    steps: StepTable,
    aside: Aside,
    map_from_step: Pose2,
    step_count: usize,
    beams: BeamCounts,
    /// The folder of the map that it goes on with.
    continues: Option<String>,
    /// By laser odometry alone, which corrections from above do not move.
    odom_from_robot: PoseF64,
    /// The last step of that.
    moved: PoseF64,
    /// What is recorded of it.
    bag: Option<RunBag>,
    /// See [`finish`](Self::finish).
    is_finished: bool,
    working: WallDuration,
}

impl<'m> MapRun<'m> {
    /// An empty map.
    ///
    /// # Errors
    /// If the memory does not fit the configuration.
    pub fn new(config: &MappingConfig, seed: u64, memory: &'m mut RunMemory) -> anyhow::Result<Self> {
        let RunMemory { mapper, high } = memory;
        let particles = config.high_particles().zip(high.as_mut());
        let particles = particles.map(|(filter, pools)| HighParticles::new(&filter, seed, pools)).transpose()?;
        let mut run = Self::with(config, seed, particles, Mapper::new(&config.slam, seed, mapper)?);
        if run.high.as_ref().is_some_and(HighSlam::has_pieces) {
            run.low.leave_returns();
        }
        Ok(run)
    }

    /// Maps one scan. A scan that cannot be believed is not drawn.
    ///
    /// * `robot_from_lrf` — where the laser sits on the robot
    /// * `odometry` — the robot's pose by its odometry, if that is to be the prediction
    ///
    /// # Errors
    /// If the scan has too many points or beams for the memory.
    pub fn add_scan(
        &mut self,
        scan: &RangeScan<'_>,
        robot_from_lrf: Pose2,
        odometry: Option<Pose2>,
    ) -> anyhow::Result<StepReport> {
        let started = WallInstant::now();
        let before = self.low.map_from_robot();
        let (step, times) = self.low.add_scan(scan, robot_from_lrf, odometry)?;
        self.moved = PoseF64::from(before).between(PoseF64::from(step.odometry.matched.map_from_robot));
        self.odom_from_robot = self.odom_from_robot.then(self.moved);
        let sweep = Sweep { scan: *scan, robot_from_lrf, motion: step.odometry.motion };
        if let Some(filter) = &step.filter {
            self.steps.add(scan.stamp, self.scans(), filter, &times);
            self.map_from_step = step.map_from_robot;
            self.step_count += 1;
        } else if !self.low.has_particles() && !step.odometry.is_lost {
            self.map.insert(&sweep, step.map_from_robot);
        }
        let step_from_robot = self.map_from_step.between(step.map_from_robot);
        let low = low_pose(&step.odometry);
        let (step_index, fit) = (self.step_count.saturating_sub(1), Fit::from(&low));
        let place = ScanPlace { stamp: scan.stamp, step: step_index, step_from_robot, fit };
        let is_kept = if self.low.has_particles() { step.filter.is_some() } else { step.odometry.is_key };
        self.place(&sweep, &low, place, is_kept)?;
        self.working += started.elapsed();
        Ok(step)
    }
}

impl MapRun<'_> {
    /// Goes on with a map made before, whose path and scans stay in it; before the first scan. `folder` — where it was saved.
    ///
    /// * `start` — where in it the robot is now; where it ended if that is not said
    ///
    /// # Errors
    /// If the configuration has no pose graph to go on with, the saved map is not whole, or its scans are larger than the memory.
    pub fn go_on(&mut self, saved: &SavedMap, folder: &Path, start: Option<Pose2>) -> anyhow::Result<()> {
        let has_graph = self.high.is_some() && self.config.high_particles().is_none();
        anyhow::ensure!(
            has_graph,
            "to go on with a map, expected hierarchy.levels = 2 and hierarchy.closing = \"graph\""
        );
        let high = HighSlam::restored(&self.config.high_slam(), &saved.path, saved.scans.clone());
        let mut high = high.with_context(|| folder.join(saved_map::FILE_NAME).display().to_string())?;
        high.put_aside(&self.aside);
        if let Some(correction) = high.drive_on_from(start) {
            let low_pose = self.low.correct(&correction, high.scans())?;
            high.low_goes_on_from(low_pose);
        }
        self.high = Some(high);
        self.continues = Some(folder.display().to_string());
        Ok(())
    }
}

impl Run<'_, RobotMap> {
    /// An empty map of scans that a robot places.
    ///
    /// # Errors
    /// If loops are to be closed by particles.
    pub fn told(config: &MappingConfig, seed: u64) -> anyhow::Result<Self> {
        let particles = config.high_particles().is_some();
        anyhow::ensure!(
            !particles,
            "hierarchy.closing is \"particles\", expected \"graph\" with a robot that does the SLAM itself"
        );
        Ok(Self::with(config, seed, None, RobotMap::new(&config.slam, seed)))
    }

    /// Takes what a robot says of path and map; a scan is placed where it says, with its beams if they were told before.
    ///
    /// # Errors
    /// If a scan is too large for the high level.
    pub fn take(&mut self, message: &FromRobot<'_>, robot_from_lrf: Pose2) -> anyhow::Result<()> {
        let started = WallInstant::now();
        self.low.take(message);
        match message {
            FromRobot::Sweep(part) => self.sweeps.take_part(part),
            FromRobot::Scan(pose) => self.take_pose(pose, robot_from_lrf)?,
            _ => {}
        }
        self.working += started.elapsed();
        Ok(())
    }

    fn take_pose(&mut self, pose: &ScanPose, robot_from_lrf: Pose2) -> anyhow::Result<()> {
        let told = self.sweeps.taken_at(pose.stamp);
        let silent = RangeScan { stamp: pose.stamp, range_max_m: 0.0, beams: &[] };
        let sweep = match &told {
            Some(told) => Sweep { scan: told.scan(), robot_from_lrf, motion: told.motion },
            None => Sweep::at_rest(silent, robot_from_lrf),
        };
        let low = LowPose {
            map_from_robot: pose.odometry,
            undetermined: pose.undetermined,
            is_lost: pose.is_lost,
            is_blind: false,
            is_frozen: false,
        };
        if let Some(bag) = &self.bag {
            match &told {
                Some(told) => bag.scan(&told.scan(), (None, robot_from_lrf), pose.odometry),
                None => bag.pose(pose.stamp, pose.odometry, Some(robot_from_lrf)),
            }
        }
        // To the robot's path every scan is a step.
        let (step, fit) = (self.scans(), Fit::from(&low));
        let place = ScanPlace { stamp: pose.stamp, step, step_from_robot: Pose2::IDENTITY, fit };
        self.place(&sweep, &low, place, told.is_some())
    }

    /// What the robot has told.
    pub fn robot(&self) -> &RobotMap {
        &self.low
    }
}

impl<'m, L: LowLevel> Run<'m, L> {
    fn with(config: &MappingConfig, seed: u64, particles: Option<HighParticles<'m>>, low: L) -> Self {
        Self {
            config: *config,
            seed,
            low,
            high: (config.hierarchy.levels > 1).then(|| HighSlam::new(&config.high_slam(), particles)),
            map: OccupancyMap::new(config.map),
            scans: ScanStore::default(),
            drawn: Vec::new(),
            sweeps: Sweeps::default(),
            places: Vec::new(),
            fits: Fits::default(),
            ends: None,
            steps: StepTable::default(),
            aside: Aside::default(),
            map_from_step: Pose2::IDENTITY,
            step_count: 0,
            beams: BeamCounts::default(),
            continues: None,
            odom_from_robot: PoseF64::default(),
            moved: PoseF64::default(),
            bag: None,
            is_finished: false,
            working: WallDuration::ZERO,
        }
    }

    /// What is wanted again only for the results goes there: a long run takes no more memory than a short one.
    pub fn put_aside(&mut self, aside: Aside) {
        self.high.iter_mut().for_each(|high| high.put_aside(&aside));
        self.steps.put_aside(&aside);
        self.aside = aside;
    }

    /// What is drawn, and what a robot tells, goes into `bag` too.
    pub fn record(&mut self, bag: RunBag) {
        self.bag = Some(bag);
    }

    /// Keeps a scan that the low level has placed.
    ///
    /// * `is_kept` — a map can be drawn from this one too; a high level judges for itself
    fn place(&mut self, sweep: &Sweep<'_>, low: &LowPose, place: ScanPlace, is_kept: bool) -> anyhow::Result<()> {
        if let Some(high) = &mut self.high {
            let taken = match high.add_scan(sweep, low)? {
                Some(correction) => self.low.begin_correction(&correction, high.scans())?,
                None => self.low.go_on_correcting(high.newest_scan(), high.scans())?,
            };
            if let Some(low_pose) = taken {
                high.low_goes_on_from(low_pose);
            }
        } else {
            if is_kept {
                self.scans.add(sweep);
                self.drawn.push(self.places.len());
            }
            self.places.push(place);
        }
        self.is_finished = false;
        self.fits.push(place.fit);
        self.ends = Some([self.ends.map_or(place.stamp, |[first, _]| first), place.stamp]);
        self.beams.add(&sweep.scan);
        Ok(())
    }

    /// No more scans come: poses are put where all visits together say, once; see [`HighSlam::refine`]. [`write_into`](Self::write_into) does it for a
    /// run that is not interrupted and does not go on.
    pub fn finish(&mut self) {
        let high = self.high.as_mut().filter(|_| !self.is_finished);
        high.into_iter().for_each(HighSlam::refine);
        self.is_finished = true;
    }

    /// Where the robot was at every scan, as the highest level now has it.
    pub fn trajectory(&self) -> Vec<TimedPose> {
        if let Some(high) = &self.high {
            let mut path = Vec::with_capacity(high.poses());
            path.extend(high.trajectory());
            return path;
        }
        let path = self.low.path();
        let pose = |place: &ScanPlace| {
            let map_from_step = path.get(place.step).copied().unwrap_or(Pose2::IDENTITY);
            TimedPose { stamp: place.stamp, map_from_robot: map_from_step * place.step_from_robot }
        };
        self.places.iter().map(pose).collect()
    }

    /// Which of these poses are to be believed: the scan fits the map, and the map there is not a piece apart.
    pub fn trust(&self) -> Vec<bool> {
        match &self.high {
            Some(high) => high.trajectory_with_trust().map(|(_, is_trusted)| is_trusted).collect(),
            None => self.fits.iter().map(|fit| fit != Fit::Lost).collect(),
        }
    }

    /// Where the robot was at every scan whose pose is to be believed.
    pub fn trusted_trajectory(&self) -> Vec<TimedPose> {
        if let Some(high) = &self.high {
            // Read once: where the disk fails, poses and trust stay together.
            let mut path = Vec::with_capacity(high.poses());
            path.extend(high.trajectory_with_trust().filter_map(|(pose, is_trusted)| is_trusted.then_some(pose)));
            return path;
        }
        let trusted = self.trajectory().into_iter().zip(self.trust());
        trusted.filter_map(|(pose, is_trusted)| is_trusted.then_some(pose)).collect()
    }

    /// What the high level did so far, if there is one.
    pub fn high_counts(&self) -> Option<HighCounts> {
        self.high.as_ref().map(HighSlam::counts)
    }

    /// Scans mapped so far.
    pub fn scans(&self) -> usize {
        self.fits.scans()
    }
}

/// What the high level goes by: laser odometry, which the particles have corrected, without their jumps from one to the other.
fn low_pose(step: &laser_odometry::OdometryReport) -> LowPose {
    let Match { map_from_robot, undetermined, .. } = step.matched;
    let laser_odometry::OdometryReport { is_lost, is_blind, is_frozen, .. } = *step;
    LowPose { map_from_robot, undetermined, is_lost, is_blind, is_frozen }
}
