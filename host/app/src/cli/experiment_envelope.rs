//! `lrfslam experiment envelope`: a log made harder in many ways, and what becomes of its map.

use std::path::PathBuf;

use clap::Args;
use clap::builder::PossibleValuesParser;

use super::Failure;
use super::out::OutArgs;
use super::shared::{ConfigArgs, LOG, RELATIONS, SEEDS, TellArgs, with_folder};
use lrfslam_host::output::write_file;
use lrfslam_host::runs::scans::read_scans;
use lrfslam_lab::evaluation::read_relations;
use lrfslam_lab::experiment::{
    ENVELOPE_ROWS, EnvelopeRun, envelope_csv, envelope_markdown, plot_envelope, run_envelope,
};

/// Where are the limits? Makes a log harder in many ways, maps each by its laser alone, and judges the paths by relations.
///
/// More people, a shorter, narrower or sparser laser, fewer scans, noise. A relation counts if both its times are among those of the scans left.
/// Writes envelope.csv, a line for each run, envelope.md and envelope.svg.
#[derive(Debug, Args)]
pub(super) struct EnvelopeArgs {
    #[arg(help = LOG)]
    log: PathBuf,
    #[arg(long, value_name = "FILE", help = RELATIONS)]
    relations: PathBuf,
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..1000), help = SEEDS)]
    seeds: u64,
    /// Start of the random numbers: the same seed and input give the same results.
    #[arg(long, value_name = "N", conflicts_with = "seeds")]
    seed: Option<u64>,
    /// These rows alone; may be given more than once, or with commas [default: all].
    #[arg(long, value_name = "NAME", value_delimiter = ',', value_parser = PossibleValuesParser::new(ENVELOPE_ROWS.map(|row| row.0)))]
    only: Vec<String>,
    #[command(flatten)]
    out: OutArgs,
    #[command(flatten)]
    config: ConfigArgs,
    #[command(flatten)]
    tell: TellArgs,
}

pub(super) fn run(args: &EnvelopeArgs) -> Result<(), Failure> {
    let config = args.config.load()?;
    let scans = read_scans(&args.log, config.log_options()).map_err(Failure::Start)?;
    let relations = read_relations(&args.relations).map_err(Failure::start)?;
    let mut folder = args.out.folder("envelope")?;
    let (mapping, robot_from_lrf) = (config.mapping(), config.robot_from_lrf());
    let mut runs: Vec<EnvelopeRun> = Vec::new();
    for row in ENVELOPE_ROWS {
        if !args.only.is_empty() && !args.only.iter().any(|name| name == row.0) {
            continue;
        }
        for seed in args.seed.map_or(1..=args.seeds, |seed| seed..=seed) {
            let run = run_envelope((&mapping, robot_from_lrf), row, seed, &scans, &relations);
            let run = run.map_err(|error| Failure::Work(error.context(format!("row {}, seed {seed}", row.0))))?;
            args.tell.say(&match &run {
                Some(run) => format!("{}, seed {seed}: {:.3} m", run.row, run.mean_m),
                None => format!("{}: left out, no relation has both its times among the scans left", row.0),
            });
            runs.extend(run);
        }
    }
    if runs.is_empty() {
        return Err(Failure::start(anyhow::anyhow!("no relation has its times among those of the scans")));
    }
    let table = envelope_markdown(&runs);
    let figure = plot_envelope(&runs).map_err(Failure::work)?;
    let files = [("envelope.csv", envelope_csv(&runs)), ("envelope.md", table.clone()), ("envelope.svg", figure)];
    folder
        .save(|stage| Ok(files.iter().try_for_each(|(name, text)| write_file(&stage.join(name), text.as_bytes()))?))
        .map_err(Failure::Work)?;
    args.tell.print(&runs, || with_folder(&table, folder.named()))
}
