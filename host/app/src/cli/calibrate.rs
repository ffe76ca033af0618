//! `lrfslam calibrate`: the noise of the motion model, from a log with known poses.

use std::fmt::Write as _;
use std::path::PathBuf;

use clap::Args;
use lrfslam_core::geometry::Pose2;
use lrfslam_core::motion::ScanMatchingMotionConfig;
use lrfslam_core::time::Duration;
use serde::Serialize;

use super::shared::{ConfigArgs, JsonArgs, LOG, RELATIONS, SeedArgs, TRUTH};
use super::{Failure, print};
use crate::config::RunConfig;
use lrfslam_host::mapping::mapper::Mapper;
use lrfslam_host::output::save_file;
use lrfslam_host::runs::scans::read_scans;
use lrfslam_host::scans::log::LogScan;
use lrfslam_host::trajectory::{TimedPose, read_trajectory};
use lrfslam_lab::calibration::{Growth, MotionFit};
use lrfslam_lab::evaluation::{Relation, displacement_errors, read_relations, relations_of_path};

/// Fit the particles' motion noise to the errors of scan matching on a log with known poses.
///
/// Maps LOG by matching alone, compares displacements with the true ones, and tells the error that is in every pose from the drift that adds up. Prints
/// a [motion] section for --config.
#[derive(Debug, Args)]
pub(super) struct CalibrateArgs {
    #[arg(help = LOG)]
    log: PathBuf,
    #[command(flatten)]
    known: Known,
    #[command(flatten)]
    config: ConfigArgs,
    #[command(flatten)]
    seed: SeedArgs,
    /// Write the section to this file instead of printing it.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    #[command(flatten)]
    json: JsonArgs,
}

#[derive(Debug, Args)]
#[group(required = true, multiple = false)]
struct Known {
    #[arg(long, value_name = "FILE", help = RELATIONS)]
    relations: Option<PathBuf>,
    #[arg(long, value_name = "FILE", help = TRUTH)]
    truth: Option<PathBuf>,
}

pub(super) fn run(args: &CalibrateArgs) -> Result<(), Failure> {
    let mut config = args.config.load()?;
    config.hierarchy.levels = 0;
    let known = known_displacements(&args.known)?;
    let matched = {
        let scans = read_scans(&args.log, config.log_options()).map_err(Failure::Start)?;
        match_scans(&scans, args.seed.seed, &config).map_err(Failure::Work)?
    };
    let tolerance = Duration::from_millis(50);
    let errors = displacement_errors(&matched.path, &matched.steps, &known, tolerance);
    let steps = matched.steps.last().copied().unwrap_or_default();
    let scans_per_step = matched.path.len() as f64 / f64::from(steps.max(1));
    let fit = MotionFit::new(&errors, &matched.predictions, scans_per_step).ok_or_else(|| {
        let found = errors.len();
        Failure::Work(anyhow::anyhow!(
            "{found} of {} known displacements lie within the log: too few to fit",
            known.len()
        ))
    })?;
    let log = args.log.display().to_string();
    let text = section(&fit, &log, errors.len());
    let report = || Fitted::new(&fit, log, errors.len());
    match &args.out {
        None => print(&args.json.choose(&report(), || text)?),
        Some(file) => {
            save_file(file, text.as_bytes()).map_err(Failure::Work)?;
            print(&args.json.choose(&report(), String::new)?)
        }
    }
}

/// The fit, as JSON.
#[derive(Debug, Serialize)]
struct Fitted {
    log: String,
    displacements: usize,
    forward_m: Growth,
    lateral_m: Growth,
    heading_deg: Growth,
    motion: ScanMatchingMotionConfig,
}

impl Fitted {
    fn new(fit: &MotionFit, log: String, displacements: usize) -> Self {
        let MotionFit { forward_m, lateral_m, heading_deg, .. } = *fit;
        Self { log, displacements, forward_m, lateral_m, heading_deg, motion: fit.config() }
    }
}

fn known_displacements(known: &Known) -> Result<Vec<Relation>, Failure> {
    match (&known.relations, &known.truth) {
        (Some(file), _) => read_relations(file).map_err(Failure::start),
        (None, Some(file)) => Ok(relations_of_path(&read_trajectory(file).map_err(Failure::start)?)),
        (None, None) => Err(Failure::start(anyhow::anyhow!("--relations or --truth is missing"))),
    }
}

/// What matching alone made of a log.
struct Matched {
    path: Vec<TimedPose>,
    /// Steps that the filter would have taken up to each scan.
    steps: Vec<u32>,
    /// Matched pose seen from the predicted one, where every axis was determined.
    predictions: Vec<Pose2>,
}

fn match_scans(scans: &[LogScan], seed: u64, config: &RunConfig) -> anyhow::Result<Matched> {
    let mut memory = config.mapping().mapper_memory(1);
    let mut mapper = Mapper::new(&config.slam(), seed, &mut memory)?;
    let mut matched = Matched { path: Vec::new(), steps: Vec::new(), predictions: Vec::new() };
    let (mut steps, mut map_from_step) = (0, Pose2::IDENTITY);
    for scan in scans {
        let robot_from_lrf = scan.robot_from_lrf.unwrap_or_else(|| config.robot_from_lrf());
        let (step, _) = mapper.add_scan(&scan.scan(), robot_from_lrf, None)?;
        let found = &step.odometry;
        if config.steps.is_due(map_from_step.between(step.map_from_robot)) {
            (steps, map_from_step) = (steps + 1, step.map_from_robot);
        }
        if !found.is_lost && found.matched.undetermined.is_none() && !matched.path.is_empty() {
            matched.predictions.push(found.predicted.between(step.map_from_robot));
        }
        matched.path.push(TimedPose { stamp: scan.stamp, map_from_robot: step.map_from_robot });
        matched.steps.push(steps);
    }
    Ok(matched)
}

fn section(fit: &MotionFit, log: &str, count: usize) -> String {
    let motion = fit.config();
    let mut text = String::new();
    // Writing to a string cannot fail.
    let _ = writeln!(text, "# Fitted to {count} displacements of {log}: variance a + b n over n steps of the filter.");
    let mut line = |name: &str, unit: &str, growth: Growth| {
        let Growth { constant, per_step } = growth;
        let _ = writeln!(text, "# {name}: {constant:.4} {unit} in every pose, {per_step:.6} {unit} more a step");
    };
    line("forward", "m", fit.forward_m);
    line("lateral", "m", fit.lateral_m);
    line("heading", "degrees", fit.heading_deg);
    let _ = writeln!(text, "[motion]\nforward_m = {:.6}\nlateral_m = {:.6}", motion.forward_m, motion.lateral_m);
    let _ = writeln!(text, "heading_deg = {:.6}\nundetermined_m = {:.4}", motion.heading_deg, motion.undetermined_m);
    text
}
