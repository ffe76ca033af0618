//! The thesis's sweeps of chapter 5: one setting is varied, the same pairs of scans are matched with each value, and the errors
//! of the displacements found are listed.
//!
//! Pairs are spread evenly over the log. The centre of the search is drawn so that the truth is uniformly distributed in the box of
//! table 4.4 (the thesis's robot moves, and the search is centred on no motion). Gaussian noise is added to the ranges of both scans,
//! as in §5.1.2. Every draw depends on seed and pair alone: all values of the setting see the same pairs, noise and random numbers.

use std::io::{self, Write};

use lrfslam_core::de::Member;
use lrfslam_core::geometry::Pose2;
use lrfslam_core::matcher::Prediction;
use lrfslam_core::math::normal;
use lrfslam_core::ndt::{DirectoryEntry, NdtConfig, NdtGrid, NdtTile};
use lrfslam_core::random::RandomStream;
use lrfslam_core::scan::{Beam, Echo};
use rand_core::Rng as _;
use serde::Serialize;

use super::pair::{Contender, Rig, align, anywhere, is_determined, is_recovered, overlap, points_of};
use crate::evaluation::Statistics;
use lrfslam_host::scans::log::LogScan;
use lrfslam_host::trajectory::TimedPose;

/// An error larger than either is a peak: the search ended in another optimum.
const PEAK_M: f64 = 0.2;
const PEAK_DEG: f64 = 5.0;

/// A whole way to match, cells included.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// The thesis: one grid of cells of 1 m, no noise added to them, differential evolution alone.
    Thesis,
    /// Ours: four overlapping grids, smoothed cells, differential evolution, then Newton steps.
    Ours,
}

/// Both, in the order of the tables.
pub const METHODS: [Method; 2] = [Method::Thesis, Method::Ours];

/// One value of the setting that is varied.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SweepCase {
    /// For tables and plots, such as `NP 20`.
    pub label: String,
    /// Everything it is matched with.
    pub run: Rig,
    /// Standard deviation added to all ranges, m.
    pub noise_m: f32,
}

/// What all cases share.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SweepConfig {
    /// Pairs, spread evenly over the log.
    pub poses: usize,
    /// Scans from the first of a pair to the second.
    pub gap: usize,
    /// Each is a whole run of its own.
    pub seeds: Vec<u64>,
    /// Pairs of which a smaller share of points overlaps are left out, 0 to 1.
    pub overlap_min: f32,
    /// Side of our cells for the one scan that is matched against, m.
    pub cell_size_m: f32,
}

/// The error of one match, in the frame of the robot at its true pose.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PairError {
    /// Index of the case.
    pub case: usize,
    /// How it was matched.
    pub method: Method,
    /// Of the run.
    pub seed: u64,
    /// Number of the pair along the log.
    pub pose: usize,
    /// The thesis's Δy, m.
    pub forward_m: f64,
    /// The thesis's Δx, m; to the left.
    pub lateral_m: f64,
    /// Δθ, degrees.
    pub heading_deg: f64,
    /// Within 5 cm and 1°.
    pub found: bool,
    /// The scene determines every axis there; in a featureless corridor no search can find the way along it.
    pub determined: bool,
    /// True displacement between the scans: distance (m) and turn (degrees).
    pub travel_m: f64,
    /// See above.
    pub turn_deg: f64,
}

/// One case and method over all seeds.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CaseSummary {
    /// Of the case.
    pub label: String,
    /// How it was matched.
    pub method: Method,
    /// Absolute forward errors, m.
    pub forward_m: Statistics,
    /// Absolute lateral errors, m.
    pub lateral_m: Statistics,
    /// Absolute heading errors, degrees.
    pub heading_deg: Statistics,
    /// Share within 5 cm and 1°.
    pub found: f64,
    /// Share off by more than 20 cm or 5°, of the pairs whose scene determines every axis.
    pub peaks: f64,
    /// The same for each seed.
    pub peaks_by_seed: Vec<f64>,
}

/// What came out.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SweepReport {
    /// What was tried.
    pub config: SweepConfig,
    /// Pairs matched.
    pub pairs: usize,
    /// Pairs left out because their scans overlap too little.
    pub without_overlap: usize,
    /// Pairs matched whose scene leaves an axis undetermined.
    pub undetermined: usize,
    /// A line for each case and method.
    pub summaries: Vec<CaseSummary>,
    /// Every match.
    #[serde(skip)]
    pub errors: Vec<PairError>,
}

/// The log and the path do not go together, or there is nothing to match.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SweepError {
    /// Counts differ, or too few.
    #[error(
        "the log has {scans} scans and the trajectory {poses} poses: expected a pose for every scan, and more scans than the gap of {gap}"
    )]
    Poses {
        /// In the log.
        scans: usize,
        /// In the trajectory.
        poses: usize,
        /// Asked for.
        gap: usize,
    },
    /// No pair overlaps.
    #[error("no pair of scans overlaps enough: expected a share of points of at least {needed}")]
    NoOverlap {
        /// Asked for, in percent.
        needed: String,
    },
}

/// Matches the pairs with every case, method and seed; `poses` has the pose of every scan of `scans`, in the same order.
///
/// # Errors
/// If scans and poses do not go together, or no pair overlaps.
pub fn sweep(
    cases: &[SweepCase],
    config: &SweepConfig,
    scans: &[LogScan],
    poses: &[TimedPose],
) -> Result<SweepReport, SweepError> {
    let gap = config.gap;
    if scans.len() != poses.len() || scans.len() <= gap {
        return Err(SweepError::Poses { scans: scans.len(), poses: poses.len(), gap });
    }
    let pairs = (scans.len() - gap).min(config.poses.max(1));
    let mut bench = Bench::new(config.cell_size_m);
    let Some(usual) = cases.first().map(|case| case.run) else { return Err(no_overlap(config)) };
    let (mut errors, mut without_overlap, mut undetermined) = (Vec::new(), 0, 0);
    for pose in 0..pairs {
        let first = pose * (scans.len() - gap) / pairs;
        let truth = poses[first].map_from_robot.between(poses[first + gap].map_from_robot);
        let mut pair = Pair { pose, target: &scans[first], source: &scans[first + gap], truth, determined: true };
        if !pair.overlaps(&usual, config.overlap_min) {
            without_overlap += 1;
            continue;
        }
        pair.determined = bench.is_determined(&pair, &usual);
        undetermined += usize::from(!pair.determined);
        for &seed in &config.seeds {
            for (index, case) in cases.iter().enumerate() {
                errors.extend(METHODS.map(|method| bench.judge(&Trial { pair: &pair, case, index, method, seed })));
            }
        }
    }
    if errors.is_empty() {
        return Err(no_overlap(config));
    }
    let summaries = cases.iter().enumerate().flat_map(|(index, case)| {
        METHODS.map(|method| summarise(&case.label, method, config, of_case(&errors, index, method)))
    });
    let summaries = summaries.collect();
    let pairs = pairs - without_overlap;
    Ok(SweepReport { config: config.clone(), pairs, without_overlap, undetermined, summaries, errors })
}

fn no_overlap(config: &SweepConfig) -> SweepError {
    SweepError::NoOverlap { needed: format!("{:.0} %", 100.0 * config.overlap_min) }
}

/// The errors of one case and method.
pub(super) fn of_case(errors: &[PairError], case: usize, method: Method) -> Vec<PairError> {
    errors.iter().filter(|error| error.case == case && error.method == method).copied().collect()
}

fn summarise(label: &str, method: Method, config: &SweepConfig, errors: Vec<PairError>) -> CaseSummary {
    let of = |value: fn(&PairError) -> f64| Statistics::of(&errors.iter().map(|e| value(e).abs()).collect::<Vec<_>>());
    let share = |wanted: &dyn Fn(&&PairError) -> bool, among: &dyn Fn(&&PairError) -> bool| {
        let total = errors.iter().filter(among).count().max(1);
        errors.iter().filter(among).filter(wanted).count() as f64 / total as f64
    };
    CaseSummary {
        label: label.to_owned(),
        method,
        forward_m: of(|e| e.forward_m),
        lateral_m: of(|e| e.lateral_m),
        heading_deg: of(|e| e.heading_deg),
        found: share(&|e| e.found, &|_| true),
        peaks: share(&|e| e.is_peak(), &|e| e.determined),
        peaks_by_seed: config
            .seeds
            .iter()
            .map(|&seed| share(&|e| e.is_peak(), &|e| e.determined && e.seed == seed))
            .collect(),
    }
}

impl PairError {
    /// Off by more than 20 cm or 5°: another optimum.
    pub fn is_peak(&self) -> bool {
        self.forward_m.hypot(self.lateral_m) > PEAK_M || self.heading_deg.abs() > PEAK_DEG
    }
}

/// Two scans and their true displacement.
struct Pair<'s> {
    pose: usize,
    target: &'s LogScan,
    source: &'s LogScan,
    truth: Pose2,
    determined: bool,
}

impl Pair<'_> {
    fn overlaps(&self, run: &Rig, needed: f32) -> bool {
        let (target, source) =
            (points_of(self.target, 0.0, run), points_of(self.source, run.slam.filter.radius_m, run));
        overlap(&target, &source, self.truth) >= needed
    }
}

/// One match to be made.
struct Trial<'t> {
    pair: &'t Pair<'t>,
    case: &'t SweepCase,
    index: usize,
    method: Method,
    seed: u64,
}

/// Memory for matching.
struct Bench {
    cell_size_m: f32,
    directory: Vec<DirectoryEntry>,
    tiles: Vec<NdtTile>,
    population: Vec<Member<3>>,
}

/// Tiles told apart in each direction.
const SIDE: usize = 256;

impl Bench {
    fn new(cell_size_m: f32) -> Self {
        Self {
            cell_size_m,
            directory: vec![DirectoryEntry::default(); NdtConfig::DIRECTORIES_MAX * SIDE * SIDE],
            tiles: vec![NdtTile::EMPTY; 16384],
            population: vec![Member::EMPTY; 1000],
        }
    }

    /// True if the scene determines every axis at the truth, by our cells and without added noise.
    fn is_determined(&mut self, pair: &Pair<'_>, run: &Rig) -> bool {
        let config = self.config(Method::Ours, run);
        let Some(mut ndt) = cells(&config, &mut self.directory, &mut self.tiles) else { return false };
        ndt.insert(&points_of(pair.target, 0.0, run), Pose2::IDENTITY);
        is_determined(&ndt, &points_of(pair.source, run.slam.filter.radius_m, run), pair.truth)
    }

    fn config(&self, method: Method, run: &Rig) -> NdtConfig {
        match method {
            Method::Thesis => NdtConfig { cell_size_m: 1.0, grids: 1, facings: 1, noise_m: 0.0 },
            Method::Ours => NdtConfig { cell_size_m: self.cell_size_m, ..run.slam.ndt },
        }
    }

    fn judge(&mut self, trial: &Trial<'_>) -> PairError {
        let Trial { pair, case, index, method, seed } = *trial;
        let mut rng = RandomStream::new(seed.wrapping_mul(1_000_003).wrapping_add(pair.pose as u64), 0, 0);
        let centre = pair.truth * anywhere(&case.run.slam.search, &mut rng).inverse();
        let search_seed = u64::from(rng.next_u32());
        let target = noisy(pair.target, case.noise_m, &mut rng);
        let source = noisy(pair.source, case.noise_m, &mut rng);
        let found = self.find(trial, [&target, &source], centre, search_seed);
        let error = pair.truth.between(found);
        PairError {
            case: index,
            method,
            seed,
            pose: pair.pose,
            forward_m: f64::from(error.x),
            lateral_m: f64::from(error.y),
            heading_deg: f64::from(error.heading).to_degrees(),
            found: is_recovered(error),
            determined: pair.determined,
            travel_m: f64::from(pair.truth.position().norm()),
            turn_deg: f64::from(pair.truth.heading).to_degrees(),
        }
    }

    /// The pose found for the source in the cells of the target; the centre of the search if there are no cells.
    fn find(&mut self, trial: &Trial<'_>, [target, source]: [&LogScan; 2], centre: Pose2, seed: u64) -> Pose2 {
        let run = &trial.case.run;
        let config = self.config(trial.method, run);
        let Some(mut ndt) = cells(&config, &mut self.directory, &mut self.tiles) else { return centre };
        ndt.insert(&points_of(target, 0.0, run), Pose2::IDENTITY);
        // A of eq. (4.43), from a scan filtered as the one that is matched.
        let score_expected = ndt.score(&points_of(target, run.slam.filter.radius_m, run), Pose2::IDENTITY);
        let points = points_of(source, run.slam.filter.radius_m, run);
        let prediction = Prediction::usual(centre, score_expected);
        let contender = if trial.method == Method::Thesis { Contender::Evolution } else { Contender::Polished };
        align(contender, &run.slam, &ndt, &points, &prediction, &mut self.population, seed).pose
    }
}

/// An empty plane.
fn cells<'m>(config: &NdtConfig, directory: &'m mut [DirectoryEntry], tiles: &'m mut [NdtTile]) -> Option<NdtGrid<'m>> {
    NdtGrid::new(config, &mut directory[..config.directories() * SIDE * SIDE], tiles).ok()
}

/// The scan with Gaussian noise on its ranges.
fn noisy(scan: &LogScan, noise_m: f32, rng: &mut RandomStream) -> LogScan {
    let beam = |beam: &Beam| match beam.echo {
        Echo::Hit(range_m) => {
            let noisy_m = range_m + noise_m * normal(rng);
            // Noise does not make a hit a miss.
            Beam { echo: Echo::from_range(noisy_m, f32::INFINITY), ..*beam }
        }
        Echo::Miss | Echo::Invalid => *beam,
    };
    LogScan { beams: scan.beams.iter().map(beam).collect(), ..scan.clone() }
}

/// Writes every match as a line of a CSV file.
///
/// # Errors
/// If `out` fails.
pub fn write_csv(cases: &[SweepCase], errors: &[PairError], out: &mut impl Write) -> io::Result<()> {
    writeln!(out, "case,method,seed,pose,forward_m,lateral_m,heading_deg,found,determined,travel_m,turn_deg")?;
    for error in errors {
        let label = cases.get(error.case).map_or("", |case| case.label.as_str());
        let method = format!("{:?}", error.method).to_lowercase();
        writeln!(
            out,
            "{label},{method},{},{},{:.5},{:.5},{:.4},{},{},{:.4},{:.3}",
            error.seed,
            error.pose,
            error.forward_m,
            error.lateral_m,
            error.heading_deg,
            u8::from(error.found),
            u8::from(error.determined),
            error.travel_m,
            error.turn_deg
        )?;
    }
    Ok(())
}
