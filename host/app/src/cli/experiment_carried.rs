//! `lrfslam experiment carried`: a robot that is picked up and set down elsewhere, drive after drive.

use std::path::PathBuf;

use clap::Args;

use super::Failure;
use super::experiment_envelope::HarderArgs;
use super::out::{OutArgs, save_texts};
use super::shared::{ConfigArgs, LOG, SeedsArgs, TRUTH, TellArgs, tolerance, with_folder};
use lrfslam_host::runs::scans::read_scans;
use lrfslam_host::trajectory::read_trajectory;
use lrfslam_lab::experiment::{
    CarriedConfig, CarriedDrive, CarriedRun, carried_csv, carried_markdown, on_true_path, run_carried,
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
    #[command(flatten)]
    seeds: SeedsArgs,
    /// Way before the robot is carried off, m.
    #[arg(long, value_name = "METRES", default_value_t = 40, value_parser = clap::value_parser!(u16).range(1..=10_000))]
    before: u16,
    /// Way elsewhere, and as much back where it began, m.
    #[arg(long, value_name = "METRES", default_value_t = 20, value_parser = clap::value_parser!(u16).range(1..=10_000))]
    after: u16,
    /// Farther from the truth is wrong, m.
    #[arg(long, value_name = "METRES", default_value_t = 0.5, value_parser = tolerance)]
    wrong: f64,
    #[command(flatten)]
    harder: HarderArgs,
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
    let carried = CarriedConfig {
        before_m: args.before.into(),
        after_m: args.after.into(),
        wrong_m: args.wrong,
        harder: args.harder.degradation(),
    };
    let mut folder = args.out.folder("carried")?;
    let (mapping, robot_from_lrf) = (config.mapping(), config.robot_from_lrf());
    let mut runs: Vec<CarriedRun> = Vec::new();
    let drives = args.seeds.each().count();
    for seed in args.seeds.each() {
        let drive = CarriedDrive::cut(&carried, seed, &scans, &truth).map_err(Failure::Start)?;
        let run = run_carried((&mapping, robot_from_lrf), &carried, seed, &drive);
        runs.push(run.map_err(|error| Failure::Work(error.context(format!("seed {seed}"))))?);
        // After each: runs of an hour are not lost if one fails, or with Ctrl-C.
        let files = [("carried.csv", carried_csv(&runs)), ("carried.md", carried_markdown(&runs))];
        save_texts(&mut folder, &files)?;
        args.tell.say(&format!("drive {} of {drives}", runs.len()));
    }
    args.tell.print(&runs, || with_folder(&carried_markdown(&runs), folder.named()))
}
