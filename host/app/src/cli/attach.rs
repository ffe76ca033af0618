//! `lrfslam attach`: to a robot that does the SLAM itself.

mod book;

use std::sync::atomic::Ordering;
use std::time::{Duration as WallDuration, Instant as WallInstant, SystemTime, UNIX_EPOCH};

use anyhow::anyhow;
use clap::{Args, ValueEnum};
use lrfslam_robot::wire::message::ToRobot;
use lrfslam_robot::{LaserConfig, LaserFamily};

use self::book::Book;
use super::Failure;
use super::key::RobotKeyArgs;
use super::laser::{EndArgs, interrupt_flag, parse_baud, say};
use super::live_scans::ended;
use super::monitor::MonitorArgs;
use super::out::{OutArgs, SaveArgs};
use super::record::RecordArgs;
use super::shared::{ConfigArgs, LEVELS, LRF, PARTICLES, PORT, RESUME, SeedArgs, TellArgs};
use crate::config::RobotRun;
use crate::config::RunConfig;
use lrfslam_host::results::report::Ending;
use lrfslam_host::robot::{ClientMemory, LinkEvent, RobotClient, RobotEvent, RobotLink};
use lrfslam_host::runs::map::Beside;
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
    #[command(flatten)]
    key: RobotKeyArgs,
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
    #[command(flatten)]
    record: RecordArgs,
    #[arg(long, requires = "out", conflicts_with = "overwrite", help = RESUME)]
    resume: bool,
    /// The robot forgets what it has done so far, and begins anew.
    #[arg(long, conflicts_with = "resume")]
    restart: bool,
    /// Leave the robot mapping at the end, for another attach.
    #[arg(long)]
    keep_running: bool,
    /// Wait as long as it takes for what is to be at the port.
    ///
    /// Otherwise it is given up if none is there within 10 s. One that was there is always waited for.
    #[arg(long)]
    wait: bool,
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
    #[command(flatten)]
    monitor: MonitorArgs,
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
    let (config, lock) = (args.config()?, args.key.lock()?);
    let watched = args.monitor.watched(("attach", args.port.to_string(), None), config.map, stop)?;
    let mut book = Book::open(args, &config, watched)?;
    book.watched.open(false, args.tell)?;
    let mut memory = ClientMemory::default();
    let robot = config.robot(args.seed.seed, args.laser());
    let resume = book.run.as_ref().and_then(RobotRun::progress);
    let mut client = RobotClient::new(&robot, this_epoch(), resume, &mut memory).with_lock(lock);
    if args.restart {
        client.ask(&ToRobot::Restart).map_err(Failure::start)?;
    }
    let mut link = RobotLink::new(&args.port, args.link_baud, client);
    let started = WallInstant::now();
    while !stop.load(Ordering::Relaxed) && !book.is_enough() {
        link.serve(LISTEN, &mut |event| book.take(event));
        book.damaged_frames = link.client().session().counters().frames.damaged;
        book.tell_now_and_then();
        book.save_if_due();
        book.give_up_if_none_is_there(started);
    }
    // A robot that maps for somebody else, or not at all, is left as it is.
    if !args.keep_running && !book.is_refused {
        end(&mut link, &mut book);
    }
    book.damaged_frames = link.client().session().counters().frames.damaged;
    // It goes on until ctrl-C, unless an end was asked for.
    let is_interrupted = stop.load(Ordering::Relaxed);
    let is_early = is_interrupted && args.end.has_end() && !book.is_enough();
    let ending = if is_early { Ending::Interrupted } else { Ending::Complete };
    if let Some(run) = book.close(ending, None) {
        let words = ended(ending, run.folder().named());
        book.watched.finish(&words, |feed| run.show(feed, Beside::default()));
    }
    book.end_recording();
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
