//! The command line: raw arguments become checked ones in one place per sub-command, and every fault an exit code.
//!
//! A reader of our output that goes away (`| head`) is no fault.

mod attach;
mod calibrate;
mod cloud;
mod cloud_summary;
mod completions;
mod config;
mod continuing;
pub mod demo;
mod doctor;
mod eval;
#[cfg(feature = "experiments")]
mod experiment;
#[cfg(not(feature = "experiments"))]
#[path = "no_experiment.rs"]
mod experiment;
#[cfg(feature = "experiments")]
mod experiment_carried;
#[cfg(feature = "experiments")]
mod experiment_cost;
#[cfg(feature = "experiments")]
mod experiment_endurance;
#[cfg(feature = "experiments")]
mod experiment_envelope;
#[cfg(feature = "experiments")]
mod experiment_starts;
#[cfg(feature = "experiments")]
mod experiment_sweep;
mod key;
mod landmarks;
mod laser;
#[cfg(feature = "monitor")]
mod live_page;
#[cfg(not(feature = "monitor"))]
#[path = "no_live_page.rs"]
mod live_page;
mod live_scans;
mod localize;
mod lrf;
mod man;
mod map;
mod monitor;
mod out;
mod particles;
mod progress;
#[cfg(feature = "experiments")]
mod prove;
#[cfg(not(feature = "experiments"))]
#[path = "no_prove.rs"]
mod prove;
mod record;
mod replay;
mod room;
mod ros2;
#[cfg(feature = "ros2")]
mod ros2_node;
#[cfg(not(feature = "ros2"))]
#[path = "no_ros2_node.rs"]
mod ros2_node;
mod run;
mod shared;
mod speed_watch;
mod summary;
#[cfg(feature = "monitor")]
mod watch;
#[cfg(not(feature = "monitor"))]
#[path = "no_watch.rs"]
mod watch;
#[cfg(feature = "zenoh")]
mod zenoh;
#[cfg(not(feature = "zenoh"))]
#[path = "no_zenoh.rs"]
mod zenoh;

pub use self::laser::interrupt_flag;
pub use self::monitor::MonitorArgs;
pub use self::out::{OutArgs, SaveArgs};
pub use self::shared::{ConfigArgs, JsonArgs, SeedArgs, TellArgs};

use std::ffi::OsString;
use std::io::ErrorKind;
use std::process::ExitCode;

use clap::{CommandFactory as _, Parser, Subcommand};
use lrfslam_host::input::printable::printable_lines;
use lrfslam_host::program::Program;

use crate::held;

/// Laser SLAM without odometry.
///
/// Turns a recorded laser log into a map and the robot's path.
#[derive(Debug, Parser)]
#[command(name = "lrfslam", version = Program::DESCRIBED, about, after_help = EXIT_CODES, max_term_width = 100, arg_required_else_help = true)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Map(map::MapArgs),
    Localize(localize::LocalizeArgs),
    Eval(eval::EvalArgs),
    Cloud(cloud::CloudArgs),
    Run(run::RunArgs),
    Replay(replay::ReplayArgs),
    Attach(Box<attach::AttachArgs>),
    Key(key::KeyArgs),
    Watch(watch::WatchArgs),
    Lrf(lrf::LrfArgs),
    Landmarks(Box<landmarks::LandmarksArgs>),
    Doctor(Box<doctor::DoctorArgs>),
    Calibrate(calibrate::CalibrateArgs),
    Config(config::PrintArgs),
    #[cfg_attr(
        not(feature = "demo"),
        command(about = "Show everything at once, by a simulated robot (not in this build)")
    )]
    Demo(demo::DemoArgs),
    Experiment(experiment::ExperimentArgs),
    Prove(prove::ProveArgs),
    Completions(completions::CompletionsArgs),
    Man(man::ManArgs),
}

const EXIT_CODES: &str = "\
Exit codes:
  0    done
  1    a fault on the way, or nothing at a port: what was earned until then is written, and said to be partial
  2    wrong usage, or input that is wrong from the start: nothing was done
  3    done, but the robot was not found in the map (localize, map --continue), or something is wrong (doctor)
  130  ended early by ctrl-C: what was earned until then is written, and said to be partial
Ctrl-C is how run, attach, demo and a live localize end: with 0. Pressed twice, it ends every command at once.";

/// Why a command did not end well.
#[derive(Debug)]
pub enum Failure {
    /// Wrong from the start: nothing was done.
    Start(anyhow::Error),
    /// On the way.
    Work(anyhow::Error),
    /// The robot was not found in the map.
    NotFound(anyhow::Error),
    /// Something is wrong with the input that was to be judged.
    Unwell(anyhow::Error),
    /// The user did not wait for the end.
    Interrupted(anyhow::Error),
}

impl Failure {
    /// A fault from the start.
    pub fn start(error: impl Into<anyhow::Error>) -> Self {
        Self::Start(error.into())
    }

    /// A fault on the way.
    pub fn work(error: impl Into<anyhow::Error>) -> Self {
        Self::Work(error.into())
    }
}

/// A command that was left out of this build, and how to get it.
pub fn not_built_in(what: &str, feature: &str) -> Failure {
    Failure::Start(anyhow::Error::msg(how_to_build_in(what, feature)))
}

/// The same in words.
fn how_to_build_in(what: &str, feature: &str) -> String {
    format!(
        "this build has no {what}: build it with the feature, beside those that it is to keep: `cargo install --locked --path host/app --features {feature}`"
    )
}

/// The whole command line, as help, completions and manual pages have it.
pub fn command() -> clap::Command {
    Cli::command()
}

/// Runs the program with `args` (the first is its name) and says how it ended.
pub fn run(args: impl IntoIterator<Item = OsString>) -> ExitCode {
    let cli = match Cli::try_parse_from(args) {
        Ok(cli) => cli,
        Err(error) => {
            // Help and version go to stdout with code 0, faults to stderr with code 2; a closed pipe is no fault.
            let _ = error.print();
            return ExitCode::from(u8::try_from(error.exit_code()).unwrap_or(2));
        }
    };
    let done = match &cli.command {
        Command::Map(args) => map::run(args),
        Command::Localize(args) => localize::run(args),
        Command::Eval(args) => eval::run(args),
        Command::Cloud(args) => cloud::run(args),
        Command::Run(args) => run::run(args),
        Command::Replay(args) => replay::run(args),
        Command::Attach(args) => attach::run(args),
        Command::Key(args) => key::run(args),
        Command::Watch(args) => watch::run(args),
        Command::Lrf(args) => lrf::run(args),
        Command::Landmarks(args) => landmarks::run(args),
        Command::Doctor(args) => doctor::run(args),
        Command::Calibrate(args) => calibrate::run(args),
        Command::Config(args) => config::run(args),
        Command::Demo(args) => demo::run(args).and_then(|text| print(&text)),
        Command::Experiment(args) => experiment::run(args),
        Command::Prove(args) => prove::run(args),
        Command::Completions(args) => completions::run(args),
        Command::Man(args) => man::run(args),
    };
    let (error, code) = match done {
        Ok(()) => return ExitCode::SUCCESS,
        Err(Failure::Start(error)) => (error, 2),
        Err(Failure::Work(error)) => (error, 1),
        Err(Failure::NotFound(error) | Failure::Unwell(error)) => (error, 3),
        Err(Failure::Interrupted(error)) => (error, 130),
    };
    held::say(&format!("lrfslam: {}", printable_lines(&cut(&in_one_line(&error)))));
    ExitCode::from(code)
}

/// Longest message, letters: one that quotes a broken file may be as long as that.
const MESSAGE_MAX: usize = 2000;

/// As much of a message as one reads.
fn cut(text: &str) -> String {
    let end = text.char_indices().nth(MESSAGE_MAX).map(|(end, _)| end);
    end.map_or_else(|| text.to_owned(), |end| format!("{} …", &text[..end]))
}

/// The error and its causes, but no cause that an outer message has quoted already.
fn in_one_line(error: &anyhow::Error) -> String {
    error.chain().fold(String::new(), |text, cause| match cause.to_string() {
        cause if text.contains(&cause) => text,
        cause if text.is_empty() => cause,
        cause => format!("{text}: {cause}"),
    })
}

/// Writes `text` to stdout; a reader that has gone away is no fault.
fn print(text: &str) -> Result<(), Failure> {
    match held::print(text) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            Err(Failure::work(anyhow::Error::new(error).context("standard output cannot be written")))
        }
        _ => Ok(()),
    }
}
