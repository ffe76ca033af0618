//! Where mapping ends: a log made harder in many ways, mapped, and judged by relations. **Error over degradation.**
//!
//! A degraded log with fewer scans has fewer times. A relation counts for a row if both its times are kept, to the microsecond; of every
//! eighth scan those are kept that leave most relations.

mod degrade;
mod figure;
mod told;

use std::collections::HashMap;
use std::fmt::Write as _;

use lrfslam_core::geometry::Pose2;
use lrfslam_core::time::{Duration, Instant};
use serde::Serialize;

use crate::evaluation::{Relation, evaluate_relations};
use lrfslam_host::mapping::MappingConfig;
use lrfslam_host::results::quality::Quality;
use lrfslam_host::runs::map::{MapRun, RunMemory};
use lrfslam_host::scans::log::LogScan;

pub use degrade::{Degradation, ENVELOPE_ROWS, EnvelopeRow, degrade};
pub use figure::plot_envelope;
pub use told::Told;

/// One mapping of the log made harder.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct EnvelopeRun {
    /// Name of the row.
    pub row: &'static str,
    /// Of the random numbers, those of the degradation too.
    pub seed: u64,
    /// Scans that were left.
    pub scans: usize,
    /// Relations judged.
    pub relations: usize,
    /// Mean of the translation errors, m.
    pub mean_m: f64,
    /// Their standard deviation, m.
    pub std_m: f64,
    /// The largest, m.
    pub max_m: f64,
    /// Mean of the rotation errors, degrees.
    pub mean_deg: f64,
    /// Share of them above 0.10 m, 0 to 1.
    pub share_above_10_cm: f64,
    /// Scans that agreed too little with the map to be believed.
    pub lost_scans: u64,
    /// Share of the walls seen again that another visit saw through, 0 to 1: [`Quality::contradicted_share`].
    pub contradicted_share: f64,
    /// What is off, and what of it the run told.
    #[serde(flatten)]
    pub told: Told,
    /// How far to trust the map, as the run itself says: [`Quality::trust`].
    pub trust: String,
}

/// Maps `scans`, made harder as `row` says, and judges the path.
///
/// * `config` — of mapping, and where the laser sits if the log does not say
/// * `results` — of the whole run: keeps what is wanted, and returns what the run noticed of itself
///
/// Returns `None` if no relation has both its times among those of the scans left.
///
/// # Errors
/// If a scan is too large, and that of `results`.
pub fn run_envelope(
    (config, robot_from_lrf): (&MappingConfig, Pose2),
    (row, degradation): EnvelopeRow,
    seed: u64,
    scans: &[LogScan],
    relations: &[Relation],
    results: impl FnOnce(&mut MapRun<'_>) -> anyhow::Result<Quality>,
) -> anyhow::Result<Option<EnvelopeRun>> {
    let (kept, first) = best_first(scans, degradation.every(), relations);
    if kept == 0 {
        return Ok(None);
    }
    let scans = degrade(scans, degradation, seed, first);
    let mut memory = RunMemory::new(config, 1);
    let mut map = MapRun::new(config, seed, &mut memory)?;
    let mut lost_scans = 0;
    for scan in &scans {
        let step = map.add_scan(&scan.scan(), scan.robot_from_lrf.unwrap_or(robot_from_lrf), None)?;
        lost_scans += u64::from(step.odometry.is_lost);
    }
    map.finish();
    let path = map.trajectory();
    let report = evaluate_relations(&path, relations, Duration::ZERO)?;
    let quality = results(&mut map)?;
    Ok(Some(EnvelopeRun {
        row,
        seed,
        scans: scans.len(),
        relations: report.translation_m.count,
        mean_m: report.translation_m.mean,
        std_m: report.translation_m.std,
        max_m: report.translation_m.max,
        mean_deg: report.rotation_deg.mean,
        share_above_10_cm: report.share_above_10_cm,
        lost_scans,
        contradicted_share: quality.contradicted_share(),
        told: Told::of(&path, relations, &quality),
        trust: quality.trust,
    }))
}

/// How many relations are left of every n-th scan at most, and the scan to begin with.
fn best_first(scans: &[LogScan], every: usize, relations: &[Relation]) -> (usize, usize) {
    let numbers: HashMap<Instant, usize> =
        scans.iter().enumerate().map(|(number, scan)| (scan.stamp, number)).collect();
    let both = |relation: &Relation| numbers.get(&relation.start).copied().zip(numbers.get(&relation.end).copied());
    let mut kept = vec![0; every];
    for (start, _) in relations.iter().filter_map(both).filter(|(start, end)| start % every == end % every) {
        kept[start % every] += 1;
    }
    let best = (0..every).max_by_key(|first| (kept[*first], every - first));
    best.map_or((0, 0), |first| (kept[first], first))
}

/// A line for each run.
pub fn envelope_csv(runs: &[EnvelopeRun]) -> String {
    let mut text = String::from(
        "row,seed,scans,relations,mean_m,std_m,max_m,mean_deg,share_above_10_cm,lost_scans,contradicted_share,off,off_told,others_told_share,trust\n",
    );
    for run in runs {
        let EnvelopeRun { row, seed, scans, relations, mean_m, std_m, max_m, mean_deg, .. } = run;
        let EnvelopeRun { share_above_10_cm, lost_scans, contradicted_share, trust, .. } = run;
        let Told { off, off_told, others_told_share } = run.told;
        // Writing to a string cannot fail. The sentence has commas, and no quotation marks.
        let _ = writeln!(
            text,
            "{row},{seed},{scans},{relations},{mean_m:.5},{std_m:.5},{max_m:.3},{mean_deg:.4},{share_above_10_cm:.4},{lost_scans},{contradicted_share:.4},{off},{off_told},{others_told_share:.4},\"{trust}\""
        );
    }
    text
}

/// The runs of one row, in the order of the rows.
fn rows(runs: &[EnvelopeRun]) -> impl Iterator<Item = &[EnvelopeRun]> {
    runs.chunk_by(|a, b| a.row == b.row)
}

/// Mean, least and largest of a number over runs.
fn spread(runs: &[EnvelopeRun], number: impl Fn(&EnvelopeRun) -> f64) -> (f64, f64, f64) {
    let numbers = || runs.iter().map(&number);
    (numbers().sum::<f64>() / runs.len() as f64, numbers().fold(f64::MAX, f64::min), numbers().fold(f64::MIN, f64::max))
}

/// What came out, row by row, as a table in Markdown: the mean over the seeds; "drawn twice" is [`EnvelopeRun::contradicted_share`]; [`Told`] of all seeds together.
/// Below it, what each run says of its map.
pub fn envelope_markdown(runs: &[EnvelopeRun]) -> String {
    let mut text = String::from(
        "| row | scans | relations | error, m | least, largest | σ, m | worst, m | error, ° | above 10 cm, % | lost scans | drawn twice, % | off, told | others told, % |\n\
         | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |\n",
    );
    for of in rows(runs) {
        let EnvelopeRun { row, scans, relations, .. } = &of[0];
        let mean = |number: fn(&EnvelopeRun) -> f64| spread(of, number).0;
        let (error, least, largest) = spread(of, |run| run.mean_m);
        let worst = spread(of, |run| run.max_m).2;
        let (std_m, deg) = (mean(|run| run.std_m), mean(|run| run.mean_deg));
        let (above, lost) = (100.0 * mean(|run| run.share_above_10_cm), mean(|run| run.lost_scans as f64));
        let twice = 100.0 * mean(|run| run.contradicted_share);
        let sum = |number: fn(&Told) -> usize| of.iter().map(|run| number(&run.told)).sum::<usize>();
        let (off, off_told) = (sum(|told| told.off), sum(|told| told.off_told));
        let others = 100.0 * mean(|run| run.told.others_told_share);
        let _ = writeln!(
            text,
            "| {row} | {scans} | {relations} | {error:.3} | {least:.3}, {largest:.3} | {std_m:.3} | {worst:.2} | {deg:.2} | {above:.1} | {lost:.0} | {twice:.1} | {off}, {off_told} | {others:.0} |"
        );
    }
    text.push_str("\nWhat each run says of its map:\n\n");
    for EnvelopeRun { row, seed, trust, .. } in runs {
        let _ = writeln!(text, "- {row}, seed {seed}: {trust}");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(row: &'static str, seed: u64, mean_m: f64) -> EnvelopeRun {
        let (std_m, max_m, mean_deg, share_above_10_cm, lost_scans) = (0.01, 1.5 * mean_m, 0.5, 0.25, 3);
        EnvelopeRun {
            row,
            seed,
            scans: 10,
            relations: 7,
            mean_m,
            std_m,
            max_m,
            mean_deg,
            share_above_10_cm,
            lost_scans,
            contradicted_share: 0.125,
            told: Told { off: 4, off_told: 3, others_told_share: 0.25 },
            trust: "trust it but along 9 m, say".to_owned(),
        }
    }

    #[test]
    fn tables_have_a_line_for_each_run_and_each_row() {
        let runs = [run("as-is", 1, 0.02), run("as-is", 2, 0.04), run("scans-8", 1, 2.0), run("scans-8", 2, 4.0)];
        let csv = envelope_csv(&runs);
        assert_eq!(
            csv.lines().nth(2),
            Some(
                "as-is,2,10,7,0.04000,0.01000,0.060,0.5000,0.2500,3,0.1250,4,3,0.2500,\"trust it but along 9 m, say\""
            )
        );
        let table = envelope_markdown(&runs);
        assert_eq!(table.lines().take_while(|line| line.starts_with('|')).count(), 4);
        assert!(table.ends_with("\n- scans-8, seed 2: trust it but along 9 m, say\n"), "{table}");
        assert!(
            table.contains(
                "| as-is | 10 | 7 | 0.030 | 0.020, 0.040 | 0.010 | 0.06 | 0.50 | 25.0 | 3 | 12.5 | 8, 6 | 25 |"
            ),
            "{table}"
        );
        let svg = plot_envelope(&runs).unwrap();
        assert!(svg.starts_with("<svg") && svg.contains("scans-8"), "{svg}");
    }
}
