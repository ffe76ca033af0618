//! What a virtual laser sees: the seam behind which any world may stand, and a small flat one with a moving robot.

use lrfslam_core::time::Instant;
use serde::Deserialize;

/// A world with a laser in it, at any time.
pub trait Scene: Send {
    /// Distance to what a ray from the laser meets, m; `None` if nothing is there.
    ///
    /// * `at` — when the ray leaves, on the simulator's clock; `bearing_rad` — from straight ahead, counter-clockwise, lrf frame
    fn range_m(&self, at: Instant, bearing_rad: f64) -> Option<f64>;
}

/// Walls as polygons, and a robot that moves on a circle (or straight, or not at all).
///
/// ```
/// let world = lrfslam_firmware_sim::scene::FlatWorld::from_toml(
///     "[[polygon]]\npoints = [[-1, -1], [1, -1], [1, 1], [-1, 1]]\n[robot]\nstart_deg = 90",
/// )?;
/// # use lrfslam_firmware_sim::scene::Scene;
/// let ahead = world.range_m(lrfslam_core::time::Instant::default(), 0.0).unwrap();
/// assert!((ahead - 1.0).abs() < 1e-9);
/// # Ok::<(), toml::de::Error>(())
/// ```
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FlatWorld {
    /// Closed outlines.
    polygon: Vec<Polygon>,
    robot: Robot,
}

#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct Polygon {
    /// Corners, m.
    points: Vec<[f64; 2]>,
}

/// A laser that starts at a pose and keeps its speed and turn rate.
#[derive(Debug, Clone, Copy, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Robot {
    /// Start, m.
    pub start_m: [f64; 2],
    /// Start heading, degrees.
    pub start_deg: f64,
    /// Forward speed, m/s.
    pub speed_mps: f64,
    /// Turn rate, degrees per second, counter-clockwise.
    pub turn_degps: f64,
}

impl FlatWorld {
    /// Reads a world file.
    ///
    /// # Errors
    /// If it is no such TOML; the message names line and key.
    pub fn from_toml(text: &str) -> Result<Self, toml::de::Error> {
        toml::from_str(text)
    }

    /// A room of 6 m by 4 m with a pillar and a recess, the robot turning slowly within.
    pub fn room() -> Self {
        let outline = vec![[-3.0, -2.0], [3.0, -2.0], [3.0, 1.0], [3.8, 1.0], [3.8, 2.0], [-3.0, 2.0]];
        let pillar = vec![[1.2, 0.4], [1.6, 0.4], [1.6, 0.8], [1.2, 0.8]];
        Self {
            polygon: vec![Polygon { points: outline }, Polygon { points: pillar }],
            robot: Robot { start_m: [-1.0, -0.8], start_deg: 0.0, speed_mps: 0.2, turn_degps: 12.0 },
        }
    }

    /// The same world with another robot.
    pub fn with_robot(self, robot: Robot) -> Self {
        Self { robot, ..self }
    }

    fn walls(&self) -> impl Iterator<Item = ([f64; 2], [f64; 2])> + '_ {
        self.polygon.iter().flat_map(|polygon| {
            let next = polygon.points.iter().cycle().skip(1);
            polygon.points.iter().copied().zip(next.copied())
        })
    }
}

impl Robot {
    /// x, y (m) and heading (rad) at a time: an arc.
    pub fn pose(&self, at: Instant) -> [f64; 3] {
        let time = at.as_secs_f64();
        let (start, rate) = (self.start_deg.to_radians(), self.turn_degps.to_radians());
        let heading = start + rate * time;
        let (dx, dy) = if rate.abs() < 1e-9 {
            (self.speed_mps * time * start.cos(), self.speed_mps * time * start.sin())
        } else {
            let radius = self.speed_mps / rate;
            (radius * (heading.sin() - start.sin()), radius * (start.cos() - heading.cos()))
        };
        [self.start_m[0] + dx, self.start_m[1] + dy, heading]
    }
}

impl Scene for FlatWorld {
    fn range_m(&self, at: Instant, bearing_rad: f64) -> Option<f64> {
        let [x, y, heading] = self.robot.pose(at);
        let (sin, cos) = (heading + bearing_rad).sin_cos();
        let distance = |(a, b): ([f64; 2], [f64; 2])| {
            let (ex, ey) = (b[0] - a[0], b[1] - a[1]);
            let (ax, ay) = (a[0] - x, a[1] - y);
            let across = cos * ey - sin * ex;
            let (along_ray, along_wall) = ((ax * ey - ay * ex) / across, (ax * sin - ay * cos) / across);
            (across != 0.0 && along_ray > 0.0 && (0.0..=1.0).contains(&along_wall)).then_some(along_ray)
        };
        self.walls().filter_map(distance).min_by(f64::total_cmp)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rays_meet_the_nearest_wall() {
        let still = Robot { start_m: [0.0, 0.6], ..Robot::default() };
        let room = FlatWorld::room().with_robot(still);
        let range = |bearing: f64| room.range_m(Instant::default(), bearing).unwrap();
        assert!((range(0.0) - 1.2).abs() < 1e-9, "pillar ahead: {}", range(0.0));
        assert!((range(std::f64::consts::FRAC_PI_2) - 1.4).abs() < 1e-9);
        assert!((range(std::f64::consts::PI) - 3.0).abs() < 1e-9);
        assert_eq!(FlatWorld::default().range_m(Instant::default(), 0.0), None);
    }

    #[test]
    fn robot_drives_a_circle() {
        let robot = Robot { speed_mps: 1.0, turn_degps: 90.0, ..Robot::default() };
        let [x, y, heading] = robot.pose(Instant::from_micros(2_000_000));
        let diameter = 4.0 / std::f64::consts::PI;
        assert!(x.abs() < 1e-9 && (y - diameter).abs() < 1e-9 && (heading - std::f64::consts::PI).abs() < 1e-9);
    }
}
