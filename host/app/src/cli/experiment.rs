//! `lrfslam experiment`: what the methods are worth on scans whose true path is known.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use clap::{Args, Subcommand};

use super::cloud::{TiltArgs, from_log};
use super::experiment_carried::{self, CarriedArgs};
use super::experiment_cost::{self, CostArgs};
use super::experiment_endurance::{self, EnduranceArgs};
use super::experiment_envelope::{self, EnvelopeArgs};
use super::experiment_starts::{self, StartsArgs};
use super::experiment_sweep::{self, SweepArgs};
use super::out::{OutArgs, save_texts};
use super::shared::{CELL, ConfigArgs, JsonArgs, LOG, SEEDS, SeedArgs, TRUTH, TellArgs, with_folder};
use super::{Failure, print};
use lrfslam_host::maps::cloud::{CloudCounts, EdgeFilter};
use lrfslam_host::output::write_file;
use lrfslam_host::runs::scans::read_scans;
use lrfslam_host::trajectory::{read_trajectory, with_poses};
use lrfslam_lab::experiment::{
    CloudError, Experiment, LoopRun, MatchPairsConfig, MatchPairsReport, judge_cloud, loop_csv, loop_markdown,
    match_pairs, normalised_csv, particle_paths, plot_growth, plot_normalised, plot_particle_paths, read_growth,
    read_surfaces, run_loop,
};

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
    Map3d(Map3dArgs),
    Growth(GrowthArgs),
    Loop(LoopArgs),
    ParticlePaths(PathsArgs),
    Starts(StartsArgs),
    Envelope(EnvelopeArgs),
    Carried(CarriedArgs),
    Endurance(EnduranceArgs),
    LandmarkCost(CostArgs),
}

/// Does the loop close (figure 3.11)? Maps a log with its true path by each number of levels, seed after seed.
///
/// Writes loop.csv, a line for each run, and loop.md.
#[derive(Debug, Args)]
struct LoopArgs {
    /// The log; `lrf-sim log --world loop --then 29.5,9.5 --scans 183` makes one.
    log: PathBuf,
    #[arg(long, value_name = "FILE", help = TRUTH)]
    truth: PathBuf,
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = clap::value_parser!(u64).range(1..1000), help = SEEDS)]
    seeds: u64,
    /// Levels to compare.
    #[arg(long, value_name = "N,…", value_delimiter = ',', default_values_t = [1, 2], value_parser = clap::value_parser!(u16).range(0..=2))]
    levels: Vec<u16>,
    /// The loop counts as closed if the robot is nowhere farther off than this as seen from its earlier visit to the place, m.
    #[arg(long, value_name = "METRES", default_value_t = 0.5)]
    closed: f64,
    #[command(flatten)]
    out: OutArgs,
    #[command(flatten)]
    config: ConfigArgs,
    #[command(flatten)]
    tell: TellArgs,
}

/// What do the particles make of a drive? Draws the path of each, and what the best one has seen.
///
/// One level, whatever the configuration says. The best one's path is red.
#[derive(Debug, Args)]
struct PathsArgs {
    #[arg(help = LOG)]
    log: PathBuf,
    /// A panel for each: the particles after so many scans.
    #[arg(long, value_name = "N,…", value_delimiter = ',', required = true)]
    after: Vec<usize>,
    /// The figure.
    #[arg(long, value_name = "FILE.svg", default_value = "particle-paths.svg")]
    out: PathBuf,
    #[command(flatten)]
    seed: SeedArgs,
    #[command(flatten)]
    config: ConfigArgs,
}

/// Does the cost of a scan grow with the map? Draws the steps of a run.
#[derive(Debug, Args)]
struct GrowthArgs {
    /// The steps.csv that `lrfslam map` left.
    steps: PathBuf,
    /// The figure.
    #[arg(long, value_name = "FILE.svg", default_value = "growth.svg")]
    out: PathBuf,
}

/// How often scans displaced anywhere in the search box are found again: by differential evolution and by Newton's method.
#[derive(Debug, Args)]
struct MatchPairsArgs {
    #[arg(help = LOG)]
    log: PathBuf,
    #[arg(long, value_name = "FILE", help = TRUTH)]
    truth: PathBuf,
    /// Pairs to draw.
    #[arg(long, value_name = "N", default_value_t = 2000)]
    pairs: u32,
    /// Scans from the first of a pair to the second.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..10_000))]
    gap: u32,
    #[command(flatten)]
    seed: SeedArgs,
    /// Pairs of which a smaller share of points overlaps are left out.
    #[arg(long, value_name = "SHARE", default_value_t = 0.6)]
    overlap: f32,
    #[arg(long, value_name = "METRES", default_value_t = 0.5, help = CELL)]
    cell: f32,
    #[command(flatten)]
    config: ConfigArgs,
    /// Draw the errors over their standard deviations, beside what these claim.
    #[arg(long, value_name = "FILE.svg")]
    plot: Option<PathBuf>,
    /// Write these errors, a line each.
    #[arg(long, value_name = "FILE.csv")]
    errors: Option<PathBuf>,
    #[command(flatten)]
    json: JsonArgs,
}

/// How far the points of a 3D map lie from the surfaces of the world that was simulated.
///
/// With --truth, a trajectory that SLAM made is moved so that its first pose lies on the true path.
#[derive(Debug, Args)]
struct Map3dArgs {
    /// The log of the tilted laser.
    log: PathBuf,
    #[command(flatten)]
    tilted: TiltArgs,
    /// The world's surfaces, as `lrf-sim surfaces` writes them.
    #[arg(long, value_name = "FILE")]
    surfaces: PathBuf,
    #[arg(long, value_name = "FILE", help = TRUTH)]
    truth: Option<PathBuf>,
    /// Keep the points in free air that a laser reports at edges.
    #[arg(long)]
    keep_edges: bool,
    #[command(flatten)]
    json: JsonArgs,
}

pub(super) fn run(args: &ExperimentArgs) -> Result<(), Failure> {
    match &args.experiment {
        Command::MatchPairs(args) => run_match_pairs(args),
        Command::DePopulation(args) => experiment_sweep::run(Experiment::Population, args),
        Command::DeGenerations(args) => experiment_sweep::run(Experiment::Generations, args),
        Command::LrfNoise(args) => experiment_sweep::run(Experiment::LrfNoise, args),
        Command::MotionModel(args) => experiment_sweep::run(Experiment::MotionModel, args),
        Command::Map3d(args) => run_map3d(args),
        Command::Growth(args) => run_growth(args),
        Command::Loop(args) => run_loops(args),
        Command::ParticlePaths(args) => run_paths(args),
        Command::Starts(args) => experiment_starts::run(args),
        Command::Envelope(args) => experiment_envelope::run(args),
        Command::Carried(args) => experiment_carried::run(args),
        Command::Endurance(args) => experiment_endurance::run(args),
        Command::LandmarkCost(args) => experiment_cost::run(args),
    }
}

fn run_loops(args: &LoopArgs) -> Result<(), Failure> {
    let config = args.config.load()?;
    let scans = read_scans(&args.log, config.log_options()).map_err(Failure::Start)?;
    let truth = read_trajectory(&args.truth).map_err(Failure::start)?;
    let mut folder = args.out.folder("loop")?;
    let each = args.levels.iter().flat_map(|levels| (1..=args.seeds).map(move |seed| (*levels, seed)));
    let mapping = config.mapping();
    let runs = each.map(|which| run_loop((&mapping, config.robot_from_lrf()), which, &scans, &truth, args.closed));
    let runs: Vec<LoopRun> = runs.collect::<Result<_, _>>().map_err(Failure::Work)?;
    let table = loop_markdown(&runs);
    let files = [("loop.csv", loop_csv(&runs)), ("loop.md", table.clone())];
    save_texts(&mut folder, &files)?;
    args.tell.print(&runs, || with_folder(&table, folder.named()))
}

fn run_paths(args: &PathsArgs) -> Result<(), Failure> {
    let config = args.config.load()?;
    let scans = read_scans(&args.log, config.log_options()).map_err(Failure::Start)?;
    if let Some(after) = args.after.iter().find(|after| !(1..=scans.len()).contains(after)) {
        let count = scans.len();
        return Err(Failure::start(anyhow::anyhow!(
            "--after {after}: the log has {count} scans; expected 1 to {count}"
        )));
    }
    let place = (&config.mapping(), config.robot_from_lrf());
    let told = particle_paths(place, args.seed.seed, &scans, &args.after).map_err(Failure::Work)?;
    save(&args.out, &plot_particle_paths(&told).map_err(Failure::work)?)
}

fn run_growth(args: &GrowthArgs) -> Result<(), Failure> {
    let name = args.steps.display();
    let text = std::fs::read_to_string(&args.steps).with_context(|| format!("{name}: cannot be read"));
    let growth =
        read_growth(&text.map_err(Failure::Start)?).with_context(|| name.to_string()).map_err(Failure::Start)?;
    let svg = plot_growth(&growth).map_err(Failure::work)?;
    save(&args.out, &svg)
}

fn save(file: &Path, text: &str) -> Result<(), Failure> {
    let written = write_file(file, text.as_bytes());
    written.with_context(|| format!("{}: cannot be written", file.display())).map_err(Failure::Work)
}

fn run_match_pairs(args: &MatchPairsArgs) -> Result<(), Failure> {
    let config = args.config.load()?;
    let scans = read_scans(&args.log, config.log_options()).map_err(Failure::Start)?;
    let poses = read_trajectory(&args.truth).map_err(Failure::start)?;
    let (scans, poses) = with_poses(scans, &poses);
    let pairs = MatchPairsConfig {
        pairs: args.pairs,
        gap: args.gap,
        seed: args.seed.seed,
        overlap_min: args.overlap,
        cell_size_m: args.cell,
    };
    let report = match_pairs(&config.rig(), &pairs, &scans, &poses).map_err(Failure::start)?;
    if let Some(file) = &args.plot {
        save(file, &plot_normalised(&report.errors).map_err(Failure::work)?)?;
    }
    if let Some(file) = &args.errors {
        save(file, &normalised_csv(&report.errors))?;
    }
    print(&args.json.choose(&report, || table(&report))?)
}

fn run_map3d(args: &Map3dArgs) -> Result<(), Failure> {
    let surfaces = read_surfaces(&args.surfaces).map_err(Failure::start)?;
    let edges = (!args.keep_edges).then(EdgeFilter::default);
    let cloud = from_log(&args.log, &args.tilted, edges, args.truth.as_deref())?;
    let points: Vec<_> = cloud.points.iter().map(|point| point.position.cast()).collect();
    let error = judge_cloud(&points, &surfaces);
    print(&args.json.choose(&error, || cloud_error(&error, &cloud.counts))?)
}

fn cloud_error(error: &CloudError, counts: &CloudCounts) -> String {
    format!(
        "{} points of {} hits ({} mixed, {} unplaced), {} surfaces\n\
         distance, mm: median {:.1}, mean {:.1}, 95 % {:.1}, max {:.1}; {:.2} % within 5 cm\n",
        error.points,
        counts.hits,
        counts.mixed,
        counts.unplaced,
        error.surfaces,
        1e3 * error.median_m,
        1e3 * error.mean_m,
        1e3 * error.most_m,
        1e3 * error.max_m,
        100.0 * error.near
    )
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
    let normalised = &report.normalised;
    let _ = writeln!(
        text,
        "\nerrors over what the covariance says, {} pairs recovered and determined: mean square {:.2} (honest: 3), median {:.2} (2.37)\n\n\
         {:<12}{:>10}{:>10}{:>10}{:>16}",
        normalised.count,
        normalised.mean_square,
        normalised.median_square,
        "within, %",
        "1 σ",
        "2 σ",
        "3 σ",
        "σ, median"
    );
    for axis in &normalised.axes {
        let [one, two, three] = axis.within.map(|share| 100.0 * share);
        let sigma = if axis.axis == "heading" {
            format!("{:.3}°", axis.median_sigma.to_degrees())
        } else {
            format!("{:.2} mm", 1e3 * axis.median_sigma)
        };
        let _ = writeln!(text, "{:<12}{one:>10.1}{two:>10.1}{three:>10.1}{sigma:>16}", axis.axis);
    }
    let _ = writeln!(text, "{:<12}{:>10}{:>10}{:>10}", "honest", "68.3", "95.4", "99.7");
    text
}
