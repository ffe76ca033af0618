//! `robot-sim`: the robot's whole program as a process, for a robot with a Linux computer, and for tests without a robot.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Context as _, Result};
use clap::{Args, Parser, ValueEnum};
use lrfslam_firmware_sim::fault::FaultPlan;
use lrfslam_firmware_sim::robot_process::{HostLine, Wiring, serve};
use lrfslam_robot::{CompactPools, LargePools, StandardPools};

/// A robot that does the SLAM itself.
///
/// The program that firmware is on a microcontroller, as a process: laser at a serial port, host at another or by TCP. It waits for
/// `lrfslam attach` to configure it, then maps whether the host is there or not.
#[derive(Debug, Parser)]
#[command(name = "robot-sim", version)]
struct Arguments {
    /// The laser's serial port, such as /dev/ttyACM0
    #[arg(long, value_name = "DEV")]
    lrf_port: PathBuf,
    #[command(flatten)]
    link: LinkArgs,
    /// Rate of --link-port, bit/s
    #[arg(long, value_name = "N", default_value_t = 921_600)]
    link_baud: u32,
    /// How much memory the robot has
    #[arg(long, value_enum, default_value_t = Size::Standard)]
    memory: Size,
    /// Faults of the host's line, such as damage=0.01 (chance per frame)
    #[arg(long, default_value = "none", value_parser = FaultPlan::parse)]
    fault: FaultPlan,
    /// Start of the random numbers: the same seed and input give the same results
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Say nothing but errors; the exit code tells how it ended
    #[arg(long, short)]
    quiet: bool,
}

/// Where the host is.
#[derive(Debug, Args)]
#[group(required = true, multiple = false)]
struct LinkArgs {
    /// At a serial port
    #[arg(long, value_name = "DEV")]
    link_port: Option<PathBuf>,
    /// At a pseudo-terminal, which is made under this name (a symbolic link)
    #[arg(long, value_name = "NAME")]
    link_pty: Option<PathBuf>,
    /// Comes by TCP to this address, such as 0.0.0.0:5557
    #[arg(long, value_name = "IP:PORT")]
    listen: Option<SocketAddr>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Size {
    /// That of the image for 512 KiB: 32 particles, 682 beams
    Standard,
    /// That of the image for 192 KiB: 12 particles, 384 beams, 4 m
    Compact,
    /// 64 particles, nine times the map, and minutes that a host may be away
    Large,
}

fn main() -> ExitCode {
    match run(&Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("robot-sim: {error:#}");
            ExitCode::FAILURE
        }
    }
}

fn run(arguments: &Arguments) -> Result<()> {
    let stop = Arc::new(AtomicBool::new(false));
    let flag = stop.clone();
    // A second one ends it at once.
    let end = move || {
        if flag.swap(true, Ordering::Relaxed) {
            std::process::exit(130);
        }
    };
    ctrlc::set_handler(end).context("catching ctrl-C")?;
    let wiring = Wiring {
        laser: arguments.lrf_port.clone(),
        host: host_line(arguments)?,
        faults: (arguments.fault.damage, arguments.seed),
    };
    let say = |text: &str| {
        if !arguments.quiet {
            eprintln!("robot-sim: {text}");
        }
    };
    match arguments.memory {
        Size::Standard => serve::<StandardPools>(&wiring, &stop, &say),
        Size::Compact => serve::<CompactPools>(&wiring, &stop, &say),
        Size::Large => serve::<LargePools>(&wiring, &stop, &say),
    }
}

fn host_line(arguments: &Arguments) -> Result<HostLine> {
    let LinkArgs { link_port, link_pty, listen } = &arguments.link;
    let serial = link_port.clone().map(|path| HostLine::Serial(path, arguments.link_baud));
    let line = serial.or_else(|| link_pty.clone().map(HostLine::Terminal)).or(listen.map(HostLine::Tcp));
    line.context("--link-port, --link-pty or --listen")
}
