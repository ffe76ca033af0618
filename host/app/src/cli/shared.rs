//! Arguments that several commands share: one name, one meaning, one help text each.

#[cfg(feature = "experiments")]
use std::path::Path;
use std::path::PathBuf;

use clap::Args;
use serde::Serialize;

use super::laser::say;
use super::{Failure, print};
use crate::config::RunConfig;
use lrfslam_host::input::printable::{printable, printable_lines};
use lrfslam_host::scans::live::Say;

/// Help of `--truth`.
pub(super) const TRUTH: &str = "The true path: TUM, or lines `t x y theta`";
/// Help of `--relations`.
pub(super) const RELATIONS: &str = "True displacements: lines `t1 t2 x y z roll pitch yaw`";
/// Help of `--lrf`.
pub(super) const LRF: &str = "The laser";
/// Help of `--port`.
pub(super) const PORT: &str =
    "Serial port, such as /dev/ttyUSB0, or tcp:HOST[:PORT], udp:HOST:PORT, or udp::PORT to listen";
/// Help of `--seeds`.
#[cfg(feature = "experiments")]
pub(super) const SEEDS: &str = "Seeds 1 to N: each is a run of its own";
/// Help of LOG.
pub(super) const LOG: &str =
    "A log, a recording of a laser, or the folder of the run that made it; - reads a log from standard input";
/// Help of `--map`.
pub(super) const MAP: &str = "Folder that `lrfslam map` has written";
/// Help of `--resume`.
pub(super) const RESUME: &str = "Go on with the run in the folder --out that was killed, with the same settings: what it has recorded is taken again, then what comes";
/// Help of `--record`.
pub(super) const RECORD: &str = "Record to this file: a name that ends in .mcap gets scans, poses, frames, the map and what is said, for Foxglove and others; \
     run records every byte of its laser, by default to laser.rec among the results";
/// Help of `--seconds`.
pub(super) const SECONDS: &str = "End after so many seconds of scans";

/// A number within bounds: neither NaN nor infinite.
pub(super) fn within(text: &str, low: f64, high: f64) -> Result<f64, String> {
    let number = text.parse().ok().filter(|n| (low..=high).contains(n));
    number.ok_or_else(|| format!("expected a number from {low} to {high}"))
}

/// Seconds that a run may last: 30 years.
pub(super) fn seconds(text: &str) -> Result<f64, String> {
    within(text, 0.0, 1e9)
}

/// How far from the truth is wrong, m or degrees.
#[cfg(feature = "experiments")]
pub(super) fn tolerance(text: &str) -> Result<f64, String> {
    within(text, 0.0, 1e6)
}

/// Help of `--start`.
pub(super) const START: &str = "Where the robot starts in the map: x and y in metres and degrees, or \"end\", where it was last when the map was \
     made [default: it finds itself]";
/// Help of `--particles`.
pub(super) const PARTICLES: &str =
    "Particles of DP-SLAM, as many as there is memory for; the same as --set particles.particles=N";
/// Help of `--levels`.
pub(super) const LEVELS: &str = "Levels of SLAM: 0, matching alone, which a robot does not take; 1, particles over whole maps; 2, loops closed as well; the same as --set hierarchy.levels=N";
/// Help of `--cell`.
#[cfg(feature = "experiments")]
pub(super) const CELL: &str = "Side of our method's NDT cells for the one scan that is matched against, m";

/// The configuration.
#[derive(Debug, Args)]
pub struct ConfigArgs {
    /// Configuration; `lrfslam config` prints one. What it leaves out stays as it is without.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Change one value of the configuration; may be given more than once.
    #[arg(long, value_name = "SECTION.KEY=VALUE")]
    set: Vec<String>,
}

impl ConfigArgs {
    /// Defaults, then the file, then the overrides, checked.
    ///
    /// # Errors
    /// What is wrong in the file or the overrides.
    pub fn load(&self) -> Result<RunConfig, Failure> {
        self.load_over(RunConfig::default(), [])
    }

    /// The same with other defaults; `flags` are overrides that flags of their own stand for.
    pub(super) fn load_over(
        &self,
        defaults: RunConfig,
        flags: impl IntoIterator<Item = String>,
    ) -> Result<RunConfig, Failure> {
        let overrides: Vec<String> = self.set.iter().cloned().chain(flags).collect();
        RunConfig::load_over(defaults, self.config.as_deref(), &overrides).map_err(Failure::start)
    }
}

/// The random numbers.
#[derive(Debug, Clone, Copy, Args)]
pub struct SeedArgs {
    /// Start of the random numbers: the same seed and input give the same results.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
}

/// The random numbers of an experiment's runs.
#[cfg(feature = "experiments")]
#[derive(Debug, Clone, Copy, Args)]
pub(super) struct SeedsArgs {
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..1000), help = SEEDS)]
    seeds: u64,
    /// Start of the random numbers: the same seed and input give the same results.
    #[arg(long, value_name = "N", conflicts_with = "seeds")]
    seed: Option<u64>,
}

#[cfg(feature = "experiments")]
impl SeedsArgs {
    /// The seed of each run.
    pub(super) fn each(self) -> std::ops::RangeInclusive<u64> {
        self.seed.map_or(1..=self.seeds, |seed| seed..=seed)
    }
}

/// Report or summary.
#[derive(Debug, Clone, Copy, Args)]
pub struct JsonArgs {
    /// Print the whole report as JSON instead of a summary.
    #[arg(long)]
    json: bool,
}

impl JsonArgs {
    /// What is to be printed.
    ///
    /// # Errors
    /// If the report cannot be written as JSON.
    pub fn choose(self, report: &impl Serialize, summary: impl FnOnce() -> String) -> Result<String, Failure> {
        if !self.json {
            return Ok(summary());
        }
        Ok(serde_json::to_string_pretty(report).map_err(Failure::work)? + "\n")
    }
}

/// What a command with results says.
#[derive(Debug, Clone, Copy, Args)]
pub struct TellArgs {
    #[command(flatten)]
    json: JsonArgs,
    /// Say nothing but errors; the exit code tells how it ended.
    #[arg(long, short, conflicts_with = "json")]
    quiet: bool,
}

impl TellArgs {
    /// Nothing but errors is to be said.
    pub fn is_quiet(self) -> bool {
        self.quiet
    }

    /// JSON is to be printed.
    #[cfg(feature = "monitor")]
    pub(super) fn is_json(self) -> bool {
        self.json.json
    }

    /// Words on the way, on standard error.
    pub fn say(self, text: &str) {
        if !self.quiet {
            say(&printable(text));
        }
    }

    /// The same, for a thread of its own.
    pub(super) fn sayer(self) -> Say {
        Box::new(move |text| self.say(text))
    }

    /// What is to be printed at the end; nothing if quiet.
    ///
    /// # Errors
    /// If the report cannot be written as JSON.
    pub fn choose(self, report: &impl Serialize, summary: impl FnOnce() -> String) -> Result<String, Failure> {
        if self.quiet {
            Ok(String::new())
        } else {
            self.json.choose(report, || printable_lines(&summary()).into_owned())
        }
    }

    /// Prints it.
    pub(super) fn print(self, report: &impl Serialize, summary: impl FnOnce() -> String) -> Result<(), Failure> {
        print(&self.choose(report, summary)?)
    }
}

/// Where `table` and files beside it are.
#[cfg(feature = "experiments")]
pub(super) fn with_folder(table: &str, folder: &Path) -> String {
    format!("{table}\nresults in {}\n", folder.display())
}
