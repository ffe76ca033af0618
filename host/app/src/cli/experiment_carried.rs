//! `lrfslam experiment carried`: a robot that is picked up and set down elsewhere, drive after drive.

use std::path::{Path, PathBuf};

use clap::Args;
use clap::builder::PossibleValuesParser;

use super::Failure;
use super::out::OutArgs;
use super::shared::{ConfigArgs, LOG, SEEDS, TRUTH, TellArgs, with_folder};
use lrfslam_host::output::{ResultFolder, write_file};
use lrfslam_host::runs::scans::read_scans;
use lrfslam_host::trajectory::read_trajectory;
use lrfslam_lab::experiment::{
    CarriedConfig, CarriedDrive, CarriedRun, Degradation, ENVELOPE_ROWS, carried_csv, carried_markdown, on_true_path,
    run_carried,
};

/// Is a robot that is carried off noticed? Each seed cuts a drive out of a log: along one stretch, set down elsewhere, and back along the first one.
///
/// The true path has a pose under the time of every scan; that of `lrfslam map` with the whole log will do. Writes carried.csv, a line for each
/// stretch of each drive, and carried.md, after each drive.
#[derive(Debug, Args)]
pub(super) struct CarriedArgs {
    #[arg(help = LOG)]
    log: PathBuf,
    #[arg(long, value_name = "FILE", help = TRUTH)]
    truth: PathBuf,
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = clap::value_parser!(u64).range(1..1000), help = SEEDS)]
    seeds: u64,
    /// Start of the random numbers: the same seed and input give the same results.
    #[arg(long, value_name = "N", conflicts_with = "seeds")]
    seed: Option<u64>,
    /// Way before the robot is carried off, m.
    #[arg(long, value_name = "METRES", default_value_t = 40, value_parser = clap::value_parser!(u16).range(1..=10_000))]
    before: u16,
    /// Way elsewhere, and as much back where it began, m.
    #[arg(long, value_name = "METRES", default_value_t = 20, value_parser = clap::value_parser!(u16).range(1..=10_000))]
    after: u16,
    /// Farther from the truth is wrong, m.
    #[arg(long, value_name = "METRES", default_value_t = 0.5)]
    wrong: f64,
    /// Makes the log harder first, as this row of `experiment envelope` does.
    #[arg(long, value_name = "ROW", value_parser = PossibleValuesParser::new(ENVELOPE_ROWS.map(|row| row.0)))]
    harder: Option<String>,
    #[command(flatten)]
    out: OutArgs,
    #[command(flatten)]
    config: ConfigArgs,
    #[command(flatten)]
    tell: TellArgs,
}

pub(super) fn run(args: &CarriedArgs) -> Result<(), Failure> {
    let config = args.config.load()?;
    let scans = read_scans(&args.log, config.log_options()).map_err(Failure::Start)?;
    let (scans, truth) = on_true_path(scans, &read_trajectory(&args.truth).map_err(Failure::start)?);
    let harder = ENVELOPE_ROWS.iter().find(|row| args.harder.as_deref() == Some(row.0));
    let carried = CarriedConfig {
        before_m: args.before.into(),
        after_m: args.after.into(),
        wrong_m: args.wrong,
        harder: harder.map_or(Degradation::None, |row| row.1),
    };
    let mut folder = args.out.folder("carried")?;
    let (mapping, robot_from_lrf) = (config.mapping(), config.robot_from_lrf());
    let mut runs: Vec<CarriedRun> = Vec::new();
    for seed in args.seed.map_or(1..=args.seeds, |seed| seed..=seed) {
        let drive = CarriedDrive::cut(&carried, seed, &scans, &truth).map_err(Failure::Start)?;
        let run = run_carried((&mapping, robot_from_lrf), &carried, seed, &drive);
        runs.push(run.map_err(|error| Failure::Work(error.context(format!("seed {seed}"))))?);
        // After each: runs of an hour are not lost if one fails, or with Ctrl-C.
        save(&mut folder, &runs)?;
        args.tell.say(&format!("drive {} of {}", runs.len(), args.seed.map_or(args.seeds, |_| 1)));
    }
    args.tell.print(&runs, || with_folder(&carried_markdown(&runs), folder.named()))
}

fn save(folder: &mut ResultFolder, runs: &[CarriedRun]) -> Result<(), Failure> {
    let files = [("carried.csv", carried_csv(runs)), ("carried.md", carried_markdown(runs))];
    let save =
        |stage: &Path| Ok(files.iter().try_for_each(|(name, text)| write_file(&stage.join(name), text.as_bytes()))?);
    folder.save(save).map_err(Failure::Work)
}
