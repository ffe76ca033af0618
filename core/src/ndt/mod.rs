//! The normal distributions transform: a plane of cells, each with the mean and covariance of the points in it.
//!
//! Biber & Straßer 2003; thesis §2.3.3, eq. (2.15) and (4.42). Points → running sums per cell (updated in place, never
//! rebuilt) → one Gaussian per cell → score of a scan at a pose.
//!
//! Cells live in tiles of 2 × 2, tiles in a pool lent by the caller; a directory that wraps around like a torus finds a
//! tile from its place in the plane. So the plane has no edge and memory does not depend on how far the robot goes. There is one such plane for each third of a turn
//! and one for all points. A point is drawn in those of its [facing](crate::facing), and looked up in one, so that a wall is not matched with its other side.
//!
//! # Invariants
//! * Sums are integers (offsets from the cell's centre in 1/256 of its side): the order of insertion does not matter, and
//!   what was added can be removed without a trace (as long as no cell has been halved).
//! * A cell that reaches `count_max` points is halved, so that no sum overflows and old evidence fades.
//! * Tile 0 of the pool stays empty: every place without a tile reads it.
//! * Memory goes to what is near: when the pool is full, or two places a whole directory's width apart want the same entry, the tile
//!   farther from the robot is forgotten, or the farther point is left out. [`InsertReport`] counts both.

mod cell;
mod grid;
mod look_through;
mod score;
mod tile;

pub(crate) use cell::SHARP_M;
pub use grid::NdtGrid;
pub use score::{Linearisation, Scatter};
pub use tile::{DirectoryEntry, InsertReport, NdtMemoryError, NdtTile, TILE_CELLS};

use crate::facing::{FACINGS_MAX, PLANES_MAX, Planes};

/// Shifts that a grid may have, so that no two are alike.
const GRIDS_MAX: u16 = 4;

crate::config! {
    /// Normal distributions transform (thesis 2.3.3).
    pub struct NdtConfig {
        /// Side of a cell, m. Biber and the thesis: 1.0.
        cell_size_m: f32 = 0.3, in 0.05..=10.0;
        /// Grids that overlap, averaged: a second one is shifted by half a cell in x and y, a third in x, a fourth in y (Biber has all four).
        /// More are smoother and more accurate, memory and time are in proportion; the search for a match uses the first one only.
        grids: u16 = 4, in 1..=GRIDS_MAX;
        /// Parts of a turn: walls that face different ones lie in planes of cells of their own, so that a wall seen from one side is not matched with
        /// its other side, and in one for all points. 3, or 1: there is one plane. More than 1 has four planes, each with a directory. Biber and the thesis: 1.
        facings: u16 = 3, in 1..=FACINGS_MAX;
        /// Standard deviation added to every cell in both directions, m: the error of the poses the points were seen from. Larger is
        /// smoother: fewer false optima, less precise ones. Thesis: 0.
        noise_m: f32 = 0.03, in 0.0..=1.0;
    }
}

impl NdtConfig {
    /// The most of [`directories`](Self::directories).
    pub const DIRECTORIES_MAX: usize = GRIDS_MAX as usize * PLANES_MAX;

    /// Grids of all planes together: directories of an [`NdtGrid`].
    pub fn directories(&self) -> usize {
        usize::from(self.grids) * Planes::new(self.facings).count() as usize
    }
}

#[cfg(test)]
mod tests;
