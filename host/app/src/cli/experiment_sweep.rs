//! `lrfslam experiment de-population | de-generations | lrf-noise | motion-model`: the thesis's sweeps over scan pairs.

use std::path::PathBuf;

use anyhow::Context as _;
use clap::Args;
use lrfslam_core::de::DeConfig;

use super::Failure;
use super::out::OutArgs;
use super::shared::{CELL, ConfigArgs, LOG, SEEDS, TRUTH, TellArgs, with_folder};
use crate::config::RunConfig;
use lrfslam_host::output::write_file;
use lrfslam_host::runs::scans::read_scans;
use lrfslam_host::trajectory::{read_trajectory, with_poses};
use lrfslam_lab::experiment::{
    Experiment, Method, MotionModel, PairError, SweepCase, SweepConfig, SweepReport, fit_motion_model, markdown,
    plot_distributions, plot_errors, sweep, write_csv,
};

/// What a sweep needs.
#[derive(Debug, Args)]
pub(super) struct SweepArgs {
    #[arg(help = LOG)]
    log: PathBuf,
    #[arg(long, value_name = "FILE", help = TRUTH)]
    truth: PathBuf,
    #[command(flatten)]
    out: OutArgs,
    /// Pairs of scans, spread evenly over the log (the thesis: 366 poses).
    #[arg(long, value_name = "N", default_value_t = 366, value_parser = clap::value_parser!(u32).range(1..1_000_000))]
    poses: u32,
    /// Scans from the first of a pair to the second.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..10_000))]
    gap: u32,
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u64).range(1..1000), help = SEEDS)]
    seeds: u64,
    /// Gaussian noise added to every range, mm, where it is not what is varied. The thesis: 15. For real scans, which have
    /// their own: 0.
    #[arg(long, value_name = "MM", default_value_t = 15.0, value_parser = millimetres)]
    noise: f32,
    /// Pairs of which a smaller share of points overlaps are left out.
    #[arg(long, value_name = "SHARE", default_value_t = 0.6)]
    overlap: f32,
    #[arg(long, value_name = "METRES", default_value_t = 1.0, help = CELL)]
    cell: f32,
    #[command(flatten)]
    config: ConfigArgs,
    #[command(flatten)]
    tell: TellArgs,
}

fn millimetres(text: &str) -> Result<f32, String> {
    let number = text.parse().ok().filter(|n| (0.0..=1000.0).contains(n));
    number.ok_or_else(|| "expected a number from 0 to 1000".to_owned())
}

pub(super) fn run(experiment: Experiment, args: &SweepArgs) -> Result<(), Failure> {
    let config = args.config.load()?;
    let scans = read_scans(&args.log, config.log_options()).map_err(Failure::Start)?;
    let poses = read_trajectory(&args.truth).map_err(Failure::start)?;
    let (scans, poses) = with_poses(scans, &poses);
    let cases = cases(experiment, &config, args.noise / 1000.0);
    let plan = SweepConfig {
        poses: args.poses as usize,
        gap: args.gap as usize,
        seeds: (1..=args.seeds).collect(),
        overlap_min: args.overlap,
        cell_size_m: args.cell,
    };
    let report = sweep(&cases, &plan, &scans, &poses).map_err(Failure::start)?;
    let ours: Vec<PairError> = report.errors.iter().filter(|error| error.method == Method::Ours).copied().collect();
    let model = (experiment == Experiment::MotionModel).then(|| fit_motion_model(&ours));
    let text = markdown(experiment, &report, model.as_ref());
    let results = Results { cases: &cases, report: &report, model: model.as_ref(), ours: &ours, text: &text };
    let mut folder = args.out.folder(name(experiment))?;
    folder.save(|stage| results.write(stage)).map_err(Failure::Work)?;
    args.tell.print(&report, || with_folder(&text, folder.named()))
}

fn name(experiment: Experiment) -> &'static str {
    match experiment {
        Experiment::Population => "de-population",
        Experiment::Generations => "de-generations",
        Experiment::LrfNoise => "lrf-noise",
        Experiment::MotionModel => "motion-model",
    }
}

/// The values of the thesis: section 5.1.1 and 5.1.2.
fn cases(experiment: Experiment, config: &RunConfig, noise_m: f32) -> Vec<SweepCase> {
    let de = |label: String, population, generations| {
        let run = RunConfig { de: DeConfig { population, generations, ..config.de }, ..*config };
        SweepCase { label, run: run.rig(), noise_m }
    };
    match experiment {
        Experiment::Population => [20, 40, 60, 100].map(|np| de(format!("NP {np}"), np, 50)).into(),
        Experiment::Generations => [15, 30, 50, 75].map(|g| de(format!("G {g}"), 100, g)).into(),
        Experiment::LrfNoise => [15_u16, 30, 45, 60, 80]
            .map(|mm| SweepCase { noise_m: f32::from(mm) / 1000.0, ..de(format!("{mm} mm"), 100, 50) })
            .into(),
        Experiment::MotionModel => vec![de(format!("{:.0} mm", 1000.0 * noise_m), 100, 50)],
    }
}

/// Everything that is written.
struct Results<'a> {
    cases: &'a [SweepCase],
    report: &'a SweepReport,
    model: Option<&'a MotionModel>,
    ours: &'a [PairError],
    text: &'a str,
}

impl Results<'_> {
    fn write(&self, out: &std::path::Path) -> anyhow::Result<()> {
        let mut csv = Vec::new();
        write_csv(self.cases, &self.report.errors, &mut csv)?;
        let mut files = vec![
            ("errors.csv", csv),
            ("errors.svg", plot_errors(self.cases, &self.report.errors)?.into_bytes()),
            ("findings.md", self.text.as_bytes().to_vec()),
            ("report.json", serde_json::to_vec_pretty(self.report)?),
        ];
        if let Some(model) = self.model {
            files.push(("distribution.svg", plot_distributions(self.ours, model)?.into_bytes()));
            files.push(("motion-model.json", serde_json::to_vec_pretty(model)?));
        }
        for (name, bytes) in files {
            let path = out.join(name);
            write_file(&path, &bytes).with_context(|| format!("{}: cannot be written", path.display()))?;
        }
        Ok(())
    }
}
