//! The map as it is drawn: a grid that grows with the area seen and counts, cell by cell, who hit and who passed.
//!
//! Data flow: scan and pose of the laser → every ray's cells ([`cells_on_ray`]) → hits and passes per cell →
//! [`Raster`]: unknown, free or occupied. A hit clears its way and marks its end; an invalid beam says nothing.
//!
//! A miss may have gone through glass, a dark door or off a smooth wall. So it says little: only its first few metres count, up to
//! the line between the hits beside it where these are near each other; it never counts against hits; and where nothing but misses
//! went, they must agree from directions apart. What lies behind a pane is looked at from few directions, an open place from many.
//!
//! Memory: square tiles of 64 × 64 cells, 6 bytes a cell, made where a ray first passes. Counters that would overflow
//! are halved in pairs, so that their ratio stays. Results do not depend on the order of the scans, but for that.

use std::collections::HashMap;

use lrfslam_core::geometry::{Point2, Pose2};
pub use lrfslam_core::grid::Occupancy;
use lrfslam_core::grid::{CellIndex, cells_on_ray};
use lrfslam_core::scan::{Beam, Echo, RangeScan};
use lrfslam_core::sweep::{Sweep, SweepMotion};

lrfslam_core::config! {
    /// How the map is drawn.
    pub struct MapConfig {
        /// Edge of a cell, m.
        cell_size_m: f32 = 0.05, in 0.005..=1.0;
        /// A hit farther away is not drawn, its ray clears the way up to here, m.
        draw_range_m: f32 = 50.0, in 0.5..=1000.0;
        /// A beam that saw nothing clears the way at most this far, m: behind that it may have gone through glass.
        miss_clears_m: f32 = 3.0, in 0.0..=1000.0;
        /// Beams that saw nothing between two hits at most this far from each other, m, clear the way up to the line between them: there
        /// is a pane or a dark door. Larger: wider panes are found, and open doors to wide places are taken for panes more often. 0: none.
        miss_gap_m: f32 = 2.5, in 0.0..=1000.0;
        /// Where only beams went that saw nothing, a cell is free if their directions are this far apart, rad, to one part in 16 of a turn.
        /// Smaller: more free space behind glass and dark doors. Larger: less of wide places that the laser does not reach across.
        /// 0: one such beam is enough, and it counts against hits as much as any other.
        miss_apart_rad: f32 = 0.7, in 0.0..=3.1;
        /// A cell is occupied if at least this share of the rays that reached it ended there.
        /// Lower: thicker walls, more ghosts of passers-by. Source: the value GMapping draws with.
        occupied_share: f32 = 0.25, in 0.01..=1.0;
        /// Longer side of map.png, pixels; a larger map is drawn smaller.
        picture_px: u32 = 2400, in 200..=20000;
    }
}

/// Edge of a tile, cells.
const TILE: usize = 64;
/// Bits of a cell index that count inside a tile.
const TILE_BITS: u32 = TILE.trailing_zeros();
/// A raster has at most so many pixels.
const RASTER_PIXELS_MAX: u64 = 1 << 26;

/// Directions are told apart by so many parts of a turn.
const SECTORS: u32 = u16::BITS;

#[derive(Debug, Clone, Copy, Default)]
struct Cell {
    hits: u16,
    /// Rays that went on to a hit.
    passes: u16,
    /// Directions of the rays that went on to nothing: a bit for each sector.
    misses: u16,
}

impl Cell {
    fn count(&mut self, hit: bool) {
        if self.hits.max(self.passes) == u16::MAX {
            self.hits /= 2;
            self.passes /= 2;
        }
        *(if hit { &mut self.hits } else { &mut self.passes }) += 1;
    }

    /// True if misses went this way in directions at least `sectors` apart, the shorter way round.
    fn misses_agree(self, sectors: u32) -> bool {
        (sectors..=SECTORS / 2).any(|apart| self.misses & self.misses.rotate_left(apart) != 0)
    }
}

/// The bit of a direction, rad.
fn sector_bit(direction_rad: f32) -> u16 {
    let sector = (direction_rad * (SECTORS as f32 / std::f32::consts::TAU)).floor() as i64;
    1 << sector.rem_euclid(i64::from(SECTORS))
}

/// The hits on both sides of beams that did not hit, lrf frame.
#[derive(Debug, Clone, Copy)]
struct Gap {
    before: Option<Point2>,
    after: Option<Point2>,
}

impl Gap {
    /// From the laser to the line between the two hits along a bearing, m, if they are at most `width_max_m` apart.
    fn way_to_line_m(&self, bearing_rad: f32, width_max_m: f32) -> Option<f32> {
        let (from, to) = self.before.zip(self.after)?;
        let along = to - from;
        let ahead = Point2::from_polar(1.0, bearing_rad);
        let cross = |a: Point2, b: Point2| a.x * b.y - a.y * b.x;
        let way_m = cross(from, along) / cross(ahead, along);
        (along.norm() <= width_max_m && way_m > 0.0).then_some(way_m)
    }
}

type TileIndex = (i32, i32);

/// The growing grid.
#[derive(Debug, Clone)]
pub struct OccupancyMap {
    config: MapConfig,
    tiles: Vec<Box<[Cell; TILE * TILE]>>,
    places: HashMap<TileIndex, usize>,
    /// Tile of the last cell, once there is one: the next cell is mostly there too.
    last: (TileIndex, usize),
    /// [`MapConfig::miss_apart_rad`] in sectors.
    miss_sectors: u32,
}

impl OccupancyMap {
    /// An empty map.
    pub fn new(config: MapConfig) -> Self {
        let miss_sectors = (config.miss_apart_rad * (SECTORS as f32 / std::f32::consts::TAU)).ceil() as u32;
        Self { config, tiles: Vec::new(), places: HashMap::new(), last: ((0, 0), 0), miss_sectors }
    }

    /// Draws the scan of `sweep`, its beams where they lie in the middle of the sweep, when the robot is at `map_from_robot`; a pose that
    /// is not finite draws nothing.
    ///
    /// Cost: O(cells that its rays cross).
    pub fn insert(&mut self, sweep: &Sweep<'_>, map_from_robot: Pose2) {
        let map_from_lrf = map_from_robot * sweep.robot_from_lrf;
        if !map_from_lrf.is_finite() {
            return;
        }
        if sweep.motion == SweepMotion::default() {
            return self.insert_beams(&sweep.scan, map_from_lrf);
        }
        let beams: Vec<Beam> = sweep.scan.beams.iter().map(sweep.middle_beam()).collect();
        self.insert_beams(&RangeScan { beams: &beams, ..sweep.scan }, map_from_lrf);
    }

    fn insert_beams(&mut self, scan: &RangeScan<'_>, map_from_lrf: Pose2) {
        let is_hit = |beam: &Beam| matches!(beam.echo, Echo::Hit(_));
        let (mut before, mut rest) = (None, scan.beams);
        while !rest.is_empty() {
            let (empty, others) = rest.split_at(rest.iter().position(is_hit).unwrap_or(rest.len()));
            let (hits, others) = others.split_at(others.iter().position(|beam| !is_hit(beam)).unwrap_or(others.len()));
            let gap = Gap { before, after: hits.first().and_then(Point2::of_hit) };
            self.insert_misses(empty, scan.range_max_m, gap, map_from_lrf);
            hits.iter().for_each(|beam| self.insert_hit(beam, map_from_lrf));
            (before, rest) = (hits.last().and_then(Point2::of_hit), others);
        }
    }

    /// * `empty` — neighbours of which none hit; `gap` — the hits beside them
    fn insert_misses(&mut self, empty: &[Beam], range_max_m: f32, gap: Gap, map_from_lrf: Pose2) {
        let MapConfig { cell_size_m, miss_clears_m, miss_gap_m, .. } = self.config;
        for beam in empty.iter().filter(|beam| beam.echo == Echo::Miss) {
            // The pane itself is not free.
            let open_m =
                gap.way_to_line_m(beam.bearing_rad, miss_gap_m).map_or(f32::INFINITY, |way_m| way_m - cell_size_m);
            let way_m = miss_clears_m.min(range_max_m).min(open_m).max(0.0);
            let direction = sector_bit(map_from_lrf.heading + beam.bearing_rad);
            let end = map_from_lrf.transform(Point2::from_polar(way_m, beam.bearing_rad));
            for index in cells_on_ray(map_from_lrf.position(), end, cell_size_m) {
                let counts_as_pass = self.miss_sectors == 0;
                let cell = self.cell_mut(index);
                if counts_as_pass { cell.count(false) } else { cell.misses |= direction }
            }
        }
    }

    fn insert_hit(&mut self, beam: &Beam, map_from_lrf: Pose2) {
        let Echo::Hit(range_m) = beam.echo else { return };
        let is_drawn = range_m <= self.config.draw_range_m;
        let end = map_from_lrf.transform(Point2::from_polar(range_m.min(self.config.draw_range_m), beam.bearing_rad));
        let last = CellIndex::containing(end, self.config.cell_size_m);
        let cells = cells_on_ray(map_from_lrf.position(), end, self.config.cell_size_m);
        cells.for_each(|cell| self.cell_mut(cell).count(is_drawn && cell == last));
    }

    /// Adds rays to the cell `index`: so many that ended in it, and that passed.
    pub fn add(&mut self, index: CellIndex, hits: u16, passes: u16) {
        if hits > 0 || passes > 0 {
            let cell = self.cell_mut(index);
            (cell.hits, cell.passes) = (cell.hits.saturating_add(hits), cell.passes.saturating_add(passes));
        }
    }

    #[inline]
    fn cell_mut(&mut self, index: CellIndex) -> &mut Cell {
        let place = tile_of(index);
        if self.last.0 != place || self.tiles.is_empty() {
            self.last = (place, self.tile_at(place));
        }
        &mut self.tiles[self.last.1][offset_in_tile(index)]
    }

    /// Index of a tile, which is made if there is none.
    #[cold]
    fn tile_at(&mut self, place: TileIndex) -> usize {
        *self.places.entry(place).or_insert_with(|| {
            self.tiles.push(Box::new([Cell::default(); TILE * TILE]));
            self.tiles.len() - 1
        })
    }

    /// What is known of the cell `index`.
    pub fn occupancy(&self, index: CellIndex) -> Occupancy {
        let tile = self.places.get(&tile_of(index)).map(|&tile| &self.tiles[tile]);
        tile.map_or(Occupancy::Unknown, |cells| self.judge(cells[offset_in_tile(index)]))
    }

    fn judge(&self, cell: Cell) -> Occupancy {
        let rays = u32::from(cell.hits) + u32::from(cell.passes);
        if rays == 0 {
            let is_free = cell.hits == 0 && cell.misses_agree(self.miss_sectors);
            if is_free { Occupancy::Free } else { Occupancy::Unknown }
        } else if f32::from(cell.hits) >= self.config.occupied_share * rays as f32 {
            Occupancy::Occupied
        } else {
            Occupancy::Free
        }
    }

    /// Edge of a tile, cells: by tiles a map is looked at in part.
    pub const TILE_CELLS: usize = TILE;

    /// Column and row of every tile that a ray has passed, in no order; a tile begins at that many times [`TILE_CELLS`](Self::TILE_CELLS).
    pub fn tiles(&self) -> impl Iterator<Item = (i32, i32)> + '_ {
        self.places.keys().copied()
    }

    /// What is known of the cells of a tile, row by row from below; none of one that no ray has passed.
    pub fn tile(&self, tile: (i32, i32)) -> impl Iterator<Item = Occupancy> + '_ {
        let cells = self.places.get(&tile).map_or(&[][..], |&tile| self.tiles[tile].as_slice());
        cells.iter().map(|cell| self.judge(*cell))
    }

    /// Edge of a cell, m.
    pub fn cell_size_m(&self) -> f32 {
        self.config.cell_size_m
    }

    /// Bytes of the cells held.
    pub fn memory_bytes(&self) -> usize {
        self.tiles.len() * TILE * TILE * size_of::<Cell>()
    }

    /// The known part as an image of at most `side_max` pixels on its longer side, several cells to a pixel if needed
    /// (the strongest of occupied, free, unknown wins); `None` if nothing is known.
    pub fn raster(&self, side_max: u32) -> Option<Raster> {
        let known = self.known()?;
        let cells_per_pixel = known.cells_per_pixel(side_max);
        let mut raster = known.empty_raster(cells_per_pixel, self.config.cell_size_m);
        self.for_each_known(|index, occupancy| raster.raise(index, occupancy));
        Some(raster)
    }

    fn known(&self) -> Option<Extent> {
        let mut extent = None;
        self.for_each_known(|index, _| extent.get_or_insert(Extent { min: index, max: index }).include(index));
        extent
    }

    fn for_each_known(&self, mut visit: impl FnMut(CellIndex, Occupancy)) {
        for (&(tile_column, tile_row), &tile) in &self.places {
            for (offset, &cell) in self.tiles[tile].iter().enumerate() {
                let occupancy = self.judge(cell);
                if occupancy != Occupancy::Unknown {
                    let column = (tile_column << TILE_BITS) + (offset % TILE) as i32;
                    let row = (tile_row << TILE_BITS) + (offset / TILE) as i32;
                    visit(CellIndex { column, row }, occupancy);
                }
            }
        }
    }
}

fn tile_of(index: CellIndex) -> TileIndex {
    (index.column >> TILE_BITS, index.row >> TILE_BITS)
}

fn offset_in_tile(index: CellIndex) -> usize {
    let inside = |i: i32| i as usize & (TILE - 1);
    inside(index.row) * TILE + inside(index.column)
}

/// Smallest rectangle around the known cells, both corners in it.
#[derive(Debug, Clone, Copy)]
struct Extent {
    min: CellIndex,
    max: CellIndex,
}

impl Extent {
    fn include(&mut self, index: CellIndex) {
        self.min.column = self.min.column.min(index.column);
        self.min.row = self.min.row.min(index.row);
        self.max.column = self.max.column.max(index.column);
        self.max.row = self.max.row.max(index.row);
    }

    fn pixels(&self, cells_per_pixel: u32) -> (u64, u64) {
        let side = |min: i32, max: i32| {
            let k = i64::from(cells_per_pixel);
            (i64::from(max).div_euclid(k) - i64::from(min).div_euclid(k) + 1).unsigned_abs()
        };
        (side(self.min.column, self.max.column), side(self.min.row, self.max.row))
    }

    /// The least number that keeps the image small enough.
    fn cells_per_pixel(&self, side_max: u32) -> u32 {
        let fits = |k: u32| {
            let (width, height) = self.pixels(k);
            width.max(height) <= u64::from(side_max.max(2)) && width * height <= RASTER_PIXELS_MAX
        };
        let (width, height) = self.pixels(1);
        let mut k = u32::try_from(width.max(height) / u64::from(side_max.max(2))).unwrap_or(u32::MAX / 2).max(1);
        while !fits(k) {
            k = k.saturating_add(k / 16 + 1);
        }
        k
    }

    fn empty_raster(&self, cells_per_pixel: u32, cell_size_m: f32) -> Raster {
        let k = i64::from(cells_per_pixel);
        let (left, bottom) = (i64::from(self.min.column).div_euclid(k), i64::from(self.min.row).div_euclid(k));
        let (width, height) = self.pixels(cells_per_pixel);
        let pixel_size_m = f64::from(cells_per_pixel) * exact_size_m(cell_size_m);
        Raster {
            width: width as usize,
            height: height as usize,
            pixel_size_m,
            origin_m: (left as f64 * pixel_size_m, bottom as f64 * pixel_size_m),
            pixels: vec![Occupancy::Unknown; (width * height) as usize],
            cells_per_pixel,
            left,
            bottom,
        }
    }
}

/// 0.05 and not the nearest `f32`'s 0.05000000075, so that an origin far out does not shift.
fn exact_size_m(cell_size_m: f32) -> f64 {
    (f64::from(cell_size_m) * 1e6).round() / 1e6
}

/// The map as an image, row 0 on top.
#[derive(Debug, Clone, PartialEq)]
pub struct Raster {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Edge of a pixel, m.
    pub pixel_size_m: f64,
    /// Lower left corner of the lower left pixel in the map frame, m.
    pub origin_m: (f64, f64),
    /// Row by row from the top.
    pub pixels: Vec<Occupancy>,
    cells_per_pixel: u32,
    left: i64,
    bottom: i64,
}

impl Raster {
    /// Edge of a pixel in cells: 1 unless the map was too large.
    pub fn cells_per_pixel(&self) -> u32 {
        self.cells_per_pixel
    }

    /// Where `point` (map, m) lies, in pixels from the upper left corner, y down; may lie outside.
    pub fn position(&self, point: Point2) -> (f64, f64) {
        let x = (f64::from(point.x) - self.origin_m.0) / self.pixel_size_m;
        let y = (f64::from(point.y) - self.origin_m.1) / self.pixel_size_m;
        (x, self.height as f64 - y)
    }

    fn raise(&mut self, index: CellIndex, occupancy: Occupancy) {
        let k = i64::from(self.cells_per_pixel);
        let column = (i64::from(index.column).div_euclid(k) - self.left) as usize;
        let row = (i64::from(index.row).div_euclid(k) - self.bottom) as usize;
        let pixel = (self.height - 1 - row) * self.width + column;
        self.pixels[pixel] = self.pixels[pixel].max(occupancy);
    }
}

#[cfg(test)]
mod tests;
