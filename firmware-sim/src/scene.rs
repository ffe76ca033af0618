//! What a virtual laser sees: the seam behind which any world may stand, and a robot in a building with people.

use std::sync::Arc;

use lrfslam_core::time::Instant;

use crate::drive::Drive;
use crate::people::Person;
use crate::raycast::RayCaster;
use crate::world::{Ray, Vector};

/// A world with a laser in it, at any time.
pub trait Scene: Send {
    /// Distance to what a ray from the laser meets, m; `None` if nothing is there.
    ///
    /// * `at` — when the ray leaves, on the simulator's clock; `bearing_rad` — from straight ahead, counter-clockwise, lrf frame
    fn range_m(&self, at: Instant, bearing_rad: f64) -> Option<f64>;

    /// The ray meets a reflector, which is much brighter than anything else.
    fn is_reflector(&self, _at: Instant, _bearing_rad: f64) -> bool {
        false
    }
}

/// How far rays go, m.
const FARTHEST_M: f64 = 1000.0;

/// A robot that drives about in a building, with a laser on it that may tilt.
///
/// ```
/// use lrfslam_firmware_sim::{scenario::Scenario, scene::Scene};
/// let square = "[[polygon]]\npoints = [[-1, -1], [1, -1], [1, 1], [-1, 1]]\n[robot]\nstart_deg = 90";
/// let scene = Scenario::parse(square, "square", std::path::Path::new(""))?.scene();
/// let ahead = scene.range_m(lrfslam_core::time::Instant::default(), 0.0).unwrap();
/// assert!((ahead - 1.0).abs() < 1e-9);
/// # Ok::<(), lrfslam_firmware_sim::scenario::ScenarioError>(())
/// ```
#[derive(Debug, Clone)]
pub struct RobotScene {
    caster: Arc<RayCaster>,
    people: Vec<Person>,
    drive: Drive,
    laser_m: [f64; 3],
}

impl RobotScene {
    /// * `laser_m` — where the laser is on the robot: x ahead, y left, z up from the floor, m
    pub fn new(caster: Arc<RayCaster>, people: Vec<Person>, drive: Drive, laser_m: [f64; 3]) -> Self {
        Self { caster, people, drive, laser_m }
    }

    /// The robot's way.
    pub fn drive(&self) -> &Drive {
        &self.drive
    }

    /// The ray of a beam.
    ///
    /// The tilt turns the beam about the laser's own lateral axis, upwards. Source: thesis, §4.3.2.
    pub fn ray(&self, at: Instant, bearing_rad: f64) -> Ray {
        let pose = self.drive.pose(at);
        let (sin, cos) = pose.heading.sin_cos();
        let level = |v: Vector| Vector::new(cos * v.x - sin * v.y, sin * v.x + cos * v.y, v.z);
        let (beam_sin, beam_cos) = bearing_rad.sin_cos();
        let (tilt_sin, tilt_cos) = self.drive.tilt().tilt_rad(at).sin_cos();
        let from = Vector::new(pose.x, pose.y, 0.0) + level(Vector::from(self.laser_m));
        Ray { from, direction: level(Vector::new(beam_cos * tilt_cos, beam_sin, beam_cos * tilt_sin)) }
    }
}

impl Scene for RobotScene {
    fn range_m(&self, at: Instant, bearing_rad: f64) -> Option<f64> {
        let ray = self.ray(at, bearing_rad);
        let people = self.people.iter().filter_map(|person| person.range_m(at, &ray));
        people.chain(self.caster.range_m(&ray, FARTHEST_M)).min_by(f64::total_cmp)
    }

    fn is_reflector(&self, at: Instant, bearing_rad: f64) -> bool {
        let ray = self.ray(at, bearing_rad);
        let Some(reflector_m) = self.caster.reflector_m(&ray, FARTHEST_M) else { return false };
        !self.people.iter().filter_map(|person| person.range_m(at, &ray)).any(|range_m| range_m < reflector_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::Scenario;
    use std::path::Path;

    fn scene(robot: &str) -> RobotScene {
        let text = format!("height_m = 2.5\n[[room]]\nfrom = [-3, -2]\nto = [3, 2]\n{robot}");
        Scenario::parse(&text, "test", Path::new("")).unwrap().scene()
    }

    #[test]
    fn rays_leave_from_where_the_laser_is_on_the_robot() {
        let scene = scene("[robot]\nstart_m = [1, 0]\nstart_deg = 90\nlaser_m = [0.25, 0.5, 0.4]\n");
        let range = |bearing: f64| scene.range_m(Instant::default(), bearing).unwrap();
        assert!((range(0.0) - 1.75).abs() < 1e-9, "ahead: the north wall");
        assert!((range(std::f64::consts::FRAC_PI_2) - 3.5).abs() < 1e-9, "left: the west wall");
    }

    #[test]
    fn tilted_rays_look_up_to_the_ceiling() {
        let sweep = "{ to_deg = 80, rate_degps = 10 }";
        let scene = scene(&format!(
            "[robot]\nroute = [[0, 0], [1, 0]]\nspeed_mps = 1\nturn_degps = 90\nlaser_m = [0, 0, 0.5]\nstop = [{{ corner = 0, sweep = {sweep} }}]\n"
        ));
        let range = |at_s: f64, bearing: f64| scene.range_m(Instant::from_secs_f64(at_s), bearing).unwrap();
        assert!((range(6.005, 0.0) - 2.0 / 60_f64.to_radians().sin()).abs() < 1e-2, "{}", range(6.005, 0.0));
        assert!((range(6.005, std::f64::consts::FRAC_PI_2) - 2.0).abs() < 1e-9, "along its axis nothing changes");
    }

    #[test]
    fn reflectors_are_told_from_posts_and_hidden_by_people() {
        let posts =
            "[[post]]\ncentre = [2, 0]\nradius_m = 0.1\nreflector = true\n[[post]]\ncentre = [0, 1]\nradius_m = 0.1\n";
        let person = "[[person]]\nway = [[1, 0], [1, 0.1]]\nspeed_mps = 0\n";
        let seen = |scene: &RobotScene, bearing: f64| {
            (scene.range_m(Instant::default(), bearing).unwrap(), scene.is_reflector(Instant::default(), bearing))
        };
        let (range, is_reflector) = seen(&scene(posts), 0.0);
        assert!((range - 1.9).abs() < 1e-3 && is_reflector);
        let (range, is_reflector) = seen(&scene(posts), std::f64::consts::FRAC_PI_2);
        assert!((range - 0.9).abs() < 1e-3 && !is_reflector);
        assert!(!seen(&scene(&format!("{posts}{person}")), 0.0).1);
    }

    #[test]
    fn people_stand_in_the_way() {
        let scene = scene("[[person]]\nway = [[1.5, 0], [2.5, 0]]\nspeed_mps = 0\n");
        assert!((scene.range_m(Instant::default(), 0.0).unwrap() - 1.35).abs() < 1e-9);
    }
}
