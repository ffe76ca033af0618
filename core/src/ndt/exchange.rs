//! Tiles leave the plane and come back: for a robot whose memory is smaller than the building.

use super::cell::CellSums;
use super::grid::{NdtGrid, NdtTile, TILE_AREA, TILE_CELLS, column_of, row_of};
use crate::distributed_map::Restored;
use crate::geometry::Point2;
use crate::region::{Region, TileAddress};

/// Most bytes that a tile takes: every sum of every cell at its longest.
pub const TILE_BYTES_MAX: usize = TILE_AREA * 31;

/// A tile cannot come back.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum RestoreError {
    /// The pool is full of nearer tiles.
    #[error("no tile is free")]
    NoRoom,
    /// There is no such layer, or the bytes are not what a tile was written as.
    #[error("not the bytes of a tile")]
    NoTile,
}

/// The sums of the cells that have points.
type Sums = [Option<CellSums>; TILE_AREA];

impl NdtGrid<'_> {
    /// From now on only points whose tiles are in `bounds` are added; others are counted as dropped.
    pub fn keep_within(&mut self, bounds: Region) {
        self.bounds = Some(bounds);
    }

    /// Addresses of all tiles in use, overlapping grids being layers.
    pub fn addresses(&self) -> impl Iterator<Item = TileAddress> + '_ {
        let taken = self.tiles.iter().enumerate().take(usize::from(self.taken)).skip(1);
        taken.filter_map(|(index, tile)| {
            let entry = self.directory.get(tile.link as usize).filter(|entry| usize::from(entry.tile) == index)?;
            let layer = (tile.link >> (2 * self.side_shift)) as u8;
            Some(TileAddress { layer, column: column_of(entry.key), row: row_of(entry.key) })
        })
    }

    /// Writes a tile into `bytes` (of [`TILE_BYTES_MAX`]); `None` if there is none.
    pub fn tile_bytes<'b>(&self, address: TileAddress, bytes: &'b mut [u8]) -> Option<&'b [u8]> {
        let tile =
            self.tiles.get(usize::from(self.tile_at(self.first_cell(address)?))).filter(|tile| tile.count > 0)?;
        let mut sums: Sums = [None; TILE_AREA];
        for (to, from) in sums.iter_mut().zip(&tile.sums) {
            *to = (*from != CellSums::EMPTY).then_some(*from);
        }
        postcard::to_slice(&sums, bytes).ok().map(|written| &*written)
    }

    /// Forgets a tile; false if there is none.
    pub fn let_go(&mut self, address: TileAddress) -> bool {
        let Some(place) = self.first_cell(address) else { return false };
        let index = self.tile_at(place);
        if index != 0 {
            self.give_back(place, index);
        }
        index != 0
    }

    /// Puts a tile back that [`tile_bytes`](Self::tile_bytes) wrote, if there is none in its place; a tile farther from `robot` (map frame, m) makes room.
    ///
    /// # Errors
    /// [`RestoreError`]; nothing has changed then.
    pub fn restore(&mut self, address: TileAddress, bytes: &[u8], robot: Point2) -> Result<Restored, RestoreError> {
        let first = self.first_cell(address).ok_or(RestoreError::NoTile)?;
        if self.tile_at(first) != 0 {
            return Ok(Restored::IsKnown);
        }
        let sums: Sums = postcard::from_bytes(bytes).map_err(|_| RestoreError::NoTile)?;
        if sums.iter().flatten().all(|sums| sums.points() == 0) {
            return Err(RestoreError::NoTile);
        }
        let index = self.tile_for(first, robot);
        let config = self.config;
        let mut restored = NdtTile { link: first.slot, ..NdtTile::EMPTY };
        for (cell, sums) in sums.iter().enumerate() {
            let Some(sums) = sums else { continue };
            let (column, row) = cell_of(address, cell);
            if let (Some(to), Some(gaussian)) = (restored.sums.get_mut(cell), restored.gaussians.get_mut(cell)) {
                *to = *sums;
                *gaussian = sums.gaussian(&config, self.centre_of(column, row, u32::from(address.layer)));
                restored.count = restored.count.saturating_add(sums.points());
            }
        }
        let tile = self.tiles.get_mut(usize::from(index)).filter(|_| index != 0).ok_or(RestoreError::NoRoom)?;
        *tile = restored;
        Ok(Restored::Done)
    }
}

/// Column and row of a tile's cell.
fn cell_of(address: TileAddress, cell: usize) -> (i32, i32) {
    let side = TILE_CELLS;
    let along = |tile: i16, offset: usize| i32::from(tile) * side as i32 + offset as i32;
    (along(address.column, cell % side), along(address.row, cell / side))
}
