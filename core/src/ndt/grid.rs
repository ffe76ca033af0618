//! The plane of cells: tiles, their directory, insertion and removal.

use super::NdtConfig;
use super::cell::{CellSums, Gaussian};
use crate::geometry::{Point2, Pose2};
use crate::math::{floor, sin_cos};

/// Cells along a tile's side.
pub const TILE_CELLS: usize = 8;
const TILE_AREA: usize = TILE_CELLS * TILE_CELLS;
/// Farther than this from the origin a point is dropped, m: 16-bit tile coordinates and `f32` give out.
const REACH_M: f32 = 10_000.0;

/// Cells of one square of the plane. All zero when empty, so that a static pool costs no flash.
#[derive(Debug, Clone)]
pub struct NdtTile {
    /// Of this tile in the directory, or the next free tile.
    link: u32,
    /// Points in it.
    count: u32,
    sums: [CellSums; TILE_AREA],
    gaussians: [Gaussian; TILE_AREA],
}

impl NdtTile {
    /// A tile without points.
    pub const EMPTY: Self =
        Self { link: 0, count: 0, sums: [CellSums::EMPTY; TILE_AREA], gaussians: [Gaussian::EMPTY; TILE_AREA] };
}

/// Which tile holds a place of the plane. All zero when empty.
#[derive(Debug, Clone, Copy, Default)]
pub struct DirectoryEntry {
    key: u32,
    tile: u16,
}

impl DirectoryEntry {
    /// Of a place without a tile.
    pub const EMPTY: Self = Self { key: 0, tile: 0 };
}

/// The memory lent to an [`NdtGrid`] does not fit together.
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
    /// Points that found no tile because the pool was full, counted once per layer.
    pub dropped: u32,
}

/// A plane of cells over memory lent by the caller; see the [module](super).
#[derive(Debug)]
pub struct NdtGrid<'m> {
    config: NdtConfig,
    cells_per_metre: f32,
    layers: u32,
    side_shift: u32,
    directory: &'m mut [DirectoryEntry],
    tiles: &'m mut [NdtTile],
    /// Tiles ever taken from the pool, tile 0 included.
    taken: u16,
    /// Head of the list of tiles given back; 0 ends it.
    free: u16,
    used: u16,
    evicted: u32,
}

/// Where a point falls in one layer.
#[derive(Clone, Copy)]
pub(super) struct Place {
    slot: u32,
    key: u32,
    cell: u32,
}

impl<'m> NdtGrid<'m> {
    /// An empty plane.
    ///
    /// * `directory` — side² entries (4 side² with overlapping grids), side a power of two; `side` tiles in each
    ///   direction can be told apart
    /// * `tiles` — the pool; one tile of it stays empty
    ///
    /// # Errors
    /// [`NdtMemoryError`] if the slices' lengths are not of that form.
    pub fn new(
        config: &NdtConfig,
        directory: &'m mut [DirectoryEntry],
        tiles: &'m mut [NdtTile],
    ) -> Result<Self, NdtMemoryError> {
        let layers: u32 = if config.overlapping { 4 } else { 1 };
        let places = directory.len() / layers as usize;
        let side_shift = places.checked_ilog2().unwrap_or(0) / 2;
        if places == 0 || directory.len() != (layers as usize) << (2 * side_shift) || side_shift > 12 {
            return Err(NdtMemoryError::Directory(directory.len()));
        }
        if tiles.len() > usize::from(u16::MAX) {
            return Err(NdtMemoryError::Tiles(tiles.len()));
        }
        *tiles.first_mut().ok_or(NdtMemoryError::Tiles(0))? = NdtTile::EMPTY;
        directory.fill(DirectoryEntry::default());
        let cells_per_metre = 1.0 / config.cell_size_m;
        let config = *config;
        Ok(Self {
            config,
            cells_per_metre,
            layers,
            side_shift,
            directory,
            tiles,
            taken: 1,
            free: 0,
            used: 0,
            evicted: 0,
        })
    }

    /// The configuration it was made with.
    pub fn config(&self) -> &NdtConfig {
        &self.config
    }

    /// Number of overlapping grids: 1 or 4.
    pub fn layers(&self) -> u32 {
        self.layers
    }

    /// Tiles in use.
    pub fn tiles_used(&self) -> usize {
        usize::from(self.used)
    }

    /// Tiles overwritten because another part of the plane needed their place in the directory.
    pub fn evicted(&self) -> u32 {
        self.evicted
    }

    /// Adds `points` (robot frame) seen from `map_from_robot`. Points that find no tile are counted and left out.
    pub fn insert(&mut self, points: &[Point2], map_from_robot: Pose2) -> InsertReport {
        self.update(points, map_from_robot, 1)
    }

    /// Takes back what [`insert`](Self::insert) added with the same arguments; exact unless a cell was halved in between.
    /// Tiles left without points return to the pool.
    pub fn remove(&mut self, points: &[Point2], map_from_robot: Pose2) {
        self.update(points, map_from_robot, -1);
    }

    fn update(&mut self, points: &[Point2], map_from_robot: Pose2, sign: i32) -> InsertReport {
        let mut report = InsertReport::default();
        let (sin, cos) = sin_cos(map_from_robot.heading);
        for point in points {
            let in_map = rotate_translate(*point, sin, cos, map_from_robot);
            let in_reach = in_map.x.abs() < REACH_M && in_map.y.abs() < REACH_M;
            for layer in 0..self.layers {
                if !(in_reach && self.update_layer(in_map, layer, sign)) {
                    report.dropped += 1;
                }
            }
        }
        report
    }

    /// False if the point found no tile.
    fn update_layer(&mut self, in_map: Point2, layer: u32, sign: i32) -> bool {
        let (u, v) = self.cell_coordinates(in_map, layer);
        let (column, row) = (floor(u), floor(v));
        let place = self.place(column, row, layer);
        let index = if sign > 0 { self.tile_for(place) } else { self.tile_at(place) };
        let shift = layer_shift(layer);
        let (left, low) = (column as f32, row as f32);
        let centre = Point2::new(left + 0.5 - shift.x, low + 0.5 - shift.y) * self.config.cell_size_m;
        let Some(tile) = self.tiles.get_mut(usize::from(index)).filter(|_| index != 0) else { return false };
        let (Some(sums), Some(gaussian)) =
            (tile.sums.get_mut(place.cell as usize), tile.gaussians.get_mut(place.cell as usize))
        else {
            return false;
        };
        sums.update(u - left - 0.5, v - low - 0.5, sign);
        sums.fade(self.config.count_max);
        *gaussian = sums.gaussian(&self.config, centre);
        tile.count = tile.count.saturating_add_signed(sign);
        if tile.count == 0 {
            self.give_back(place, index);
        }
        true
    }

    /// A point in units of cells, for one layer.
    #[inline(always)]
    fn cell_coordinates(&self, in_map: Point2, layer: u32) -> (f32, f32) {
        let shift = layer_shift(layer);
        (in_map.x * self.cells_per_metre + shift.x, in_map.y * self.cells_per_metre + shift.y)
    }

    /// Column and row of the cell that a point falls into, for one layer.
    #[inline(always)]
    pub(super) fn cell_of(&self, in_map: Point2, layer: u32) -> (i32, i32) {
        let (u, v) = self.cell_coordinates(in_map, layer);
        (floor(u), floor(v))
    }

    /// Directory slot, tile and cell of a cell of one layer.
    #[inline(always)]
    pub(super) fn place(&self, column: i32, row: i32, layer: u32) -> Place {
        let (tile_x, tile_y) = ((column >> 3) as u32, (row >> 3) as u32);
        let mask = (1 << self.side_shift) - 1;
        Place {
            slot: (((layer << self.side_shift) + (tile_y & mask)) << self.side_shift) + (tile_x & mask),
            key: (tile_y << 16) | (tile_x & 0xffff),
            cell: (((row & 7) << 3) | (column & 7)) as u32,
        }
    }

    /// The tile that holds `place`; the empty tile 0 if there is none.
    #[inline(always)]
    fn tile_at(&self, place: Place) -> u16 {
        match self.directory.get(place.slot as usize) {
            Some(entry) if entry.key == place.key => entry.tile,
            _ => 0,
        }
    }

    /// The distribution at `place`; an empty one if there is none.
    #[inline(always)]
    pub(super) fn gaussian_at(&self, place: Place) -> &Gaussian {
        match self.tiles.get(usize::from(self.tile_at(place))) {
            Some(tile) => tile.gaussians.get(place.cell as usize).unwrap_or(&Gaussian::EMPTY),
            None => &Gaussian::EMPTY,
        }
    }

    /// The tile that holds `place`, taken from the pool if there is none yet; 0 if the pool is empty.
    fn tile_for(&mut self, place: Place) -> u16 {
        let Some(entry) = self.directory.get(place.slot as usize).copied() else { return 0 };
        if entry.tile != 0 && entry.key == place.key {
            return entry.tile;
        }
        let index = if entry.tile != 0 {
            self.evicted = self.evicted.saturating_add(1);
            entry.tile
        } else {
            self.take()
        };
        let Some(tile) = self.tiles.get_mut(usize::from(index)).filter(|_| index != 0) else { return 0 };
        *tile = NdtTile { link: place.slot, ..NdtTile::EMPTY };
        if let Some(entry) = self.directory.get_mut(place.slot as usize) {
            *entry = DirectoryEntry { key: place.key, tile: index };
        }
        index
    }

    /// A tile from the free list or the untouched rest of the pool; 0 if there is none.
    fn take(&mut self) -> u16 {
        let index = if self.free != 0 { self.free } else { self.taken };
        let Some(tile) = self.tiles.get(usize::from(index)) else { return 0 };
        if index == self.free {
            self.free = tile.link as u16;
        } else {
            self.taken += 1;
        }
        self.used += 1;
        index
    }

    fn give_back(&mut self, place: Place, index: u16) {
        if let (Some(tile), Some(entry)) =
            (self.tiles.get_mut(usize::from(index)), self.directory.get_mut(place.slot as usize))
        {
            tile.link = u32::from(self.free);
            *entry = DirectoryEntry::default();
            self.free = index;
            self.used -= 1;
        }
    }
}

#[inline(always)]
pub(super) fn rotate_translate(point: Point2, sin: f32, cos: f32, pose: Pose2) -> Point2 {
    Point2::new(pose.x + cos * point.x - sin * point.y, pose.y + sin * point.x + cos * point.y)
}

/// Shift of a layer in cells: none, x, y, both.
#[inline(always)]
fn layer_shift(layer: u32) -> Point2 {
    Point2::new(0.5 * (layer & 1) as f32, 0.5 * (layer >> 1) as f32)
}
