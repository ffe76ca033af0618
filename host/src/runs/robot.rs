//! One life of a robot, from its start or from when this host came to the end: what it tells goes to disk, then into path and map.

use lrfslam_core::geometry::Pose2;
use lrfslam_robot::wire::message::{FromRobot, Status};
use lrfslam_robot::wire::session::Progress;
use serde::Serialize;

use super::map::{About, Beside, Run};
use crate::mapping::MappingConfig;
use crate::mapping::high::HighCounts;
use crate::maps::io::{PGM_SIDE_MAX, write_map};
use crate::monitor::Feed;
use crate::output::ResultFolder;
use crate::results::report::{Ending, RobotCounts, RunReport, Source};
use crate::robot::{Absurd, JOURNAL, Journal, Judge, RobotMap, Skipped, Told};

/// How a robot's map is made.
#[derive(Debug, Clone)]
pub struct RobotSetup<C> {
    /// The part that makes maps.
    pub mapping: MappingConfig,
    /// Where the laser sits on the robot.
    pub robot_from_lrf: Pose2,
    /// The program's configuration, for the report and the saved map.
    pub config: C,
}

/// See the [module](super).
#[derive(Debug)]
pub struct RobotRun<C> {
    mapping: MappingConfig,
    robot_from_lrf: Pose2,
    /// The program's, for the report and the saved map.
    config: C,
    run: Run<'static, RobotMap>,
    judge: Judge,
    journal: Journal,
    /// Of the journal that was gone on with.
    skipped: Skipped,
    folder: ResultFolder,
    /// How far the robot's messages have come.
    progress: Option<Progress>,
    board: String,
    status: Status,
}

impl<C: Serialize + Clone> RobotRun<C> {
    /// A robot of which nothing is known yet, with results and journal in `folder`.
    ///
    /// # Errors
    /// If the journal cannot be written, or loops are to be closed by particles.
    pub fn open(folder: ResultFolder, setup: RobotSetup<C>, seed: u64) -> anyhow::Result<Self> {
        let run = Run::told(&setup.mapping, seed)?;
        let journal = (Journal::create(&folder.growing(JOURNAL))?, Skipped::default());
        Ok(Self::new(setup, run, journal, folder))
    }

    /// Goes on with what the journal in `folder` holds.
    ///
    /// # Errors
    /// If the journal cannot be read or written, or loops are to be closed by particles.
    pub fn resume(folder: ResultFolder, setup: RobotSetup<C>, seed: u64) -> anyhow::Result<Self> {
        let mut told = Vec::new();
        let path = folder.growing(JOURNAL);
        let journal = Journal::resume(&path, |message| told.push((message.at, message.bytes.to_vec())))?;
        let run = Run::told(&setup.mapping, seed)?;
        let mut run = Self::new(setup, run, journal, folder);
        for (at, bytes) in &told {
            match run.hear(&Told { at: *at, bytes }) {
                // It was refused then, too.
                Err(error) if error.is::<Absurd>() => run.skipped.messages += 1,
                heard => heard?,
            }
        }
        Ok(run)
    }

    fn new(
        setup: RobotSetup<C>,
        mut run: Run<'static, RobotMap>,
        (journal, skipped): (Journal, Skipped),
        folder: ResultFolder,
    ) -> Self {
        let RobotSetup { mapping, robot_from_lrf, config } = setup;
        run.put_aside(folder.aside());
        Self {
            mapping,
            robot_from_lrf,
            config,
            run,
            judge: Judge::default(),
            journal,
            skipped,
            folder,
            progress: None,
            board: String::new(),
            status: Status::default(),
        }
    }

    /// What it tells, and its map, go into `bag` too.
    pub fn record(&mut self, bag: crate::runs::bag::RunBag) {
        self.run.record(bag);
    }

    /// Takes a message; it is in the journal when this returns, or waits in memory for a disk without room.
    ///
    /// # Errors
    /// [`Absurd`] if no robot says that: it changes nothing. If a scan is too large for the high level.
    pub fn take(&mut self, told: &Told<'_>) -> anyhow::Result<()> {
        // A message of the link's fits a frame.
        let _ = self.journal.add(told);
        self.hear(told)
    }

    /// What there is to tell of the journal's disk.
    pub fn journal_news(&mut self) -> Option<String> {
        self.journal.news()
    }

    /// What of the journal that was gone on with could not be read, if it is anything.
    pub fn skipped(&self) -> Option<Skipped> {
        Some(self.skipped).filter(|skipped| *skipped != Skipped::default())
    }

    /// Puts the journal on disk.
    ///
    /// # Errors
    /// If there is no room for all of it.
    pub fn finish_journal(&mut self) -> std::io::Result<()> {
        self.journal.finish()
    }

    fn hear(&mut self, told: &Told<'_>) -> anyhow::Result<()> {
        self.progress = Some(Progress { epoch: told.at.epoch, next: told.at.next.wrapping_add(1) });
        let Some(message) = told.message() else { return Ok(()) };
        self.judge.check(&message)?;
        if let FromRobot::Identity(identity) = &message {
            identity.board.clone_into(&mut self.board);
        }
        self.run.take(&message, self.robot_from_lrf)
    }

    /// How far the robot's messages have come.
    pub fn progress(&self) -> Option<Progress> {
        self.progress
    }

    /// How the robot is.
    pub fn set_status(&mut self, status: &Status) {
        self.status = *status;
    }

    /// How the robot is, as it said last.
    pub fn status(&self) -> &Status {
        &self.status
    }

    /// What it has told of path and map.
    pub fn map(&self) -> &RobotMap {
        self.run.robot()
    }

    /// Hands what is new to those who look; call it when [`Feed::is_wanted`].
    pub fn show(&self, feed: &mut Feed, beside: Beside) {
        self.run.show(feed, beside);
    }

    /// What the high level did so far, if there is one.
    pub fn high_counts(&self) -> Option<HighCounts> {
        self.run.high_counts()
    }

    /// Writes the results as they are now; the run can go on.
    ///
    /// * `port` — where the robot is; `damaged_frames` — of its link
    /// * `ending` and `fault` — how the run stands, and what ended it early
    ///
    /// # Errors
    /// If a file cannot be written: the last results are still there then.
    pub fn save(
        &mut self,
        (port, damaged_frames): (&str, u32),
        ending: Ending,
        fault: Option<&anyhow::Error>,
    ) -> anyhow::Result<RunReport<C>> {
        let source = Source::Robot { port: port.to_owned(), robot: self.counts(damaged_frames) };
        let (config, fault) = (self.config.clone(), fault.map(|error| format!("{error:#}")));
        let about = About { config, source, odometry: false, ending, fault };
        let drawn = self.map().draw(self.mapping.slam.particle_map.square_size_m, &self.mapping.map);
        let raster = drawn.raster(PGM_SIDE_MAX);
        let run = &mut self.run;
        self.folder.save(|stage| {
            raster.iter().try_for_each(|raster| write_map(stage, "robot-map", raster))?;
            run.write_into(stage, &about)
        })
    }

    /// Leaves no journal of a robot that has told nothing of its path.
    pub fn forget(self) {
        // Nobody is left to be told.
        let _ = std::fs::remove_file(self.folder.growing(JOURNAL));
    }

    /// The folder of the results.
    pub fn folder(&self) -> &ResultFolder {
        &self.folder
    }

    fn counts(&self, damaged_frames: u32) -> RobotCounts {
        let Status { untold_sweeps, late_scans, refused_scans, dropped_particles, damaged, restarts, .. } = self.status;
        let Status { squares_left_out, tiles_left, tiles_restored, tiles_forgotten, .. } = self.status;
        RobotCounts {
            board: self.board.clone(),
            is_from_start: self.map().is_from_start(),
            is_map_complete: self.map().is_complete(),
            missing_scans: self.map().missing_scans(),
            untold_sweeps,
            late_scans,
            refused_scans,
            dropped_particles,
            squares_left_out,
            tiles_left,
            tiles_restored,
            tiles_forgotten,
            damaged,
            restarts,
            damaged_frames,
            journal_holes: self.journal.holes(),
            journal_missing: self.skipped.messages,
        }
    }
}
