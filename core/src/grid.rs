//! The cells of a square grid that a straight ray crosses.
//!
//! Data flow: two points (m) and a cell size → indices of every crossed cell, from the first point's to the last
//! one's, each sharing an edge with the one before. No heap, no recursion; the number of cells is known before the
//! first step, so the walk always ends, and always in the right cell, whatever rounding does on its way.
//!
//! Source: Amanatides & Woo, *A fast voxel traversal algorithm for ray tracing*, Eurographics 1987.
//! Departure: the count of steps per axis ends the walk, not a comparison of ray parameters.

use core::iter::FusedIterator;

use crate::geometry::Point2;

/// Column and row of a cell: it covers `[column, column + 1) × [row, row + 1)` times the cell size.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct CellIndex {
    /// Along x, 0 right of the origin.
    pub column: i32,
    /// Along y, 0 left of the origin (y points left).
    pub row: i32,
}

impl CellIndex {
    /// The cell that holds `point` (m); saturates far outside, 0 for NaN.
    pub fn containing(point: Point2, cell_size_m: f32) -> Self {
        Self { column: libm::floorf(point.x / cell_size_m) as i32, row: libm::floorf(point.y / cell_size_m) as i32 }
    }
}

/// What is known of a place.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Occupancy {
    /// Nothing.
    Unknown,
    /// Rays pass.
    Free,
    /// Rays end.
    Occupied,
}

/// Cells from `start` to `end` (m), both ends' cells included; nothing if a number is not finite or the cell size not
/// positive.
///
/// A ray exactly through a corner passes one of the two cells beside it: neighbours always share an edge.
/// Cost: |Δcolumn| + |Δrow| + 1 steps of one comparison and one addition.
pub fn cells_on_ray(start: Point2, end: Point2, cell_size_m: f32) -> RayCells {
    let finite = start.x.is_finite() && start.y.is_finite() && end.x.is_finite() && end.y.is_finite();
    let first = CellIndex::containing(start, cell_size_m);
    let last = CellIndex::containing(end, cell_size_m);
    let columns = Axis::new(start.x / cell_size_m, end.x / cell_size_m, first.column, last.column);
    let rows = Axis::new(start.y / cell_size_m, end.y / cell_size_m, first.row, last.row);
    RayCells { next: (finite && cell_size_m > 0.0).then_some(first), columns, rows }
}

/// Iterator of [`cells_on_ray`].
#[derive(Debug, Clone)]
pub struct RayCells {
    next: Option<CellIndex>,
    columns: Axis,
    rows: Axis,
}

/// The walk along one axis, in cells; `crossing` is the ray parameter (0 start, 1 end) of the next border.
#[derive(Debug, Clone)]
struct Axis {
    step: i32,
    steps_left: u32,
    crossing: f32,
    crossing_step: f32,
}

impl Axis {
    fn new(start: f32, end: f32, first: i32, last: i32) -> Self {
        let length = end - start;
        let forward = last > first;
        let border = if forward { libm::floorf(start) + 1.0 } else { libm::floorf(start) };
        let steps_left = last.abs_diff(first);
        let crossing = if steps_left == 0 { f32::INFINITY } else { (border - start) / length };
        Self { step: if forward { 1 } else { -1 }, steps_left, crossing, crossing_step: 1.0 / length.abs() }
    }

    fn advance(&mut self, index: &mut i32) {
        *index = index.saturating_add(self.step);
        self.steps_left -= 1;
        self.crossing = if self.steps_left == 0 { f32::INFINITY } else { self.crossing + self.crossing_step };
    }
}

impl Iterator for RayCells {
    type Item = CellIndex;

    fn next(&mut self) -> Option<CellIndex> {
        let current = self.next?;
        let mut following = current;
        if self.columns.steps_left == 0 && self.rows.steps_left == 0 {
            self.next = None;
            return Some(current);
        }
        if self.rows.steps_left == 0 || (self.columns.steps_left > 0 && self.columns.crossing < self.rows.crossing) {
            self.columns.advance(&mut following.column);
        } else {
            self.rows.advance(&mut following.row);
        }
        self.next = Some(following);
        Some(current)
    }

    /// The same walk, without asking at each cell whether it ends there.
    fn fold<B, F: FnMut(B, CellIndex) -> B>(self, init: B, mut visit: F) -> B {
        let Self { next: Some(mut at), mut columns, mut rows } = self else { return init };
        let mut folded = visit(init, at);
        while columns.steps_left > 0 && rows.steps_left > 0 {
            if columns.crossing < rows.crossing {
                columns.advance(&mut at.column);
            } else {
                rows.advance(&mut at.row);
            }
            folded = visit(folded, at);
        }
        while columns.steps_left > 0 {
            columns.advance(&mut at.column);
            folded = visit(folded, at);
        }
        while rows.steps_left > 0 {
            rows.advance(&mut at.row);
            folded = visit(folded, at);
        }
        folded
    }

    fn size_hint(&self) -> (usize, Option<usize>) {
        let left = self.columns.steps_left as u64 + self.rows.steps_left as u64 + 1;
        let left = if self.next.is_some() { usize::try_from(left).unwrap_or(usize::MAX) } else { 0 };
        (left, Some(left))
    }
}

impl FusedIterator for RayCells {}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::vec::Vec;

    fn cells(start: (f32, f32), end: (f32, f32)) -> Vec<(i32, i32)> {
        cells_on_ray(Point2::new(start.0, start.1), Point2::new(end.0, end.1), 0.5).map(|c| (c.column, c.row)).collect()
    }

    #[test]
    fn straight_rays_cross_the_expected_cells() {
        assert_eq!(cells((0.1, 0.1), (1.6, 0.2)), [(0, 0), (1, 0), (2, 0), (3, 0)]);
        assert_eq!(cells((0.1, 0.1), (-0.6, 0.1)), [(0, 0), (-1, 0), (-2, 0)]);
        assert_eq!(cells((0.1, 0.1), (0.2, 0.3)), [(0, 0)]);
        assert_eq!(cells((0.1, 0.4), (1.1, 0.9)), [(0, 0), (0, 1), (1, 1), (2, 1)]);
    }

    #[test]
    fn numbers_without_meaning_cross_nothing() {
        assert!(cells((f32::NAN, 0.0), (1.0, 1.0)).is_empty());
        assert!(cells((0.0, 0.0), (f32::INFINITY, 1.0)).is_empty());
        assert_eq!(cells_on_ray(Point2::new(0.0, 0.0), Point2::new(1.0, 1.0), 0.0).count(), 0);
        assert_eq!(cells_on_ray(Point2::new(0.0, 0.0), Point2::new(1.0, 1.0), f32::NAN).count(), 0);
    }

    #[test]
    fn size_hint_counts_the_cells_and_far_rays_do_not_overflow() {
        let far = cells_on_ray(Point2::new(-3e38, -3e38), Point2::new(3e38, 3e38), 0.5);
        assert!(far.size_hint().0 > 1_000_000_000);
        assert_eq!(far.take(5).count(), 5);
    }

    /// Distance in cells by which a point lies outside a cell.
    fn outside(cell: (i32, i32), x: f32, y: f32) -> f32 {
        let along = |i: i32, v: f32| (i as f32 - v).max(v - (i + 1) as f32).max(0.0);
        along(cell.0, x).max(along(cell.1, y))
    }

    proptest! {
        #[test]
        fn walk_is_connected_straight_and_complete(
            a in -20.0..20.0_f32, b in -20.0..20.0_f32, c in -20.0..20.0_f32, d in -20.0..20.0_f32,
        ) {
            let walk = cells((a, b), (c, d));
            let hint = cells_on_ray(Point2::new(a, b), Point2::new(c, d), 0.5).size_hint();
            prop_assert_eq!(hint, (walk.len(), Some(walk.len())));
            let mut folded = Vec::new();
            cells_on_ray(Point2::new(a, b), Point2::new(c, d), 0.5).for_each(|c| folded.push((c.column, c.row)));
            let mut one_by_one = Vec::new();
            for c in cells_on_ray(Point2::new(a, b), Point2::new(c, d), 0.5) {
                one_by_one.push((c.column, c.row));
            }
            prop_assert_eq!(&folded, &one_by_one);
            for pair in walk.windows(2) {
                prop_assert_eq!((pair[0].0 - pair[1].0).abs() + (pair[0].1 - pair[1].1).abs(), 1);
            }
            // Brute force: every densely sampled point of the ray lies in a cell of the walk, or on its border.
            let samples: Vec<(f32, f32)> = (0..=2000)
                .map(|i| i as f32 / 2000.0)
                .map(|t| ((a + t * (c - a)) / 0.5, (b + t * (d - b)) / 0.5))
                .collect();
            for &(x, y) in &samples {
                prop_assert!(walk.iter().any(|&cell| outside(cell, x, y) < 1e-3), "({x}, {y}) is in no cell");
            }
            // And every cell of the walk is touched by the ray.
            for &cell in &walk {
                prop_assert!(samples.iter().any(|&(x, y)| outside(cell, x, y) < 0.06), "{cell:?} is not crossed");
            }
        }
    }
}
