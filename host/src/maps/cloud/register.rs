//! Two stops brought together by the plane's own scan matcher: both clouds are levelled by their floors, a band of heights is
//! seen from above as a 2D scan, and these are matched (flat floor: three numbers are left to be found).

use lrfslam_core::de::{DeConfig, Member};
use lrfslam_core::geometry::{Point2, Pose2};
use lrfslam_core::matcher::{Match, MatcherConfig, Prediction, PriorSpread, RecoveryConfig, ScanMatcher, SearchConfig};
use lrfslam_core::ndt::{DirectoryEntry, NdtConfig, NdtGrid, NdtTile};
use lrfslam_core::random::RandomStream;
use lrfslam_core::time::Instant;
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use serde::Serialize;

use super::planes::Plane;
use super::{CloudPoint, thin};

/// How stops are matched.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct RegisterConfig {
    /// Lower end of the band of heights above the floor, m: above what stands on the floor and is moved about.
    pub low_m: f64,
    /// Upper end, m: below the ceiling.
    pub high_m: f64,
    /// One point is kept for each square of this side of the band seen from above, m.
    pub thinning_m: f32,
    /// The search about the stop before: how far, with how many candidates.
    pub search: RecoveryConfig,
    /// Of the search.
    pub seed: u64,
}

impl Default for RegisterConfig {
    fn default() -> Self {
        let search = RecoveryConfig { generations: 120, ..RecoveryConfig::default() };
        Self { low_m: 0.5, high_m: 1.9, thinning_m: 0.03, search, seed: 1 }
    }
}

/// The frame above the floor: z up from it, the laser above the origin, x as far ahead as level allows.
///
/// * `floor` — in the laser's frame, its normal up
pub fn level_from_lrf(floor: &Plane) -> Option<Isometry3<f64>> {
    let rotation = UnitQuaternion::rotation_between_axis(&floor.normal, &Vector3::z_axis())?;
    Some(Isometry3::from_parts(Translation3::new(0.0, 0.0, -floor.offset_m), rotation))
}

/// Finds `points` among `map`, both seen from above: the pose of the levelled frame of `points` in that of `map`.
///
/// * `map`, `points` — bands of heights, see [`band`]
/// * `near` — the search is centred here
pub fn register(map: &[Point2], points: &[Point2], near: Pose2, config: &RegisterConfig) -> Option<Match> {
    // Points from above face no way.
    let ndt = NdtConfig { facings: 1, ..NdtConfig::default() };
    let mut directory = vec![DirectoryEntry::default(); 4 * 1024 * 1024];
    let mut tiles = vec![NdtTile::EMPTY; usize::from(u16::MAX)];
    let mut ndt = NdtGrid::new(&ndt, &mut directory, &mut tiles).ok()?;
    ndt.insert(map, Pose2::IDENTITY);
    // The score of a scan that fits everywhere: it is not reached, and the search uses all its generations.
    let prediction = Prediction { prior: PriorSpread::NONE, ..Prediction::usual(near, points.len() as f32) };
    let mut population = vec![Member::EMPTY; usize::from(config.search.population)];
    let (search, de, matcher) = (SearchConfig::default(), DeConfig::default(), MatcherConfig::default());
    let mut matcher = ScanMatcher::new(&search, &de, &matcher, &mut population);
    let mut rng = RandomStream::new(config.seed, 0, 0);
    let found = matcher.align_anywhere(&ndt, points, &prediction, &config.search, &mut rng);
    (found.score > 0.0).then_some(found)
}

/// The points of a band of heights seen from above, one for each small square.
///
/// * `points` — levelled
pub fn band(points: impl Iterator<Item = Point3<f64>>, config: &RegisterConfig) -> Vec<Point2> {
    let inside = points.filter(|point| (config.low_m..=config.high_m).contains(&point.z));
    let flat = inside
        .map(|point| CloudPoint { position: Point3::new(point.x, point.y, 0.0).cast(), stamp: Instant::default() });
    let flat: Vec<CloudPoint> = flat.collect();
    thin(&flat, config.thinning_m).iter().map(|point| Point2::new(point.position.x, point.position.y)).collect()
}
