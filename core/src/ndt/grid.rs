//! The plane of cells: tiles, their directory, insertion and removal.

use super::cell::{CellSums, Gaussian};
use super::tile::{DirectoryEntry, InsertReport, NdtMemoryError, NdtTile, TILE_CELLS, TILE_SHIFT};
use super::{GRIDS_MAX, NdtConfig};
use crate::facing::{FACINGS_MAX, PLANES_MAX, planes};
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
    facings: u32,
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

/// Where a point falls in one layer.
#[derive(Clone, Copy, PartialEq)]
pub(super) struct Place {
    slot: u32,
    key: u32,
    cell: u32,
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
        let facings = u32::from(config.facings.clamp(1, FACINGS_MAX));
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
            facings,
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
    pub(super) fn planes(&self) -> u32 {
        planes(self.facings)
    }

    /// Parts of a turn with a plane each, 3 at most.
    pub(super) fn facings(&self) -> u32 {
        self.facings
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
        self.update(points, map_from_robot, 1)
    }

    /// Takes back what [`insert`](Self::insert) added with the same arguments; exact unless a cell was halved, or forgotten, in between.
    /// Tiles left without points return to the pool.
    pub fn remove(&mut self, points: &[Point2], map_from_robot: Pose2) {
        self.update(points, map_from_robot, -1);
    }

    fn update(&mut self, points: &[Point2], map_from_robot: Pose2, sign: i16) -> InsertReport {
        let mut report = InsertReport::default();
        let evicted_before = self.evicted;
        self.farthest = f32::INFINITY;
        let (sin, cos) = sin_cos(map_from_robot.heading);
        let mut stale = [[None; GRIDS_MAX as usize]; PLANES_MAX];
        let robot = map_from_robot.position();
        for point in points {
            let in_map = rotate_translate(*point, sin, cos, map_from_robot);
            let in_reach = in_map.x.abs() < REACH_M && in_map.y.abs() < REACH_M;
            let facings = self.facings;
            let is_drawn = |plane| point.facing.is_drawn_in(plane, map_from_robot.heading, facings);
            for (plane, stale) in (0..self.planes()).zip(&mut stale).filter(|(plane, _)| is_drawn(*plane)) {
                for (layer, stale) in (0..self.layers).zip(stale) {
                    if !(in_reach && self.update_layer((in_map, layer, plane), sign, robot, stale)) {
                        report.dropped += 1;
                    }
                }
            }
        }
        stale.into_iter().flatten().flatten().for_each(|place| self.refresh(place));
        InsertReport { evicted: self.evicted.wrapping_sub(evicted_before), ..report }
    }

    /// False if the point found no tile.
    ///
    /// * `stale` — the layer's cell whose distribution waits to be made anew: points that follow one another are mostly of one cell
    fn update_layer(
        &mut self,
        (in_map, layer, plane): (Point2, u32, u32),
        sign: i16,
        robot: Point2,
        stale: &mut Option<Place>,
    ) -> bool {
        let (u, v) = self.cell_coordinates(in_map, layer);
        let (column, row) = (floor(u), floor(v));
        let place = self.place(column, row, layer, plane);
        if let Some(left) = stale.replace(place).filter(|left| *left != place) {
            self.refresh(left);
        }
        if sign > 0 {
            self.tile_for(place, robot);
        }
        self.change(place, |sums| {
            sums.update(u - column as f32 - 0.5, v - row as f32 - 0.5, sign);
            sums.fade();
        })
    }

    /// Changes the sums of a cell, unless it is frozen; false if there is no tile for it. A tile left without points returns to the pool. The
    /// distribution is to be [refreshed](Self::refresh).
    pub(super) fn change(&mut self, place: Place, change: impl FnOnce(&mut CellSums)) -> bool {
        let index = self.tile_at(place);
        let Some(tile) = self.tiles.get_mut(usize::from(index)).filter(|_| index != 0) else { return false };
        let Some(sums) = tile.sums.get_mut(place.cell as usize) else { return false };
        if sums.is_frozen() {
            return true;
        }
        change(sums);
        if tile.sums.iter().all(CellSums::is_empty) {
            self.give_back(place, index);
        }
        true
    }

    /// Makes a cell's distribution that of its sums, if it has a tile and is not frozen.
    pub(super) fn refresh(&mut self, place: Place) {
        let (index, cell) = (self.tile_at(place), place.cell as usize);
        let Some(tile) = self.tiles.get_mut(usize::from(index)).filter(|_| index != 0) else { return };
        if let (Some(sums), Some(gaussian)) = (tile.sums.get(cell), tile.gaussians.get_mut(cell))
            && !sums.is_frozen()
        {
            *gaussian = sums.gaussian(&self.config);
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
        let directory = plane * self.layers + layer;
        Place {
            slot: (((directory << self.side_shift) + (tile_y & mask)) << self.side_shift) + (tile_x & mask),
            key: (tile_y << 16) | (tile_x & 0xffff),
            cell: ((cell_y << TILE_SHIFT) | cell_x) as u32,
        }
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
        let shift = layer_shift((slot >> (2 * self.side_shift)) % self.layers.max(1));
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
