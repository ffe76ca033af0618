//! A log in; a folder with its map, the path and a report out.
//!
//! `cargo run --release -p lrfslam-host --example map_log -- examples/floor.log.gz floor`

use std::path::PathBuf;
use std::sync::atomic::AtomicBool;
use std::thread::available_parallelism;

use anyhow::Context as _;
use lrfslam_host::mapping::MappingConfig;
use lrfslam_host::output::ResultFolder;
use lrfslam_host::results::report::Ending;
use lrfslam_host::runs::map::{About, MapRun, RunMemory};
use lrfslam_host::runs::scans::Scans;
use lrfslam_host::scans::log::LogOptions;

/// Of all random numbers: the same seed, log and configuration give the same map.
const SEED: u64 = 1;

static STOP: AtomicBool = AtomicBool::new(false);

fn main() -> anyhow::Result<()> {
    let mut arguments = std::env::args_os().skip(1).map(PathBuf::from);
    let (log, folder) = arguments.next().zip(arguments.next()).context("expected a log and a new folder")?;
    let mut folder = ResultFolder::claim(&folder, false)?;
    let config = MappingConfig::default();
    let mut memory = RunMemory::new(&config, available_parallelism().map_or(1, usize::from));
    let mut run = MapRun::new(&config, SEED, &mut memory)?;
    run.put_aside(folder.aside());
    let mut scans = Scans::open(&log, LogOptions::default(), &STOP, Box::new(|news| eprintln!("{news}")))?;
    for scan in &mut scans {
        let scan = scan?;
        let step = run.add_scan(&scan.scan(), scan.robot_from_lrf.unwrap_or_default(), None)?;
        if run.scans() % 500 == 0 {
            let robot = step.map_from_robot;
            println!("scan {}: x {:.2} m, y {:.2} m", run.scans(), robot.x, robot.y);
        }
    }
    let source = scans.source(true);
    let about = About { config: config.slam, source, odometry: false, ending: Ending::Complete, fault: None };
    let report = folder.save(|folder| run.write_into(folder, &about))?;
    println!("{} scans in {:.1} s: {}", report.cost.scans, report.cost.wall_s, folder.named().display());
    Ok(())
}
