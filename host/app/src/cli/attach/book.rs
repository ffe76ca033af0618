//! What a host knows of the robot it is attached to.

use std::path::{Path, PathBuf};
use std::time::{Duration as WallDuration, Instant as WallInstant};

use anyhow::anyhow;
use lrfslam_robot::wire::message::{FromRobot, Status};

use super::super::Failure;
use super::super::laser::say;
use super::super::monitor::Watched;
use super::super::summary::summary;
use super::AttachArgs;
use crate::config::{RobotRun, RunConfig};
use lrfslam_host::monitor::Health;
use lrfslam_host::output::ResultFolder;
use lrfslam_host::plural::count;
use lrfslam_host::results::report::Ending;
use lrfslam_host::robot::{Absurd, JOURNAL, LinkEvent, RobotEvent, Told};
use lrfslam_host::runs::bag::RunBag;
use lrfslam_host::runs::map::Beside;

/// From one line about the robot to the next.
const TELL_EVERY: WallDuration = WallDuration::from_secs(2);
/// A robot that is not there is waited for so long, unless the user says otherwise.
const GIVE_UP: WallDuration = WallDuration::from_secs(10);

/// Lines of a robot that are shown.
const WORDS_MAX: u32 = 1000;

/// What is heard, life after life of the robot.
pub(super) struct Book<'a> {
    args: &'a AttachArgs,
    config: &'a RunConfig,
    pub(super) run: Option<RobotRun>,
    /// Claimed for the first life.
    folder: Option<ResultFolder>,
    /// That of the first life.
    first: Option<PathBuf>,
    /// Number of the robot's life that `run` is about, from 1.
    pub(super) life: u32,
    pub(super) messages: u64,
    /// Lines that the robot has said.
    words: u32,
    /// Robots still to come before the one that is meant: with --restart, what the one that is there says is of no interest.
    robots_to_come: u32,
    told_at: WallInstant,
    is_lost: bool,
    /// The robot has another host.
    is_busy: bool,
    /// What is wrong with the port.
    trouble: Option<String>,
    pub(super) damaged_frames: u32,
    /// The robot does not work for this host.
    pub(super) is_refused: bool,
    pub(super) fault: Option<anyhow::Error>,
    pub(super) watched: Watched,
    /// What is recorded, life after life.
    bag: Option<RunBag>,
    /// Of one of its lives there are results.
    pub(super) has_results: bool,
}

/// DIR, DIR-2, DIR-3 …
fn lives(out: &Path) -> impl Iterator<Item = PathBuf> {
    let numbered = |life: u32| {
        let mut name = out.as_os_str().to_owned();
        name.push(format!("-{life}"));
        PathBuf::from(name)
    };
    std::iter::once(out.to_owned()).chain((2..).map(numbered))
}

/// Of these the last that has a journal, and which life it is.
fn last_life(out: &Path) -> Option<(u32, PathBuf)> {
    let there = (1..).zip(lives(out)).take_while(|(_, folder)| folder.exists());
    there.filter(|(_, folder)| ResultFolder::last_grown(folder, JOURNAL).is_some()).last()
}

impl<'a> Book<'a> {
    pub(super) fn open(args: &'a AttachArgs, config: &'a RunConfig, watched: Watched) -> Result<Self, Failure> {
        let (mut folder, mut run, mut life) = (None, None, 0);
        let bag = args.record.bag(None)?;
        match args.out.named().filter(|_| args.resume) {
            Some(out) => {
                let none = || anyhow!("{}: nothing to resume, there is no {JOURNAL}", out.display());
                let (last, place) = last_life(out).ok_or_else(none).map_err(Failure::Start)?;
                let stored = ResultFolder::go_on(&place, JOURNAL)
                    .and_then(|stored| RobotRun::resume(stored, config.robot_setup(), args.seed.seed));
                let stored = stored.map_err(Failure::Start)?;
                if let Some(skipped) = stored.skipped() {
                    say(&format!("{}: {skipped}; the file stays as it is", stored.folder().growing(JOURNAL).display()));
                }
                (run, life) = (Some(stored), last);
            }
            None => folder = Some(args.out.folder("robot")?),
        }
        let mut book = Self {
            args,
            config,
            run,
            folder,
            first: args.out.named().map(Path::to_owned),
            life,
            messages: 0,
            words: 0,
            robots_to_come: if args.restart { 2 } else { 0 },
            told_at: WallInstant::now(),
            is_lost: false,
            is_busy: false,
            trouble: None,
            damaged_frames: 0,
            is_refused: false,
            fault: None,
            watched,
            bag,
            has_results: false,
        };
        book.record();
        Ok(book)
    }

    fn say(&self, text: &str) {
        self.args.tell.say(text);
        self.watched.tell(text);
        self.bag.iter().for_each(|bag| bag.say(text));
    }

    pub(super) fn take(&mut self, event: LinkEvent<'_>) {
        match event {
            // A robot that has another host opens, and closes at once.
            LinkEvent::Open | LinkEvent::Gone(_) if self.is_busy => {}
            LinkEvent::Open => {
                (self.is_lost, self.trouble) = (false, None);
                self.say(&format!("{} is open", self.args.port));
            }
            LinkEvent::Gone(error) => {
                let (port, mut why) = (self.args.port.to_string(), error.to_string());
                if !why.starts_with(&port) {
                    why = format!("{port}: {why}");
                }
                if !self.is_lost {
                    self.say(&format!("{why}; trying again"));
                }
                (self.is_lost, self.trouble) = (true, Some(why));
            }
            LinkEvent::Robot(RobotEvent::NewRobot) => {
                self.is_busy = false;
                self.robots_to_come = self.robots_to_come.saturating_sub(1);
                self.say("a robot is there");
            }
            LinkEvent::Robot(RobotEvent::Message(_)) if self.robots_to_come > 0 => {}
            LinkEvent::Robot(RobotEvent::Status(status)) => {
                self.run.iter_mut().for_each(|run| run.set_status(&status));
            }
            LinkEvent::Robot(RobotEvent::Foreign(why)) => self.fail(why.into()),
            LinkEvent::Robot(RobotEvent::Absurd(why)) => self.fail(why.into()),
            LinkEvent::Robot(RobotEvent::Busy) => self.take_busy(),
            LinkEvent::Robot(RobotEvent::Message(told)) => self.take_told(&told),
            LinkEvent::Robot(RobotEvent::Recall(recall)) => {
                self.run.iter().for_each(|run| recall.answer(run.map().to_give_back()));
            }
        }
    }

    pub(super) fn give_up_if_none_is_there(&mut self, started: WallInstant) {
        if self.messages == 0 && self.run.is_none() && !self.args.wait && started.elapsed() > GIVE_UP {
            let why = self.trouble.take().unwrap_or_else(|| format!("{}: no robot answers", self.args.port));
            self.fail(anyhow!("{why}; given up after {} s (--wait waits as long as it takes)", GIVE_UP.as_secs()));
        }
    }

    /// The first fault ends the run.
    pub(super) fn fail(&mut self, fault: anyhow::Error) {
        // Of one that says what no robot can, no end is waited for.
        self.is_refused |= fault.is::<Absurd>();
        self.fault.get_or_insert(fault);
    }

    /// Said once; it may be let go.
    fn take_busy(&mut self) {
        let busy = format!("{}: another host is attached to this robot", self.args.port);
        if !std::mem::replace(&mut self.is_busy, true) {
            say(&format!("{busy}; trying again"));
        }
        self.trouble = Some(busy);
    }

    fn take_told(&mut self, told: &Told<'_>) {
        self.messages += 1;
        let known = self.run.as_ref().and_then(RobotRun::progress);
        if known.is_none_or(|known| known.epoch != told.at.epoch) {
            self.begin_life();
        }
        let stored = self.run.as_mut().map_or(Ok(()), |run| run.take(told));
        stored.unwrap_or_else(|fault| self.fail(fault));
        self.run.as_mut().and_then(RobotRun::journal_news).iter().for_each(|news| say(news));
        match told.message() {
            Some(FromRobot::Identity(identity)) => {
                let state = if identity.is_configured { "mapping already" } else { "waiting" };
                self.say(&format!(
                    "{}: {state}, memory for {}",
                    identity.board,
                    count(identity.capacities.particles.into(), "particle")
                ));
            }
            Some(FromRobot::Scan(_)) => self.show(),
            Some(FromRobot::Said(words)) => {
                self.words += 1;
                match self.words {
                    ..WORDS_MAX => self.say(words),
                    WORDS_MAX => self.say("the robot says ever more: no more of it is shown"),
                    _ => {}
                }
            }
            Some(FromRobot::Refused(reason)) => {
                self.is_refused = true;
                self.fail(anyhow!("the robot refuses: {reason}"));
            }
            _ => {}
        }
    }

    /// To those who look.
    fn show(&mut self) {
        let Some(run) = &self.run else { return };
        let missed = u64::from(run.map().missing_scans());
        let (damaged, restarts) = (u64::from(self.damaged_frames), u64::from(run.status().restarts));
        let beside = Beside { health: Some(Health { damaged, restarts, missed }), ..Beside::default() };
        self.watched.show(|feed| run.show(feed, beside));
    }

    /// A robot that was not there before: what is known of the last one is written, and a new folder begun.
    fn begin_life(&mut self) {
        if self.run.is_some() {
            self.say("the robot has started anew");
            self.close(Ending::Failed, Some(&anyhow!("the robot started anew")));
        }
        self.life += 1;
        self.watched.begin_anew();
        let opened = self
            .next_folder()
            .and_then(|folder| RobotRun::open(folder, self.config.robot_setup(), self.args.seed.seed));
        match opened {
            Ok(run) => {
                self.run = Some(run);
                self.record();
            }
            Err(fault) => self.fail(fault),
        }
    }

    /// What the robot tells from now on goes into the recording, too.
    fn record(&mut self) {
        let (Some(run), Some(bag)) = (&mut self.run, &self.bag) else { return };
        match bag.begin(self.args.out.overwrites()) {
            Ok(()) => run.record(bag.clone()),
            Err(fault) => self.fail(fault),
        }
    }

    pub(super) fn end_recording(&self) {
        if let Some(Err(error)) = self.bag.as_ref().map(RunBag::finish) {
            say(&format!("--record: {error}"));
        }
    }

    /// The one claimed at the start, later the first that is not there.
    fn next_folder(&mut self) -> anyhow::Result<ResultFolder> {
        if let Some(folder) = self.folder.take() {
            self.first.get_or_insert(folder.named().to_owned());
            return Ok(folder);
        }
        let first = self.first.clone().unwrap_or_default();
        let place = lives(&first).find(|place| !place.exists()).unwrap_or_default();
        ResultFolder::claim(&place, false)
    }

    /// Writes what is known of the robot's life, and returns it; a fault makes any ending a failure.
    pub(super) fn close(&mut self, ending: Ending, why: Option<&anyhow::Error>) -> Option<RobotRun> {
        let mut run = self.run.take()?;
        if let Err(error) = run.finish_journal() {
            say(&format!("{}: {error}", run.folder().growing(JOURNAL).display()));
        }
        // Without a scan what was there before stays; a robot that is left mapping is resumed by the journal.
        if run.map().scans().is_empty() {
            if !self.args.keep_running && !self.args.resume {
                run.forget();
            }
            return None;
        }
        self.has_results = true;
        let why = why.or(self.fault.as_ref());
        let ending = if why.is_some() { Ending::Failed } else { ending };
        let port = self.args.port.to_string();
        let done = run.save((&port, self.damaged_frames), ending, why).and_then(|report| {
            let printed = self.args.tell.print(&report, || summary(&report, run.folder().named()));
            printed.map_err(|_| anyhow!("standard output cannot be written"))
        });
        done.unwrap_or_else(|fault| self.fail(fault));
        Some(run)
    }

    pub(super) fn save_if_due(&mut self) {
        self.bag.iter().filter_map(|bag| bag.file().news()).for_each(|news| say(&news));
        let is_asked = self.watched.is_asked_to_save();
        let is_due = |run: &&mut RobotRun| {
            !run.map().scans().is_empty() && (is_asked || run.folder().is_due(self.args.save.every()))
        };
        let Some(run) = self.run.as_mut().filter(is_due) else { return };
        let port = self.args.port.to_string();
        let saved = run.save((&port, self.damaged_frames), Ending::Running, None);
        run.folder().news(&saved).iter().for_each(|news| say(news));
    }

    pub(super) fn is_enough(&self) -> bool {
        let Some(run) = &self.run else { return self.fault.is_some() };
        let scans = run.map().scans();
        let ends = scans.first().zip(scans.last());
        let seconds = ends.map_or(0.0, |(first, last)| last.stamp.since(first.stamp).micros as f64 * 1e-6);
        self.fault.is_some() || self.args.end.is_reached(scans.len(), seconds)
    }

    pub(super) fn tell_now_and_then(&mut self) {
        let Some(run) = self.run.as_ref().filter(|_| self.told_at.elapsed() >= TELL_EVERY) else { return };
        self.told_at = WallInstant::now();
        let Status { map_from_robot, scans, particles, tiles, .. } = run.status();
        let closures =
            run.high_counts().map_or(String::new(), |high| format!(", {} closed", count(high.closures, "loop")));
        self.say(&format!(
            "{}, {} here; robot at {:.2} m, {:.2} m, {:.0}°; {} in {}{closures}",
            count(u64::from(*scans), "scan"),
            run.map().scans().len(),
            map_from_robot.x,
            map_from_robot.y,
            map_from_robot.heading.to_degrees(),
            count(u64::from(*particles), "particle"),
            count(u64::from(*tiles), "tile"),
        ));
    }
}
