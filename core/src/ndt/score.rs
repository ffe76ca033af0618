//! How well a scan at a pose agrees with the cells: eq. (4.42), and its derivatives.

use nalgebra::{Matrix3, Vector3};

use super::cell::{self, Gaussian};
use super::grid::{NdtGrid, rotate_translate};
use super::tile::Place;
use crate::geometry::{Point2, Pose2};
use crate::math::{floor, sin_cos};

/// Points added up together.
const CHUNK: usize = 16;
/// Of these, evaluated together: as many as vector instructions take, one where there are none.
const LANES: usize = if cfg!(target_arch = "arm") { 1 } else { CHUNK };

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

/// How far the gradient of a score may be from the one that errors without end would average out to.
#[derive(Debug, Clone, Copy)]
pub struct Scatter {
    /// Covariance of [`Linearisation::gradient`], (x, y, heading), map frame.
    pub gradient: Matrix3<f32>,
    /// Streaks of points that it was seen from, per layer.
    pub runs: f32,
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
        let (chunks, rest) = points.as_chunks::<CHUNK>();
        let mut score = 0.0;
        let mut left = points.len() as f32;
        for chunk in chunks {
            score += self.chunk_score(chunk, CHUNK, at, layer);
            left -= CHUNK as f32;
            if score + left < at_least {
                return score;
            }
        }
        if !rest.is_empty() {
            let mut padded = [Point2::default(); CHUNK];
            padded.iter_mut().zip(rest).for_each(|(to, from)| *to = *from);
            score += self.chunk_score(&padded, rest.len(), at, layer);
        }
        score
    }

    /// Sum over the first `count` of the points, added in an order that does not depend on how many are evaluated together.
    #[inline(always)]
    #[allow(clippy::indexing_slicing, reason = "constant bounds; the form that vectorises")]
    fn chunk_score(&self, points: &[Point2; CHUNK], count: usize, at: Rotated, layer: u32) -> f32 {
        let mut density = [0.0_f32; CHUNK];
        let parts = density.as_chunks_mut::<LANES>().0.iter_mut().zip(points.as_chunks::<LANES>().0);
        for (densities, points) in parts.take(count.div_ceil(LANES)) {
            *densities = self.densities(points, at, layer);
        }
        density[count..].fill(0.0);
        let mut sum = [0.0_f32; 4];
        for i in 0..CHUNK {
            sum[i & 3] += density[i];
        }
        (sum[0] + sum[2]) + (sum[1] + sum[3])
    }

    /// Densities at the points: transformed, looked up, evaluated.
    ///
    /// Each stage is a plain loop over lanes, which the compiler turns into vector instructions; all but the look-up.
    #[inline(always)]
    #[allow(
        clippy::indexing_slicing,
        clippy::needless_range_loop,
        reason = "constant bounds; the form that vectorises"
    )]
    fn densities(&self, points: &[Point2; LANES], at: Rotated, layer: u32) -> [f32; LANES] {
        let (mut u, mut v) = ([0.0_f32; LANES], [0.0_f32; LANES]);
        let (mut column, mut row, mut place) = ([0_i32; LANES], [0_i32; LANES], [Place::default(); LANES]);
        for i in 0..LANES {
            (u[i], v[i]) = self.cell_coordinates(at.transform(points[i]), layer);
            (column[i], row[i]) = (floor(u[i]), floor(v[i]));
            let plane = self.planes().of(points[i].facing, at.pose.heading);
            place[i] = self.place(column[i], row[i], layer, plane);
        }
        let (mut mean_u, mut mean_v) = ([0_i32; LANES], [0_i32; LANES]);
        let (mut xx, mut xy2, mut yy) = ([0.0_f32; LANES], [0.0_f32; LANES], [0.0_f32; LANES]);
        for i in 0..LANES {
            let gaussian = self.gaussian_at(place[i]);
            (mean_u[i], mean_v[i]) = (i32::from(gaussian.mean[0]), i32::from(gaussian.mean[1]));
            [xx[i], xy2[i], yy[i]] = gaussian.scaled;
        }
        // A point that is evaluated alone is done here if it fell into a cell that does not count: many do while a search begins.
        if LANES == 1 && xx[0] >= 0.0 {
            return [0.0; LANES];
        }
        let mut density = [0.0_f32; LANES];
        for i in 0..LANES {
            let du = u[i] - column[i] as f32 - 0.5 - cell::in_cells(mean_u[i]);
            let dv = v[i] - row[i] as f32 - 0.5 - cell::in_cells(mean_v[i]);
            density[i] = cell::density([xx[i], xy2[i], yy[i]], du, dv);
        }
        density
    }

    /// Calls `visit` with every layer and every point's cell on it, the point's distance from the cell's mean in cells, and its place in the map.
    #[inline(always)]
    fn for_each_cell<'a>(
        &'a self,
        points: &[Point2],
        at: Rotated,
        mut visit: impl FnMut(u32, &'a Gaussian, Point2, Point2),
    ) {
        for point in points {
            let in_map = at.transform(*point);
            let plane = self.planes().of(point.facing, at.pose.heading);
            for layer in 0..self.layers() {
                let (u, v) = self.cell_coordinates(in_map, layer);
                let (column, row) = (floor(u), floor(v));
                let gaussian = self.gaussian_at(self.place(column, row, layer, plane));
                let [mean_u, mean_v] = gaussian.mean();
                let d = Point2::new(u - column as f32 - 0.5 - mean_u, v - row as f32 - 0.5 - mean_v);
                visit(layer, gaussian, d, in_map);
            }
        }
    }

    /// Score and its derivatives with respect to (x, y, heading) of `map_from_robot`.
    #[inline(never)]
    pub fn linearise(&self, points: &[Point2], map_from_robot: Pose2) -> Linearisation {
        self.sums(points, map_from_robot, None).linearisation(self.share(), self.config().cell_size_m)
    }

    /// The same, with the scatter of the gradient.
    ///
    /// Points that follow one another in a cell are off together: they share the cell's own error and what the cell does not
    /// say of the wall's form. So each such run is one witness: the scatter is the sum over runs of the outer product of what a run adds
    /// to the gradient, averaged over the layers, which see the same points and are taken as fully dependent.
    ///
    /// Source: Liang & Zeger 1986 (clusters of dependent errors); a cluster is a run here.
    pub fn linearise_with_scatter(&self, points: &[Point2], map_from_robot: Pose2) -> (Linearisation, Scatter) {
        let mut runs = Streaks::default();
        let sums = self.sums(points, map_from_robot, Some(&mut runs));
        let (share, cell_size_m) = (self.share(), self.config().cell_size_m);
        runs.open.iter_mut().for_each(|run| run.close(&mut runs.scatter));
        let gradient = in_si(runs.scatter, cell_size_m) * share;
        (sums.linearisation(share, cell_size_m), Scatter { gradient, runs: runs.count * share })
    }

    fn share(&self) -> f32 {
        1.0 / self.layers() as f32
    }

    /// One copy for both: flash is dear on a small robot.
    #[inline(never)]
    fn sums<'a>(&'a self, points: &[Point2], map_from_robot: Pose2, mut runs: Option<&mut Streaks<'a>>) -> Sums {
        let mut sums = Sums::default();
        self.for_each_cell(points, Rotated::new(map_from_robot), |layer, gaussian, d, in_map| {
            let arm = Point2::new(in_map.x - map_from_robot.x, in_map.y - map_from_robot.y);
            let slope = sums.add(gaussian, d, arm * (1.0 / self.config().cell_size_m));
            if let (Some(runs), Some(slope)) = (&mut runs, slope) {
                runs.add(layer, gaussian, slope);
            }
        });
        sums
    }

    /// What the cells at a place of the map say about each direction, 0 to 1, as (xx, xy, yy), averaged over those layers of all planes that have one; `None` if
    /// none has.
    #[inline(never)]
    pub(crate) fn worth_at(&self, in_map: Point2) -> Option<[f32; 3]> {
        let mut sum = [0.0_f32; 3];
        let mut count = 0.0_f32;
        let grids = (0..self.planes().count()).flat_map(|plane| (0..self.layers()).map(move |layer| (layer, plane)));
        for (layer, plane) in grids {
            let (u, v) = self.cell_coordinates(in_map, layer);
            let gaussian = self.gaussian_at(self.place(floor(u), floor(v), layer, plane));
            if gaussian.counts() {
                count += 1.0;
                sum.iter_mut().zip(gaussian.worth(self.config())).for_each(|(sum, term)| *sum += term);
            }
        }
        (count > 0.0).then(|| sum.map(|element| element / count))
    }

    /// How much the matched points say about each direction: Σ s (w_n n nᵀ + w_t t tᵀ) / Σ s as (xx, xy, yy).
    ///
    /// n and t are the axes of a cell's distribution and w their worth, 1 for an axis of 4 cm or less, whatever `noise_m` adds to it, and 0
    /// for one as wide as points spread evenly over the cell, or over what the cell cuts from a wall: a wall speaks for its normal only,
    /// however it lies and however finely the cells cut it up, a pillar for both axes. A small eigenvalue means that the scene leaves its axis undetermined.
    // One copy for all who ask: flash is dear on a small robot.
    #[inline(never)]
    pub fn constraint(&self, points: &[Point2], map_from_robot: Pose2) -> [f32; 3] {
        let mut sum = [0.0_f32; 3];
        let mut total = 1e-9_f32;
        self.for_each_cell(points, Rotated::new(map_from_robot), |_, gaussian, d, _| {
            let density = gaussian.density(d);
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

/// Sums over points of a [`Linearisation`], lengths in cells: symmetric matrices as (xx, xy, xh, yy, yh, hh).
#[derive(Default)]
struct Sums {
    score: f32,
    gradient: [f32; 3],
    information: [f32; 6],
    /// What the Hessian has less than the information.
    rest: [f32; 6],
}

impl Sums {
    /// Adds one point at `d` from the cell's mean and at `arm` from the robot's centre (map axes); returns what it takes from the gradient.
    #[inline(always)]
    fn add(&mut self, gaussian: &Gaussian, d: Point2, arm: Point2) -> Option<[f32; 3]> {
        let s = gaussian.density(d);
        if s <= 0.0 {
            return None;
        }
        let [xx, xy, yy] = gaussian.information();
        let pull = Point2::new(xx * d.x + xy * d.y, xy * d.x + yy * d.y);
        // J = (1 0 −arm.y; 0 1 arm.x); Σ⁻¹ times its third column:
        let turn = Point2::new(xy * arm.x - xx * arm.y, yy * arm.x - xy * arm.y);
        let slope = [pull.x, pull.y, pull.y * arm.x - pull.x * arm.y];
        let curvature = [xx, xy, turn.x, yy, turn.y, turn.y * arm.x - turn.x * arm.y];
        let bend = pull.x * arm.x + pull.y * arm.y;
        let [x, y, h] = [s * slope[0], s * slope[1], s * slope[2]];
        let rest = [x * pull.x, x * pull.y, x * slope[2], y * pull.y, y * slope[2], h * slope[2] + s * bend];
        self.score += s;
        self.gradient.iter_mut().zip([x, y, h]).for_each(|(sum, term)| *sum -= term);
        self.information.iter_mut().zip(curvature).for_each(|(sum, term)| *sum += s * term);
        self.rest.iter_mut().zip(rest).for_each(|(sum, term)| *sum += term);
        Some([x, y, h])
    }

    /// `share` of the sums, with a cell's side in m.
    #[inline(never)]
    fn linearisation(&self, share: f32, cell_size_m: f32) -> Linearisation {
        let per_m = 1.0 / cell_size_m;
        let lengths = Vector3::new(per_m, per_m, 1.0);
        let symmetric = |matrix| in_si(matrix, cell_size_m) * share;
        let information = symmetric(self.information);
        Linearisation {
            score: self.score * share,
            gradient: Vector3::from(self.gradient).component_mul(&lengths) * share,
            information,
            hessian: information - symmetric(self.rest),
        }
    }
}

/// A symmetric matrix of [`Sums`] per m and rad instead of cells.
#[inline(never)]
fn in_si([xx, xy, xh, yy, yh, hh]: [f32; 6], cell_size_m: f32) -> Matrix3<f32> {
    let per_m = 1.0 / cell_size_m;
    let lengths = Vector3::new(per_m, per_m, 1.0);
    let units = lengths * lengths.transpose();
    Matrix3::new(xx, xy, xh, xy, yy, yh, xh, yh, hh).component_mul(&units)
}

/// Points that follow one another in a cell, the last ones on each layer, and the scatter of those before; lengths in cells.
#[derive(Default)]
struct Streaks<'a> {
    open: [Streak<'a>; 4],
    scatter: [f32; 6],
    count: f32,
}

#[derive(Default)]
struct Streak<'a> {
    cell: Option<&'a Gaussian>,
    slope: [f32; 3],
}

impl<'a> Streaks<'a> {
    #[inline(never)]
    fn add(&mut self, layer: u32, gaussian: &'a Gaussian, slope: [f32; 3]) {
        let Some(run) = self.open.get_mut(layer as usize) else { return };
        if !run.cell.is_some_and(|cell| core::ptr::eq(cell, gaussian)) {
            run.close(&mut self.scatter);
            run.cell = Some(gaussian);
            self.count += 1.0;
        }
        run.slope.iter_mut().zip(slope).for_each(|(sum, term)| *sum += term);
    }
}

impl Streak<'_> {
    #[inline(never)]
    fn close(&mut self, scatter: &mut [f32; 6]) {
        let [x, y, h] = core::mem::take(&mut self.slope);
        scatter.iter_mut().zip([x * x, x * y, x * h, y * y, y * h, h * h]).for_each(|(sum, term)| *sum += term);
    }
}
