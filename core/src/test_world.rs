//! A flat world of walls and a perfect laser in it, for tests.

use crate::geometry::{Point2, Pose2};
use crate::math::normal;
use crate::scan::{Beam, Echo};
use crate::time::Duration;
use rand_pcg::Pcg32;

/// Straight walls, each from one point to another.
pub struct World(pub Vec<(Point2, Point2)>);

impl World {
    /// Joins the points one after the other by walls.
    pub fn polyline(points: &[(f32, f32)]) -> Self {
        let points: Vec<_> = points.iter().map(|(x, y)| Point2::new(*x, *y)).collect();
        Self(points.windows(2).map(|w| (w[0], w[1])).collect())
    }

    /// A room of 8 × 6 m with an alcove and a pillar; nothing in it is symmetric. The origin is inside.
    pub fn room() -> Self {
        let mut walls = Self::polyline(&[
            (-3.0, -2.0),
            (5.0, -2.0),
            (5.0, 1.0),
            (6.5, 1.0),
            (6.5, 2.2),
            (5.0, 2.2),
            (5.0, 4.0),
            (-3.0, 4.0),
            (-3.0, -2.0),
        ]);
        walls.0.extend(Self::polyline(&[(1.5, 2.0), (2.1, 2.0), (2.1, 2.4), (1.5, 2.4), (1.5, 2.0)]).0);
        walls
    }

    /// Two parallel walls 2 m apart and 400 m long.
    pub fn corridor() -> Self {
        let mut walls = Self::polyline(&[(-200.0, -1.03), (200.0, -1.03)]);
        walls.0.extend(Self::polyline(&[(-200.0, 0.97), (200.0, 0.97)]).0);
        walls
    }

    /// Distance to the nearest wall from `pose` in its direction, m.
    pub fn range(&self, pose: Pose2) -> Option<f32> {
        let ahead = Point2::new(libm::cosf(pose.heading), libm::sinf(pose.heading));
        let cross = |a: Point2, b: Point2| a.x * b.y - a.y * b.x;
        let hits = self.0.iter().filter_map(|(a, b)| {
            let (wall, to) = (*b - *a, *a - pose.position());
            let determinant = cross(ahead, wall);
            let (range, along) = (cross(to, wall) / determinant, cross(to, ahead) / determinant);
            (range > 0.0 && (0.0..=1.0).contains(&along)).then_some(range)
        });
        hits.min_by(f32::total_cmp)
    }

    /// 181 beams over 180°, 8 m range unless `range_max_m` says otherwise, σ = `noise_m`.
    pub fn scan(&self, map_from_lrf: Pose2, range_max_m: f32, noise_m: f32, rng: &mut Pcg32) -> Vec<Beam> {
        let beam = |i: i32| {
            let bearing_rad = ((i - 90) as f32).to_radians();
            let range = self.range(map_from_lrf * Pose2::new(0.0, 0.0, bearing_rad)).unwrap_or(f32::INFINITY);
            let echo = Echo::from_range(range + noise_m * normal(rng), range_max_m);
            Beam { bearing_rad, offset: Duration::ZERO, echo }
        };
        (0..181).map(beam).collect()
    }
}
