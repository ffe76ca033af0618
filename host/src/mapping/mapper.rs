//! The seam between a stream of scans and the SLAM: scans in, poses of the robot out.

use lrfslam_core::geometry::Pose2;
use lrfslam_core::laser_odometry::{LaserOdometry, OdometryReport};
use lrfslam_core::scan::RangeScan;
use lrfslam_core::slam::{ScanCapacityError, Slam, SlamConfig, SlamMemory, SlamMemoryError, StepReport};
use lrfslam_core::time::{Duration, Instant};
use std::time::{Duration as WallDuration, Instant as WallInstant};

use super::drawing::Beside;
use super::memory::{MapperMemory, SIDE, WindowSlots};
use super::threads::weigh_on_threads;
use super::{Correction, LowLevel, MatchCounts};
use crate::mapping::genealogy::Genealogy;
use crate::scans::store::ScanStore;

/// Turns scans into poses.
#[derive(Debug)]
pub struct Mapper<'m> {
    engine: Engine<'m>,
    last_odometry: Option<Pose2>,
    newest: Newest,
    counts: MatchCounts,
}

/// The latest scan.
#[derive(Debug, Clone, Copy, Default)]
struct Newest {
    stamp: Option<Instant>,
    /// Since the one before.
    interval: Duration,
    map_from_robot: Pose2,
    /// It went into what scans are matched against.
    is_key: bool,
}

#[derive(Debug)]
enum Engine<'m> {
    /// Matching alone.
    Matcher(Box<LaserOdometry<'m>>),
    /// Particles over whole maps.
    DpSlam(Box<DpSlam<'m>>),
}

#[derive(Debug)]
struct DpSlam<'m> {
    slam: Slam<'m, SIDE>,
    /// The corrected map, if there is memory for two.
    beside: Option<Beside<'m>>,
    /// One window for each thread.
    windows: &'m mut [WindowSlots],
    genealogy: Genealogy,
}

/// Where the time of one scan went.
#[derive(Debug, Clone, Copy, Default)]
pub struct StageTimes {
    /// Matching the scan, and moving the particles.
    pub matching: WallDuration,
    /// Weighing the particles.
    pub weighing: WallDuration,
    /// Resampling, and printing the scan into the particles' maps.
    pub printing: WallDuration,
}

impl<'m> Mapper<'m> {
    /// A mapper that has seen nothing; `seed` starts its random numbers.
    ///
    /// # Errors
    /// If the memory does not fit the configuration.
    pub fn new(config: &SlamConfig, seed: u64, memory: &'m mut MapperMemory) -> Result<Self, SlamMemoryError> {
        let MapperMemory { odometry, particles, beside } = memory;
        let odometry = odometry.lend();
        let engine = match particles {
            None => Engine::Matcher(Box::new(LaserOdometry::new(&config.laser_odometry(), seed, odometry)?)),
            Some(memory) => {
                let (particles, windows) = memory.lend();
                let slam = Slam::new(config, seed, SlamMemory { odometry, particles })?;
                let beside = beside.as_mut().map(|(odometry, particles)| {
                    let (odometry, particles) = (odometry.lend(), particles.lend().0);
                    Slam::new(config, seed, SlamMemory { odometry, particles }).map(Beside::new)
                });
                let beside = beside.transpose()?;
                Engine::DpSlam(Box::new(DpSlam { slam, beside, windows, genealogy: Genealogy::default() }))
            }
        };
        Ok(Self { engine, last_odometry: None, newest: Newest::default(), counts: MatchCounts::default() })
    }

    /// A lost robot begins a new piece of map, and metres of way tell where that lies.
    pub fn leave_returns(&mut self) {
        match &mut self.engine {
            Engine::Matcher(matcher) => matcher.leave_returns(),
            Engine::DpSlam(engine) => engine.slam.leave_returns(),
        }
    }

    /// Takes the next scan.
    ///
    /// * `robot_from_lrf` — where the laser sits on the robot
    /// * `odometry` — the robot's pose by its odometry, if that is to be the prediction
    ///
    /// # Errors
    /// If the scan has more points or beams than there is memory for.
    pub fn add_scan(
        &mut self,
        scan: &RangeScan<'_>,
        robot_from_lrf: Pose2,
        odometry: Option<Pose2>,
    ) -> Result<(StepReport, StageTimes), ScanCapacityError> {
        let displacement = self.last_odometry.zip(odometry).map(|(last, now)| last.between(now));
        let started = WallInstant::now();
        let done = match &mut self.engine {
            Engine::Matcher(matcher) => {
                let odometry = matcher.step(scan, robot_from_lrf, displacement)?;
                let step = StepReport { map_from_robot: odometry.matched.map_from_robot, odometry, filter: None };
                (step, StageTimes { matching: started.elapsed(), ..StageTimes::default() })
            }
            Engine::DpSlam(engine) => engine.add_scan(scan, robot_from_lrf, displacement)?,
        };
        self.last_odometry = odometry;
        self.newest = self.newest.followed_by(scan.stamp, &done.0.odometry);
        self.counts.add(&done.0.odometry);
        Ok(done)
    }

    /// Index of the best particle, and the path of each at all steps of the filter since the map was last corrected; none of matching alone.
    pub fn particle_paths(&self) -> (usize, Vec<Vec<Pose2>>) {
        let Engine::DpSlam(engine) = &self.engine else { return (0, Vec::new()) };
        let count = engine.slam.filter().particles().len();
        (engine.slam.best(), (0..count).map(|index| engine.genealogy.path(index)).collect())
    }

    /// Where the laser odometry takes the robot to be: from here the next scan will have moved.
    pub fn map_from_robot(&self) -> Pose2 {
        match &self.engine {
            Engine::Matcher(matcher) => matcher.map_from_robot(),
            Engine::DpSlam(engine) => engine.slam.odometry().map_from_robot(),
        }
    }
}

impl LowLevel for Mapper<'_> {
    fn correct(&mut self, correction: &Correction, scans: &ScanStore) -> anyhow::Result<Pose2> {
        let Correction { map_from_robot, reference } = correction;
        match &mut self.engine {
            Engine::Matcher(matcher) => matcher.restart_at(*map_from_robot),
            Engine::DpSlam(engine) => engine.restart_at(*map_from_robot),
        }
        let mut beams = Vec::new();
        for (map_from_scan, scan) in reference {
            let Some(sweep) = scans.sweep(*scan as usize, &mut beams) else { continue };
            let dropped = match &mut self.engine {
                Engine::Matcher(matcher) => matcher.refer_to(&sweep, *map_from_scan)?,
                Engine::DpSlam(engine) => engine.slam.refer_to(&sweep, *map_from_scan)?,
            };
            self.counts.dropped_points += u64::from(dropped);
        }
        Ok(*map_from_robot)
    }

    fn begin_correction(&mut self, correction: &Correction, scans: &ScanStore) -> anyhow::Result<Option<Pose2>> {
        let Newest { interval, map_from_robot, .. } = self.newest;
        if let Engine::DpSlam(engine) = &mut self.engine
            && let Some(beside) = &mut engine.beside
            && beside.begin(correction, map_from_robot, (scans, interval))
        {
            // A scan that closes a loop has cost enough.
            return Ok(None);
        }
        self.correct(correction, scans).map(Some)
    }

    fn go_on_correcting(&mut self, newest: Option<u32>, scans: &ScanStore) -> anyhow::Result<Option<Pose2>> {
        let Engine::DpSlam(engine) = &mut self.engine else { return Ok(None) };
        let Some(beside) = &mut engine.beside else { return Ok(None) };
        let Newest { interval, map_from_robot, is_key, .. } = self.newest;
        if let Some(scan) = newest.filter(|_| is_key) {
            beside.add(scan, map_from_robot);
        }
        self.counts.dropped_points += u64::from(beside.draw(scans, interval)?);
        let goes_on_from = beside.change_over(&mut engine.slam, map_from_robot);
        if goes_on_from.is_some() {
            engine.genealogy = Genealogy::default();
        }
        Ok(goes_on_from)
    }

    /// The best particle's own history.
    fn path(&self) -> Vec<Pose2> {
        match &self.engine {
            Engine::Matcher(_) => Vec::new(),
            Engine::DpSlam(engine) => engine.genealogy.path(engine.slam.best()),
        }
    }

    fn has_particles(&self) -> bool {
        matches!(self.engine, Engine::DpSlam(_))
    }

    fn counts(&self) -> MatchCounts {
        self.counts
    }

    fn particles(&self) -> Vec<(Pose2, f32)> {
        match &self.engine {
            Engine::Matcher(_) => Vec::new(),
            Engine::DpSlam(engine) => {
                let particles = engine.slam.filter().particles().iter();
                particles.map(|particle| (particle.map_from_robot, particle.weight)).collect()
            }
        }
    }
}

impl Newest {
    fn followed_by(self, stamp: Instant, step: &OdometryReport) -> Self {
        Self {
            stamp: Some(stamp),
            interval: self.stamp.map_or(Duration::ZERO, |last| stamp.since(last)),
            map_from_robot: step.matched.map_from_robot,
            is_key: step.is_key,
        }
    }
}

impl DpSlam<'_> {
    fn restart_at(&mut self, map_from_robot: Pose2) {
        self.beside.iter_mut().for_each(Beside::stop);
        self.slam.restart_at(map_from_robot);
        self.genealogy = Genealogy::default();
    }

    fn add_scan(
        &mut self,
        scan: &RangeScan<'_>,
        robot_from_lrf: Pose2,
        displacement: Option<Pose2>,
    ) -> Result<(StepReport, StageTimes), ScanCapacityError> {
        let started = WallInstant::now();
        let mut weighed = None;
        let windows = &mut *self.windows;
        let step = self.slam.step_with(scan, robot_from_lrf, displacement, |weighing, samples, own| {
            let begun = WallInstant::now();
            weigh_on_threads(weighing, samples, own, windows);
            weighed = Some((begun, WallInstant::now()));
        })?;
        if step.filter.is_some() {
            self.genealogy.add(self.slam.filter().particles());
        }
        let times = match weighed {
            None => StageTimes { matching: started.elapsed(), ..StageTimes::default() },
            Some((begun, ended)) => {
                StageTimes { matching: begun - started, weighing: ended - begun, printing: ended.elapsed() }
            }
        };
        Ok((step, times))
    }
}
