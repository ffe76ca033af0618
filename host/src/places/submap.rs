//! The map of a stretch of path, in the frame of one of its poses: what is matched when a loop may close.
//!
//! Some of its scans → points (a voxel each), and squares that rays passed or ended in, so that two submaps can be compared both ways:
//! walls of the one must not stand where the other looked through.

use std::collections::BTreeMap;

use lrfslam_core::facing::{FACINGS_MAX, Planes};
use lrfslam_core::geometry::{Point2, Pose2};
use lrfslam_core::grid::CellIndex;
use lrfslam_core::scan::Beam;

use crate::maps::occupancy::{MapConfig, Occupancy, OccupancyMap};
use crate::scans::store::ScanStore;

/// Edge of a square, m.
const SQUARE_M: f32 = 0.1;
/// One point is kept of each square of this edge, m, and part of a turn that walls face.
pub(super) const POINTS_APART_M: f32 = 0.15;
/// A wall this many squares away is the same wall.
const SAME_SQUARES: i32 = 1;
/// A wall in free space counts as missing if there is none within so many squares.
const MISSING_SQUARES: i32 = 3;

/// See the [module](self).
#[derive(Debug, Clone)]
pub struct Submap {
    points: Vec<Point2>,
    squares: OccupancyMap,
}

/// How the points of one submap lie in another.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Agreement {
    /// Share of all points that lie on the other's walls.
    pub on_walls: f32,
    /// Share of the points in known places that stand in free space.
    pub contradicting: f32,
    /// Share of all points that are in known places: on walls, or in free space.
    pub known: f32,
}

impl Submap {
    /// The map of some scans of `store`, each with its pose in the submap's frame; hits farther than `range_max_m` are left out.
    pub fn new(scans: impl Iterator<Item = (Pose2, u32)>, store: &ScanStore, range_max_m: f32) -> Self {
        // What is drawn for people and planners has no say in what loops are closed by.
        let any_miss = MapConfig { miss_apart_rad: 0.0, miss_gap_m: 0.0, ..MapConfig::default() };
        let config = MapConfig { cell_size_m: SQUARE_M, draw_range_m: range_max_m, ..any_miss };
        let mut squares = OccupancyMap::new(config);
        let planes = Planes::new(FACINGS_MAX);
        let mut voxels: BTreeMap<(i32, i32, u32), (Point2, f32)> = BTreeMap::new();
        let mut beams: Vec<Beam> = Vec::new();
        for (pose, scan) in scans {
            let Some(sweep) = store.sweep(scan as usize, &mut beams) else { continue };
            squares.insert(&sweep, pose);
            for hit in store.hits(scan as usize, range_max_m) {
                let point = pose.transform(hit);
                let CellIndex { column, row } = CellIndex::containing(point, POINTS_APART_M);
                let key = (row, column, planes.of(point.facing, 0.0));
                let none = Point2 { facing: point.facing, ..Point2::default() };
                let (sum, count) = voxels.entry(key).or_insert((none, 0.0));
                (*sum, *count) = (*sum + point, *count + 1.0);
            }
        }
        // A square that was hit once only may be a passer-by.
        let often = voxels.into_values().filter(|(_, count)| *count > 1.0);
        let points = often.map(|(sum, count)| sum * (1.0 / count)).collect();
        Self { points, squares }.without_movers()
    }

    /// What other scans looked through was there for a moment only: people, doors, poses gone wrong.
    fn without_movers(self) -> Self {
        let points = self.points.iter().copied().filter(|point| self.is_on_wall(*point)).collect();
        Self { points, squares: self.squares }
    }

    /// Its points, spread evenly.
    pub fn points(&self) -> &[Point2] {
        &self.points
    }

    /// How `points` lie in this map if their frame is at `pose`.
    pub fn agreement(&self, points: &[Point2], pose: Pose2) -> Agreement {
        let (mut on_walls, mut contradicting) = (0.0, 0.0);
        for point in points {
            let square = CellIndex::containing(pose.transform(*point), SQUARE_M);
            if self.has_wall_near(square, SAME_SQUARES) {
                on_walls += 1.0;
            } else if self.squares.occupancy(square) == Occupancy::Free && !self.has_wall_near(square, MISSING_SQUARES)
            {
                contradicting += 1.0;
            }
        }
        let known: f32 = on_walls + contradicting;
        let all = points.len().max(1) as f32;
        Agreement { on_walls: on_walls / all, contradicting: contradicting / known.max(1.0), known: known / all }
    }

    /// True if `point` (its frame) lies on a wall.
    pub fn is_on_wall(&self, point: Point2) -> bool {
        self.has_wall_near(CellIndex::containing(point, SQUARE_M), SAME_SQUARES)
    }

    fn has_wall_near(&self, square: CellIndex, squares: i32) -> bool {
        (-squares..=squares).any(|rows| {
            (-squares..=squares).any(|columns| {
                let near = CellIndex { column: square.column + columns, row: square.row + rows };
                self.squares.occupancy(near) == Occupancy::Occupied
            })
        })
    }
}
