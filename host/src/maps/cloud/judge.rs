//! What real stops show: their planes, and how our matching of them agrees with the poses that came with the data.

use lrfslam_core::geometry::{Point2, Pose2};
use lrfslam_core::matcher::Match;
use nalgebra::{Isometry3, Point3, Vector3};
use serde::Serialize;

use super::nearness::{Nearness, nearness};
use super::planes::refine;
use super::register::{band, register};
use super::{
    CloudPoint, EdgeFilter, Plane, PlaneConfig, PlaneFit, RegisterConfig, Stop, find_planes, floor_of, level_from_lrf,
    planar, thin,
};
use crate::pose_f64::{PoseF64, wrap};

/// Side of the cubes that planes are looked for in, m: dense places near the laser must not outvote the rest.
const PLANE_VOXEL_M: f32 = 0.03;
/// The same for the comparison of clouds.
const NEAR_VOXEL_M: f32 = 0.05;

/// What a plane is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Surface {
    /// The one found as such.
    Floor,
    /// Level, above the laser.
    Ceiling,
    /// Upright to within 10°.
    Wall,
    /// Anything else.
    Other,
}

/// One plane of a stop.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct SurfaceFit {
    /// What it is.
    pub surface: Surface,
    /// Hits on it.
    pub points: usize,
    /// Root of their mean square distance from it, m.
    pub rms_m: f64,
    /// From upright or level, degrees.
    pub off_deg: f64,
    /// Distance from the laser, m.
    pub distance_m: f64,
}

/// One stop.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StopReport {
    /// Name of its file.
    pub name: String,
    /// Hits in it.
    pub hits: usize,
    /// Of these, mixed pixels.
    pub mixed: usize,
    /// The laser's zero from level, by the floor: pitch up, roll to the left up, degrees.
    pub floor_tilt_deg: [f64; 2],
    /// Planes, the largest first.
    pub planes: Vec<SurfaceFit>,
    /// How it lies to the first stop; `None` for that one.
    pub registration: Option<RegistrationReport>,
}

/// How a stop lies to the first one, by us and by the data's own poses.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct RegistrationReport {
    /// By us: x, y (m) and heading (degrees) of the laser in the map.
    pub ours: [f64; 3],
    /// By the data, the same.
    pub given: [f64; 3],
    /// Distance between the two positions, seen from above, m.
    pub apart_m: f64,
    /// Difference of the two headings, degrees.
    pub apart_deg: f64,
    /// Distance between the two positions in space, m.
    pub apart_in_space_m: f64,
    /// Angle between the two orientations in space, degrees: the levels of the floors are in it.
    pub apart_in_space_deg: f64,
    /// Score per point of the match, 0 to 1.
    pub score_per_point: f32,
    /// How near the stop's cloud comes to those of the stops before, by our poses.
    pub near_by_ours: Nearness,
    /// And by the given ones.
    pub near_by_given: Nearness,
}

/// Stops with the floor found and the others placed.
#[derive(Debug, Clone, PartialEq)]
pub struct JudgedStops {
    /// A line for each.
    pub stops: Vec<StopReport>,
    /// Pose of each stop's laser in the map by our matching: floor at z = 0, the origin below the first stop's laser.
    pub map_from_lrf: Vec<Isometry3<f64>>,
    /// The same by the data's own poses, relative to the first.
    pub given: Vec<Isometry3<f64>>,
}

/// A stop in which no floor, or no match, was found.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum JudgeError {
    /// No level plane below the laser.
    #[error("{stop}: no floor found: expected a level plane below the laser")]
    NoFloor {
        /// Name of the stop.
        stop: String,
    },
    /// Nothing to match.
    #[error("{stop}: no points between {low_m} and {high_m} m above the floor to match")]
    NoMatch {
        /// Name of the stop.
        stop: String,
        /// Lower end of the band, m.
        low_m: f64,
        /// Upper end, m.
        high_m: f64,
    },
}

/// Finds planes in every stop and matches each with all stops before it.
///
/// The search starts at the pose of the stop before: nothing of the given poses goes into it.
///
/// # Errors
/// If a stop has no floor or cannot be matched.
pub fn judge_stops(
    stops: &[Stop],
    planes: &PlaneConfig,
    matching: &RegisterConfig,
    edges: Option<EdgeFilter>,
) -> Result<JudgedStops, JudgeError> {
    let mut judged = JudgedStops { stops: Vec::new(), map_from_lrf: Vec::new(), given: Vec::new() };
    let mut map = Map::default();
    for stop in stops {
        let cloud = stop.cloud(Isometry3::identity(), edges);
        let no_floor = || JudgeError::NoFloor { stop: stop.name.clone() };
        let (surfaces, level) = survey(&cloud.points, planes).ok_or_else(no_floor)?;
        let found = map.find(&cloud.points, &level, matching);
        let RegisterConfig { low_m, high_m, .. } = *matching;
        let no_match = || JudgeError::NoMatch { stop: stop.name.clone(), low_m, high_m };
        let (map_from_lrf, matched) = found.ok_or_else(no_match)?;
        let given = match (stops.first(), judged.map_from_lrf.first()) {
            (Some(first), Some(map_from_first)) => map_from_first * first.map_from_lrf.inv_mul(&stop.map_from_lrf),
            _ => map_from_lrf,
        };
        let near_points = positions(&thin(&cloud.points, NEAR_VOXEL_M));
        judged.stops.push(StopReport {
            name: stop.name.clone(),
            hits: cloud.counts.hits,
            mixed: cloud.counts.mixed,
            floor_tilt_deg: floor_tilt_deg(&level),
            planes: surfaces,
            registration: matched.map(|matched| map.compare(&near_points, &map_from_lrf, &given, &matched)),
        });
        map.add(&cloud.points, &near_points, &map_from_lrf, &given, matched, matching);
        judged.map_from_lrf.push(map_from_lrf);
        judged.given.push(given);
    }
    Ok(judged)
}

/// What the stops so far have seen.
#[derive(Default)]
struct Map {
    /// The band of heights, seen from above.
    band: Vec<Point2>,
    /// Pose of the last stop's levelled frame.
    last: Pose2,
    /// Everything, by our poses and by the given ones.
    by_ours: Vec<Point3<f64>>,
    by_given: Vec<Point3<f64>>,
}

impl Map {
    /// Pose of the laser, and the match; the first stop is where it is.
    fn find(
        &self,
        cloud: &[CloudPoint],
        level_from_lrf: &Isometry3<f64>,
        config: &RegisterConfig,
    ) -> Option<(Isometry3<f64>, Option<Match>)> {
        if self.by_ours.is_empty() {
            return Some((*level_from_lrf, None));
        }
        let levelled = cloud.iter().map(|point| level_from_lrf * point.position.cast::<f64>());
        let matched = register(&self.band, &band(levelled, config), self.last, config)?;
        let map_from_level = planar(PoseF64::from(matched.map_from_robot));
        Some((map_from_level * level_from_lrf, Some(matched)))
    }

    fn add(
        &mut self,
        cloud: &[CloudPoint],
        near_points: &[Point3<f64>],
        map_from_lrf: &Isometry3<f64>,
        given: &Isometry3<f64>,
        matched: Option<Match>,
        config: &RegisterConfig,
    ) {
        self.band.extend(band(cloud.iter().map(|point| map_from_lrf * point.position.cast::<f64>()), config));
        self.last = matched.map_or(Pose2::IDENTITY, |matched| matched.map_from_robot);
        self.by_ours.extend(near_points.iter().map(|point| map_from_lrf * point));
        self.by_given.extend(near_points.iter().map(|point| given * point));
    }

    /// The stop's two poses against each other and against the stops so far.
    fn compare(
        &self,
        points: &[Point3<f64>],
        map_from_lrf: &Isometry3<f64>,
        given: &Isometry3<f64>,
        matched: &Match,
    ) -> RegistrationReport {
        let difference = given.inv_mul(map_from_lrf);
        let ([x, y, heading], [given_x, given_y, given_heading]) = (in_plane(map_from_lrf), in_plane(given));
        RegistrationReport {
            ours: [x, y, heading],
            given: [given_x, given_y, given_heading],
            apart_m: (x - given_x).hypot(y - given_y),
            apart_deg: wrap((heading - given_heading).to_radians()).to_degrees().abs(),
            apart_in_space_m: difference.translation.vector.norm(),
            apart_in_space_deg: difference.rotation.angle().to_degrees(),
            score_per_point: matched.score_per_point,
            near_by_ours: nearness(&self.by_ours, points, map_from_lrf),
            near_by_given: nearness(&self.by_given, points, given),
        }
    }
}

fn positions(points: &[CloudPoint]) -> Vec<Point3<f64>> {
    points.iter().map(|point| point.position.cast()).collect()
}

/// The planes of a stop, and the frame above its floor; `None` if it has none.
///
/// Planes and level come from the thinned cloud, where every place counts the same: the floor far away says more about
/// its slope than the dense one near the laser. How well the planes fit is said of all hits.
fn survey(points: &[CloudPoint], config: &PlaneConfig) -> Option<(Vec<SurfaceFit>, Isometry3<f64>)> {
    let thinned = positions(&thin(points, PLANE_VOXEL_M));
    let found = find_planes(&thinned, config);
    let level = level_from_lrf(&floor_of(&found)?.plane)?;
    let planes: Vec<Plane> = found.iter().map(|fit| fit.plane).collect();
    let fits = refine(&positions(points), &planes, config.inlier_m);
    let floor = floor_of(&fits)?;
    Some((surfaces(&fits, &floor), level))
}

/// How far the laser's x axis looks up, and its y axis, over the floor.
fn floor_tilt_deg(level_from_lrf: &Isometry3<f64>) -> [f64; 2] {
    let up = |axis: Vector3<f64>| (level_from_lrf * axis).z.asin().to_degrees();
    [up(Vector3::x()), up(Vector3::y())]
}

/// What the planes (in the laser's frame) are, seen over the floor.
fn surfaces(planes: &[PlaneFit], floor: &PlaneFit) -> Vec<SurfaceFit> {
    let surface = |fit: &PlaneFit| {
        let rise = fit.plane.normal.dot(&floor.plane.normal).clamp(-1.0, 1.0);
        let (upright, level) = (rise.abs().asin().to_degrees(), rise.abs().acos().to_degrees());
        let (surface, off_deg) = match () {
            () if fit == floor => (Surface::Floor, level),
            () if level < 5.0 && rise < 0.0 => (Surface::Ceiling, level),
            () if upright < 10.0 => (Surface::Wall, upright),
            () => (Surface::Other, level.min(upright)),
        };
        SurfaceFit { surface, points: fit.points, rms_m: fit.rms_m, off_deg, distance_m: fit.plane.offset_m.abs() }
    };
    planes.iter().map(surface).collect()
}

/// x, y (m) and heading (degrees) over the floor.
fn in_plane(map_from_lrf: &Isometry3<f64>) -> [f64; 3] {
    let (position, ahead) = (map_from_lrf.translation.vector, map_from_lrf * Vector3::x());
    [position.x, position.y, ahead.y.atan2(ahead.x).to_degrees()]
}
