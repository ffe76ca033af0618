//! The seam between a stream of scans and the SLAM: scans in, poses of the robot out.

use lrfslam_core::de::Member;
use lrfslam_core::filter::PointCapacityError;
use lrfslam_core::geometry::{Point2, Pose2};
use lrfslam_core::laser_odometry::{KeyScan, LaserOdometry, OdometryMemory, Reference, StepReport};
use lrfslam_core::ndt::{DirectoryEntry, NdtMemoryError, NdtTile};
use rand_core::SeedableRng as _;
use rand_pcg::Pcg32;
use serde::Serialize;

use crate::config::RunConfig;
use crate::log::LogScan;

lrfslam_core::config! {
    /// Memory, fixed from the start.
    pub struct MemoryConfig {
        /// Tiles of 8 × 8 NDT cells (3 kB each), for all overlapping grids together.
        ndt_tiles: u16 = 8192, in 16..=65535;
        /// Points of one scan.
        scan_points: u16 = 4096, in 64..=65535;
    }
}

/// Tiles along the side of the NDT's directory: 614 m of cells of 0.3 m before places are told apart no more.
const DIRECTORY_SIDE: usize = 256;

/// The memory that a [`Mapper`] works in.
#[derive(Debug)]
pub struct MapperMemory {
    directory: Vec<DirectoryEntry>,
    tiles: Vec<NdtTile>,
    population: Vec<Member<3>>,
    points: Vec<Point2>,
    hits: Vec<Point2>,
    key_points: Vec<Point2>,
    key_scans: Vec<KeyScan>,
}

impl MapperMemory {
    /// As much as `config` says; it does not grow.
    pub fn new(config: &RunConfig) -> Self {
        let layers = if config.ndt.overlapping { 4 } else { 1 };
        let population = config.de.population.max(config.recovery.population);
        let points = usize::from(config.memory.scan_points);
        let key_scans = match config.odometry.reference {
            Reference::WholeMap => 0,
            Reference::PreviousScan => 1,
            Reference::RecentScans => usize::from(config.odometry.recent_scans),
        };
        Self {
            directory: vec![DirectoryEntry::default(); layers * DIRECTORY_SIDE * DIRECTORY_SIDE],
            tiles: vec![NdtTile::EMPTY; usize::from(config.memory.ndt_tiles)],
            population: vec![Member::EMPTY; usize::from(population)],
            points: vec![Point2::default(); points],
            hits: vec![Point2::default(); points],
            key_points: vec![Point2::default(); points * key_scans],
            key_scans: vec![KeyScan::default(); key_scans],
        }
    }
}

/// Turns scans into poses.
#[derive(Debug)]
pub struct Mapper<'m> {
    odometry: LaserOdometry<'m>,
    rng: Pcg32,
    last_odometry: Option<Pose2>,
    counts: MatchCounts,
}

/// How the matching went, over a run.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct MatchCounts {
    /// Scans that agreed too little with the reference for their pose to be believed.
    pub lost_scans: u64,
    /// Scans whose scene left an axis undetermined, e.g. a featureless corridor.
    pub undetermined_scans: u64,
    /// Scans that went into the reference.
    pub key_scans: u64,
    /// Generations of the search.
    pub generations: u64,
    /// Points after the filter.
    pub points: u64,
    /// Points that found the pool of cells full.
    pub dropped_points: u64,
}

impl MatchCounts {
    fn add(&mut self, step: &StepReport) {
        self.lost_scans += u64::from(step.is_lost);
        self.undetermined_scans += u64::from(step.matched.undetermined.is_some());
        self.key_scans += u64::from(step.is_key);
        self.generations += u64::from(step.matched.generations);
        self.points += step.points as u64;
        self.dropped_points += u64::from(step.dropped);
    }
}

impl<'m> Mapper<'m> {
    /// A mapper that has seen nothing; `seed` starts its random numbers.
    ///
    /// # Errors
    /// If the memory does not fit the configuration.
    pub fn new(config: &RunConfig, seed: u64, memory: &'m mut MapperMemory) -> Result<Self, NdtMemoryError> {
        let lent = OdometryMemory {
            directory: &mut memory.directory,
            tiles: &mut memory.tiles,
            population: &mut memory.population,
            points: &mut memory.points,
            hits: &mut memory.hits,
            key_points: &mut memory.key_points,
            key_scans: &mut memory.key_scans,
        };
        Ok(Self {
            odometry: LaserOdometry::new(&config.laser_odometry(), lent)?,
            rng: Pcg32::seed_from_u64(seed),
            last_odometry: None,
            counts: MatchCounts::default(),
        })
    }

    /// Takes the next scan; only with `use_odometry` is the log's odometry looked at.
    ///
    /// # Errors
    /// If the scan has more points than there is memory for.
    pub fn add_scan(
        &mut self,
        scan: &LogScan,
        robot_from_lrf: Pose2,
        use_odometry: bool,
    ) -> Result<StepReport, PointCapacityError> {
        let odometry = scan.map_from_robot_odometry.filter(|_| use_odometry);
        let displacement = self.last_odometry.zip(odometry).map(|(last, now)| last.between(now));
        let step = self.odometry.step(&scan.scan(), robot_from_lrf, displacement, &mut self.rng)?;
        self.last_odometry = odometry;
        self.counts.add(&step);
        Ok(step)
    }

    /// How the matching went so far.
    pub fn counts(&self) -> MatchCounts {
        self.counts
    }
}
