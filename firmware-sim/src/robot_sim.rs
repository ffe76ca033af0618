//! `robot-sim`: the robot's whole program as a process, for a robot with a Linux computer, and for tests without a robot.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Context as _, Result, anyhow};
use clap::{Args, Parser, ValueEnum};
use lrfslam_firmware_sim::fault::FaultPlan;
use lrfslam_firmware_sim::robot_process::{HostLine, Wiring, read_key_file, serve};
use lrfslam_robot::wire::key::Key;
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
    #[command(flatten)]
    key: KeyArgs,
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
    /// Comes by TCP to this address, such as 127.0.0.1:5557, or with a key 0.0.0.0:5557
    #[arg(long, value_name = "IP:PORT")]
    listen: Option<SocketAddr>,
}

/// Who is listened to; without any, the environment's LRFSLAM_KEY is taken, if there is one.
#[derive(Debug, Args)]
#[group(multiple = false)]
struct KeyArgs {
    /// Listen only to a host with this key; `lrfslam key FILE` makes one. To be reached from other computers there must be one
    #[arg(long, value_name = "FILE")]
    key_file: Option<PathBuf>,
    /// The same key in 64 hexadecimal digits, which every user of this computer can see
    #[arg(long, value_name = "HEX")]
    key: Option<String>,
}

impl KeyArgs {
    fn key(&self) -> Result<Option<Key>> {
        if let Some(path) = &self.key_file {
            return read_key_file(path).map(Some);
        }
        let from_environment = || std::env::var("LRFSLAM_KEY").ok().filter(|key| !key.is_empty());
        let (name, digits) = match self.key.clone() {
            Some(digits) => ("--key", Some(digits)),
            None => ("LRFSLAM_KEY", from_environment()),
        };
        let no_key = || anyhow!("{name}: this is no key: 64 hexadecimal digits, as `lrfslam key` makes them");
        digits.map(|digits| Key::from_hex(digits.trim()).ok_or_else(no_key)).transpose()
    }
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
    let arguments = Arguments::parse();
    // Wrong from the start: nothing was done.
    let (done, code) = match wiring(&arguments) {
        Ok(wiring) => (run(&arguments, &wiring), ExitCode::FAILURE),
        Err(error) => (Err(error), ExitCode::from(2)),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("robot-sim: {error:#}");
            code
        }
    }
}

fn wiring(arguments: &Arguments) -> Result<Wiring> {
    let wiring = Wiring {
        laser: arguments.lrf_port.clone(),
        host: host_line(arguments)?,
        key: arguments.key.key()?,
        faults: (arguments.fault.damage, arguments.seed),
    };
    wiring.check()?;
    Ok(wiring)
}

fn run(arguments: &Arguments, wiring: &Wiring) -> Result<()> {
    let stop = Arc::new(AtomicBool::new(false));
    let flag = stop.clone();
    // A second one ends it at once.
    let end = move || {
        if flag.swap(true, Ordering::Relaxed) {
            std::process::exit(130);
        }
    };
    ctrlc::set_handler(end).context("catching ctrl-C")?;
    let say = |text: &str| {
        if !arguments.quiet {
            eprintln!("robot-sim: {text}");
        }
    };
    match arguments.memory {
        Size::Standard => serve::<StandardPools>(wiring, &stop, &say),
        Size::Compact => serve::<CompactPools>(wiring, &stop, &say),
        Size::Large => serve::<LargePools>(wiring, &stop, &say),
    }
}

fn host_line(arguments: &Arguments) -> Result<HostLine> {
    let LinkArgs { link_port, link_pty, listen } = &arguments.link;
    let serial = link_port.clone().map(|path| HostLine::Serial(path, arguments.link_baud));
    let line = serial.or_else(|| link_pty.clone().map(HostLine::Terminal)).or(listen.map(HostLine::Tcp));
    line.context("--link-port, --link-pty or --listen")
}
