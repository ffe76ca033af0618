//! Tiles leave the plane and come back: for a robot whose memory is smaller than the building.

use super::cell::CellSums;
use super::grid::{NdtGrid, Standing, TILE_AREA, TILE_CELLS, column_of, row_of};
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
    /// Somebody keeps tiles for this grid, and has none in `home` that is not here too. Tiles made outside of it are parts of what he may
    /// have, until he gives his part or the home comes to include them.
    pub fn set_home(&mut self, home: Region) {
        self.home = Some(home);
        for index in 1..self.taken {
            let is_in = self.address_of(index).is_some_and(|address| home.contains(address));
            if let Some(tile) =
                self.tiles.get_mut(usize::from(index)).filter(|tile| is_in && tile.standing == Standing::Part)
            {
                tile.standing = Standing::Whole;
            }
        }
    }

    /// Addresses of all tiles in use, overlapping grids being layers.
    pub fn addresses(&self) -> impl Iterator<Item = TileAddress> + '_ {
        (1..self.taken).filter_map(|index| self.address_of(index))
    }

    /// Those that are whole, and that nobody [has saved](Self::set_saved) as they are.
    pub fn unsaved(&self) -> impl Iterator<Item = TileAddress> + '_ {
        let is_unsaved =
            |index: u16| self.tiles.get(usize::from(index)).is_some_and(|tile| tile.standing == Standing::Whole);
        (1..self.taken).filter(move |index| is_unsaved(*index)).filter_map(|index| self.address_of(index))
    }

    /// Somebody has the tile as it is: nothing is lost if it is forgotten for a nearer one. False if there is none.
    pub fn set_saved(&mut self, address: TileAddress) -> bool {
        let Some(first) = self.first_cell(address) else { return false };
        let index = self.tile_at(first);
        let tile = self.tiles.get_mut(usize::from(index)).filter(|_| index != 0);
        tile.map(|tile| tile.standing = Standing::Saved).is_some()
    }

    /// `None` if the tile is not in use.
    fn address_of(&self, index: u16) -> Option<TileAddress> {
        let slot = self.tiles.get(usize::from(index))?.link;
        let entry = self.directory.get(slot as usize).filter(|entry| entry.tile == index)?;
        let layer = (slot >> (2 * self.side_shift)) as u8;
        Some(TileAddress { layer, column: column_of(entry.key), row: row_of(entry.key) })
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

    /// Puts a tile back that [`tile_bytes`](Self::tile_bytes) wrote, and adds it to a part that is there; if a whole tile is there, nothing has changed.
    /// A tile farther from `robot` (map frame, m) makes room.
    ///
    /// # Errors
    /// [`RestoreError`]; nothing has changed then.
    pub fn restore(&mut self, address: TileAddress, bytes: &[u8], robot: Point2) -> Result<Restored, RestoreError> {
        let first = self.first_cell(address).ok_or(RestoreError::NoTile)?;
        let there = self.tiles.get(usize::from(self.tile_at(first))).map(|tile| (tile.count, tile.standing));
        if matches!(there, Some((1.., Standing::Whole | Standing::Saved))) {
            return Ok(Restored::IsKnown);
        }
        let sums: Sums = postcard::from_bytes(bytes).map_err(|_| RestoreError::NoTile)?;
        if sums.iter().flatten().all(|sums| sums.points() == 0) {
            return Err(RestoreError::NoTile);
        }
        let config = self.config;
        let index = self.tile_for(first, robot);
        for (cell, restored) in sums.iter().enumerate() {
            let Some(restored) = restored else { continue };
            let (column, row) = cell_of(address, cell);
            let centre = self.centre_of(column, row, u32::from(address.layer));
            let tile = self.tiles.get_mut(usize::from(index)).filter(|_| index != 0).ok_or(RestoreError::NoRoom)?;
            if let (Some(sums), Some(gaussian)) = (tile.sums.get_mut(cell), tile.gaussians.get_mut(cell)) {
                sums.add(restored);
                sums.fade(config.count_max);
                *gaussian = sums.gaussian(&config, centre);
                tile.count = tile.count.saturating_add(restored.points());
                tile.standing = Standing::Whole;
            }
        }
        Ok(Restored::Done)
    }
}

/// Column and row of a tile's cell.
fn cell_of(address: TileAddress, cell: usize) -> (i32, i32) {
    let side = TILE_CELLS;
    let along = |tile: i16, offset: usize| i32::from(tile) * side as i32 + offset as i32;
    (along(address.column, cell % side), along(address.row, cell / side))
}
