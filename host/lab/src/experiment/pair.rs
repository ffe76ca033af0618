//! Matching one pair of scans: what all experiments on pairs share.

use lrfslam_core::de::Member;
use lrfslam_core::facing::face;
use lrfslam_core::filter::{FilterConfig, hits, thin};
use lrfslam_core::geometry::{Point2, Pose2};
use lrfslam_core::matcher::{CONSTRAINT_MIN, Match, MatcherConfig, Prediction, ScanMatcher, SearchConfig};
use lrfslam_core::math::uniform;
use lrfslam_core::ndt::NdtGrid;
use lrfslam_core::random::RandomStream;
use lrfslam_core::slam::SlamConfig;
use lrfslam_core::sweep::Sweep;
use nalgebra::Matrix3;
use serde::Serialize;

use lrfslam_host::scans::log::LogScan;

/// A match this near to the truth is a recovery.
const RECOVERED_M: f32 = 0.05;
const RECOVERED_RAD: f32 = std::f32::consts::PI / 180.0;
/// Points nearer than this to one of the other scan's overlap with it, m.
const OVERLAP_M: f32 = 0.3;

/// A way to match.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub enum Contender {
    /// Differential evolution over the box, polished by Newton steps.
    Polished,
    /// Differential evolution alone, as in the thesis.
    Evolution,
    /// Newton's method from the centre of the box.
    Newton,
}

/// A displacement drawn uniformly from the search box.
pub(super) fn anywhere(search: &SearchConfig, rng: &mut RandomStream) -> Pose2 {
    Pose2::new(
        -search.backward_m + (search.backward_m + search.forward_m) * uniform(rng),
        search.lateral_m * (2.0 * uniform(rng) - 1.0),
        search.rotation_deg.to_radians() * (2.0 * uniform(rng) - 1.0),
    )
}

/// What pairs are matched with.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Rig {
    /// Of which matching alone.
    #[serde(flatten)]
    pub slam: SlamConfig,
    /// Where the laser sits in logs that do not tell it.
    #[serde(skip)]
    pub robot_from_lrf: Pose2,
}

/// True if a match that is off by `error` counts as found.
pub(super) fn is_recovered(error: Pose2) -> bool {
    error.position().norm() <= RECOVERED_M && error.heading.abs() <= RECOVERED_RAD
}

/// Points of a scan in the robot frame, filtered with `radius_m`.
pub(super) fn points_of(scan: &LogScan, radius_m: f32, rig: &Rig) -> Vec<Point2> {
    let (mut raw, mut points) = (vec![Point2::default(); scan.beams.len()], vec![Point2::default(); scan.beams.len()]);
    let robot_from_lrf = scan.robot_from_lrf.unwrap_or(rig.robot_from_lrf);
    // There is a place for every beam: this cannot fail.
    let hits = hits(&Sweep::at_rest(scan.scan(), robot_from_lrf), &mut raw);
    let mut faced = hits.unwrap_or_default().to_vec();
    face(&mut faced, robot_from_lrf.position());
    let count = thin(&FilterConfig { radius_m }, &faced, &mut points).map_or(0, |kept| kept.len());
    points.truncate(count);
    points
}

/// Share of `points` that, displaced by `truth`, lie near a point of the reference.
pub(super) fn overlap(reference: &[Point2], points: &[Point2], truth: Pose2) -> f32 {
    let near = |point: &&Point2| {
        let moved = truth.transform(**point);
        reference.iter().any(|other| (moved - *other).norm() <= OVERLAP_M)
    };
    points.iter().filter(near).count() as f32 / points.len().max(1) as f32
}

/// True if the scene determines every axis at the truth.
pub(super) fn is_determined(ndt: &NdtGrid<'_>, points: &[Point2], truth: Pose2) -> bool {
    let [xx, xy, yy] = ndt.constraint(points, truth);
    0.5 * (xx + yy) - (0.5 * (xx - yy)).hypot(xy) >= CONSTRAINT_MIN
}

/// Where a contender found a scan.
pub(super) struct Found {
    pub(super) pose: Pose2,
    /// Of (x, y, heading), if the contender says: m², m rad, rad².
    pub(super) covariance: Option<Matrix3<f32>>,
}

/// The pose that `contender` finds for `points` in `ndt`.
pub(super) fn align(
    contender: Contender,
    config: &SlamConfig,
    ndt: &NdtGrid<'_>,
    points: &[Point2],
    prediction: &Prediction,
    population: &mut [Member<3>],
    seed: u64,
) -> Found {
    let newton_steps = if contender == Contender::Evolution { 0 } else { config.matcher.newton_steps };
    // Nothing is known of the motion here: no prior.
    let matching = MatcherConfig { newton_steps, prior_position_m: 0.0, prior_heading_deg: 0.0, ..config.matcher };
    let mut matcher = ScanMatcher::new(&config.search, &config.de, &matching, population);
    if contender == Contender::Newton {
        return Found { pose: matcher.align_locally(ndt, points, prediction), covariance: None };
    }
    let found: Match = matcher.align(ndt, points, prediction, &mut RandomStream::new(seed, 0, 0));
    Found { pose: found.map_from_robot, covariance: Some(found.covariance) }
}
