//! Exhaustive search for a pose: the best of all in a window, and proof that there is no second one as good.
//!
//! Points of one map are laid over a grid that says how near the other map's points are. Poses are searched coarse to fine
//! by branch and bound: a coarse pose's score, on grids of maxima, is no less than any fine pose's within it, so whole regions are ruled
//! out at once and the result is that of trying every pose. Differential evolution finds the optimum in a box of a metre;
//! over tens of metres it may miss it, and cannot say that a second one is missing.
//!
//! Source: Hess, Kohler, Rapp & Andor, *Real-time loop closure in 2D LIDAR SLAM*, ICRA 2016; Olson, ICRA 2009.

use lrfslam_core::geometry::{Point2, Pose2};
use lrfslam_core::math::wrap_angle;

/// Edge of a cell of the finest grid, m.
const CELL_M: f32 = 0.1;
/// Coarsest poses are 2⁶ cells apart.
const LEVELS: usize = 7;
/// How likely a point is by its distance from the nearest point of the map: standard deviation, m.
const SIGMA_M: f32 = 0.12;
/// Cells about a point that are marked.
const MARKED: i32 = 3;
/// Points farther away turn by more than a cell from one tried heading to the next, m.
const LEVER_M: f32 = 12.0;

/// Where to search.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SearchWindow {
    /// Its centre.
    pub centre: Pose2,
    /// To each side along both axes, m.
    pub distance_m: f32,
    /// To each side, rad.
    pub heading_rad: f32,
}

impl SearchWindow {
    /// All headings, and the square about `points`.
    pub fn about(points: &[Point2]) -> Self {
        let (mut low, mut high) = (Point2::new(f32::MAX, f32::MAX), Point2::new(f32::MIN, f32::MIN));
        for point in points {
            low = Point2::new(low.x.min(point.x), low.y.min(point.y));
            high = Point2::new(high.x.max(point.x), high.y.max(point.y));
        }
        let (centre, size) = ((low + high) * 0.5, high - low);
        let distance_m = (0.5 * size.x.max(size.y)).max(0.0);
        Self { centre: Pose2::new(centre.x, centre.y, 0.0), distance_m, heading_rad: std::f32::consts::PI }
    }
}

/// A pose and how well points fit there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Found {
    /// Frame of the points in the frame of the grid.
    pub pose: Pose2,
    /// Mean likelihood of a point, 0 to 1.
    pub share: f32,
}

/// Poses that do not count.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Excluded {
    /// About this pose.
    pub pose: Pose2,
    /// Nearer than this, m …
    pub distance_m: f32,
    /// … and turned by less than this, rad.
    pub heading_rad: f32,
}

/// How near the points of a map are to any place; see the [module](self).
#[derive(Debug, Clone)]
pub struct CorrelationGrid {
    /// Of the lower left cell.
    column: i32,
    row: i32,
    width: i32,
    height: i32,
    /// Entry (x, y) of level h is the maximum over the 2ʰ × 2ʰ cells from (x, y) on.
    levels: Vec<Vec<u8>>,
}

/// A region of poses: one heading, and a square of positions.
#[derive(Debug, Clone, Copy)]
struct Region {
    score: u32,
    heading: usize,
    x: i32,
    y: i32,
}

impl CorrelationGrid {
    /// The grid of `points`; `None` without any, or if they lie more than some hundred metres apart.
    pub fn new(points: &[Point2]) -> Option<Self> {
        let cells: Vec<(i32, i32)> = points.iter().map(|point| cell_of(*point)).collect();
        let span = |of: &dyn Fn(&(i32, i32)) -> i32| Some((cells.iter().map(of).min()?, cells.iter().map(of).max()?));
        let ((left, right), (low, high)) = (span(&|cell| cell.0)?, span(&|cell| cell.1)?);
        // A maximum over cells to the right and above is asked for from as far to the left and below.
        let (margin, reach) = (MARKED, 1 << (LEVELS - 1));
        let (column, row) = (left - margin - reach, low - margin - reach);
        let (width, height) = (right + margin + 1 - column, high + margin + 1 - row);
        if width.max(height) > 4096 {
            return None;
        }
        let mut finest = vec![0_u8; (width * height) as usize];
        for (x, y) in cells {
            for (dx, dy) in (-MARKED..=MARKED).flat_map(|dx| (-MARKED..=MARKED).map(move |dy| (dx, dy))) {
                let off = ((dx * dx + dy * dy) as f32).sqrt() * CELL_M / SIGMA_M;
                let value = (255.0 * (-0.5 * off * off).exp()) as u8;
                let cell = &mut finest[((y + dy - row) * width + x + dx - column) as usize];
                *cell = value.max(*cell);
            }
        }
        let mut grid = Self { column, row, width, height, levels: vec![finest] };
        (1..LEVELS).for_each(|level| grid.levels.push(grid.coarser(level - 1)));
        Some(grid)
    }

    /// Maxima over squares twice as large as those of `level`.
    fn coarser(&self, level: usize) -> Vec<u8> {
        let (side, fine) = (1 << level, &self.levels[level]);
        let mut coarse = vec![0; fine.len()];
        for y in 0..self.height {
            let row = (y * self.width) as usize;
            let above = ((y + side).min(self.height - 1) * self.width) as usize;
            for x in 0..self.width as usize {
                let right = (x + side as usize).min(self.width as usize - 1);
                let maximum = fine[row + x].max(fine[row + right]).max(fine[above + x]).max(fine[above + right]);
                coarse[row + x] = maximum;
            }
        }
        coarse
    }

    /// The best pose in `window` at which the mean likelihood of `points` is more than `share_min`, if there is one.
    ///
    /// Deterministic; cost depends on how peaked the scores are.
    pub fn search(
        &self,
        points: &[Point2],
        window: &SearchWindow,
        share_min: f32,
        excluded: Option<Excluded>,
    ) -> Option<Found> {
        let headings = headings(points, window);
        let cells: Vec<Vec<(i32, i32)>> = headings.iter().map(|heading| rotated(points, window, *heading)).collect();
        let mut search = Search { grid: self, window, headings: &headings, cells: &cells, excluded, best: None };
        let mut limit = (share_min * 255.0 * points.len() as f32) as u32;
        let top = LEVELS - 1;
        let side = (window.distance_m / CELL_M).ceil() as i32;
        let steps = || (-side..=side).step_by(1 << top);
        let places =
            (0..headings.len()).flat_map(|heading| steps().flat_map(move |x| steps().map(move |y| (heading, x, y))));
        let regions = places.map(|(heading, x, y)| search.region(top, heading, x, y)).collect();
        search.descend(top, side, regions, &mut limit);
        let best = search.best?;
        let share = best.score as f32 / (255.0 * points.len().max(1) as f32);
        Some(Found { pose: search.pose(&best), share })
    }

    #[inline]
    fn at(&self, level: usize, x: i32, y: i32) -> u32 {
        let (x, y) = (x - self.column, y - self.row);
        let inside = x >= 0 && y >= 0 && x < self.width && y < self.height;
        if inside { u32::from(self.levels[level][(y * self.width + x) as usize]) } else { 0 }
    }
}

/// A search under way.
struct Search<'a> {
    grid: &'a CorrelationGrid,
    window: &'a SearchWindow,
    headings: &'a [f32],
    /// The points' cells at each heading, at the window's centre.
    cells: &'a [Vec<(i32, i32)>],
    excluded: Option<Excluded>,
    best: Option<Region>,
}

impl Search<'_> {
    fn region(&self, level: usize, heading: usize, x: i32, y: i32) -> Region {
        let cells = &self.cells[heading];
        let score = cells.iter().map(|(column, row)| self.grid.at(level, column + x, row + y)).sum();
        Region { score, heading, x, y }
    }

    /// Looks into `regions`, the most promising first, as long as one can be better than `limit`.
    fn descend(&mut self, level: usize, side: i32, mut regions: Vec<Region>, limit: &mut u32) {
        regions.sort_by_key(|region| (std::cmp::Reverse(region.score), region.heading, region.x, region.y));
        for region in regions {
            if region.score <= *limit {
                return;
            }
            if level == 0 {
                if !self.is_excluded(&region) {
                    (*limit, self.best) = (region.score, Some(region));
                    return;
                }
                continue;
            }
            let half = 1 << (level - 1);
            let corners = [(0, 0), (half, 0), (0, half), (half, half)].map(|(x, y)| (region.x + x, region.y + y));
            let inside = corners.into_iter().filter(|(x, y)| *x <= side && *y <= side);
            let parts = inside.map(|(x, y)| self.region(level - 1, region.heading, x, y)).collect();
            self.descend(level - 1, side, parts, limit);
        }
    }

    fn pose(&self, region: &Region) -> Pose2 {
        let Pose2 { x, y, .. } = self.window.centre;
        Pose2::new(x + region.x as f32 * CELL_M, y + region.y as f32 * CELL_M, self.headings[region.heading])
    }

    fn is_excluded(&self, region: &Region) -> bool {
        let pose = self.pose(region);
        self.excluded.is_some_and(|excluded| {
            (pose.position() - excluded.pose.position()).norm() < excluded.distance_m
                && wrap_angle(pose.heading - excluded.pose.heading).abs() < excluded.heading_rad
        })
    }
}

fn cell_of(point: Point2) -> (i32, i32) {
    ((point.x / CELL_M).floor() as i32, (point.y / CELL_M).floor() as i32)
}

/// Headings so near to each other that no point moves by much more than a cell from one to the next.
fn headings(points: &[Point2], window: &SearchWindow) -> Vec<f32> {
    let farthest = points.iter().map(|point| point.norm()).fold(1.0, f32::max).min(LEVER_M);
    let count = (window.heading_rad / (CELL_M / farthest)).ceil() as i32;
    let step = if count > 0 { window.heading_rad / count as f32 } else { 0.0 };
    (-count..=count).map(|index| window.centre.heading + step * index as f32).collect()
}

fn rotated(points: &[Point2], window: &SearchWindow, heading: f32) -> Vec<(i32, i32)> {
    let pose = Pose2::new(window.centre.x, window.centre.y, heading);
    points.iter().map(|point| cell_of(pose.transform(*point))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use lrfslam_core::math::{normal, uniform};
    use lrfslam_core::random::RandomStream;

    /// Corners of walls at random.
    fn scene(seed: u64) -> Vec<Point2> {
        let mut rng = RandomStream::new(seed, 0, 0);
        let mut points = Vec::new();
        for _ in 0..12 {
            let (x, y) = (20.0 * uniform(&mut rng) - 10.0, 20.0 * uniform(&mut rng) - 10.0);
            let turned = uniform(&mut rng) > 0.5;
            let along =
                |i| if turned { Point2::new(x + 0.1 * i as f32, y) } else { Point2::new(x, y + 0.1 * i as f32) };
            points.extend((0..20).map(along));
        }
        points
    }

    #[test]
    fn a_pose_far_away_is_found() {
        for seed in 1..=5 {
            let mut rng = RandomStream::new(seed, 1, 0);
            let map = scene(seed);
            let truth = Pose2::new(5.0 * uniform(&mut rng), -4.0 * uniform(&mut rng), 0.3 * uniform(&mut rng));
            let mut seen = |point: &Point2| {
                truth.inverse().transform(*point) + Point2::new(0.02 * normal(&mut rng), 0.02 * normal(&mut rng))
            };
            let points: Vec<Point2> = map.iter().step_by(2).map(&mut seen).collect();
            let window = SearchWindow { centre: Pose2::IDENTITY, distance_m: 6.0, heading_rad: 0.35 };
            let grid = CorrelationGrid::new(&map).unwrap();
            let found = grid.search(&points, &window, 0.3, None).unwrap();
            let error = truth.between(found.pose);
            assert!(error.position().norm() < 0.15 && error.heading.abs() < 0.015 && found.share > 0.6, "{error:?}");
            let excluded = Excluded { pose: found.pose, distance_m: 1.0, heading_rad: 0.2 };
            assert!(grid.search(&points, &window, 0.8 * found.share, Some(excluded)).is_none());
        }
    }

    #[test]
    fn branch_and_bound_finds_what_trying_everything_finds() {
        let map = scene(7);
        let points: Vec<Point2> = scene(8).into_iter().step_by(5).collect();
        let grid = CorrelationGrid::new(&map).unwrap();
        let window = SearchWindow { centre: Pose2::new(0.4, -0.3, 0.1), distance_m: 3.0, heading_rad: 0.05 };
        let found = grid.search(&points, &window, 0.0, None).unwrap();
        let mut best = 0;
        for heading in headings(&points, &window) {
            let cells = rotated(&points, &window, heading);
            for (x, y) in (-30..=30).flat_map(|x| (-30..=30).map(move |y| (x, y))) {
                best = best.max(cells.iter().map(|(column, row)| grid.at(0, column + x, row + y)).sum::<u32>());
            }
        }
        assert_eq!(found.share, best as f32 / (255.0 * points.len() as f32));
    }

    #[test]
    fn a_corridor_has_many_poses() {
        let walls: Vec<Point2> = (0..300).flat_map(|i| [0.0, 2.0].map(|y| Point2::new(0.1 * i as f32, y))).collect();
        let grid = CorrelationGrid::new(&walls).unwrap();
        let points: Vec<Point2> = walls[200..300].iter().map(|p| *p - Point2::new(15.0, 0.0)).collect();
        let window = SearchWindow { centre: Pose2::new(15.0, 0.0, 0.0), distance_m: 5.0, heading_rad: 0.1 };
        let found = grid.search(&points, &window, 0.3, None).unwrap();
        let excluded = Excluded { pose: found.pose, distance_m: 1.0, heading_rad: 0.2 };
        assert!(grid.search(&points, &window, 0.9 * found.share, Some(excluded)).is_some());
    }

    #[test]
    fn no_points_no_grid() {
        assert!(CorrelationGrid::new(&[]).is_none());
    }
}
