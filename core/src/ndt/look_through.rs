//! What rays go through is not there: people who walked on, doors that opened, walls drawn at a wrong pose.
//!
//! A ray takes evidence from every cell whose distribution it went through, until the cell is gone. It went through if it passed the
//! mean within [`THROUGH`], and went on behind it for [`BEHIND_SIGMAS`] of the distribution along the ray. So a ray that ends on a wall
//! never speaks against that wall, however flat it meets it.
//!
//! Source: Saarinen, Andreasson, Stoyanov & Lilienthal, *3D normal distributions transform occupancy maps*, IJRR 2013: where along a ray a
//! distribution is likeliest. Departure: evidence is the number of points itself.

use super::cell::{CellSums, Gaussian};
use super::grid::{NdtGrid, rotate_translate};
use crate::geometry::{Point2, Pose2};
use crate::grid::{CellIndex, cells_on_ray};
use crate::math::{hypot, sin_cos};

/// Squared Mahalanobis distance from the mean below which a ray goes through a distribution: half of its density. Chosen.
const THROUGH: f32 = 1.4;
/// A ray went through if it went on for so many standard deviations. Chosen.
const BEHIND_SIGMAS: f32 = 3.0;
/// And at least so far, m: the error of ranges and poses. Chosen.
const BEHIND_M: f32 = 0.2;

/// One ray of so many is looked along: what a quarter of the rays hit is there. Source: the share of rays that GMapping draws with.
pub const RAY_STEP: usize = 4;

impl NdtGrid<'_> {
    /// Takes evidence from what stands between the laser and `points` (robot frame), seen from `map_from_robot`.
    ///
    /// * `robot_from_lrf` — where the laser is on the robot, m
    /// * `turn` — counts the scans: of [`RAY_STEP`] rays one is looked along, each time another one
    ///
    /// Cost: O(cells on these rays). What [`insert`](Self::insert) added can no longer be removed without a trace.
    pub fn look_through(&mut self, points: &[Point2], robot_from_lrf: Point2, map_from_robot: Pose2, turn: u32) {
        let (sin, cos) = sin_cos(map_from_robot.heading);
        let eye = rotate_translate(robot_from_lrf, sin, cos, map_from_robot);
        for point in points.iter().skip(turn as usize % RAY_STEP).step_by(RAY_STEP) {
            let hit = rotate_translate(*point, sin, cos, map_from_robot);
            for layer in 0..self.layers() {
                let [from, to] = [eye, hit].map(|point| self.cell_coordinates(point, layer));
                self.look_along(Point2::new(from.0, from.1), Point2::new(to.0, to.1), layer);
            }
        }
    }

    /// The same for one ray on one layer, in cells.
    fn look_along(&mut self, eye: Point2, hit: Point2, layer: u32) {
        let (x, y) = (hit.x - eye.x, hit.y - eye.y);
        let length = hypot(x, y);
        if !(length > 0.0 && length.is_finite()) {
            return;
        }
        let behind = BEHIND_M / self.config().cell_size_m;
        let ray = Ray { direction: Point2::new(x / length, y / length), length, behind };
        for cell in cells_on_ray(eye, hit, 1.0) {
            let CellIndex { column, row } = cell;
            let centre = Point2::new(column as f32 + 0.5, row as f32 + 0.5);
            let place = self.place(column, row, layer);
            if ray.goes_through(self.gaussian_at(place), eye - centre) {
                self.change(place, CellSums::weaken);
            }
        }
    }
}

/// A ray, in cells.
struct Ray {
    direction: Point2,
    length: f32,
    /// It must have gone on for so long.
    behind: f32,
}

impl Ray {
    /// * `eye` — where it starts, seen from the cell's centre
    fn goes_through(&self, gaussian: &Gaussian, eye: Point2) -> bool {
        if gaussian.scaled[0] >= 0.0 {
            return false;
        }
        let ([xx, xy, yy], [mean_x, mean_y], d) = (gaussian.information(), gaussian.mean(), self.direction);
        let (x, y) = (eye.x - mean_x, eye.y - mean_y);
        let along = Point2::new(xx * d.x + xy * d.y, xy * d.x + yy * d.y);
        let curvature = d.x * along.x + d.y * along.y;
        let likeliest = -(x * along.x + y * along.y) / curvature;
        let (x, y) = (x + likeliest * d.x, y + likeliest * d.y);
        let distance = x * (xx * x + 2.0 * xy * y) + yy * y * y;
        let behind = (BEHIND_SIGMAS / libm::sqrtf(curvature)).max(self.behind);
        distance < THROUGH && likeliest > 0.0 && likeliest + behind < self.length
    }
}
