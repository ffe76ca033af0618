//! How the robot moves from scan to scan: by matching, cheaply, and by the log's odometry.

use lrfslam_core::filter::{FilterConfig, hits, thin};
use lrfslam_core::geometry::{Point2, Pose2};
use lrfslam_core::laser_odometry::{LaserOdometry, LaserOdometryConfig};
use lrfslam_core::matcher::{Prediction, PriorSpread, ScanMatcher};
use lrfslam_core::ndt::{DirectoryEntry, NdtGrid, NdtTile};
use lrfslam_core::random::RandomStream;
use lrfslam_core::scan::{Beam, Echo, RangeScan};
use lrfslam_core::slam::SlamConfig;
use lrfslam_core::sweep::Sweep;

use super::finding::Mark;
use crate::mapping::{MapperMemory, MemoryConfig};
use crate::scans::log::LogScan;

/// DE's population and generations: a tenth of what mapping takes, since a step may be off by a centimetre here.
const POPULATION: u16 = 24;
const GENERATIONS: u16 = 10;
/// NDT grids: half the usual number.
const GRIDS: u16 = 2;
/// Points that the search looks at.
const SEARCH_POINTS: u16 = 64;
/// The same for a robot that is lost.
const LOST: (u16, u16) = (150, 30);
/// Moments at which it is tried whether the scans are mirrored from there on.
const TRIALS: u32 = 40;
/// A mirrored scan that agrees so many times better with the one before …
const MIRRORED: f32 = 1.3;
/// … and at least so well, score per point, is mirrored.
const AGREES: f32 = 0.12;
/// A scan whose score per point is below this share of the usual one may be mirrored.
const DOUBTFUL: f32 = 0.75;
/// The usual score follows over about ten scans.
const FOLLOWS: f32 = 0.1;
/// After a doubtful scan so many pass before the next trial.
const PAUSE: u32 = 10;

/// From one scan to the next, in the robot's frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct Step {
    pub mark: Mark,
    /// Time since the scan before, s; not positive where times are wrong.
    pub seconds: f64,
    /// How long the sweep took, s; 0 if the beams' times are not known.
    pub sweep_s: f64,
    /// By matching; `None` if the scan did not fit.
    pub matched: Option<Pose2>,
    /// Matching says nothing about one direction: a corridor without features.
    pub is_undetermined: bool,
    /// By odometry; `None` where there is none.
    pub odometry: Option<Pose2>,
    /// Share of the beams that differ from those when the odometry moved last.
    pub strayed: f64,
    /// This scan is mirrored, seen from the one before.
    pub is_mirrored: bool,
}

/// Memory that a [`Doctor`](super::Doctor) follows the robot with.
#[derive(Debug)]
pub struct FollowerMemory {
    odometry: MapperMemory,
    config: SlamConfig,
}

impl FollowerMemory {
    /// For matching with the settings of `slam`, but less effort.
    pub fn new(slam: &SlamConfig, memory: &MemoryConfig) -> Self {
        let mut config = *slam;
        (config.de.population, config.de.generations) = (POPULATION, GENERATIONS);
        config.matcher.search_points = SEARCH_POINTS;
        (config.ndt.grids, config.ndt.facings) = (config.ndt.grids.min(GRIDS), 1);
        (config.recovery.population, config.recovery.generations) = LOST;
        config.recovery.search_points = SEARCH_POINTS;
        Self { odometry: MapperMemory::of_matching(&config, memory), config }
    }
}

/// Follows the robot.
#[derive(Debug)]
pub(super) struct Follower<'m> {
    config: LaserOdometryConfig,
    matcher: LaserOdometry<'m>,
    last: Option<(LogScan, Pose2)>,
    /// Beams when the odometry moved last.
    anchor: Vec<Beam>,
    /// Score per point, as usual.
    usual: f32,
    /// Scans until a mirrored one is looked for again.
    pause: u32,
    trials: u32,
}

impl<'m> Follower<'m> {
    pub fn new(memory: &'m mut FollowerMemory) -> anyhow::Result<Self> {
        let config = memory.config.laser_odometry();
        let matcher = LaserOdometry::new(&config, 1, memory.odometry.lend_odometry())?;
        Ok(Self { config, matcher, last: None, anchor: Vec::new(), usual: 0.0, pause: PAUSE, trials: TRIALS })
    }

    /// The step to `scan`; `None` for the first one.
    pub fn step(&mut self, scan: &LogScan, robot_from_lrf: Pose2) -> anyhow::Result<Option<Step>> {
        let report = self.matcher.step(&scan.scan(), robot_from_lrf, None)?;
        let pose = report.matched.map_from_robot;
        let is_doubtful = self.is_doubtful(report.matched.score_per_point);
        let Some((last, from)) = self.last.replace((scan.clone(), pose)) else { return Ok(None) };
        let is_mirrored = is_doubtful && is_mirrored(&self.config, &last, scan)?;
        let odometry = last.map_from_robot_odometry.zip(scan.map_from_robot_odometry);
        let odometry = odometry.map(|(from, to)| from.between(to));
        if odometry != Some(Pose2::IDENTITY) {
            self.anchor.clone_from(&scan.beams);
        }
        let sweep = scan.beams.first().zip(scan.beams.last());
        Ok(Some(Step {
            mark: Mark::of(scan),
            seconds: scan.stamp.since(last.stamp).micros as f64 * 1e-6,
            sweep_s: sweep.map_or(0.0, |(first, last)| last.offset.micros.abs_diff(first.offset.micros) as f64 * 1e-6),
            matched: (!report.is_lost).then(|| from.between(pose)),
            is_undetermined: report.matched.undetermined.is_some(),
            odometry,
            strayed: strayed(&self.anchor, &scan.beams),
            is_mirrored,
        }))
    }
}

impl Follower<'_> {
    /// True if a scan with this score per point agrees so little that it is worth a trial.
    fn is_doubtful(&mut self, score: f32) -> bool {
        let is_doubtful = score < DOUBTFUL * self.usual;
        self.usual += FOLLOWS * (score - self.usual);
        let is_due = is_doubtful && self.pause == 0 && self.trials > 0;
        self.trials -= u32::from(is_due);
        self.pause = if is_doubtful { PAUSE } else { self.pause.saturating_sub(1) };
        is_due
    }
}

/// Share of the beams that hit something in both, at clearly other ranges.
fn strayed(before: &[Beam], now: &[Beam]) -> f64 {
    let hits = before.iter().zip(now).filter_map(|pair| match (pair.0.echo, pair.1.echo) {
        (Echo::Hit(before_m), Echo::Hit(now_m)) => Some((before_m - now_m).abs() > 0.1 + 0.02 * before_m),
        _ => None,
    });
    let (hits, others) =
        hits.fold((0.0, 0.0), |(hits, others), differs| (hits + 1.0, others + f64::from(u8::from(differs))));
    if hits > 0.0 { others / hits } else { 0.0 }
}

/// Points of a scan in the laser's frame.
fn points(scan: &RangeScan<'_>, radius_m: f32) -> anyhow::Result<Vec<Point2>> {
    let mut raw = vec![Point2::default(); scan.beams.len().max(1)];
    let mut memory = raw.clone();
    let hits = hits(&Sweep::at_rest(*scan, Pose2::IDENTITY), &mut raw)?;
    Ok(thin(&FilterConfig { radius_m }, hits, &mut memory)?.to_vec())
}

/// True if `now`, seen in a mirror, agrees with `before`, and as it is does not.
fn is_mirrored(config: &LaserOdometryConfig, before: &LogScan, now: &LogScan) -> anyhow::Result<bool> {
    const SIDE: usize = 256;
    let mut directory = vec![DirectoryEntry::default(); config.ndt.directories() * SIDE * SIDE];
    let mut tiles = vec![NdtTile::EMPTY; 16_000];
    let mut grid = NdtGrid::new(&config.ndt, &mut directory, &mut tiles)?;
    grid.insert(&points(&before.scan(), 0.0)?, Pose2::IDENTITY);
    let source = points(&now.scan(), config.filter.radius_m)?;
    let mirrored: Vec<Point2> = source.iter().map(|point| Point2::new(point.x, -point.y)).collect();
    let size = usize::from(config.recovery.population);
    let score = |points: &[Point2]| {
        let mut population = vec![lrfslam_core::de::Member::EMPTY; size];
        let mut matcher = ScanMatcher::new(&config.search, &config.de, &config.matcher, &mut population);
        let prediction =
            Prediction { prior: PriorSpread::NONE, ..Prediction::usual(Pose2::IDENTITY, points.len() as f32) };
        let mut rng = RandomStream::new(1, 0, 0);
        matcher.align_anywhere(&grid, points, &prediction, &config.recovery, &mut rng).score_per_point
    };
    let (as_is, in_mirror) = (score(&source), score(&mirrored));
    Ok(in_mirror >= AGREES && in_mirror > MIRRORED * as_is)
}
