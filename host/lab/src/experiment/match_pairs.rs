//! How often a scan is found again that was displaced anywhere in the search box (thesis §5.1, on real scans).
//!
//! A pair is a scan and a later one; their true displacement comes from a trajectory that was made with all scans. The
//! search is centred so far from it that the truth is uniformly distributed in the box. A pair is recovered if the match
//! is within 5 cm and 1° of the truth. The same pairs, on the same cells, are given to differential evolution with a
//! polish by Newton steps (ours), to differential evolution alone (the thesis), and to Newton's method from the centre of
//! the box: the contrast that the thesis claims.
//!
//! For the polished matches that are recovered, and whose scene determines every axis, the error is also compared with the
//! covariance that the match gives: a wrong optimum is another matter, of which no covariance speaks.

use std::time::Instant as WallInstant;

use lrfslam_core::de::Member;
use lrfslam_core::geometry::Pose2;
use lrfslam_core::matcher::Prediction;
use lrfslam_core::ndt::{DirectoryEntry, NdtConfig, NdtGrid, NdtTile};
use lrfslam_core::random::RandomStream;
use rand_core::Rng as _;
use serde::Serialize;

use super::normalised::{NormalisedError, NormalisedSummary};
use super::pair::{Contender, Rig, align, anywhere, is_determined, is_recovered, overlap, points_of};
use lrfslam_host::scans::log::LogScan;
use lrfslam_host::trajectory::TimedPose;

/// What to try.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct MatchPairsConfig {
    /// Pairs to draw.
    pub pairs: u32,
    /// Scans from the first of a pair to the second.
    pub gap: u32,
    /// Of the draws.
    pub seed: u64,
    /// Pairs of which a smaller share of points overlaps are left out, 0 to 1.
    pub overlap_min: f32,
    /// Side of an NDT cell for the single scan that is matched against, m.
    pub cell_size_m: f32,
}

/// How one contender did.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ContenderScore {
    /// Which.
    pub contender: Contender,
    /// Share of all judged pairs recovered.
    pub recovered: f64,
    /// Share recovered of the pairs whose scene determines every axis.
    pub recovered_determined: f64,
    /// Mean time of a match, ms.
    pub mean_ms: f64,
}

/// What came out.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MatchPairsReport {
    /// What was tried.
    pub config: MatchPairsConfig,
    /// Pairs drawn whose scans overlap.
    pub judged: usize,
    /// Pairs left out because their scans overlap too little.
    pub without_overlap: usize,
    /// Judged pairs whose scene leaves an axis undetermined at the truth.
    pub undetermined: usize,
    /// One line for each contender.
    pub scores: Vec<ContenderScore>,
    /// Errors of the polished, recovered, determined matches over what their covariance says.
    pub normalised: NormalisedSummary,
    /// These errors one by one.
    #[serde(skip)]
    pub errors: Vec<NormalisedError>,
}

/// The log and the trajectory do not go together.
#[derive(Debug, thiserror::Error)]
#[error(
    "the log has {scans} scans and the trajectory {poses} poses: expected a pose for every scan, and more scans than the gap of {gap}"
)]
pub struct MatchPairsError {
    scans: usize,
    poses: usize,
    gap: u32,
}

/// Draws pairs and matches them; `poses` has the pose of every scan of `scans`, in the same order.
///
/// # Errors
/// If the numbers of scans and poses differ, or there is no pair.
pub fn match_pairs(
    run: &Rig,
    config: &MatchPairsConfig,
    scans: &[LogScan],
    poses: &[TimedPose],
) -> Result<MatchPairsReport, MatchPairsError> {
    let gap = config.gap as usize;
    if scans.len() != poses.len() || scans.len() <= gap {
        return Err(MatchPairsError { scans: scans.len(), poses: poses.len(), gap: config.gap });
    }
    let mut bench = Bench::new(run, config);
    let mut rng = RandomStream::new(config.seed, 0, 0);
    for _ in 0..config.pairs {
        let first = ((u64::from(rng.next_u32()) * (scans.len() - gap) as u64) >> 32) as usize;
        let offset = anywhere(&run.slam.search, &mut rng);
        let truth = poses[first].map_from_robot.between(poses[first + gap].map_from_robot);
        bench.judge(&scans[first], &scans[first + gap], truth, offset, &mut rng);
    }
    Ok(bench.report())
}

/// Works through pairs and keeps the tally.
struct Bench {
    run: Rig,
    config: MatchPairsConfig,
    directory: Vec<DirectoryEntry>,
    tiles: Vec<NdtTile>,
    population: Vec<Member<3>>,
    without_overlap: usize,
    undetermined: usize,
    judged: usize,
    tally: [Tally; 3],
    errors: Vec<NormalisedError>,
}

/// One contender's results so far.
#[derive(Clone, Copy, Default)]
struct Tally {
    recovered: usize,
    recovered_determined: usize,
    seconds: f64,
}

const CONTENDERS: [Contender; 3] = [Contender::Polished, Contender::Evolution, Contender::Newton];

impl Bench {
    fn new(run: &Rig, config: &MatchPairsConfig) -> Self {
        Self {
            run: *run,
            config: *config,
            directory: vec![DirectoryEntry::default(); NdtConfig::DIRECTORIES_MAX * 512 * 512],
            tiles: vec![NdtTile::EMPTY; 16384],
            population: vec![Member::EMPTY; usize::from(run.slam.de.population)],
            without_overlap: 0,
            undetermined: 0,
            judged: 0,
            tally: [Tally::default(); 3],
            errors: Vec::new(),
        }
    }

    /// Matches `source` against `target` by every contender; the search is centred at truth ⊕ offset⁻¹.
    fn judge(&mut self, target: &LogScan, source: &LogScan, truth: Pose2, offset: Pose2, rng: &mut RandomStream) {
        let reference = points_of(target, 0.0, &self.run);
        let points = points_of(source, self.run.slam.filter.radius_m, &self.run);
        if overlap(&reference, &points, truth) < self.config.overlap_min {
            self.without_overlap += 1;
            return;
        }
        let config = NdtConfig { cell_size_m: self.config.cell_size_m, ..self.run.slam.ndt };
        let directory = &mut self.directory[..config.directories() * 512 * 512];
        let Ok(mut ndt) = NdtGrid::new(&config, directory, &mut self.tiles) else { return };
        ndt.insert(&reference, Pose2::IDENTITY);
        // A of eq. (4.43), from a scan filtered as the one that is matched.
        let own = ndt.score(&points_of(target, self.run.slam.filter.radius_m, &self.run), Pose2::IDENTITY);
        let prediction = Prediction::usual(truth * offset.inverse(), own);
        let seed = u64::from(rng.next_u32());
        let determined = is_determined(&ndt, &points, truth);
        self.judged += 1;
        self.undetermined += usize::from(!determined);
        for (contender, tally) in CONTENDERS.into_iter().zip(&mut self.tally) {
            let started = WallInstant::now();
            let found = align(contender, &self.run.slam, &ndt, &points, &prediction, &mut self.population, seed);
            tally.seconds += started.elapsed().as_secs_f64();
            let recovered = is_recovered(truth.between(found.pose));
            tally.recovered += usize::from(recovered);
            tally.recovered_determined += usize::from(recovered && determined);
            let told = found.covariance.filter(|_| contender == Contender::Polished && recovered && determined);
            self.errors.extend(told.and_then(|covariance| NormalisedError::of(found.pose, truth, &covariance)));
        }
    }

    fn report(self) -> MatchPairsReport {
        let share = |part: usize, whole: usize| part as f64 / whole.max(1) as f64;
        let determined = self.judged - self.undetermined;
        let score = |(contender, tally): (Contender, &Tally)| ContenderScore {
            contender,
            recovered: share(tally.recovered, self.judged),
            recovered_determined: share(tally.recovered_determined, determined),
            mean_ms: 1e3 * tally.seconds / self.judged.max(1) as f64,
        };
        MatchPairsReport {
            config: self.config,
            judged: self.judged,
            without_overlap: self.without_overlap,
            undetermined: self.undetermined,
            scores: CONTENDERS.into_iter().zip(&self.tally).map(score).collect(),
            normalised: NormalisedSummary::of(&self.errors),
            errors: self.errors,
        }
    }
}
