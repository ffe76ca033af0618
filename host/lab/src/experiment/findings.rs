//! What the thesis found, and whether these figures say the same.

use std::fmt::Write as _;

use super::motion_model::{AxisModel, MotionModel};
use super::sweep::{CaseSummary, Method, SweepReport};

/// The thesis's experiments on scan pairs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Experiment {
    /// Figures 5.1 and 5.2.
    Population,
    /// Figures 5.3 and 5.4.
    Generations,
    /// Figures 5.5 and 5.6.
    LrfNoise,
    /// Section 5.1.2 and table 4.7.
    MotionModel,
}

/// A claim of the thesis, and whether it holds, with the numbers.
struct Finding {
    claim: &'static str,
    holds: bool,
    numbers: String,
}

/// Tables and findings as Markdown.
pub fn markdown(experiment: Experiment, report: &SweepReport, model: Option<&MotionModel>) -> String {
    let mut text = String::new();
    let seeds: Vec<String> = report.config.seeds.iter().map(u64::to_string).collect();
    let _ = writeln!(
        text,
        "{} pairs of scans, {} apart ({} left out for lack of overlap; {} leave an axis undetermined); seeds {}.\n",
        report.pairs,
        report.config.gap,
        report.without_overlap,
        report.undetermined,
        seeds.join(", ")
    );
    text.push_str(
        "| | method | found, % | peaks, % (by seed) | Δy forward: median, RMS, max, cm | Δx lateral | Δθ: median, RMS, max, deg |\n\
         | --- | --- | --- | --- | --- | --- | --- |\n",
    );
    report.summaries.iter().for_each(|summary| write_row(&mut text, summary));
    text.push_str("\nFound: within 5 cm and 1°. Peaks: off by more than 20 cm or 5°, of the pairs whose scene determines every axis.\n");
    let findings = match experiment {
        Experiment::Population => population(report),
        Experiment::Generations => generations(report),
        Experiment::LrfNoise => noise(report),
        Experiment::MotionModel => Vec::new(),
    };
    if !findings.is_empty() {
        text.push_str("\n| the thesis says | here | numbers (its method) |\n| --- | --- | --- |\n");
    }
    for Finding { claim, holds, numbers } in findings {
        let verdict = if holds { "the same" } else { "not so" };
        let _ = writeln!(text, "| {claim} | {verdict} | {numbers} |");
    }
    if let Some(model) = model {
        write_model(&mut text, model);
    }
    text
}

fn write_row(text: &mut String, summary: &CaseSummary) {
    let method = format!("{:?}", summary.method).to_lowercase();
    let by_seed: Vec<String> = summary.peaks_by_seed.iter().map(|share| format!("{:.1}", 100.0 * share)).collect();
    let (forward, lateral, heading) = (&summary.forward_m, &summary.lateral_m, &summary.heading_deg);
    let _ = writeln!(
        text,
        "| {} | {method} | {:.1} | {:.1} ({}) | {:.2}, {:.2}, {:.0} | {:.2}, {:.2}, {:.0} | {:.3}, {:.3}, {:.1} |",
        summary.label,
        100.0 * summary.found,
        100.0 * summary.peaks,
        by_seed.join(", "),
        100.0 * forward.median,
        100.0 * forward.rmse,
        100.0 * forward.max,
        100.0 * lateral.median,
        100.0 * lateral.rmse,
        100.0 * lateral.max,
        heading.median,
        heading.rmse,
        heading.max
    );
}

/// The thesis's own method, case by case.
fn theirs(report: &SweepReport) -> Vec<&CaseSummary> {
    report.summaries.iter().filter(|summary| summary.method == Method::Thesis).collect()
}

fn listed(of: &[&CaseSummary], value: impl Fn(&CaseSummary) -> String) -> String {
    of.iter().map(|summary| format!("{}: {}", summary.label, value(summary))).collect::<Vec<_>>().join("; ")
}

fn percent(share: f64) -> String {
    format!("{:.1} %", 100.0 * share)
}

fn population(report: &SweepReport) -> Vec<Finding> {
    let of = theirs(report);
    let (Some(first), Some(last)) = (of.first(), of.last()) else { return Vec::new() };
    vec![
        Finding {
            claim: "small populations (20, 40) do not converge: huge errors",
            holds: first.peaks > 0.05,
            numbers: listed(&of, |summary| percent(summary.peaks)),
        },
        Finding {
            claim: "at 100 the peaks are significantly fewer and smaller",
            holds: last.peaks < 0.2 * first.peaks && last.forward_m.rmse < 0.5 * first.forward_m.rmse,
            numbers: listed(&of, |summary| format!("RMS {:.1} cm", 100.0 * summary.forward_m.rmse)),
        },
    ]
}

fn generations(report: &SweepReport) -> Vec<Finding> {
    let of = theirs(report);
    let (Some(first), Some(last)) = (of.first(), of.last()) else { return Vec::new() };
    let falling = of.windows(2).all(|pair| pair[1].forward_m.median < pair[0].forward_m.median);
    vec![
        Finding {
            claim: "more generations make the estimate more precise",
            holds: falling,
            numbers: listed(&of, |summary| format!("median {:.2} cm", 100.0 * summary.forward_m.median)),
        },
        Finding {
            claim: "with 15 and 30 convergence is assured already",
            holds: first.peaks <= 1.5 * last.peaks + 0.01,
            numbers: listed(&of, |summary| percent(summary.peaks)),
        },
    ]
}

fn noise(report: &SweepReport) -> Vec<Finding> {
    let of = theirs(report);
    let (Some(first), Some(last)) = (of.first(), of.last()) else { return Vec::new() };
    let growing = of.windows(2).all(|pair| pair[1].forward_m.median > pair[0].forward_m.median);
    vec![
        Finding {
            claim: "the greater the laser's error, the worse the estimate",
            holds: growing,
            numbers: listed(&of, |summary| format!("median {:.2} cm", 100.0 * summary.forward_m.median)),
        },
        Finding {
            claim: "the search stays robust",
            holds: last.peaks <= first.peaks + 0.05,
            numbers: listed(&of, |summary| percent(summary.peaks)),
        },
    ]
}

fn write_model(text: &mut String, model: &MotionModel) {
    let _ = write!(
        text,
        "\nMotion model (table 4.7), our method, {:.1} % of the matches found. Standard deviation, robust and plain; share beyond three of them (a Gaussian: \
         0.27 %); robust one of the half with less and with more motion (median travel {:.3} m, turn {:.2}°).\n\n\
         | | robust | plain | mean | beyond 3 | less, more motion |\n| --- | --- | --- | --- | --- | --- |\n",
        100.0 * model.found,
        model.travel_m,
        model.turn_deg
    );
    write_axis(text, "forward (Δy), cm", 100.0, &model.forward_m);
    write_axis(text, "lateral (Δx), cm", 100.0, &model.lateral_m);
    write_axis(text, "heading (Δθ), deg", 1.0, &model.heading_deg);
}

fn write_axis(text: &mut String, name: &str, scale: f64, axis: &AxisModel) {
    let of = &axis.all;
    let _ = writeln!(
        text,
        "| {name} | {:.3} | {:.3} | {:.3} | {:.1} % | {:.3}, {:.3} |",
        scale * of.robust_std,
        scale * of.std,
        scale * of.mean,
        100.0 * of.beyond_three,
        scale * axis.less_motion.robust_std,
        scale * axis.more_motion.robust_std
    );
}
