//! `lrf-sim`: a laser range finder on a pseudo-terminal, for drivers that want a serial port; and drives as logs.

mod log_command;
mod surfaces_command;

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Context, Result};
use clap::{Args, Parser, Subcommand, ValueEnum};
use lrfslam_core::time::Instant;
use lrfslam_firmware_sim::fault::FaultPlan;
use lrfslam_firmware_sim::lrf_model::LrfErrors;
use lrfslam_firmware_sim::pty;
use lrfslam_firmware_sim::scenario::Scenario;
use lrfslam_firmware_sim::virtual_lrf::hokuyo::HokuyoModel;
use lrfslam_firmware_sim::virtual_lrf::ldrobot::VirtualLd06;
use lrfslam_firmware_sim::virtual_lrf::rplidar::{RplidarModel, VirtualRplidar};
use lrfslam_firmware_sim::virtual_lrf::sick::SickModel;
use lrfslam_firmware_sim::virtual_lrf::{SensorModel, VirtualLrf};
use lrfslam_lrf::sick_lms::Variant;

/// Simulated laser range finders.
///
/// Serves one on a pseudo-terminal that drivers cannot tell from a real one; `lrf-sim log` writes a drive as a log instead.
#[derive(Debug, Parser)]
#[command(name = "lrf-sim", version, args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
struct Arguments {
    #[command(subcommand)]
    command: Option<Command>,
    #[command(flatten)]
    serve: Option<ServeArgs>,
}

#[derive(Debug, Subcommand)]
enum Command {
    Log(Box<log_command::LogArgs>),
    Surfaces(surfaces_command::SurfacesArgs),
}

/// Help of `--world`.
const WORLD: &str = "Where it is: room, floor, office, demo, corridor, loop, ring, maze, small-maze, reflectors, a world file, or the YAML of a ROS map";

/// A laser on a pseudo-terminal.
#[derive(Debug, Args)]
struct ServeArgs {
    /// The laser
    #[arg(long, value_enum, visible_alias = "model")]
    lrf: Model,
    /// Name under which the port appears (a symbolic link)
    #[arg(long)]
    link: PathBuf,
    #[arg(long, default_value = "room", value_name = "NAME|FILE", help = WORLD)]
    world: String,
    /// Baud rate that the sensor has at first, instead of its power-up rate
    #[arg(long)]
    baud: Option<u32>,
    /// SICK: field of view and resolution in degrees, such as 180/0.5
    #[arg(long, value_parser = parse_variant)]
    variant: Option<Variant>,
    /// Faults of the line, such as damage=0.01,unplug=20 (chance per write, seconds)
    #[arg(long, default_value = "none", value_parser = FaultPlan::parse)]
    fault: FaultPlan,
    /// Power comes on at the start, so that the sensor boots first (15 s for a SICK)
    #[arg(long)]
    boot: bool,
    /// Start of the random numbers: the same seed and input give the same results
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Say nothing but errors; the exit code tells how it ended
    #[arg(long, short)]
    quiet: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Model {
    #[value(name = "lms200")]
    Lms200,
    #[value(name = "lms200-3016")]
    Lms200Far,
    /// An LMS200 of old firmware, whose configuration has 32 bytes
    #[value(name = "lms200-old")]
    Lms200Old,
    #[value(name = "lms291")]
    Lms291,
    #[value(name = "urg-04lx")]
    Urg04lx,
    /// The URG-04LX by its USB port: it wakes in SCIP 1.1, at the speed of USB
    #[value(name = "urg-04lx-usb")]
    Urg04lxUsb,
    #[value(name = "urg-04lx-ug01")]
    Urg04lxUg01,
    #[value(name = "utm-30lx")]
    Utm30lx,
    #[value(name = "rplidar-a2")]
    RplidarA2,
    #[value(name = "rplidar-c1")]
    RplidarC1,
    /// An RPLIDAR A1 of old firmware, which has no scans with check sums
    #[value(name = "rplidar-a1-old")]
    RplidarA1Old,
    #[value(name = "ld06")]
    Ld06,
}

/// What a model is on the wire.
enum Sensor {
    Known(SensorModel),
    Rplidar(RplidarModel),
    Ld06,
}

impl Model {
    /// What the sensor is on the wire.
    fn sensor(self) -> Sensor {
        Sensor::Known(match self {
            Self::RplidarA2 => return Sensor::Rplidar(RplidarModel::a2()),
            Self::RplidarC1 => return Sensor::Rplidar(RplidarModel::c1()),
            Self::RplidarA1Old => return Sensor::Rplidar(RplidarModel::a1_old()),
            Self::Ld06 => return Sensor::Ld06,
            Self::Lms200 => SensorModel::Sick(SickModel::lms200()),
            Self::Lms200Far => SensorModel::Sick(SickModel::lms200_3016()),
            Self::Lms200Old => SensorModel::Sick(SickModel::lms200().with_old_firmware()),
            Self::Lms291 => SensorModel::Sick(SickModel::lms291()),
            Self::Urg04lx => SensorModel::Hokuyo(HokuyoModel::urg_04lx()),
            Self::Urg04lxUsb => SensorModel::Hokuyo(HokuyoModel::urg_04lx_usb()),
            Self::Urg04lxUg01 => SensorModel::Hokuyo(HokuyoModel::urg_04lx_ug01()),
            Self::Utm30lx => SensorModel::Hokuyo(HokuyoModel::utm_30lx()),
        })
    }
}

fn parse_variant(text: &str) -> Result<Variant, String> {
    let expected = || format!("{text}: expected 180/1, 180/0.5, 100/1, 100/0.5 or 100/0.25");
    let (angle, resolution) = text.split_once('/').ok_or_else(expected)?;
    let angle_deg = angle.parse().map_err(|_| expected())?;
    let resolution: f64 = resolution.parse().map_err(|_| expected())?;
    let variant = Variant { angle_deg, resolution_cdeg: (resolution * 100.0).round() as u16 };
    if variant.is_possible() { Ok(variant) } else { Err(expected()) }
}

fn main() -> ExitCode {
    match run(Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("lrf-sim: {error:#}");
            ExitCode::FAILURE
        }
    }
}

fn run(arguments: Arguments) -> Result<()> {
    match (arguments.command, arguments.serve) {
        (Some(Command::Log(arguments)), _) => log_command::run(&arguments),
        (Some(Command::Surfaces(arguments)), _) => surfaces_command::run(&arguments),
        (None, Some(arguments)) => serve(&arguments),
        // clap asks for the arguments of a laser where there is no command.
        (None, None) => Ok(()),
    }
}

fn serve(arguments: &ServeArgs) -> Result<()> {
    let mut device = build(arguments)?;
    if arguments.boot {
        device.power_on(Instant::default());
    }
    let stop = Arc::new(AtomicBool::new(false));
    let flag = stop.clone();
    // A second one ends it at once.
    let end = move || {
        if flag.swap(true, Ordering::Relaxed) {
            std::process::exit(130);
        }
    };
    ctrlc::set_handler(end).context("catching ctrl-C")?;
    let say = |text: String| {
        if !arguments.quiet {
            eprintln!("{text}");
        }
    };
    let name = arguments.lrf.to_possible_value().map_or(String::new(), |value| value.get_name().to_owned());
    say(format!("{name} at {}; ctrl-C ends", arguments.link.display()));
    let mut clock = pty::wall_clock();
    let report = pty::serve(device.as_mut(), &arguments.link, arguments.fault, arguments.seed, &mut clock, &stop)?;
    say(format!("{} writes, {} damaged or lost, {} bytes not taken", report.writes, report.faults, report.dropped));
    Ok(())
}

fn build(arguments: &ServeArgs) -> Result<Box<dyn VirtualLrf>> {
    let scene = Box::new(Scenario::load(&arguments.world)?.scene());
    let model = match (arguments.lrf.sensor(), arguments.variant) {
        (Sensor::Known(SensorModel::Sick(model)), Some(variant)) => SensorModel::Sick(model.with_variant(variant)),
        (Sensor::Known(model), _) => model,
        (Sensor::Rplidar(model), _) => return Ok(Box::new(VirtualRplidar::new(model, scene, arguments.seed))),
        (Sensor::Ld06, _) => {
            let errors = LrfErrors { lost: 0.01, ..LrfErrors::gaussian(0.01) };
            return Ok(Box::new(VirtualLd06::new(errors, scene, arguments.seed)));
        }
    };
    Ok(model.seeing(scene, arguments.seed, arguments.baud))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What the laser of these arguments answers, within two seconds.
    fn answer(lrf: &str, request: &[u8]) -> Vec<u8> {
        let arguments = Arguments::parse_from(["lrf-sim", "--lrf", lrf, "--link", "/tmp/laser"]);
        let mut device = build(&arguments.serve.unwrap()).unwrap();
        device.receive(Instant::from_micros(1_000_000), request);
        device.timeout(Instant::from_micros(3_000_000));
        std::iter::from_fn(|| device.poll()).flat_map(|emission| emission.bytes).collect()
    }

    #[test]
    fn every_laser_can_be_served() {
        for model in Model::value_variants() {
            let name = model.to_possible_value().unwrap().get_name().to_owned();
            let request: &[u8] = match &name[..3] {
                "lms" => &[0x02, 0, 1, 0, 0x31, 0x15, 0x12],
                "rpl" => &[0xA5, 0x50],
                _ => b"VV\n",
            };
            assert!(!answer(&name, request).is_empty(), "{name}");
        }
    }

    #[test]
    fn old_firmware_has_a_configuration_of_32_bytes() {
        let get_config = [0x02, 0, 1, 0, 0x74, 0x50, 0x12];
        assert_eq!((answer("lms200-old", &get_config).len(), answer("lms200", &get_config).len()), (1 + 40, 1 + 42));
    }

    #[test]
    fn urg_on_usb_wakes_in_scip1() {
        assert_eq!(answer("urg-04lx-usb", b"QT\n"), b"QT\nE\n\n");
    }
}
