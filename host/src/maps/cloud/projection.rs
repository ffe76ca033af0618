//! Beams of a tilted laser to points of the map: pose ⊕ mounting ⊕ tilt (thesis §3.3, §4.3.2).

use lrfslam_core::scan::{Echo, RangeScan};
use lrfslam_core::time::Instant;
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};

use super::{Cloud, CloudPoint, EdgeFilter, Track};
use crate::pose_f64::PoseF64;

/// How the tilting laser sits on the robot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TiltMounting {
    /// Where the tilt axis is on the robot, at tilt 0: its y axis is the axis of tilt, its z how high it is above the floor.
    pub robot_from_axis: Isometry3<f64>,
    /// Where the beams start from, seen from the axis: a laser whose mirror lies ahead of or above the axis moves when tilted.
    pub axis_from_lrf: Isometry3<f64>,
}

impl Default for TiltMounting {
    /// The laser's mirror on the axis, the axis at the robot's origin.
    fn default() -> Self {
        Self { robot_from_axis: Isometry3::identity(), axis_from_lrf: Isometry3::identity() }
    }
}

impl TiltMounting {
    /// Pose of the laser on the robot when it looks up by `tilt_rad`.
    pub fn robot_from_lrf(&self, tilt_rad: f64) -> Isometry3<f64> {
        self.robot_from_axis * UnitQuaternion::from_axis_angle(&Vector3::y_axis(), -tilt_rad) * self.axis_from_lrf
    }
}

/// A pose in the plane as one in space, on a flat floor: no height, no roll, no pitch.
pub fn planar(pose: PoseF64) -> Isometry3<f64> {
    let rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), pose.heading);
    Isometry3::from_parts(Vector3::new(pose.x, pose.y, 0.0).into(), rotation)
}

/// Everything that places beams.
#[derive(Debug, Clone)]
pub struct Projection {
    /// How the laser sits on the robot.
    pub mounting: TiltMounting,
    /// Where the robot was: `map_from_robot`.
    pub path: Track<Isometry3<f64>>,
    /// How far the laser looked up, rad.
    pub tilt: Track<f64>,
    /// Removes mixed pixels, if wanted.
    pub edges: Option<EdgeFilter>,
}

impl Projection {
    /// Adds the hits of `scan` to `cloud`, each by the pose and the tilt at its own time.
    pub fn add(&self, scan: &RangeScan<'_>, cloud: &mut Cloud) {
        // Consecutive beams of a still robot share their pose: it is looked up once for each time.
        let mut placed: Option<(Instant, Option<Isometry3<f64>>)> = None;
        for (index, beam) in scan.beams.iter().enumerate() {
            let Echo::Hit(range_m) = beam.echo else { continue };
            cloud.counts.hits += 1;
            if self.edges.is_some_and(|filter| filter.is_mixed(scan.beams, index)) {
                cloud.counts.mixed += 1;
                continue;
            }
            let stamp = scan.stamp + beam.offset;
            let pose = match placed {
                Some((at, pose)) if at == stamp => pose,
                _ => self.map_from_lrf(stamp),
            };
            placed = Some((stamp, pose));
            let Some(map_from_lrf) = pose else {
                cloud.counts.unplaced += 1;
                continue;
            };
            let (sin, cos) = f64::from(beam.bearing_rad).sin_cos();
            let hit = Point3::new(cos, sin, 0.0) * f64::from(range_m);
            cloud.points.push(CloudPoint { position: (map_from_lrf * hit).cast(), stamp });
        }
    }

    fn map_from_lrf(&self, stamp: Instant) -> Option<Isometry3<f64>> {
        Some(self.path.at(stamp)? * self.mounting.robot_from_lrf(self.tilt.at(stamp)?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lrfslam_core::scan::Beam;
    use lrfslam_core::time::Duration;
    use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};

    fn beam(bearing_rad: f64, micros: i64, range_m: f32) -> Beam {
        Beam { bearing_rad: bearing_rad as f32, offset: Duration::from_micros(micros), echo: Echo::Hit(range_m) }
    }

    fn still(pose: PoseF64) -> Track<Isometry3<f64>> {
        Track::new([(Instant::default(), planar(pose))], Duration::from_millis(1000))
    }

    fn points(projection: &Projection, beams: &[Beam]) -> (Vec<Point3<f32>>, Cloud) {
        let mut cloud = Cloud::default();
        projection.add(&RangeScan { stamp: Instant::default(), range_max_m: 30.0, beams }, &mut cloud);
        (cloud.points.iter().map(|point| point.position).collect(), cloud)
    }

    /// Every link of the chain moves the point as it should: worked by hand.
    #[test]
    fn pose_mounting_tilt_and_bearing_carry_a_beam_into_the_map() {
        let mounting = TiltMounting {
            robot_from_axis: Isometry3::translation(0.2, 0.0, 0.5),
            axis_from_lrf: Isometry3::translation(0.1, 0.0, 0.0),
        };
        let tilt = Track::new([(Instant::default(), FRAC_PI_4)], Duration::from_millis(1000));
        let projection = Projection { mounting, path: still(PoseF64::new(1.0, 2.0, FRAC_PI_2)), tilt, edges: None };
        let (found, _) = points(&projection, &[beam(0.0, 0, 2.0), beam(FRAC_PI_2, 0, 3.0)]);
        let half = 0.5_f32.sqrt();
        // Robot looks along map y. Ahead: 0.2 + (0.1 + 2) cos 45° along it, 0.5 + 2.1 sin 45° high; to the left is −x.
        let ahead = Point3::new(1.0, 2.0 + 0.2 + 2.1 * half, 0.5 + 2.1 * half);
        let left = Point3::new(1.0 - 3.0, 2.0 + 0.2 + 0.1 * half, 0.5 + 0.1 * half);
        assert!((found[0] - ahead).norm() < 1e-6 && (found[1] - left).norm() < 1e-6, "{found:?}");
    }

    #[test]
    fn beams_of_a_moving_tilt_are_placed_by_their_own_times() {
        let end = Instant::from_micros(1000);
        let tilt = Track::new([(Instant::default(), 0.0), (end, FRAC_PI_2)], Duration::from_millis(1000));
        let path = still(PoseF64::default());
        let projection = Projection { mounting: TiltMounting::default(), path, tilt, edges: None };
        let (found, _) = points(&projection, &[beam(0.0, 0, 1.0), beam(0.0, 500, 1.0), beam(0.0, 1000, 1.0)]);
        let half = 0.5_f32.sqrt();
        let expected = [Point3::new(1.0, 0.0, 0.0), Point3::new(half, 0.0, half), Point3::new(0.0, 0.0, 1.0)];
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).norm() < 1e-6), "{found:?}");
    }

    #[test]
    fn a_beam_without_a_pose_is_counted_and_left_out() {
        let tilt = Track::new([(Instant::default(), 0.0)], Duration::from_micros(10));
        let path = still(PoseF64::default());
        let projection = Projection { mounting: TiltMounting::default(), path, tilt, edges: None };
        let (found, cloud) = points(&projection, &[beam(0.0, 0, 1.0), beam(0.0, 11, 1.0)]);
        assert_eq!((found.len(), cloud.counts.hits, cloud.counts.unplaced), (1, 2, 1));
    }
}
