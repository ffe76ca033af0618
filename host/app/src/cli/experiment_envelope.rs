//! `lrfslam experiment envelope`: a log made harder in many ways, and what becomes of its map.

use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use clap::Args;
use clap::builder::PossibleValuesParser;

use super::Failure;
use super::out::{OutArgs, save_texts};
use super::shared::{ConfigArgs, LOG, RELATIONS, SeedsArgs, TellArgs, with_folder};
use lrfslam_host::output::ResultFolder;
use lrfslam_host::results::report::Ending;
use lrfslam_host::runs::map::{About, MapRun};
use lrfslam_host::runs::scans::Scans;
use lrfslam_host::scans::log::LogScan;
use lrfslam_lab::evaluation::read_relations;
use lrfslam_lab::experiment::{
    Degradation, ENVELOPE_ROWS, EnvelopeRow, EnvelopeRun, envelope_csv, envelope_markdown, plot_envelope, run_envelope,
};

/// Where are the limits? Makes a log harder in many ways, maps each by its laser alone, and judges the paths by relations.
///
/// More people, a shorter, narrower or sparser laser, fewer scans, noise. A relation counts if both its times are among those of the scans left.
/// Writes envelope.csv, a line for each run, with what the run itself says of its map, envelope.md and envelope.svg, after each run.
#[derive(Debug, Args)]
pub(super) struct EnvelopeArgs {
    #[arg(help = LOG)]
    log: PathBuf,
    #[arg(long, value_name = "FILE", help = RELATIONS)]
    relations: PathBuf,
    #[command(flatten)]
    seeds: SeedsArgs,
    /// These rows alone; may be given more than once, or with commas [default: all].
    #[arg(long, value_name = "NAME", value_delimiter = ',', value_parser = PossibleValuesParser::new(ENVELOPE_ROWS.map(|row| row.0)))]
    only: Vec<String>,
    /// Keep the results of each run, as `lrfslam map` writes them, in DIR/ROW-SEED: where did it go wrong?
    #[arg(long, value_name = "DIR")]
    keep: Option<PathBuf>,
    #[command(flatten)]
    out: OutArgs,
    #[command(flatten)]
    config: ConfigArgs,
    #[command(flatten)]
    tell: TellArgs,
}

/// A log that is made harder first.
#[derive(Debug, Args)]
pub(super) struct HarderArgs {
    /// Makes the log harder first, as this row of `experiment envelope` does.
    #[arg(long, value_name = "ROW", value_parser = PossibleValuesParser::new(ENVELOPE_ROWS.map(|row| row.0)))]
    harder: Option<String>,
}

impl HarderArgs {
    /// What is made of the log.
    pub(super) fn degradation(&self) -> Degradation {
        let row = ENVELOPE_ROWS.iter().find(|row| self.harder.as_deref() == Some(row.0));
        row.map_or(Degradation::None, |row| row.1)
    }
}

impl EnvelopeArgs {
    /// The runs, row by row.
    fn wanted(&self) -> impl Iterator<Item = (EnvelopeRow, u64)> {
        let rows =
            ENVELOPE_ROWS.into_iter().filter(|row| self.only.is_empty() || self.only.iter().any(|name| name == row.0));
        let seeds = self.seeds.each();
        rows.flat_map(move |row| seeds.clone().map(move |seed| (row, seed)))
    }

    /// Where the results of a run are kept, if they are.
    fn kept(&self, row: &str, seed: u64) -> Result<Option<ResultFolder>, Failure> {
        let place = self.keep.as_ref().map(|keep| keep.join(format!("{row}-{seed}")));
        let folder = place.map(|place| ResultFolder::claim(&place, self.out.overwrites()));
        folder.transpose().map_err(Failure::Start)
    }
}

pub(super) fn run(args: &EnvelopeArgs) -> Result<(), Failure> {
    let config = args.config.load()?;
    static NEVER: AtomicBool = AtomicBool::new(false);
    let mut log = Scans::open(&args.log, config.log_options(), &NEVER, Box::new(|_| {})).map_err(Failure::Start)?;
    let scans: Vec<LogScan> = log.by_ref().collect::<anyhow::Result<_>>().map_err(Failure::Start)?;
    let about = About { config, source: log.source(true), odometry: false, ending: Ending::Complete, fault: None };
    let relations = read_relations(&args.relations).map_err(Failure::start)?;
    let mut folder = args.out.folder("envelope")?;
    let (mapping, robot_from_lrf) = (config.mapping(), config.robot_from_lrf());
    // All of them before the first run: whoever waits for an hour is not to be told then that a folder is in use.
    let wanted = args.wanted().map(|(row, seed)| Ok((row, seed, args.kept(row.0, seed)?)));
    let wanted = wanted.collect::<Result<Vec<_>, Failure>>()?;
    let mut runs: Vec<EnvelopeRun> = Vec::new();
    for (row, seed, kept) in wanted {
        let results = |map: &mut MapRun<'_>| match kept {
            Some(mut folder) => Ok(folder.save(|stage| map.write_into(stage, &about))?.quality),
            None => Ok(map.quality()),
        };
        let run = run_envelope((&mapping, robot_from_lrf), row, seed, &scans, &relations, results);
        let run = run.map_err(|error| Failure::Work(error.context(format!("row {}, seed {seed}", row.0))))?;
        let said = match &run {
            Some(run) => format!("{}, seed {seed}: {:.3} m; {}", run.row, run.mean_m, run.trust),
            None => format!("{}: left out, no relation has both its times among the scans left", row.0),
        };
        runs.extend(run);
        // After each: runs of an hour are not lost if one fails, or with Ctrl-C.
        if !runs.is_empty() {
            save(&mut folder, &runs)?;
        }
        args.tell.say(&said);
    }
    if runs.is_empty() {
        return Err(Failure::start(anyhow::anyhow!("no relation has its times among those of the scans")));
    }
    args.tell.print(&runs, || with_folder(&envelope_markdown(&runs), folder.named()))
}

fn save(folder: &mut ResultFolder, runs: &[EnvelopeRun]) -> Result<(), Failure> {
    let figure = plot_envelope(runs).map_err(Failure::work)?;
    let files =
        [("envelope.csv", envelope_csv(runs)), ("envelope.md", envelope_markdown(runs)), ("envelope.svg", figure)];
    save_texts(folder, &files)
}
