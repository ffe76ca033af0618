//! A whole log through all that is between a laser and a finished map: the virtual laser's bytes, the robot's program in its pools, its link, and
//! the host that closes loops. Robot and host do in virtual time what they do at a table.
//!
//! The robot's clock begins when it is switched on; from the first scan on it goes with the log's times, made good where those run backwards, crowd
//! or stop (see [`pace`]). `trajectory.tum` has the log's own times, and so has `robot.tum`, the robot's own path before the host has closed any loop.

use std::collections::HashMap;
use std::fs::File;
use std::io::{BufWriter, Write as _};
use std::path::{Path, PathBuf};
use std::time::Instant as WallInstant;

use anyhow::{Context as _, ensure};
use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser as _};
use lrfslam_app::config::RunConfig;
use lrfslam_core::time::{Duration, Instant};
use lrfslam_firmware_sim::virtual_lrf::SensorModel;
use lrfslam_firmware_sim::virtual_lrf::recording::RecordedScan;
use lrfslam_host::output::ResultFolder;
use lrfslam_host::results::report::Ending;
use lrfslam_host::robot::{Tiles, Told};
use lrfslam_host::runs::robot::RobotRun;
use lrfslam_host::scans::log::LogScan;
use lrfslam_host::trajectory::{TimedPose, read_trajectory};
use lrfslam_robot::wire::message::{FromRobot, Status, ToRobot};
use lrfslam_robot::wire::session::Progress;
use lrfslam_robot::{LaserConfig, LaserFamily};
use lrfslam_tests::robot_rig::{Build, HostDisk, LineFaults, MakeMemory, PoolSize, RobotRig, Tally};

use crate::read;

/// Until then the host has configured the robot.
const LASER_AT: Duration = Duration::from_millis(6000);
/// A SICK takes 15 s from its power to the first scan, and the robot some more to find it.
const START: Duration = Duration::from_millis(60_000);
/// How long the robot may take to tell all of its map at the end.
const END: Duration = Duration::from_millis(60_000);
/// Of a SICK on RS-422: its scans take less time on the line than from one to the next, bit/s.
const SICK_BAUD: u32 = 500_000;
/// A laser that says nothing for longer is taken to be gone; the log's pauses are cut to this.
const PAUSE: Duration = Duration::from_millis(400);
/// From one line about the way to the next, scans.
const TELL_EVERY: usize = 1000;

#[derive(Args)]
pub struct BuildingArgs {
    log: PathBuf,
    /// Folder for the results, as `lrfslam attach` leaves them, and robot.tum, the path without the loops that the host closes
    out: PathBuf,
    /// Of robot, host and the line's faults
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// How much memory the robot has, as for robot-sim
    #[arg(long, value_parser = PossibleValuesParser::new(["standard", "compact", "large"]).map(|name| build(&name)), default_value = "standard")]
    memory: Build,
    /// Change one value of the robot's and host's configuration; may be given more than once
    #[arg(long, value_name = "SECTION.KEY=VALUE")]
    set: Vec<String>,
    /// One of the robot's pools is of another size than there; may be given more than once
    #[arg(long, value_name = "NAME=COUNT", value_parser = PoolSize::parse)]
    pool: Vec<PoolSize>,
    /// Only so many scans from the log's start
    #[arg(long, value_name = "N")]
    scans: Option<usize>,
    /// Chance of each fault per frame of the host's line
    #[arg(long, value_name = "CHANCE", default_value_t = 0.0)]
    faults: f32,
}

/// The host's memory: a run, and what went wrong with it first.
struct Heard {
    run: RobotRun<RunConfig>,
    sweeps: u32,
    fault: Option<anyhow::Error>,
}

impl HostDisk for Heard {
    fn take(&mut self, told: &Told<'_>) {
        let taken = self.run.take(told);
        let refused = match told.message() {
            Some(FromRobot::Said(words)) => {
                eprintln!("robot: {words}");
                Ok(())
            }
            Some(FromRobot::Refused(reason)) => Err(anyhow::anyhow!("the robot refuses: {reason}")),
            Some(FromRobot::Sweep(part)) => {
                self.sweeps += u32::from(part.is_last);
                Ok(())
            }
            _ => Ok(()),
        };
        if let Err(fault) = taken.and(refused) {
            self.fault.get_or_insert(fault);
        }
    }

    fn progress(&self) -> Option<Progress> {
        self.run.progress()
    }

    fn to_give_back(&self) -> Option<&Tiles> {
        Some(self.run.map().to_give_back())
    }
}

pub fn building(args: &BuildingArgs) -> anyhow::Result<()> {
    let mut config = RunConfig::load_over(RunConfig::for_robot(), None, &args.set)?;
    let mut scans = read(&args.log, &config)?;
    scans.truncate(args.scans.unwrap_or(usize::MAX));
    mount(&mut config, &scans);
    drive(args, &config, &scans)
}

/// Gives robot and host the mounting that the log tells, if they are to have it.
fn mount(config: &mut RunConfig, scans: &[LogScan]) {
    let told = scans.first().and_then(|scan| scan.robot_from_lrf).filter(|_| config.mounting.from_log);
    if let Some(robot_from_lrf) = told {
        (config.mounting.forward_m, config.mounting.left_m) = (robot_from_lrf.x, robot_from_lrf.y);
        config.mounting.heading_deg = robot_from_lrf.heading.to_degrees();
    }
}

fn drive(args: &BuildingArgs, config: &RunConfig, scans: &[LogScan]) -> anyhow::Result<()> {
    let started = WallInstant::now();
    let (laser, wanted) = laser(&args.log, scans, memory(args)().beams.len())?;
    let after = pace(scans);
    let length = after.last().copied().unwrap_or_default();
    let recorded =
        after.iter().zip(scans).map(|(after, scan)| RecordedScan { after: *after, beams: scan.beams.clone() });
    let folder = ResultFolder::claim(&args.out, true)?;
    let heard = Heard { run: RobotRun::open(folder, config.robot_setup(), args.seed)?, sweeps: 0, fault: None };
    let faults = LineFaults::all(args.faults);
    let robot = config.robot(args.seed, wanted);
    let mut rig = RobotRig::with(heard, memory(args), laser.say(recorded.collect()), &robot);
    rig.set_faults(faults, args.seed);
    rig.start();
    rig.run_for(LASER_AT);
    rig.plug_laser(true);
    let until = rig.now + START + length;
    run_until(&mut rig, until, |rig| rig.tally.scans as usize == scans.len())?;
    rig.ask(&ToRobot::Stop);
    let until = rig.now + END;
    run_until(&mut rig, until, |rig| rig.disk.run.map().is_complete())?;
    finish(args, scans, rig, started)
}

fn build(name: &str) -> Build {
    match name {
        "compact" => Build::Compact,
        "large" => Build::Large,
        _ => Build::Standard,
    }
}

fn memory(args: &BuildingArgs) -> MakeMemory {
    let (build, pools) = (args.memory, args.pool.clone());
    Box::new(move || build.memory(&pools))
}

/// The laser that took the log, and what the robot is told of it.
fn laser(log: &Path, scans: &[LogScan], room: usize) -> anyhow::Result<(SensorModel, LaserConfig)> {
    let first = scans.first().with_context(|| format!("{}: no scan", log.display()))?;
    let range_max_m = scans.iter().map(|scan| scan.range_max_m).fold(0.0, f32::max);
    let laser = SensorModel::of(&first.beams, range_max_m).with_context(|| {
        let bearing_deg = |beam: Option<&lrfslam_core::scan::Beam>| beam.map_or(0.0, |beam| beam.bearing_rad.to_degrees());
        format!(
            "{}: line {}: {} beams from {:.2}° to {:.2}°, expected those of a SICK LMS2xx (within 100° or 180°, every 0.25°, 0.5° or 1°) or of a URG-04LX (within 240°, every 360°/1024)",
            log.display(),
            first.line,
            first.beams.len(),
            bearing_deg(first.beams.first()),
            bearing_deg(first.beams.last()),
        )
    })?;
    let cluster = first.beams.len().div_ceil(room.max(1)) as u8;
    let wanted = match laser {
        SensorModel::Sick(_) => LaserConfig { family: LaserFamily::Sick, baud: SICK_BAUD, cluster: 1 },
        SensorModel::Hokuyo(_) => LaserConfig { family: LaserFamily::Hokuyo, baud: 0, cluster },
    };
    Ok((laser, wanted))
}

/// When the laser says each scan, from the first on: at the log's times, but no less than half a mean interval and no more than [`PAUSE`] after the
/// scan before. (Intel's times run backwards 652 times, and pause for up to 3.5 s; no laser does either.)
fn pace(scans: &[LogScan]) -> Vec<Duration> {
    let stamp = |scan: Option<&LogScan>| scan.map_or(Instant::default(), |scan| scan.stamp);
    let start = stamp(scans.first());
    let mean = stamp(scans.last()).since(start).micros / (scans.len() as i64 - 1).max(1);
    let shortest = (mean / 2).clamp(0, PAUSE.micros);
    let (mut last, mut left_out) = (-shortest, 0);
    let mut next = |scan: &LogScan| {
        let wanted = scan.stamp.since(start).micros - left_out;
        let at = wanted.clamp(last + shortest, last + PAUSE.micros);
        left_out += (wanted - at).max(0);
        last = at;
        Duration::from_micros(at)
    };
    scans.iter().map(&mut next).collect()
}

fn run_until(
    rig: &mut RobotRig<Heard>,
    until: Instant,
    is_done: impl Fn(&RobotRig<Heard>) -> bool,
) -> anyhow::Result<()> {
    let mut told = 0;
    while !is_done(rig) {
        if let Some(fault) = rig.disk.fault.take() {
            return Err(fault);
        }
        ensure!(rig.now < until, "the robot has mapped {} scans and says no more: {:?}", rig.tally.scans, rig.status);
        rig.step();
        let thousands = rig.tally.scans as usize / TELL_EVERY;
        if thousands > told {
            told = thousands;
            eprintln!("{} scans", thousands * TELL_EVERY);
        }
    }
    Ok(())
}

fn finish(
    args: &BuildingArgs,
    scans: &[LogScan],
    mut rig: RobotRig<Heard>,
    started: WallInstant,
) -> anyhow::Result<()> {
    let (damaged, line_faults) = (rig.host_counters().frames.damaged, rig.faults());
    let RobotRig { status, tally, disk: Heard { mut run, sweeps, .. }, .. } = rig;
    let numbers: Vec<u32> = run.map().scans().iter().map(|scan| scan.number).collect();
    run.set_status(&status);
    let high = run.high_counts();
    run.save((&args.log.display().to_string(), damaged), Ending::Complete, None)?;
    let path = run.map().path();
    let taken: HashMap<Instant, u32> = path.iter().map(|pose| pose.stamp).zip(numbers.iter().copied()).collect();
    write_path(&args.out.join("robot.tum"), &path, scans, &taken)?;
    // Scans that fitted nowhere are not in it.
    let file = args.out.join("trajectory.tum");
    write_path(&file, &read_trajectory(&file)?, scans, &taken)?;
    let Tally { lost, dropped, tiles, ndt_dropped, ndt_evicted, .. } = tally;
    let wall_s = started.elapsed().as_secs_f64();
    println!("{} of {} scans mapped, {lost} of them lost", tally.scans, scans.len());
    println!("{dropped} particles dropped, {} left; {tiles} map tiles at most", status.particles);
    let Status { tiles_left, tiles_restored, tiles_forgotten, .. } = status;
    println!("{tiles_left} map tiles left with the host, {tiles_restored} taken back, {tiles_forgotten} forgotten");
    println!("{ndt_evicted} of the matcher's tiles forgotten, {ndt_dropped} points found no room in it");
    println!(
        "{} scans' poses told, {sweeps} of them with their beams, {} without for want of room",
        numbers.len(),
        status.untold_sweeps
    );
    println!("{line_faults} faults of the line, {damaged} frames damaged");
    high.iter().for_each(|high| println!("{} loops closed", high.closures));
    println!("{wall_s:.1} s, {:.0} scans/s", scans.len() as f64 / wall_s);
    Ok(())
}

/// Writes poses, the log's times in the place of those of the robot's clock.
///
/// * `taken` — the number of the scan that was taken at a time of the robot's clock
fn write_path(
    file: &Path,
    poses: &[TimedPose],
    scans: &[LogScan],
    taken: &HashMap<Instant, u32>,
) -> anyhow::Result<()> {
    let mut out = BufWriter::new(File::create(file)?);
    for pose in poses {
        let number = taken.get(&pose.stamp).copied().unwrap_or(0);
        let scan = (number as usize).checked_sub(1).and_then(|index| scans.get(index)).context("a pose of no scan")?;
        TimedPose { stamp: scan.stamp, ..*pose }.write_tum(&mut out)?;
    }
    Ok(out.flush()?)
}
