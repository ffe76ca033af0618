//! `lrfslam experiment`: what the methods are worth on scans whose true path is known.

use std::fmt::Write as _;
use std::path::PathBuf;

use clap::{Args, Subcommand};

use super::experiment_sweep::{self, SweepArgs};
use super::{Failure, print};
use crate::config::RunConfig;
use crate::experiment::{Experiment, MatchPairsConfig, MatchPairsReport, match_pairs};
use crate::log::{LogReader, LogScan};
use crate::trajectory::read_trajectory;

/// Measure the methods on scans whose true path is known, simulated or real.
#[derive(Debug, Args)]
pub(super) struct ExperimentArgs {
    #[command(subcommand)]
    experiment: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    MatchPairs(MatchPairsArgs),
    /// Errors of displacement over the size of DE's population (figures 5.1, 5.2).
    DePopulation(SweepArgs),
    /// Errors of displacement over the number of DE's generations (figures 5.3, 5.4).
    DeGenerations(SweepArgs),
    /// Errors of displacement over the laser's noise (figures 5.5, 5.6).
    LrfNoise(SweepArgs),
    /// The distribution of the errors: the scan-matching motion model (table 4.7).
    MotionModel(SweepArgs),
}

/// How often scans displaced anywhere in the search box are found again: by differential evolution and by Newton's method.
#[derive(Debug, Args)]
struct MatchPairsArgs {
    /// The log.
    log: PathBuf,
    /// The path of the log's scans, as `lrfslam map` writes it: the truth.
    #[arg(long, value_name = "FILE")]
    trajectory: PathBuf,
    /// Pairs to draw.
    #[arg(long, value_name = "N", default_value_t = 2000)]
    pairs: u32,
    /// Scans from the first of a pair to the second.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..10_000))]
    gap: u32,
    /// Start of the random numbers.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Pairs of which a smaller share of points overlaps are left out.
    #[arg(long, value_name = "SHARE", default_value_t = 0.6)]
    overlap: f32,
    /// Side of an NDT cell of the one scan that is matched against, m.
    #[arg(long, value_name = "METRES", default_value_t = 0.5)]
    cell: f32,
    /// Configuration; `lrfslam config` prints one.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Change one value of the configuration; may be given more than once.
    #[arg(long, value_name = "SECTION.KEY=VALUE")]
    set: Vec<String>,
    /// Print JSON instead of a table.
    #[arg(long)]
    json: bool,
}

pub(super) fn run(args: &ExperimentArgs) -> Result<(), Failure> {
    match &args.experiment {
        Command::MatchPairs(args) => run_match_pairs(args),
        Command::DePopulation(args) => experiment_sweep::run(Experiment::Population, args),
        Command::DeGenerations(args) => experiment_sweep::run(Experiment::Generations, args),
        Command::LrfNoise(args) => experiment_sweep::run(Experiment::LrfNoise, args),
        Command::MotionModel(args) => experiment_sweep::run(Experiment::MotionModel, args),
    }
}

fn run_match_pairs(args: &MatchPairsArgs) -> Result<(), Failure> {
    let config = RunConfig::load(args.config.as_deref(), &args.set).map_err(Failure::start)?;
    let log = LogReader::open(&args.log, config.log_options()).map_err(Failure::start)?;
    let scans: Vec<LogScan> = log.collect::<Result<_, _>>().map_err(Failure::start)?;
    let poses = read_trajectory(&args.trajectory).map_err(Failure::start)?;
    let pairs = MatchPairsConfig {
        pairs: args.pairs,
        gap: args.gap,
        seed: args.seed,
        overlap_min: args.overlap,
        cell_size_m: args.cell,
    };
    let report = match_pairs(&config, &pairs, &scans, &poses).map_err(Failure::start)?;
    if args.json {
        let text = serde_json::to_string_pretty(&report).map_err(Failure::work)?;
        return print(&(text + "\n"));
    }
    print(&table(&report))
}

fn table(report: &MatchPairsReport) -> String {
    let mut text = format!("{:<12}{:>14}{:>26}{:>12}\n", "", "recovered, %", "where determined, %", "ms");
    for score in &report.scores {
        let name = format!("{:?}", score.contender).to_lowercase();
        let (all, determined) = (100.0 * score.recovered, 100.0 * score.recovered_determined);
        let _ = writeln!(text, "{name:<12}{all:>14.2}{determined:>26.2}{:>12.3}", score.mean_ms);
    }
    let _ = writeln!(
        text,
        "\n{} pairs, {} of them with an undetermined axis; {} more left out for want of overlap",
        report.judged, report.undetermined, report.without_overlap
    );
    text
}
