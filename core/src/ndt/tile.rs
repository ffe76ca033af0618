//! Memory of an [`NdtGrid`](super::NdtGrid): tiles, the directory that finds them, and what there may be no room for.

use super::cell::{CellSums, Gaussian};
use crate::facing::PLANES_MAX;

/// Cells along a tile's side.
pub const TILE_CELLS: usize = 1 << TILE_SHIFT;
pub(super) const TILE_SHIFT: u32 = 1;
const TILE_AREA: usize = TILE_CELLS * TILE_CELLS;

/// Cells of one square of the plane. All zero when empty, so that a static pool costs no flash.
///
/// What the look-up reads stands together.
#[derive(Debug, Clone)]
#[repr(C)]
pub struct NdtTile {
    /// Of its place in the plane.
    pub(super) key: u32,
    /// Of this tile in the directory, or the next free tile.
    pub(super) link: u32,
    pub(super) gaussians: [Gaussian; TILE_AREA],
    pub(super) sums: [CellSums; TILE_AREA],
}

impl NdtTile {
    /// A tile without points.
    pub const EMPTY: Self =
        Self { key: 0, link: 0, sums: [CellSums::EMPTY; TILE_AREA], gaussians: [Gaussian::EMPTY; TILE_AREA] };
}

/// The tile that holds one of the places of the plane that share this entry; 0 if none does.
#[derive(Debug, Clone, Copy, Default)]
pub struct DirectoryEntry(pub(super) u16);

impl DirectoryEntry {
    /// Of places without a tile.
    pub const EMPTY: Self = Self(0);
}

/// Where a point falls in one layer.
#[derive(Clone, Copy, Default, PartialEq)]
pub(super) struct Place {
    pub(super) slot: u32,
    pub(super) key: u32,
    pub(super) cell: u32,
}

impl Place {
    /// The same in another plane, of one in the first.
    #[inline(always)]
    pub(super) fn in_plane(self, plane: u32) -> Self {
        Self { slot: self.slot + plane, ..self }
    }

    /// The same in each of these planes, told as bits, of one in the first.
    #[inline(always)]
    pub(super) fn in_planes(self, planes: u32) -> impl Iterator<Item = Self> {
        let is_one = move |plane: &u32| planes >> plane & 1 != 0;
        (0..PLANES_MAX as u32).filter(is_one).map(move |plane| self.in_plane(plane))
    }
}

/// The memory lent to an [`NdtGrid`](super::NdtGrid) does not fit together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum NdtMemoryError {
    /// The directory's length must be layers × 4ⁿ.
    #[error("directory of {0} entries: expected layers times a power of four, at most 4096 squared")]
    Directory(usize),
    /// Tile 0 stays empty, and a 16-bit index names the others.
    #[error("{0} tiles: expected 1 to 65535")]
    Tiles(usize),
}

/// What an insertion could not keep.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct InsertReport {
    /// Points that found no tile because the pool was full of nearer ones, counted once per layer.
    pub dropped: u32,
    /// Tiles forgotten because a place nearer to the robot needed their memory, or their place in the directory.
    pub evicted: u32,
}

impl core::ops::AddAssign for InsertReport {
    fn add_assign(&mut self, other: Self) {
        self.dropped += other.dropped;
        self.evicted += other.evicted;
    }
}
