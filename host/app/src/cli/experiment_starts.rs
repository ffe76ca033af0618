//! `lrfslam experiment starts`: localisation from an unknown start, again and again along a log.

use std::path::PathBuf;

use crate::config::RunConfig;
use clap::Args;
use lrfslam_core::time::Duration;

use super::experiment_envelope::HarderArgs;
use super::localize::not_whole;
use super::shared::{ConfigArgs, LOG, MAP, SeedArgs, TRUTH, tolerance};
use super::{Failure, print};
use lrfslam_host::localize::KnownMap;
use lrfslam_host::mapping::saved_map::SavedMap;
use lrfslam_host::output::write_file;
use lrfslam_host::runs::scans::read_scans;
use lrfslam_host::trajectory::read_trajectory;
use lrfslam_lab::experiment::{
    StartsConfig, degrade, starts_csv, starts_summary, told_starts_markdown, try_starts, try_told_starts,
};

/// Does a robot find itself in a saved map, wherever it is switched on? Starts every few seconds of a log, each from an unknown place.
///
/// The true path is in the map's frame, with a pose under the time of every scan.
#[derive(Debug, Args)]
pub(super) struct StartsArgs {
    #[arg(help = LOG)]
    log: PathBuf,
    #[arg(long, value_name = "DIR", help = MAP)]
    map: PathBuf,
    #[arg(long, value_name = "FILE", help = TRUTH)]
    truth: PathBuf,
    /// From start to start, s.
    #[arg(long, value_name = "S", default_value_t = 20, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    every: u32,
    /// A start is given up after this, s.
    #[arg(long, value_name = "S", default_value_t = 60, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    patience: u32,
    /// Farther from the truth is wrong, m.
    #[arg(long, value_name = "METRES", default_value_t = 0.5, value_parser = tolerance)]
    wrong: f64,
    /// Farther from the true heading is wrong, degrees.
    #[arg(long, value_name = "DEGREES", default_value_t = 5.0, value_parser = tolerance)]
    wrong_deg: f64,
    #[command(flatten)]
    harder: HarderArgs,
    /// Tells the robot where it starts, rightly and wrongly: what comes of it, in a table.
    #[arg(long, conflicts_with = "out")]
    told: bool,
    #[command(flatten)]
    seed: SeedArgs,
    /// Table with a line for each start.
    #[arg(long, value_name = "FILE.csv")]
    out: Option<PathBuf>,
    #[command(flatten)]
    config: ConfigArgs,
}

pub(super) fn run(args: &StartsArgs) -> Result<(), Failure> {
    let saved = SavedMap::read(&args.map).map_err(Failure::start)?;
    let config = RunConfig::of_saved(&saved, &args.map).map_err(Failure::start)?;
    let config = args.config.load_over(config, [])?;
    let map = KnownMap::new(&saved, &config.mapping().high_slam()).map_err(|error| not_whole(&args.map, &error))?;
    let scans = read_scans(&args.log, config.log_options()).map_err(Failure::Start)?;
    let scans = degrade(&scans, args.harder.degradation(), args.seed.seed, 0);
    let truth = read_trajectory(&args.truth).map_err(Failure::start)?;
    let seconds = |seconds: u32| Duration::from_micros(i64::from(seconds) * 1_000_000);
    let starts = StartsConfig {
        every: seconds(args.every),
        patience: seconds(args.patience),
        wrong_m: args.wrong,
        wrong_deg: args.wrong_deg,
        seed: args.seed.seed,
    };
    let localizer = (&config.localizer(), config.robot_from_lrf());
    if args.told {
        let all = try_told_starts(localizer, &starts, &map, &scans, &truth).map_err(Failure::Work)?;
        return print(&told_starts_markdown(&all));
    }
    let outcomes = try_starts(localizer, &starts, &map, &scans, &truth).map_err(Failure::Work)?;
    if let Some(file) = &args.out {
        let written = write_file(file, starts_csv(&outcomes).as_bytes());
        let context = || format!("{}: cannot be written", file.display());
        written.map_err(|error| Failure::Work(anyhow::Error::new(error).context(context())))?;
    }
    print(&starts_summary(&starts, &outcomes))
}
