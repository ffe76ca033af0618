//! `lrfslam demo`: the simulator and the mapper in one process, met as bytes on a pseudo-terminal.
//!
//! Only here does the program see both sides: the library never imports the simulator. Data flow: [`robot`] (building, drive, laser on a
//! pseudo-terminal) → the real driver → [`session`] (level scans to the mapper, tilted ones kept) → [`results`] (files, errors
//! against the truth).

use std::sync::atomic::Ordering;

use super::{DemoArgs, results};
use crate::cli::{Failure, interrupt_flag};
use crate::config::RunConfig;
use crate::config::RunReport;
use anyhow::anyhow;
use lrfslam_firmware_sim::scenario::Scenario;
use lrfslam_host::output::ResultFolder;
use lrfslam_host::results::report::Ending;
use lrfslam_host::runs::map::{MapRun, RunMemory};
use lrfslam_host::scans::live::{ScanSource, for_each_scan};

use super::robot::SimulatedRobot;
use super::session::DemoMapping;

/// Runs the demonstration; returns what there is to tell.
pub(in crate::cli) fn run(args: &DemoArgs) -> Result<String, Failure> {
    let config = args.config.load()?;
    let scenario = Scenario::load(&args.world).map_err(Failure::start)?;
    if args.seconds.is_none() && scenario.drive().end().is_none() {
        let error = anyhow!("{}: its robot has no route: say by --seconds how long it is to drive", args.world);
        return Err(Failure::Start(error));
    }
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let mapping = config.mapping();
    let mut memory = RunMemory::new(&mapping, threads);
    let map = MapRun::new(&mapping, args.seed.seed, &mut memory).map_err(Failure::Start)?;
    let folder = args.out.folder("demo")?;
    let (report, text) = show(args, &config, scenario, (map, folder))?;
    args.tell.choose(&report, || text)
}

fn show(
    args: &DemoArgs,
    config: &RunConfig,
    scenario: Scenario,
    (map, mut folder): (MapRun<'_>, ResultFolder),
) -> Result<(RunReport, String), Failure> {
    let stop = interrupt_flag().map_err(Failure::Start)?;
    let robot = SimulatedRobot::start(scenario, args).map_err(Failure::Work)?;
    let source = ScanSource::Live(robot.laser(args));
    let source_name = format!("a simulated {:?} in {}", args.lrf, args.world);
    let watched = args.monitor.watched(("demo", source_name, None), config.map, stop)?;
    watched.open(false, args.tell)?;
    let mut session = DemoMapping::new((config, map), (&robot, watched), args);
    let done = for_each_scan(&source, stop, &mut |item| session.take(item));
    robot.switch_off().map_err(Failure::Work)?;
    let done = done.map_err(Failure::Work)?;
    if session.has_failed() || (stop.load(Ordering::Relaxed) && !session.has_ended()) {
        return Err(session.leave(&done, &mut folder));
    }
    let written = folder.save(|stage| {
        let drive = session.finish(&done, stage)?;
        let table = results::write(args, config, &robot, &drive, stage)?;
        Ok((drive.report, table))
    });
    let (report, table) = written.map_err(Failure::Work)?;
    session.show_end(Ending::Complete, folder.named());
    Ok((report, format!("{table}\nresults in {}\n", folder.named().display())))
}
