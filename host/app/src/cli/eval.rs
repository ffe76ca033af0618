//! `lrfslam eval`: how far a trajectory is from the truth.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use clap::Args;
use lrfslam_core::time::Duration;

use super::shared::{JsonArgs, RELATIONS, TRUTH, within};
use super::{Failure, print};
use lrfslam_host::runs::scans::read_scans;
use lrfslam_host::scans::log::LogOptions;
use lrfslam_host::trajectory::{TimedPose, read_trajectory, with_poses};
use lrfslam_lab::evaluation::{
    OwnNoise, RelationReport, Standing, Statistics, StretchReport, TruthReport, Turn, evaluate_in_frame,
    evaluate_relations, evaluate_stretches, evaluate_truth, read_relations,
};

/// Judge a trajectory by relations between poses or by the true path.
///
/// TRAJECTORY is a TUM file (`t x y z qx qy qz qw`), as `lrfslam map` writes it. All files may be gzip.
#[derive(Debug, Args)]
pub(super) struct EvalArgs {
    /// The trajectory to judge.
    trajectory: PathBuf,
    #[command(flatten)]
    reference: Reference,
    /// How far in time a pose may be from the reference's time, s.
    #[arg(long, value_name = "SECONDS", default_value_t = 0.05, value_parser = seconds)]
    tolerance: f64,
    /// Length of the stretches over which the relative error is taken, m (with --truth).
    #[arg(long, value_name = "METRES", default_value_t = 10.0, value_parser = metres)]
    stretch: f64,
    /// Both paths are in one frame: they are not aligned (with --truth).
    #[arg(long)]
    same_frame: bool,
    #[command(flatten)]
    json: JsonArgs,
}

#[derive(Debug, Args)]
#[group(required = true, multiple = false)]
struct Reference {
    #[arg(long, value_name = "FILE", help = RELATIONS)]
    relations: Option<PathBuf>,
    #[arg(long, value_name = "FILE", help = TRUTH)]
    truth: Option<PathBuf>,
    /// The log the trajectory was made from: its odometry shows where the robot stood and where it turned fastest.
    #[arg(long, value_name = "LOG")]
    stretches: Option<PathBuf>,
}

fn seconds(text: &str) -> Result<f64, String> {
    within(text, 0.0, 3600.0)
}

fn metres(text: &str) -> Result<f64, String> {
    within(text, 0.001, 1e6)
}

pub(super) fn run(args: &EvalArgs) -> Result<(), Failure> {
    let poses = read_trajectory(&args.trajectory).map_err(Failure::start)?;
    let tolerance = Duration::from_micros((args.tolerance * 1e6).round() as i64);
    let Reference { relations, truth, stretches } = &args.reference;
    let text = match (relations, truth, stretches) {
        (Some(file), _, _) => by_relations(args, &poses, file, tolerance)?,
        (_, Some(file), _) => by_truth(args, &poses, file, tolerance)?,
        (_, _, Some(log)) => by_stretches(args, &poses, log)?,
        (None, None, None) => return Err(Failure::start(anyhow::anyhow!("the reference is missing"))),
    };
    print(&text)
}

fn by_relations(args: &EvalArgs, poses: &[TimedPose], file: &Path, tolerance: Duration) -> Result<String, Failure> {
    let relations = read_relations(file).map_err(Failure::start)?;
    let report = evaluate_relations(poses, &relations, tolerance).map_err(Failure::start)?;
    args.json.choose(&report, || relation_table(&report))
}

fn by_truth(args: &EvalArgs, poses: &[TimedPose], file: &Path, tolerance: Duration) -> Result<String, Failure> {
    let truth = read_trajectory(file).map_err(Failure::start)?;
    let evaluate = if args.same_frame { evaluate_in_frame } else { evaluate_truth };
    let report = evaluate(poses, &truth, tolerance, args.stretch).map_err(Failure::start)?;
    args.json.choose(&report, || truth_table(&report))
}

fn by_stretches(args: &EvalArgs, poses: &[TimedPose], log: &Path) -> Result<String, Failure> {
    let scans = read_scans(log, LogOptions::default()).map_err(Failure::Start)?;
    let (scans, poses) = with_poses(scans, poses);
    let report = evaluate_stretches(&poses, &scans).map_err(Failure::start)?;
    args.json.choose(&report, || stretch_table(&report))
}

fn stretch_table(report: &StretchReport) -> String {
    let mut text = head("step against odometry");
    row(&mut text, "translation, m", &report.step_departure_m);
    row(&mut text, "rotation, deg", &report.step_departure_deg);
    let _ = writeln!(text, "\nstanding: from, s   for, s   drift, m  drift, deg   spread, m");
    for s in &report.standing {
        let Standing { from_s, duration_s, drift_m, drift_deg, spread_m } = s;
        let _ = writeln!(text, "{from_s:>18.1}{duration_s:>9.1}{drift_m:>11.4}{drift_deg:>12.3}{spread_m:>12.4}");
    }
    let _ = writeln!(text, "\nturning:  from, s   turned, deg   error, deg   worst jump, m");
    for Turn { from_s, turned_deg, error_deg, jump_m } in &report.turns {
        let _ = writeln!(text, "{from_s:>18.1}{turned_deg:>14.1}{error_deg:>13.2}{jump_m:>16.4}");
    }
    text
}

fn relation_table(report: &RelationReport) -> String {
    let mut text = head("relation error");
    row(&mut text, "translation, m", &report.translation_m);
    row(&mut text, "rotation, deg", &report.rotation_deg);
    let judged = report.translation_m.count;
    let _ = writeln!(text, "\n{judged} of {} relations judged", report.relations);
    if report.unmatched > 0 {
        let _ = writeln!(text, "{} without a pose within {} s of both times", report.unmatched, report.tolerance_s);
    }
    if report.inexact_times > 0 {
        let _ = writeln!(text, "{} by a pose that is only near in time", report.inexact_times);
    }
    let _ = writeln!(text, "{:.2} % above 0.10 m", 100.0 * report.share_above_10_cm);
    let (from, to) = report.worst_at_s;
    let _ = writeln!(text, "worst: {from:.6} to {to:.6} s");
    if let Some(OwnNoise { triangles, translation_m, rotation_deg }) = &report.own_noise {
        let _ = writeln!(
            text,
            "the relations themselves err by {translation_m:.4} m and {rotation_deg:.2}°, as {triangles} triangles of them tell"
        );
    }
    text
}

fn truth_table(report: &TruthReport) -> String {
    let mut text = head("error");
    row(&mut text, "absolute, m", &report.absolute_m);
    row(&mut text, "absolute, deg", &report.absolute_deg);
    row(&mut text, "relative, m per m", &report.relative.translation_m_per_m);
    row(&mut text, "relative, deg per m", &report.relative.rotation_deg_per_m);
    if report.revisit_m.count > 0 {
        row(&mut text, "places revisited, m", &report.revisit_m);
    }
    let judged = report.absolute_m.count;
    let how = if report.aligned { "after rigid alignment" } else { "in the same frame" };
    let _ = writeln!(text, "\nabsolute: {judged} of {} true poses, {how}", report.truth_poses);
    let _ = writeln!(text, "{:.2} % within 0.10 m", 100.0 * report.share_within_10_cm);
    if report.unmatched > 0 {
        let _ = writeln!(text, "{} without a pose within {} s", report.unmatched, report.tolerance_s);
    }
    let stretches = report.relative.translation_m_per_m.count;
    let _ = writeln!(text, "relative: {stretches} stretches of {} m of the true path", report.relative.stretch_m);
    text
}

fn head(name: &str) -> String {
    let columns = ["mean", "std", "rmse", "median", "max"].map(|c| format!("{c:>10}"));
    format!("{name:<22}{}\n", columns.concat())
}

fn row(text: &mut String, name: &str, of: &Statistics) {
    let values = [of.mean, of.std, of.rmse, of.median, of.max].map(|v| format!("{v:>10.4}"));
    let _ = writeln!(text, "{name:<22}{}", values.concat());
}
