//! What the robot's program costs on a microcontroller, and how well it maps with the memory of one.
//!
//! `firmware-sim/firmware/figures` builds what `instructions` needs, and runs it and `accuracy`.

mod accuracy;
mod building;
mod instructions;

use std::path::{Path, PathBuf};

use clap::{Parser, Subcommand};
use lrfslam_app::config::RunConfig;
use lrfslam_core::geometry::Pose2;
use lrfslam_host::scans::log::{LogReader, LogScan};
use lrfslam_robot::{Mapping, RobotConfig};
use lrfslam_tests::robot_rig::Tally;

#[derive(Parser)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// The robot's mapping, in the memory of the two images, beside that of this computer
    Accuracy {
        log: PathBuf,
        /// Where the robot truly was, TUM
        truth: Option<PathBuf>,
        /// Change one value of the configuration of all; may be given more than once
        #[arg(long, value_name = "SECTION.KEY=VALUE")]
        set: Vec<String>,
    },
    /// Mean distance between where the log's hits lie by one path and by another
    Distance {
        log: PathBuf,
        /// TUM, as `building` writes it
        path: PathBuf,
        /// TUM; without, this computer's path
        other: Option<PathBuf>,
    },
    /// The same on QEMU's microcontrollers, counted by stage, and compared bit by bit
    Instructions {
        log: PathBuf,
        /// So many from the log's start
        scans: usize,
        /// The middle of them is left out, so many: the robot is lost behind it
        #[arg(long, value_name = "N", default_value_t = 0)]
        leave_out: usize,
    },
    /// A whole log through laser, robot, link and host, on a virtual clock
    Building(building::BuildingArgs),
}

fn main() -> anyhow::Result<()> {
    match &Arguments::parse().command {
        Command::Accuracy { log, truth, set } => accuracy::accuracy(log, truth.as_deref(), set),
        Command::Distance { log, path, other } => accuracy::distance(log, path, other.as_deref()),
        Command::Instructions { log, scans, leave_out } => instructions::instructions(log, *scans, *leave_out),
        Command::Building(args) => building::building(args),
    }
}

fn read(log: &Path, config: &RunConfig) -> anyhow::Result<Vec<LogScan>> {
    let reader = LogReader::open(log, config.log_options())?;
    Ok(reader.collect::<Result<_, _>>()?)
}

fn mounting(scans: &[LogScan]) -> Pose2 {
    scans.first().and_then(|scan| scan.robot_from_lrf).unwrap_or_default()
}

/// The second image has memory for 384 beams: with more, every second one is left out.
fn thinned(scan: &LogScan, beams: usize) -> LogScan {
    let keep_every = scan.beams.len().div_ceil(beams).max(1);
    LogScan { beams: scan.beams.iter().step_by(keep_every).copied().collect(), ..scan.clone() }
}

/// The smaller memory: fewer particles, beams and metres.
fn compact(mut config: RobotConfig) -> RobotConfig {
    config.slam.particles.particles = 12;
    config.slam.rays.range_max_m = 4.0;
    // They take little time: all of it may look at more.
    config.slam.matcher.search_points = 32;
    (config.slam.particle_map.print_step, config.slam.perception.beam_step) = (3, 4);
    config
}

struct MappedPath {
    poses: Vec<Pose2>,
    steps: u32,
    refused: u32,
    tally: Tally,
}

fn map(mapping: &mut Mapping<'_>, scans: &[LogScan]) -> MappedPath {
    let mut mapped = MappedPath { poses: Vec::new(), steps: 0, refused: 0, tally: Tally::default() };
    for scan in scans {
        match mapping.add_scan(&scan.scan()) {
            Ok(done) => {
                mapped.poses.push(done.report.map_from_robot);
                mapped.tally.add(&done);
            }
            Err(_) => {
                mapped.refused += 1;
                mapped.poses.push(mapped.poses.last().copied().unwrap_or_default());
            }
        }
    }
    mapped.steps = mapping.steps();
    mapped
}
