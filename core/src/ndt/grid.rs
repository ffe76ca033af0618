//! The plane of cells: tiles, their directory, insertion and removal.

use super::cell::{CellOffset, CellSums, Change, Gaussian};
use super::tile::{DirectoryEntry, InsertReport, NdtMemoryError, NdtTile, Place, TILE_CELLS, TILE_SHIFT};
use super::{GRIDS_MAX, NdtConfig};
use crate::facing::Planes;
use crate::geometry::{Point2, Pose2};
use crate::math::{floor, sin_cos};

/// Farther than this from the origin a point is dropped, m: 16-bit tile coordinates and `f32` give out.
const REACH_M: f32 = 5_000.0;

/// A plane of cells over memory lent by the caller; see the [module](super).
#[derive(Debug)]
pub struct NdtGrid<'m> {
    config: NdtConfig,
    cells_per_metre: f32,
    layers: u32,
    planes: Planes,
    side_shift: u32,
    directory: &'m mut [DirectoryEntry],
    tiles: &'m mut [NdtTile],
    /// Tiles ever taken from the pool, tile 0 included.
    taken: u16,
    /// Head of the list of tiles given back; 0 ends it.
    free: u16,
    used: u16,
    /// Tiles forgotten so far.
    evicted: u32,
    /// While points are inserted: no tile is farther from the robot than this, squared, in cells.
    farthest: f32,
}

/// Binary logarithm of the places along a side of each of the `directories`; `None` if `entries` are not directories × 4ⁿ.
fn side_shift(directories: usize, entries: usize) -> Option<u32> {
    let shift = entries.checked_div(directories)?.checked_ilog2()? / 2;
    (shift <= 12 && entries == directories << (2 * shift)).then_some(shift)
}

impl<'m> NdtGrid<'m> {
    /// An empty plane.
    ///
    /// * `directory` — side² entries for each of [`NdtConfig::directories`], side a power of two; `side` tiles in each direction can be told apart
    /// * `tiles` — the pool; one tile of it stays empty
    ///
    /// # Errors
    /// [`NdtMemoryError`] if the slices' lengths are not of that form.
    pub fn new(
        config: &NdtConfig,
        directory: &'m mut [DirectoryEntry],
        tiles: &'m mut [NdtTile],
    ) -> Result<Self, NdtMemoryError> {
        let layers = u32::from(config.grids.min(GRIDS_MAX));
        let side_shift = side_shift(config.directories(), directory.len());
        let side_shift = side_shift.ok_or(NdtMemoryError::Directory(directory.len()))?;
        if tiles.len() > usize::from(u16::MAX) {
            return Err(NdtMemoryError::Tiles(tiles.len()));
        }
        *tiles.first_mut().ok_or(NdtMemoryError::Tiles(0))? = NdtTile::EMPTY;
        directory.fill(DirectoryEntry::EMPTY);
        let cells_per_metre = 1.0 / config.cell_size_m;
        let config = *config;
        Ok(Self {
            config,
            cells_per_metre,
            layers,
            planes: Planes::new(config.facings),
            side_shift,
            directory,
            tiles,
            taken: 1,
            free: 0,
            used: 0,
            evicted: 0,
            farthest: f32::INFINITY,
        })
    }

    /// True if a directory of so many entries suits a configuration.
    pub fn is_directory(config: &NdtConfig, entries: usize) -> bool {
        side_shift(config.directories(), entries).is_some()
    }

    /// Forgets all points.
    pub fn clear(&mut self) {
        self.directory.fill(DirectoryEntry::EMPTY);
        (self.taken, self.free, self.used) = (1, 0, 0);
    }

    /// Every cell that counts now stays as it is: later points are left out there, and change only what had too few points so far.
    pub fn freeze(&mut self) {
        let cells = self.tiles.iter_mut().take(usize::from(self.taken)).flat_map(|tile| &mut tile.sums);
        cells.for_each(|sums| sums.freeze());
    }

    /// The configuration it was made with.
    pub fn config(&self) -> &NdtConfig {
        &self.config
    }

    /// Number of overlapping grids, 4 at most.
    pub fn layers(&self) -> u32 {
        self.layers
    }

    /// Its planes, 4 at most.
    pub(super) fn planes(&self) -> Planes {
        self.planes
    }

    /// Tiles in use.
    pub fn tiles_used(&self) -> usize {
        usize::from(self.used)
    }

    /// Adds `points` (robot frame) seen from `map_from_robot`.
    ///
    /// A point is drawn in the planes of its [facing](crate::facing::Facing).
    /// When the pool is full, the tile farthest from the robot is forgotten for one that is nearer; of two at the same distance the one
    /// that came first in the pool. A point farther than all tiles is counted and left out. Cost then: the pool is looked through once for each tile
    /// that is forgotten.
    pub fn insert(&mut self, points: &[Point2], map_from_robot: Pose2) -> InsertReport {
        self.update(points, map_from_robot, Change::Add)
    }

    /// Adds `points` that nobody has seen, to cells in which few were seen.
    pub(crate) fn fill(&mut self, points: &[Point2], map_from_robot: Pose2) {
        self.update(points, map_from_robot, Change::Fill);
    }

    /// Takes back what [`insert`](Self::insert) added with the same arguments; exact unless a cell was halved, or forgotten, in between.
    /// Tiles left without points return to the pool.
    pub fn remove(&mut self, points: &[Point2], map_from_robot: Pose2) {
        self.update(points, map_from_robot, Change::Remove);
    }

    fn update(&mut self, points: &[Point2], map_from_robot: Pose2, change: Change) -> InsertReport {
        let mut report = InsertReport::default();
        let evicted_before = self.evicted;
        self.farthest = f32::INFINITY;
        let (sin, cos) = sin_cos(map_from_robot.heading);
        let mut stale = [None; GRIDS_MAX as usize];
        let robot = map_from_robot.position();
        for point in points {
            let in_map = rotate_translate(*point, sin, cos, map_from_robot);
            let in_reach = in_map.x.abs() < REACH_M && in_map.y.abs() < REACH_M;
            let drawn = self.planes.drawn(point.facing, map_from_robot.heading);
            for (layer, stale) in (0..self.layers).zip(&mut stale) {
                report.dropped += if in_reach {
                    self.update_layer((in_map, layer, drawn), change, robot, stale)
                } else {
                    drawn.count_ones()
                };
            }
        }
        stale.into_iter().flatten().for_each(|(place, planes)| self.refresh(place, planes));
        InsertReport { evicted: self.evicted.wrapping_sub(evicted_before), ..report }
    }

    /// In how many planes the point found no tile.
    ///
    /// * `drawn` — the planes, as bits
    /// * `stale` — the cell, and the planes, whose distributions wait to be made anew: points that follow one another are mostly of one cell
    fn update_layer(
        &mut self,
        (in_map, layer, drawn): (Point2, u32, u32),
        change: Change,
        robot: Point2,
        stale: &mut Option<(Place, u32)>,
    ) -> u32 {
        let (u, v) = self.cell_coordinates(in_map, layer);
        let (column, row) = (floor(u), floor(v));
        let first = self.place(column, row, layer, 0);
        let offset = CellOffset::new(u - column as f32 - 0.5, v - row as f32 - 0.5);
        let since = match *stale {
            Some((place, planes)) if place == first => planes,
            Some((place, planes)) => {
                self.refresh(place, planes);
                0
            }
            None => 0,
        };
        *stale = Some((first, since | drawn));
        let mut dropped = 0;
        for place in first.in_planes(drawn) {
            let index = if change == Change::Remove { self.tile_at(place) } else { self.tile_for(place, robot) };
            let is_kept = self.change_in(index, place, |sums| sums.update(offset, change));
            dropped += u32::from(!is_kept);
        }
        dropped
    }

    /// Changes the sums of a cell, unless it is frozen; false if there is no tile for it. A tile left without points returns to the pool. The
    /// distribution is to be [refreshed](Self::refresh).
    pub(super) fn change(&mut self, place: Place, change: impl FnOnce(&mut CellSums)) -> bool {
        self.change_in(self.tile_at(place), place, change)
    }

    /// The same, in the tile that `place` is known to have.
    fn change_in(&mut self, index: u16, place: Place, change: impl FnOnce(&mut CellSums)) -> bool {
        let Some(tile) = self.tiles.get_mut(usize::from(index)).filter(|_| index != 0) else { return false };
        let Some(sums) = tile.sums.get_mut(place.cell as usize) else { return false };
        if sums.is_frozen() {
            return true;
        }
        change(sums);
        if sums.is_empty() && tile.sums.iter().all(CellSums::is_empty) {
            self.give_back(place, index);
        }
        true
    }

    /// Makes a cell's distributions in these planes those of its sums, where it has a tile and is not frozen.
    ///
    /// * `first` — the cell in the first plane
    pub(super) fn refresh(&mut self, first: Place, planes: u32) {
        // Mostly the planes of one wall, which have the same points.
        let mut last = (CellSums::EMPTY, Gaussian::EMPTY);
        for place in first.in_planes(planes) {
            let (index, cell) = (self.tile_at(place), place.cell as usize);
            let Some(tile) = self.tiles.get_mut(usize::from(index)).filter(|_| index != 0) else { continue };
            if let (Some(sums), Some(gaussian)) = (tile.sums.get(cell), tile.gaussians.get_mut(cell))
                && !sums.is_frozen()
            {
                if last.0 != *sums {
                    last = (*sums, sums.gaussian(&self.config));
                }
                *gaussian = last.1;
            }
        }
    }

    /// A point in units of cells, for one layer.
    #[inline(always)]
    pub(super) fn cell_coordinates(&self, in_map: Point2, layer: u32) -> (f32, f32) {
        let shift = layer_shift(layer);
        (in_map.x * self.cells_per_metre + shift.x, in_map.y * self.cells_per_metre + shift.y)
    }

    /// Directory slot, tile and cell of a cell of one layer of a plane.
    #[inline(always)]
    pub(super) fn place(&self, column: i32, row: i32, layer: u32, plane: u32) -> Place {
        let (tile_x, tile_y) = ((column >> TILE_SHIFT) as u32, (row >> TILE_SHIFT) as u32);
        let (cell_x, cell_y) = (column & (TILE_CELLS as i32 - 1), row & (TILE_CELLS as i32 - 1));
        let mask = (1 << self.side_shift) - 1;
        let row_of_tiles = (layer << self.side_shift) + (tile_y & mask);
        Place {
            slot: (((row_of_tiles << self.side_shift) + (tile_x & mask)) << self.planes.shift()) + plane,
            key: (tile_y << 16) | (tile_x & 0xffff),
            cell: ((cell_y << TILE_SHIFT) | cell_x) as u32,
        }
    }

    /// The tiles that the planes have for a place in the first, in the order of the planes.
    #[inline(always)]
    pub(super) fn tiles_at(&self, first: Place) -> impl Iterator<Item = Option<&NdtTile>> {
        let from = first.slot as usize;
        let entries = self.directory.get(from..from + self.planes.count() as usize).unwrap_or_default();
        let is_held = move |tile: &&NdtTile| tile.key == first.key;
        entries.iter().map(move |entry| match entry.0 {
            0 => None,
            index => self.tiles.get(usize::from(index)).filter(is_held),
        })
    }

    /// The tile that the directory has for `place`, which may be that of another place; the empty tile 0 if there is none.
    #[inline(always)]
    fn entry(&self, place: Place) -> u16 {
        self.directory.get(place.slot as usize).map_or(0, |entry| entry.0)
    }

    /// The tile that holds `place`; 0 if there is none.
    fn tile_at(&self, place: Place) -> u16 {
        let index = self.entry(place);
        if self.key_of(index) == place.key { index } else { 0 }
    }

    fn key_of(&self, index: u16) -> u32 {
        self.tiles.get(usize::from(index)).map_or(0, |tile| tile.key)
    }

    /// The distribution at `place`; an empty one if there is none.
    #[inline(always)]
    pub(super) fn gaussian_at(&self, place: Place) -> &Gaussian {
        match self.tiles.get(usize::from(self.entry(place))) {
            Some(tile) if tile.key == place.key => tile.gaussians.get(place.cell as usize).unwrap_or(&Gaussian::EMPTY),
            _ => &Gaussian::EMPTY,
        }
    }

    /// The tile that holds `place`, which takes the memory of a farther one if there is no other; 0 if there is none.
    fn tile_for(&mut self, place: Place, robot: Point2) -> u16 {
        let held = self.entry(place);
        if held != 0 && self.key_of(held) == place.key {
            return held;
        }
        let distance = self.distance_to(place.slot, place.key, robot);
        let index = if held != 0 {
            self.evict_if_beyond(distance, Some(held), robot)
        } else {
            match self.take() {
                0 => self.evict_farther_than(distance, robot),
                index => index,
            }
        };
        let (Some(tile), Some(entry)) =
            (self.tiles.get_mut(usize::from(index)), self.directory.get_mut(place.slot as usize))
        else {
            return 0;
        };
        if index != 0 {
            *tile = NdtTile { key: place.key, link: place.slot, ..NdtTile::EMPTY };
            *entry = DirectoryEntry(index);
        }
        index
    }

    /// Frees the tile farthest from the robot if it is farther than `distance`, and returns it; else 0.
    fn evict_farther_than(&mut self, distance: f32, robot: Point2) -> u16 {
        if distance >= self.farthest {
            return 0;
        }
        let farthest = self.farthest_from(robot);
        self.farthest = farthest.map_or(0.0, |index| self.tile_distance(index, robot));
        self.evict_if_beyond(distance, farthest, robot)
    }

    /// Frees `tile` if it is farther from the robot than `distance`, and returns it; else 0.
    fn evict_if_beyond(&mut self, distance: f32, tile: Option<u16>, robot: Point2) -> u16 {
        let Some(index) = tile.filter(|index| self.tile_distance(*index, robot) > distance) else { return 0 };
        let slot = self.tiles.get(usize::from(index)).map_or(0, |tile| tile.link);
        if let Some(entry) = self.directory.get_mut(slot as usize) {
            *entry = DirectoryEntry::EMPTY;
        }
        self.evicted = self.evicted.wrapping_add(1);
        index
    }

    /// Of all tiles in use; the first of several.
    fn farthest_from(&self, robot: Point2) -> Option<u16> {
        let distance = |index: &u16| self.tile_distance(*index, robot);
        (1..self.taken).rev().max_by(|a, b| distance(a).total_cmp(&distance(b)))
    }

    fn tile_distance(&self, index: u16, robot: Point2) -> f32 {
        let (slot, key) = self.tiles.get(usize::from(index)).map_or((0, 0), |tile| (tile.link, tile.key));
        self.distance_to(slot, key, robot)
    }

    /// From the robot to the centre of a place's tile, squared, in cells.
    fn distance_to(&self, slot: u32, key: u32, robot: Point2) -> f32 {
        let shift = layer_shift(slot >> (2 * self.side_shift + self.planes.shift()));
        let side = TILE_CELLS as f32;
        let x = (f32::from(key as u16 as i16) + 0.5) * side - shift.x - robot.x * self.cells_per_metre;
        let y = (f32::from((key >> 16) as u16 as i16) + 0.5) * side - shift.y - robot.y * self.cells_per_metre;
        x * x + y * y
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
            *entry = DirectoryEntry::EMPTY;
            self.free = index;
            self.used -= 1;
        }
    }
}

#[inline(always)]
pub(super) fn rotate_translate(point: Point2, sin: f32, cos: f32, pose: Pose2) -> Point2 {
    Point2::new(pose.x + cos * point.x - sin * point.y, pose.y + sin * point.x + cos * point.y)
}

/// Shift of a layer in cells: none, both, x, y.
#[inline(always)]
fn layer_shift(layer: u32) -> Point2 {
    Point2::new(0.5 * ((layer ^ (layer >> 1)) & 1) as f32, 0.5 * (layer & 1) as f32)
}
