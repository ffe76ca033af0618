//! How well a scan at a pose agrees with the cells: eq. (4.42), and its derivatives.

use nalgebra::{Matrix3, Vector3};

use super::cell::Gaussian;
use super::grid::{NdtGrid, rotate_translate};
use crate::geometry::{Point2, Pose2};
use crate::math::{exp2_neg, sin_cos};

/// Points evaluated together.
const LANES: usize = 16;

/// Score of a scan at a pose with its first and second derivatives.
#[derive(Debug, Clone, Copy)]
pub struct Linearisation {
    /// Eq. (4.42), averaged over the layers.
    pub score: f32,
    /// ∂score/∂(x, y, heading), map frame.
    pub gradient: Vector3<f32>,
    /// Gauss–Newton approximation of −∂²score: Σ s Jᵀ Σ⁻¹ J, positive semi-definite.
    pub information: Matrix3<f32>,
    /// −∂²score itself, as Newton's method (Biber) has it; indefinite away from the optimum.
    pub hessian: Matrix3<f32>,
}

/// The pose of a robot with its heading's sine and cosine.
#[derive(Clone, Copy)]
struct Rotated {
    pose: Pose2,
    sin: f32,
    cos: f32,
}

impl Rotated {
    fn new(pose: Pose2) -> Self {
        let (sin, cos) = sin_cos(pose.heading);
        Self { pose, sin, cos }
    }

    #[inline(always)]
    fn transform(&self, point: Point2) -> Point2 {
        rotate_translate(point, self.sin, self.cos, self.pose)
    }
}

impl NdtGrid<'_> {
    /// Score of `points` (robot frame) at `map_from_robot`, eq. (4.42), averaged over the layers; 0 to the number of points.
    pub fn score(&self, points: &[Point2], map_from_robot: Pose2) -> f32 {
        let sum: f32 = (0..self.layers()).map(|layer| self.layer_score(points, map_from_robot, layer, 0.0)).sum();
        sum / self.layers() as f32
    }

    /// The score on the first layer alone: what a search evaluates thousands of times.
    ///
    /// Gives up and returns some value below `at_least` as soon as it is clear that the score is below that, a point
    /// counting 1 at most. Cost O(points).
    pub fn search_score(&self, points: &[Point2], map_from_robot: Pose2, at_least: f32) -> f32 {
        self.layer_score(points, map_from_robot, 0, at_least)
    }

    fn layer_score(&self, points: &[Point2], map_from_robot: Pose2, layer: u32, at_least: f32) -> f32 {
        if self.tiles_used() == 0 {
            return 0.0; // a robot's first scan is searched for in nothing
        }
        let at = Rotated::new(map_from_robot);
        let (chunks, rest) = points.as_chunks::<LANES>();
        let mut score = 0.0;
        let mut left = points.len() as f32;
        for chunk in chunks {
            score += self.chunk_score(chunk, LANES, at, layer);
            left -= LANES as f32;
            if score + left < at_least {
                return score;
            }
        }
        if !rest.is_empty() {
            let mut padded = [Point2::default(); LANES];
            padded.iter_mut().zip(rest).for_each(|(to, from)| *to = *from);
            score += self.chunk_score(&padded, rest.len(), at, layer);
        }
        score
    }

    /// Sum over the first `count` of the points: transformed, looked up, evaluated.
    ///
    /// Each stage is a plain loop over lanes, which the compiler turns into vector instructions; all but the look-up. The
    /// lanes are added in a fixed order, so that the result is the same bits with and without them.
    #[inline(always)]
    #[allow(
        clippy::indexing_slicing,
        clippy::needless_range_loop,
        reason = "constant bounds; the form that vectorises"
    )]
    fn chunk_score(&self, points: &[Point2; LANES], count: usize, at: Rotated, layer: u32) -> f32 {
        let (mut x, mut y) = ([0.0_f32; LANES], [0.0_f32; LANES]);
        let (mut column, mut row) = ([0_i32; LANES], [0_i32; LANES]);
        for i in 0..LANES {
            let in_map = at.transform(points[i]);
            (x[i], y[i]) = (in_map.x, in_map.y);
            (column[i], row[i]) = self.cell_of(in_map, layer);
        }
        let (mut mean_x, mut mean_y) = ([0.0_f32; LANES], [0.0_f32; LANES]);
        let (mut xx, mut xy2, mut yy) = ([0.0_f32; LANES], [0.0_f32; LANES], [0.0_f32; LANES]);
        let mut weight = [0.0_f32; LANES];
        for i in 0..LANES {
            let gaussian = self.gaussian_at(self.place(column[i], row[i], layer));
            (mean_x[i], mean_y[i]) = (gaussian.mean.x, gaussian.mean.y);
            [xx[i], xy2[i], yy[i]] = gaussian.scaled;
            weight[i] = gaussian.weight;
        }
        let mut density = [0.0_f32; LANES];
        for i in 0..LANES {
            let (dx, dy) = (x[i] - mean_x[i], y[i] - mean_y[i]);
            density[i] = weight[i] * exp2_neg(dx * (xx[i] * dx + xy2[i] * dy) + yy[i] * dy * dy);
        }
        density[count..].fill(0.0);
        let mut sum = [0.0_f32; 4];
        for i in 0..LANES {
            sum[i & 3] += density[i];
        }
        (sum[0] + sum[2]) + (sum[1] + sum[3])
    }

    /// Calls `visit` with every point's cell on every layer, and the point's place in the map.
    fn for_each_cell(&self, points: &[Point2], at: Rotated, mut visit: impl FnMut(&Gaussian, Point2)) {
        for point in points {
            let in_map = at.transform(*point);
            for layer in 0..self.layers() {
                let (column, row) = self.cell_of(in_map, layer);
                visit(self.gaussian_at(self.place(column, row, layer)), in_map);
            }
        }
    }

    /// Score and its derivatives with respect to (x, y, heading) of `map_from_robot`.
    pub fn linearise(&self, points: &[Point2], map_from_robot: Pose2) -> Linearisation {
        let mut sum = Linearisation {
            score: 0.0,
            gradient: Vector3::zeros(),
            information: Matrix3::zeros(),
            hessian: Matrix3::zeros(),
        };
        let share = 1.0 / self.layers() as f32;
        self.for_each_cell(points, Rotated::new(map_from_robot), |gaussian, in_map| {
            let arm = Point2::new(in_map.x - map_from_robot.x, in_map.y - map_from_robot.y);
            sum.add(gaussian, in_map - gaussian.mean, arm, share);
        });
        sum
    }

    /// How much the matched points say about each direction: Σ s (w_n n nᵀ + w_t t tᵀ) / Σ s as (xx, xy, yy).
    ///
    /// n and t are the axes of a cell's distribution and w their worth, 1 for an axis as narrow as the laser's noise and 0
    /// for one as wide as points spread evenly over the cell: a wall speaks for its normal only, however finely the cells
    /// cut it up, a pillar for both axes. A small eigenvalue means that the scene leaves its axis undetermined.
    pub fn constraint(&self, points: &[Point2], map_from_robot: Pose2) -> [f32; 3] {
        let mut sum = [0.0_f32; 3];
        let mut total = 1e-9_f32;
        self.for_each_cell(points, Rotated::new(map_from_robot), |gaussian, in_map| {
            let density = gaussian.density(in_map - gaussian.mean);
            if density > 0.0 {
                total += density;
                for (element, term) in sum.iter_mut().zip(gaussian.worth(self.config())) {
                    *element += density * term;
                }
            }
        });
        sum.map(|element| element / total)
    }
}

impl Linearisation {
    /// Adds one point at `d` from the cell's mean and at `arm` from the robot's centre (map axes).
    fn add(&mut self, gaussian: &Gaussian, d: Point2, arm: Point2, share: f32) {
        let s = share * gaussian.density(d);
        if s <= 0.0 {
            return;
        }
        let [xx, xy, yy] = gaussian.information();
        let pull = Point2::new(xx * d.x + xy * d.y, xy * d.x + yy * d.y);
        // J = (1 0 −arm.y; 0 1 arm.x); Σ⁻¹ times its third column:
        let turn = Point2::new(xy * arm.x - xx * arm.y, yy * arm.x - xy * arm.y);
        let turn_turn = turn.y * arm.x - turn.x * arm.y;
        let slope = Vector3::new(pull.x, pull.y, pull.y * arm.x - pull.x * arm.y);
        let curvature = Matrix3::new(xx, xy, turn.x, xy, yy, turn.y, turn.x, turn.y, turn_turn);
        let bend = Matrix3::from_diagonal(&Vector3::new(0.0, 0.0, pull.x * arm.x + pull.y * arm.y));
        self.score += s;
        self.gradient -= slope * s;
        self.information += curvature * s;
        self.hessian += (curvature - slope * slope.transpose() - bend) * s;
    }
}
