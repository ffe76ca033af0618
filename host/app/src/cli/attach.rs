//! `lrfslam attach`: to a robot that does the SLAM itself.

use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::{Duration as WallDuration, Instant as WallInstant, SystemTime, UNIX_EPOCH};

use anyhow::anyhow;
use clap::{Args, ValueEnum};
use lrfslam_robot::wire::message::{FromRobot, Status, ToRobot};
use lrfslam_robot::{LaserConfig, LaserFamily};

use super::Failure;
use super::laser::{EndArgs, interrupt_flag, parse_baud, say};
use super::out::{OutArgs, SaveArgs};
use super::shared::{ConfigArgs, LEVELS, LRF, PARTICLES, PORT, SeedArgs, TellArgs};
use super::summary::summary;
use crate::config::RobotRun;
use crate::config::RunConfig;
use lrfslam_host::output::ResultFolder;
use lrfslam_host::plural::count;
use lrfslam_host::results::report::Ending;
use lrfslam_host::robot::{ClientMemory, JOURNAL, LinkEvent, RobotClient, RobotEvent, RobotLink, Told};
use lrfslam_host::scans::link::Address;

/// Attach to a robot that does the SLAM itself (firmware, or robot-sim), until ctrl-C, which stops its laser and writes the map.
///
/// Configures the robot, keeps what it tells, closes loops, and writes what `lrfslam run` writes; also robot-map.pgm and .yaml, the
/// map as the robot has it, and robot.journal, all that it told. A robot that starts anew gets a folder of its own: DIR-2, DIR-3 …, the
/// first that is not there.
#[derive(Debug, Args)]
pub(super) struct AttachArgs {
    #[arg(long, value_name = "DEV", help = PORT)]
    port: Address,
    /// Rate of a serial port, bit/s.
    #[arg(long, value_name = "N", default_value_t = 921_600)]
    link_baud: u32,
    #[arg(long, value_enum, help = LRF)]
    lrf: RobotLaser,
    /// Rate to which the robot raises its laser if it is slower, bit/s; auto is what every cable can.
    #[arg(long, value_name = "auto|N", default_value = "auto", value_parser = parse_baud)]
    lrf_baud: u32,
    /// Hokuyo: merge so many neighbouring steps into one beam.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=99))]
    cluster: u8,
    #[command(flatten)]
    out: OutArgs,
    #[command(flatten)]
    save: SaveArgs,
    /// Go on with what an earlier attach has stored in the folder --out, its last robot's if there were several.
    #[arg(long, requires = "out", conflicts_with = "overwrite")]
    resume: bool,
    /// The robot forgets what it has done so far, and begins anew.
    #[arg(long, conflicts_with = "resume")]
    restart: bool,
    /// Leave the robot mapping at the end, for another attach.
    #[arg(long)]
    keep_running: bool,
    #[command(flatten)]
    config: ConfigArgs,
    #[command(flatten)]
    seed: SeedArgs,
    #[command(flatten)]
    end: EndArgs,
    #[arg(long, value_name = "N", help = PARTICLES)]
    particles: Option<u16>,
    #[arg(long, value_name = "N", help = LEVELS, value_parser = clap::value_parser!(u16).range(1..=2))]
    levels: Option<u16>,
    #[command(flatten)]
    tell: TellArgs,
}

/// Lasers that a robot can drive.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum RobotLaser {
    /// SICK LMS200, 211, 220, 221, 291
    #[value(name = "sick-lms2xx")]
    SickLms2xx,
    /// Hokuyo with SCIP
    Hokuyo,
}

/// Longest wait for the robot, so that ctrl-C is noticed.
const LISTEN: WallDuration = WallDuration::from_millis(50);
/// From one line about the robot to the next.
const TELL_EVERY: WallDuration = WallDuration::from_secs(2);
/// At the end, a robot that says nothing new for so long is left.
const PATIENCE: WallDuration = WallDuration::from_secs(5);
/// How long a robot may take to be let go.
const FAREWELL: WallDuration = WallDuration::from_secs(4);

impl AttachArgs {
    fn laser(&self) -> LaserConfig {
        let (family, usual) = match self.lrf {
            RobotLaser::SickLms2xx => (LaserFamily::Sick, 38_400),
            RobotLaser::Hokuyo => (LaserFamily::Hokuyo, 115_200),
        };
        let baud = if self.lrf_baud == 0 { usual } else { self.lrf_baud };
        LaserConfig { family, baud, cluster: self.cluster }
    }

    fn config(&self) -> Result<RunConfig, Failure> {
        let particles = self.particles.map(|count| format!("particles.particles={count}"));
        let levels = self.levels.map(|levels| format!("hierarchy.levels={levels}"));
        self.config.load_over(RunConfig::for_robot(), particles.into_iter().chain(levels))
    }
}

pub(super) fn run(args: &AttachArgs) -> Result<(), Failure> {
    let stop = interrupt_flag().map_err(Failure::Start)?;
    let config = args.config()?;
    let mut book = Book::open(args, &config)?;
    let mut memory = ClientMemory::default();
    let robot = config.robot(args.seed.seed, args.laser());
    let resume = book.run.as_ref().and_then(RobotRun::progress);
    let mut client = RobotClient::new(&robot, this_epoch(), resume, &mut memory);
    if args.restart {
        client.ask(&ToRobot::Restart).map_err(Failure::start)?;
    }
    let mut link = RobotLink::new(&args.port, args.link_baud, client);
    while !stop.load(Ordering::Relaxed) && !book.is_enough() {
        link.serve(LISTEN, &mut |event| book.take(event));
        book.damaged_frames = link.client().session().counters().frames.damaged;
        book.tell_now_and_then();
        book.save_if_due();
    }
    // A robot that maps for somebody else, or not at all, is left as it is.
    if !args.keep_running && !book.is_refused {
        end(&mut link, &mut book);
    }
    book.damaged_frames = link.client().session().counters().frames.damaged;
    // It goes on until ctrl-C, unless an end was asked for.
    let is_interrupted = stop.load(Ordering::Relaxed);
    let is_early = is_interrupted && args.end.has_end() && !book.is_enough();
    book.close(if is_early { Ending::Interrupted } else { Ending::Complete }, None);
    match book.fault {
        Some(fault) => Err(Failure::Work(fault)),
        None if !book.has_results => {
            let missing = if book.life == 0 { "robot" } else { "scan" };
            let nothing = anyhow!("no {missing} came: no results were written");
            Err(if is_interrupted { Failure::Interrupted(nothing) } else { Failure::Work(nothing) })
        }
        None if is_early => Err(Failure::Interrupted(anyhow!("stopped early: the results are of a part"))),
        None => Ok(()),
    }
}

/// A number that the next start will not have: microseconds since 1970, and the process, since two starts may lie within one tick of a clock.
fn this_epoch() -> u32 {
    let micros = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_micros();
    (micros as u32) ^ std::process::id().rotate_left(16)
}

/// Stops the robot, waits for the whole of its map, and lets it go.
fn end(link: &mut RobotLink<'_>, book: &mut Book<'_>) {
    if book.run.is_none() || link.client().ask(&ToRobot::Stop).is_err() {
        return;
    }
    let mut heard = (book.messages, WallInstant::now());
    while !book.run.as_ref().is_some_and(|run| run.map().is_complete()) {
        link.serve(LISTEN, &mut |event| book.take(event));
        if book.messages != heard.0 {
            heard = (book.messages, WallInstant::now());
        }
        if heard.1.elapsed() > PATIENCE {
            say("the robot does not answer: its laser may still be on, and of its map there is what came");
            return;
        }
    }
    let started = WallInstant::now();
    let mut is_gone = link.client().release().is_err();
    while !is_gone && started.elapsed() < FAREWELL {
        link.serve(LISTEN, &mut |event| is_gone |= matches!(event, LinkEvent::Robot(RobotEvent::NewRobot)));
    }
}

/// What is heard, life after life of the robot.
struct Book<'a> {
    args: &'a AttachArgs,
    config: &'a RunConfig,
    run: Option<RobotRun>,
    /// Claimed for the first life.
    folder: Option<ResultFolder>,
    /// That of the first life.
    first: Option<PathBuf>,
    /// Number of the robot's life that `run` is about, from 1.
    life: u32,
    messages: u64,
    /// Robots still to come before the one that is meant: with --restart, what the one that is there says is of no interest.
    robots_to_come: u32,
    told_at: WallInstant,
    is_lost: bool,
    damaged_frames: u32,
    /// The robot does not work for this host.
    is_refused: bool,
    fault: Option<anyhow::Error>,
    /// Of one of its lives there are results.
    has_results: bool,
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
    fn open(args: &'a AttachArgs, config: &'a RunConfig) -> Result<Self, Failure> {
        let (mut folder, mut run, mut life) = (None, None, 0);
        match args.out.named().filter(|_| args.resume) {
            Some(out) => {
                let none = || anyhow!("{}: nothing to resume, there is no {JOURNAL}", out.display());
                let (last, place) = last_life(out).ok_or_else(none).map_err(Failure::Start)?;
                let stored = ResultFolder::go_on(&place, JOURNAL)
                    .and_then(|stored| RobotRun::resume(stored, config.robot_setup(), args.seed.seed));
                (run, life) = (Some(stored.map_err(Failure::Start)?), last);
            }
            None => folder = Some(args.out.folder("robot")?),
        }
        Ok(Self {
            args,
            config,
            run,
            folder,
            first: args.out.named().map(Path::to_owned),
            life,
            messages: 0,
            robots_to_come: if args.restart { 2 } else { 0 },
            told_at: WallInstant::now(),
            is_lost: false,
            damaged_frames: 0,
            is_refused: false,
            fault: None,
            has_results: false,
        })
    }

    fn say(&self, text: &str) {
        self.args.tell.say(text);
    }

    fn take(&mut self, event: LinkEvent<'_>) {
        match event {
            LinkEvent::Open => {
                self.is_lost = false;
                self.say(&format!("{} is open", self.args.port));
            }
            LinkEvent::Gone(error) => {
                if !self.is_lost {
                    self.say(&format!("{}: {error}; trying again", self.args.port));
                }
                self.is_lost = true;
            }
            LinkEvent::Robot(RobotEvent::NewRobot) => {
                self.robots_to_come = self.robots_to_come.saturating_sub(1);
                self.say("a robot is there");
            }
            LinkEvent::Robot(RobotEvent::Message(_)) if self.robots_to_come > 0 => {}
            LinkEvent::Robot(RobotEvent::Status(status)) => {
                self.run.iter_mut().for_each(|run| run.set_status(&status));
            }
            LinkEvent::Robot(RobotEvent::Foreign(why)) => self.fail(why.into()),
            LinkEvent::Robot(RobotEvent::Message(told)) => self.take_told(&told),
            LinkEvent::Robot(RobotEvent::Recall(recall)) => {
                self.run.iter().for_each(|run| recall.answer(run.map().to_give_back()));
            }
        }
    }

    /// The first fault ends the run.
    fn fail(&mut self, fault: anyhow::Error) {
        self.fault.get_or_insert(fault);
    }

    fn take_told(&mut self, told: &Told<'_>) {
        self.messages += 1;
        let known = self.run.as_ref().and_then(RobotRun::progress);
        if known.is_none_or(|known| known.epoch != told.at.epoch) {
            self.begin_life();
        }
        let stored = self.run.as_mut().map_or(Ok(()), |run| run.take(told));
        stored.unwrap_or_else(|fault| self.fail(fault));
        match told.message() {
            Some(FromRobot::Identity(identity)) => {
                let state = if identity.is_configured { "mapping already" } else { "waiting" };
                self.say(&format!(
                    "{}: {state}, memory for {}",
                    identity.board,
                    count(identity.capacities.particles.into(), "particle")
                ));
            }
            Some(FromRobot::Said(words)) => self.say(words),
            Some(FromRobot::Refused(reason)) => {
                self.is_refused = true;
                self.fail(anyhow!("the robot refuses: {reason}"));
            }
            _ => {}
        }
    }

    /// A robot that was not there before: what is known of the last one is written, and a new folder begun.
    fn begin_life(&mut self) {
        if self.run.is_some() {
            self.say("the robot has started anew");
            self.close(Ending::Failed, Some(&anyhow!("the robot started anew")));
        }
        self.life += 1;
        let opened = self
            .next_folder()
            .and_then(|folder| RobotRun::open(folder, self.config.robot_setup(), self.args.seed.seed));
        match opened {
            Ok(run) => self.run = Some(run),
            Err(fault) => self.fail(fault),
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

    /// Writes what is known of the robot's life; a fault makes any ending a failure.
    fn close(&mut self, ending: Ending, why: Option<&anyhow::Error>) {
        let Some(mut run) = self.run.take() else { return };
        // Without a scan what was there before stays; a robot that is left mapping is resumed by the journal.
        if run.map().scans().is_empty() {
            if !self.args.keep_running && !self.args.resume {
                run.forget();
            }
            return;
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
    }

    fn save_if_due(&mut self) {
        let is_due = |run: &&mut RobotRun| !run.map().scans().is_empty() && run.folder().is_due(self.args.save.every());
        let Some(run) = self.run.as_mut().filter(is_due) else { return };
        let port = self.args.port.to_string();
        let saved = run.save((&port, self.damaged_frames), Ending::Running, None);
        run.folder().news(&saved).iter().for_each(|news| say(news));
    }

    fn is_enough(&self) -> bool {
        let Some(run) = &self.run else { return self.fault.is_some() };
        let scans = run.map().scans();
        let ends = scans.first().zip(scans.last());
        let seconds = ends.map_or(0.0, |(first, last)| last.stamp.since(first.stamp).micros as f64 * 1e-6);
        self.fault.is_some() || self.args.end.is_reached(scans.len(), seconds)
    }

    fn tell_now_and_then(&mut self) {
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
