//! The loop over scans that `map`, `run` and `replay` share: every scan is mapped, and the results are written on the way and at the end.

use std::io::IsTerminal as _;
use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::time::{Duration as WallDuration, Instant as WallInstant};

use anyhow::{Context as _, anyhow, ensure};
use clap::Args;
use lrfslam_core::geometry::Pose2;
use lrfslam_core::slam::StepReport;
use lrfslam_core::time::Instant;

use super::Failure;
use super::continuing::{ContinueArgs, ReadAhead, in_words, verified_start};
use super::laser::{EndArgs, interrupt_flag, say};
use super::localize::Start;
use super::monitor::{MonitorArgs, Watched};
use super::out::{OutArgs, SaveArgs};
use super::particles::ParticleArgs;
use super::progress::Progress;
use super::room::ensure_room;
use super::ros2::Ros2Args;
use super::ros2_node::Published;
use super::shared::{ConfigArgs, RESUME, SeedArgs, TellArgs};
use super::speed_watch::SpeedWatch;
use super::summary::{partial_notice, summary};
use crate::config::{About, RunConfig};
use lrfslam_host::mapping::saved_map::SavedMap;
use lrfslam_host::monitor::Health;
use lrfslam_host::output::{RECORDING, ResultFolder, shown};
use lrfslam_host::plural::count;
use lrfslam_host::results::report::{Ending, Source};
use lrfslam_host::runs::bag::RunBag;
use lrfslam_host::runs::map::{Beside, MapRun, RunMemory};
use lrfslam_host::runs::scans::Scans;
use lrfslam_host::scans::driver::HostClock;
use lrfslam_host::scans::live::Say;
use lrfslam_host::scans::log::LogScan;

/// How to map, and when to end.
#[derive(Debug, Args)]
pub(super) struct Mapping {
    #[command(flatten)]
    out: OutArgs,
    #[arg(long, requires = "out", conflicts_with = "overwrite", help = RESUME)]
    resume: bool,
    #[command(flatten)]
    save: SaveArgs,
    #[command(flatten)]
    config: ConfigArgs,
    #[command(flatten)]
    seed: SeedArgs,
    #[command(flatten)]
    end: EndArgs,
    #[command(flatten)]
    going_on: ContinueArgs,
    #[command(flatten)]
    particles: ParticleArgs,
    #[command(flatten)]
    tell: TellArgs,
    #[command(flatten)]
    monitor: MonitorArgs,
    #[command(flatten)]
    ros2: Ros2Args,
}

impl Mapping {
    /// Older results, and an older recording, may go.
    pub(super) fn overwrites(&self) -> bool {
        self.out.overwrites()
    }

    /// A run that was killed goes on.
    pub(super) fn resumes(&self) -> bool {
        self.resume
    }

    /// Where the results of a run with this configuration go.
    pub(super) fn folder(&self, stem: &str, config: &RunConfig) -> Result<ResultFolder, Failure> {
        match self.out.named().filter(|_| self.resume) {
            Some(out) => unfinished(out, config, self.seed.seed).map_err(Failure::Start),
            None => self.out.folder(stem),
        }
    }

    pub(super) fn say(&self, text: &str) {
        self.tell.say(text);
    }

    /// Says where a recording is that does not begin among the results: a kill would leave it there.
    pub(super) fn tell_where(&self, recording: &Path, folder: &ResultFolder) {
        let beside = folder.growing(RECORDING);
        if !self.tell.is_quiet() && recording == beside && beside.parent().is_some_and(|home| home != folder.place()) {
            say(&format!("recording to {} until there are results", shown(&beside).display()));
        }
    }

    /// Reads the map to go on with, if there is one, and the configuration.
    ///
    /// * `what` and `source` — the command, and where its scans come from, as they are called on the live page
    pub(super) fn plan(&self, what: &str, source: String) -> Result<Plan<'_>, Failure> {
        let stop = interrupt_flag().map_err(Failure::Start)?;
        let folder = self.going_on.continued.as_deref();
        let saved = folder.map(SavedMap::read).transpose().map_err(Failure::start)?;
        let defaults = match saved.as_ref().zip(folder) {
            Some((saved, folder)) => RunConfig::of_saved(saved, folder).map_err(Failure::start)?,
            None => RunConfig::default(),
        };
        let config = self.particles.load_over(defaults, &self.config)?;
        ensure_room(&config).map_err(Failure::Start)?;
        let frame = folder.map(|folder| folder.display().to_string());
        let watched = self.monitor.watched((what, source, frame), config.map, stop)?;
        Ok(Plan { args: self, config, saved, odometry: false, watched, bag: None, is_of_ros2: false, stop })
    }
}

/// The folder of a run that has not ended, and had the same settings as far as it has saved any.
///
/// # Errors
/// If it is not there, or its run was another.
fn unfinished(out: &Path, config: &RunConfig, seed: u64) -> anyhow::Result<ResultFolder> {
    ensure!(out.is_dir(), "{}: nothing to resume, it is not there", out.display());
    let folder = ResultFolder::go_on(out, RECORDING)?;
    let Ok(text) = std::fs::read_to_string(out.join("run.json")) else { return Ok(folder) };
    let was: serde_json::Value = serde_json::from_str(&text).with_context(|| format!("{}: run.json", out.display()))?;
    let is = serde_json::to_string(config).and_then(|text| serde_json::from_str::<serde_json::Value>(&text))?;
    ensure!(was["ending"] != "complete", "{}: nothing to resume, its run came to its end", out.display());
    ensure!(
        was["config"] == is && was["seed"] == seed,
        "{}: its run had another configuration or seed: resume it with the same",
        out.display()
    );
    Ok(folder)
}

/// What is known before the first scan.
pub(super) struct Plan<'a> {
    args: &'a Mapping,
    pub(super) config: RunConfig,
    saved: Option<SavedMap>,
    /// A log's odometry predicts motion.
    odometry: bool,
    watched: Watched,
    /// What is recorded besides, or with, a laser's bytes.
    pub(super) bag: Option<RunBag>,
    /// The scans are those of a topic.
    is_of_ros2: bool,
    pub(super) stop: &'static AtomicBool,
}

impl Plan<'_> {
    pub(super) fn with_odometry(self, odometry: bool) -> Self {
        Self { odometry, ..self }
    }

    pub(super) fn of_ros2(self) -> Self {
        Self { is_of_ros2: true, ..self }
    }

    pub(super) fn with_bag(self, bag: Option<RunBag>) -> Self {
        Self { bag, ..self }
    }

    /// Words on the way: to the user, to those who watch, and into what is recorded.
    pub(super) fn sayer(&self) -> Say {
        let (mut say, bag) = (self.watched.sayer(self.args.tell), self.bag.clone());
        Box::new(move |text| {
            say(text);
            bag.iter().for_each(|bag| bag.say(text));
        })
    }

    /// Maps every scan, and writes and prints what came out.
    ///
    /// * `folder` — is asked for once it is known that there is something to map
    pub(super) fn map(
        mut self,
        scans: Scans,
        folder: impl FnOnce() -> Result<ResultFolder, Failure>,
    ) -> Result<(), Failure> {
        let config = self.config.mapping();
        let mut memory = RunMemory::new(&config, self.args.particles.threads());
        let mut map = MapRun::new(&config, self.args.seed.seed, &mut memory).map_err(Failure::Start)?;
        self.watched.open(scans.is_log(), self.args.tell)?;
        let published = self.args.ros2.announce(!self.is_of_ros2)?;
        let mut scans = ReadAhead::new(scans, self.args.end);
        scans.wait(self.stop)?;
        let start = self.start(&mut scans)?;
        let mut folder = folder()?;
        map.put_aside(folder.aside());
        if let Some(bag) = &self.bag {
            bag.begin(self.args.overwrites()).map_err(Failure::Start)?;
            map.record(bag.clone());
        }
        // Results of a recording may replace those beside it.
        scans.scans().recording().iter().for_each(|file| folder.keep(file));
        if let (Some(saved), Some(from)) = (&self.saved, &self.args.going_on.continued) {
            map.go_on(saved, from, start).map_err(Failure::Start)?;
        }
        let watched = std::mem::replace(&mut self.watched, Watched::nobody(self.stop));
        LiveMapping::new(&self, map, scans, (folder, watched, published)).run()
    }

    /// Where the robot is in the map to go on with.
    fn start(&self, scans: &mut ReadAhead) -> Result<Option<Pose2>, Failure> {
        let ContinueArgs { continued, start: told, trust_start } = &self.args.going_on;
        let start = told.and_then(Start::told);
        let (Some(saved), Some(folder), false) = (&self.saved, continued, trust_start) else { return Ok(start) };
        if scans.scans().is_live() {
            self.args.tell.say("looking where in the map the robot is: it has to drive a few metres");
        }
        let found = verified_start(saved, folder, (&self.config, self.args.seed.seed), *told, scans)?;
        if start.is_none() {
            self.args.tell.say(&format!("the drive begins at {} in the map", in_words(found)));
        }
        Ok(Some(found))
    }
}

/// What is older than this is of a recording.
const RECORDED_AFTER: WallDuration = WallDuration::from_secs(60);
/// From one line about a live run to the next.
const TELL_EVERY: WallDuration = WallDuration::from_secs(2);

/// Scans on their way into a map.
struct LiveMapping<'a, 'm> {
    plan: &'a Plan<'a>,
    map: MapRun<'m>,
    scans: ReadAhead,
    folder: ResultFolder,
    watched: Watched,
    published: Option<Published>,
    is_laser: bool,
    progress: Progress,
    watch: SpeedWatch,
    clock: HostClock,
    /// When a line was last told, and how many scans there were then.
    told: (WallInstant, usize),
    fault: Option<anyhow::Error>,
}

impl<'a, 'm> LiveMapping<'a, 'm> {
    fn new(
        plan: &'a Plan<'a>,
        map: MapRun<'m>,
        mut scans: ReadAhead,
        (folder, watched, published): (ResultFolder, Watched, Option<Published>),
    ) -> Self {
        let robot_from_lrf = plan.config.robot_from_lrf();
        let watch = SpeedWatch::new(plan.config.speed, robot_from_lrf);
        let progress = Progress::new(scans.scans(), plan.args.tell.is_quiet());
        let (clock, told) = (HostClock::default(), (WallInstant::now(), 0));
        let is_laser = !scans.scans().is_log();
        Self { plan, map, scans, folder, watched, published, is_laser, progress, watch, clock, told, fault: None }
    }

    /// Maps scan after scan until there are no more, the user has seen enough, or a fault ends it.
    fn run(mut self) -> Result<(), Failure> {
        while let Some(scan) = self.scans.next() {
            if let Err(fault) = scan.and_then(|scan| self.add_scan(&scan)) {
                self.fault = Some(fault);
                break;
            }
            self.save_if_due();
            self.progress.set(self.map.scans() as u64);
        }
        self.progress.clear();
        self.finish()
    }

    fn add_scan(&mut self, scan: &LogScan) -> anyhow::Result<()> {
        let odometry = scan.map_from_robot_odometry.filter(|_| self.plan.odometry);
        let robot_from_lrf = scan.robot_from_lrf.unwrap_or_else(|| self.plan.config.robot_from_lrf());
        let step = self.map.add_scan(&scan.scan(), robot_from_lrf, odometry)?;
        if let Some(bag) = &self.plan.bag {
            bag.scan(&scan.scan(), (scan.map_from_robot_odometry, robot_from_lrf), step.map_from_robot);
        }
        if self.is_laser {
            if self.watch.is_too_fast(&scan.scan(), step.odometry.matched.map_from_robot) {
                self.plan.args.tell.say("the robot moves faster than the laser's rate allows: the map suffers");
            }
            self.tell_now_and_then(scan.stamp, step.map_from_robot);
        }
        if let Some(published) = &mut self.published {
            published.step(scan.scan(), robot_from_lrf, self.map.whereabouts(&step));
            published.map_if_due(|| self.map.raster());
        }
        self.show(scan, robot_from_lrf, &step);
        Ok(())
    }

    /// To those who look.
    fn show(&mut self, scan: &LogScan, robot_from_lrf: Pose2, step: &StepReport) {
        let Self { map, watched, watch, clock, is_laser, .. } = self;
        watched.show(|feed| {
            let missed = u64::from(watch.too_fast);
            let health = is_laser.then_some(Health { missed, ..Health::default() });
            let late = is_laser.then(|| WallDuration::from_micros(clock.now().since(scan.stamp).micros.max(0) as u64));
            let beside = Beside { health, late: late.filter(|late| *late < RECORDED_AFTER), ..Beside::default() };
            map.show(feed, Some((&scan.scan(), robot_from_lrf, step)), beside);
        });
        watched.pause(|feed| map.show(feed, None, Beside::default()));
    }

    /// On a terminal: where the robot is, how many scans a second, and how late they are mapped.
    fn tell_now_and_then(&mut self, stamp: Instant, map_from_robot: Pose2) {
        let ((at, scans_then), scans) = (self.told, self.map.scans());
        if self.plan.args.tell.is_quiet() || at.elapsed() < TELL_EVERY || !std::io::stderr().is_terminal() {
            return;
        }
        self.told = (WallInstant::now(), scans);
        let rate = (scans - scans_then) as f64 / at.elapsed().as_secs_f64();
        let late_ms = self.clock.now().since(stamp).micros as f64 / 1e3;
        // A recording is not late.
        let late = if late_ms < RECORDED_AFTER.as_secs_f64() * 1e3 {
            format!(", mapped after {late_ms:.0} ms")
        } else {
            String::new()
        };
        let loops =
            self.map.high_counts().map_or(String::new(), |high| format!(", {} closed", count(high.closures, "loop")));
        let Pose2 { x, y, heading } = map_from_robot;
        say(&format!(
            "{}, {rate:.1} a second{late}; robot at {x:.2} m, {y:.2} m, {:.0}°{loops}",
            count(scans as u64, "scan"),
            heading.to_degrees()
        ));
    }

    fn save_if_due(&mut self) {
        self.plan.bag.iter().filter_map(|bag| bag.file().news()).for_each(|news| say(&news));
        if self.folder.is_due(self.plan.args.save.every()) || self.watched.is_asked_to_save() {
            // What the driver has counted is told at the end.
            let about = self.about(Ending::Running);
            let saved = self.folder.save(|stage| self.map.write_into(stage, &about));
            self.folder.news(&saved).iter().for_each(|news| say(news));
        }
    }

    fn about(&mut self, ending: Ending) -> About {
        let mut source = self.scans.scans().source(ending != Ending::Running);
        if let Source::Laser { laser, .. } = &mut source {
            laser.too_fast = self.watch.too_fast;
        }
        let fault = self.fault.as_ref().map(|error| format!("{error:#}"));
        About { config: self.plan.config, source, odometry: self.plan.odometry, ending, fault }
    }

    /// Writes the results of at least one scan.
    fn finish(mut self) -> Result<(), Failure> {
        self.scans.scans().end();
        let ending = self.scans.ending(self.fault.is_some(), self.plan.stop);
        let about = self.about(ending);
        let report = self.folder.save(|stage| self.map.write_into(stage, &about));
        self.published.take().into_iter().for_each(|published| published.finish(|| self.map.raster()));
        let recorded = self.plan.bag.as_ref().map_or(Ok(()), RunBag::finish);
        let report = report.map_err(|error| Failure::Work(with_cause(error, self.fault.as_ref())))?;
        recorded.unwrap_or_else(|error| say(&format!("--record: {error}")));
        self.plan.args.tell.print(&report, || summary(&report, self.folder.named()))?;
        let notice = partial_notice(&report, self.folder.named());
        self.watched.finish(&ended(ending, self.folder.named()), |feed| self.map.show(feed, None, Beside::default()));
        match (ending, self.fault) {
            (_, Some(fault)) => Err(Failure::Work(fault.context(notice))),
            (Ending::Interrupted, None) => Err(Failure::Interrupted(anyhow!(notice))),
            _ => Ok(()),
        }
    }
}

/// The end in words, for those who watch.
pub(super) fn ended(ending: Ending, folder: &Path) -> String {
    let how = match ending {
        Ending::Failed => "ended by a fault",
        Ending::Interrupted => "ended early",
        Ending::Complete | Ending::Running => "done",
    };
    format!("{how}: results in {}", folder.display())
}

/// A failed last write must not hide what went wrong before it.
fn with_cause(error: anyhow::Error, fault: Option<&anyhow::Error>) -> anyhow::Error {
    match fault {
        Some(fault) => error.context(format!("{fault:#}; then, while writing partial results")),
        None => error,
    }
}
