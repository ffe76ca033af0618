//! What rays go through is not there: people who walked on, doors that opened, walls drawn at a wrong pose.
//!
//! A ray takes evidence from every cell whose distribution it went through, until the cell is gone. It went through if it passed the
//! mean within [`THROUGH`], and went on behind it for [`BEHIND_SIGMAS`] of the distribution: of a wall, across it. So a ray that ends on
//! a wall does not speak against it, however flat it meets it.
//!
//! Source: Saarinen, Andreasson, Stoyanov & Lilienthal, *3D normal distributions transform occupancy maps*, IJRR 2013: where along a ray a
//! distribution is likeliest. Departure: evidence is the number of points itself.

use super::cell::{CellSums, Gaussian};
use super::grid::{NdtGrid, rotate_translate};
#[cfg(feature = "witnesses")]
use super::tile::NdtTile;
use super::tile::Place;
use crate::geometry::{Point2, Pose2};
use crate::grid::{CellIndex, cells_on_ray};
#[cfg(feature = "witnesses")]
use crate::math::floor;
use crate::math::{hypot, sin_cos};

/// Squared Mahalanobis distance from the mean below which a ray goes through a distribution: half of its density. Chosen.
const THROUGH: f32 = 1.4;
/// A ray went through if it went on for so many standard deviations. Chosen.
const BEHIND_SIGMAS: f32 = 3.0;
/// And at least so far, m: the error of ranges and poses. Chosen.
const BEHIND_M: f32 = 0.2;

/// A distribution is a wall if half the difference of its axes' information is more than this share of half their sum. Chosen.
const WALL_SHARE: f32 = 0.6;
/// One ray of so many is looked along: what a quarter of the rays hit is there. Source: the share of rays that GMapping draws with.
const RAY_STEP: usize = 4;

impl NdtGrid<'_> {
    /// Takes evidence from what stands between the laser and `points` (robot frame), seen from `map_from_robot`.
    ///
    /// * `robot_from_lrf` — where the laser is on the robot, m
    /// * `turn` — counts the scans: one of four rays is looked along, each time another one
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
        let Some(ray) = Ray::new(eye, hit, self.config().cell_size_m) else { return };
        for cell in cells_on_ray(eye, hit, 1.0) {
            let first = self.place(cell.column, cell.row, layer, 0);
            let through = self.planes_through(&ray, first, cell);
            if through != 0 {
                for place in first.in_planes(through) {
                    self.change(place, CellSums::weaken);
                }
                self.refresh(first, through);
            }
        }
    }

    /// Those planes, as bits, where a ray goes through what a cell holds.
    #[inline(always)]
    fn planes_through(&self, ray: &Ray, first: Place, cell: CellIndex) -> u32 {
        // Mostly the planes of one wall, which have the same points.
        let mut last = (Gaussian::EMPTY, 0);
        let mut through = 0;
        for (plane, tile) in self.tiles_at(first).enumerate() {
            let Some(gaussian) = tile.and_then(|tile| tile.gaussians.get(first.cell as usize)) else { continue };
            if !gaussian.counts() {
                continue;
            }
            if *gaussian != last.0 {
                last = (*gaussian, u32::from(ray.goes_through(gaussian, cell)));
            }
            through |= last.1 << plane;
        }
        through
    }

    /// True if somebody has seen something at a place of the map, or so near that a cell of it reaches there.
    #[cfg(feature = "witnesses")]
    pub(crate) fn is_seen_at(&self, in_map: Point2) -> bool {
        (0..self.layers()).any(|layer| {
            let (u, v) = self.cell_coordinates(in_map, layer);
            self.planes_seen(self.place(floor(u), floor(v), layer, 0)) != 0
        })
    }

    /// Those planes, as bits, where a cell holds what was seen.
    #[cfg(feature = "witnesses")]
    fn planes_seen(&self, first: Place) -> u32 {
        let is_seen = |tile: &NdtTile| tile.sums.get(first.cell as usize).is_some_and(CellSums::is_seen);
        self.tiles_at(first)
            .enumerate()
            .fold(0, |seen, (plane, tile)| seen | (u32::from(tile.is_some_and(is_seen)) << plane))
    }

    /// True if a ray from `eye` to `hit`, both in the map, would have to go through what was seen there.
    #[cfg(feature = "witnesses")]
    pub(crate) fn stands_between(&self, eye: Point2, hit: Point2) -> bool {
        let [eye, hit] = [eye, hit].map(|point| self.cell_coordinates(point, 0)).map(|(u, v)| Point2::new(u, v));
        let Some(ray) = Ray::new(eye, hit, self.config().cell_size_m) else { return false };
        let is_through = |cell: CellIndex| {
            let first = self.place(cell.column, cell.row, 0, 0);
            let through = self.planes_through(&ray, first, cell);
            through != 0 && through & self.planes_seen(first) != 0
        };
        cells_on_ray(eye, hit, 1.0).any(is_through)
    }
}

/// A ray, in cells.
struct Ray {
    eye: Point2,
    direction: Point2,
    length: f32,
    /// It must have gone on for so long.
    behind: f32,
}

impl Ray {
    /// `None` if it has no direction.
    fn new(eye: Point2, hit: Point2, cell_size_m: f32) -> Option<Self> {
        let (x, y) = (hit.x - eye.x, hit.y - eye.y);
        let length = hypot(x, y);
        let has_direction = length > 0.0 && length.is_finite();
        let direction = Point2::new(x / length, y / length);
        has_direction.then_some(Self { eye, direction, length, behind: BEHIND_M / cell_size_m })
    }

    fn goes_through(&self, gaussian: &Gaussian, CellIndex { column, row }: CellIndex) -> bool {
        let ([xx, xy, yy], [mean_x, mean_y], d) = (gaussian.information(), gaussian.mean(), self.direction);
        // Where it starts, seen from the cell's centre.
        let eye = self.eye - Point2::new(column as f32 + 0.5, row as f32 + 0.5);
        let (x, y) = (eye.x - mean_x, eye.y - mean_y);
        let along = Point2::new(xx * d.x + xy * d.y, xy * d.x + yy * d.y);
        let curvature = d.x * along.x + d.y * along.y;
        let likeliest = -(x * along.x + y * along.y) / curvature;
        let (x, y) = (x + likeliest * d.x, y + likeliest * d.y);
        let distance = x * (xx * x + 2.0 * xy * y) + yy * y * y;
        if distance >= THROUGH || likeliest <= 0.0 || likeliest + self.behind >= self.length {
            return false;
        }
        let (half_trace, half_difference) = (0.5 * (xx + yy), 0.5 * (xx - yy));
        let radius = hypot(half_difference, xy);
        let sigmas_per_cell = if radius > WALL_SHARE * half_trace {
            // The cell cuts the wall off, so only its normal counts: (d·n)² of the sharper axis.
            let cos2 = (half_difference * (d.x * d.x - d.y * d.y) + 2.0 * xy * d.x * d.y) / radius;
            libm::sqrtf((half_trace + radius) * 0.5 * (1.0 + cos2).max(0.0))
        } else {
            libm::sqrtf(curvature)
        };
        likeliest + BEHIND_SIGMAS / sigmas_per_cell.max(1e-6) < self.length
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ndt::{DirectoryEntry, NdtConfig, NdtTile};
    use std::vec;
    use std::vec::Vec;

    fn line(from: (f32, f32), to: (f32, f32), count: usize) -> Vec<Point2> {
        let share = |i: usize| i as f32 / (count - 1) as f32;
        (0..count)
            .map(|i| Point2::new(from.0 + (to.0 - from.0) * share(i), from.1 + (to.1 - from.1) * share(i)))
            .collect()
    }

    fn after_looking(standing: &[Point2], hits: &[Point2], times: u32) -> (f32, f32) {
        let mut directory = vec![DirectoryEntry::EMPTY; NdtConfig::default().directories() * 64 * 64];
        let mut tiles = vec![NdtTile::EMPTY; 4000];
        let mut grid = NdtGrid::new(&NdtConfig::default(), &mut directory, &mut tiles).unwrap();
        (0..5).for_each(|_| {
            grid.insert(standing, Pose2::IDENTITY);
        });
        let before = grid.score(standing, Pose2::IDENTITY);
        (0..times).for_each(|turn| grid.look_through(hits, Point2::default(), Pose2::IDENTITY, turn));
        (before, grid.score(standing, Pose2::IDENTITY))
    }

    #[test]
    fn who_walked_on_is_gone_when_the_wall_behind_is_seen() {
        let somebody = line((2.0, -0.2), (2.0, 0.2), 20);
        let wall = line((4.0, -2.0), (4.0, 2.0), 81);
        let (before, after) = after_looking(&somebody, &wall, 40);
        assert!(before > 10.0 && after < 0.5, "{before} {after}");
    }

    /// Three points beside one that was seen make a cell; three that were seen make known ground.
    #[cfg(feature = "witnesses")]
    #[test]
    fn what_is_supposed_is_no_known_ground_and_no_wall_before_it() {
        let mut directory = vec![DirectoryEntry::EMPTY; NdtConfig::default().directories() * 64 * 64];
        let mut tiles = vec![NdtTile::EMPTY; 4000];
        let mut grid = NdtGrid::new(&NdtConfig::default(), &mut directory, &mut tiles).unwrap();
        let [eye, wall, behind] = [0.0, 2.1, 6.0].map(|x| Point2::new(x, 0.1));
        grid.insert(&[wall], Pose2::IDENTITY);
        grid.fill(&line((2.1, 0.0), (2.1, 0.2), 3), Pose2::IDENTITY);
        assert!(grid.score(&[wall], Pose2::IDENTITY) > 0.5);
        assert!(!grid.is_seen_at(wall) && !grid.stands_between(eye, behind));
        (0..2).for_each(|_| {
            grid.insert(&[wall], Pose2::IDENTITY);
        });
        assert!(grid.is_seen_at(wall) && grid.stands_between(eye, behind));
    }

    /// However flat the rays meet it.
    #[test]
    fn a_wall_does_not_wear_off_by_being_looked_at() {
        let wall = line((0.5, 0.4), (9.0, 0.4), 200);
        let noisy: Vec<Point2> =
            wall.iter().enumerate().map(|(i, point)| Point2::new(point.x, point.y + 0.02 * (i % 3) as f32)).collect();
        let (before, after) = after_looking(&wall, &noisy, 200);
        assert!(after > 0.98 * before, "{before} {after}");
    }
}
