//! The map as it is drawn: a grid that grows with the area seen and counts, cell by cell, who hit and who passed.
//!
//! Data flow: scan and pose of the laser → every ray's cells ([`cells_on_ray`]) → hits and passes per cell →
//! [`Raster`]: unknown, free or occupied. A hit clears its way and marks its end; a miss clears only the first few
//! metres, since glass and black walls give misses too; an invalid beam says nothing.
//!
//! Memory: square tiles of 64 × 64 cells, 4 bytes a cell, made where a ray first passes. Counters that would overflow
//! are halved in pairs, so that their ratio stays.

use std::collections::HashMap;

use lrfslam_core::geometry::{Point2, Pose2};
use lrfslam_core::grid::{CellIndex, cells_on_ray};
use lrfslam_core::scan::{Beam, Echo, RangeScan};

lrfslam_core::config! {
    /// How the map is drawn.
    pub struct MapConfig {
        /// Edge of a cell, m.
        cell_size_m: f32 = 0.05, in 0.005..=1.0;
        /// A hit farther away is not drawn, its ray clears the way up to here, m.
        draw_range_m: f32 = 50.0, in 0.5..=1000.0;
        /// A beam that saw nothing clears the way this far, m: behind that it may have gone through glass.
        miss_clears_m: f32 = 3.0, in 0.0..=1000.0;
        /// A cell is occupied if at least this share of the rays that reached it ended there.
        /// Lower: thicker walls, more ghosts of passers-by. Source: the value GMapping draws with.
        occupied_share: f32 = 0.25, in 0.01..=1.0;
        /// Fewer rays leave a cell unknown.
        observations_min: u16 = 1, in 1..=1000;
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

#[derive(Debug, Clone, Copy, Default)]
struct Cell {
    hits: u16,
    passes: u16,
}

impl Cell {
    fn count(&mut self, hit: bool) {
        if self.hits.max(self.passes) == u16::MAX {
            self.hits /= 2;
            self.passes /= 2;
        }
        *(if hit { &mut self.hits } else { &mut self.passes }) += 1;
    }
}

type TileIndex = (i32, i32);

/// The growing grid.
#[derive(Debug, Clone)]
pub struct OccupancyMap {
    config: MapConfig,
    tiles: Vec<Vec<Cell>>,
    places: HashMap<TileIndex, usize>,
    /// Where the last cell was: the next one is mostly there too.
    last: Option<(TileIndex, usize)>,
}

impl OccupancyMap {
    /// An empty map.
    pub fn new(config: MapConfig) -> Self {
        Self { config, tiles: Vec::new(), places: HashMap::new(), last: None }
    }

    /// Draws `scan`, taken by a laser at `map_from_lrf`; a pose that is not finite draws nothing.
    ///
    /// Cost: O(cells that its rays cross).
    pub fn insert(&mut self, scan: &RangeScan<'_>, map_from_lrf: Pose2) {
        if map_from_lrf.is_finite() {
            scan.beams.iter().for_each(|beam| self.insert_beam(beam, scan.range_max_m, map_from_lrf));
        }
    }

    fn insert_beam(&mut self, beam: &Beam, range_max_m: f32, map_from_lrf: Pose2) {
        let (way_m, hit) = match beam.echo {
            Echo::Hit(range_m) if range_m <= self.config.draw_range_m => (range_m, true),
            Echo::Hit(_) => (self.config.draw_range_m, false),
            Echo::Miss => (self.config.miss_clears_m.min(range_max_m), false),
            Echo::Invalid => return,
        };
        let end = map_from_lrf.transform(Point2::from_polar(way_m, beam.bearing_rad));
        let last = CellIndex::containing(end, self.config.cell_size_m);
        for cell in cells_on_ray(map_from_lrf.position(), end, self.config.cell_size_m) {
            self.cell_mut(cell).count(hit && cell == last);
        }
    }

    /// Adds rays to the cell `index`: so many that ended in it, and that passed.
    pub fn add(&mut self, index: CellIndex, hits: u16, passes: u16) {
        if hits > 0 || passes > 0 {
            let cell = self.cell_mut(index);
            (cell.hits, cell.passes) = (cell.hits.saturating_add(hits), cell.passes.saturating_add(passes));
        }
    }

    fn cell_mut(&mut self, index: CellIndex) -> &mut Cell {
        let place = tile_of(index);
        let tile = match self.last {
            Some((last, tile)) if last == place => tile,
            _ => *self.places.entry(place).or_insert_with(|| {
                self.tiles.push(vec![Cell::default(); TILE * TILE]);
                self.tiles.len() - 1
            }),
        };
        self.last = Some((place, tile));
        &mut self.tiles[tile][offset_in_tile(index)]
    }

    /// What is known of the cell `index`.
    pub fn occupancy(&self, index: CellIndex) -> Occupancy {
        let tile = self.places.get(&tile_of(index)).map(|&tile| &self.tiles[tile]);
        tile.map_or(Occupancy::Unknown, |cells| self.judge(cells[offset_in_tile(index)]))
    }

    fn judge(&self, cell: Cell) -> Occupancy {
        let rays = u32::from(cell.hits) + u32::from(cell.passes);
        if rays == 0 || rays < u32::from(self.config.observations_min) {
            Occupancy::Unknown
        } else if f32::from(cell.hits) >= self.config.occupied_share * rays as f32 {
            Occupancy::Occupied
        } else {
            Occupancy::Free
        }
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
mod tests {
    use super::*;
    use lrfslam_core::time::{Duration, Instant};

    fn config() -> MapConfig {
        MapConfig { cell_size_m: 0.5, miss_clears_m: 1.0, ..MapConfig::default() }
    }

    fn insert(map: &mut OccupancyMap, beams: &[(f32, Echo)], pose: Pose2) {
        let beams: Vec<Beam> = beams
            .iter()
            .map(|&(degrees, echo)| Beam { bearing_rad: degrees.to_radians(), offset: Duration::ZERO, echo })
            .collect();
        map.insert(&RangeScan { stamp: Instant::default(), range_max_m: 80.0, beams: &beams }, pose);
    }

    fn picture(map: &OccupancyMap, side_max: u32) -> Vec<String> {
        let raster = map.raster(side_max).unwrap();
        let sign = |o: &Occupancy| match o {
            Occupancy::Unknown => '?',
            Occupancy::Free => '.',
            Occupancy::Occupied => '#',
        };
        raster.pixels.chunks(raster.width).map(|row| row.iter().map(sign).collect()).collect()
    }

    #[test]
    fn hit_clears_its_way_miss_a_little_invalid_nothing() {
        let mut map = OccupancyMap::new(config());
        let beams = [(0.0, Echo::Hit(2.0)), (90.0, Echo::Miss), (180.0, Echo::Invalid), (-90.0, Echo::Hit(0.6))];
        insert(&mut map, &beams, Pose2::new(0.2, 0.2, 0.0));
        assert_eq!(picture(&map, 100), [".????", ".????", "....#", "#????"]);
        assert_eq!(map.raster(100).unwrap().origin_m, (0.0, -0.5));
    }

    #[test]
    fn far_hit_is_cleared_but_not_drawn() {
        let mut map = OccupancyMap::new(MapConfig { draw_range_m: 1.0, ..config() });
        insert(&mut map, &[(0.0, Echo::Hit(30.0))], Pose2::new(0.2, 0.2, 0.0));
        assert_eq!(picture(&map, 100), ["..."]);
    }

    #[test]
    fn passer_by_fades_and_wall_stays() {
        let mut map = OccupancyMap::new(config());
        insert(&mut map, &[(0.0, Echo::Hit(1.0))], Pose2::new(0.2, 0.2, 0.0));
        for _ in 0..70_000 {
            insert(&mut map, &[(0.0, Echo::Hit(2.0))], Pose2::new(0.2, 0.2, 0.0));
        }
        assert_eq!(picture(&map, 100), ["....#"]);
    }

    #[test]
    fn large_map_is_drawn_smaller_and_keeps_its_walls() {
        let mut map = OccupancyMap::new(config());
        insert(&mut map, &[(0.0, Echo::Hit(9.6)), (90.0, Echo::Hit(4.6))], Pose2::new(-3.3, 0.2, 0.0));
        let full = map.raster(100).unwrap();
        let small = map.raster(7).unwrap();
        assert_eq!((full.width, full.cells_per_pixel()), (20, 1));
        assert_eq!((small.width <= 7, small.pixels.contains(&Occupancy::Occupied)), (true, true));
        assert_eq!(small.pixel_size_m, f64::from(small.cells_per_pixel()) * 0.5);
        let (x, y) = full.position(Point2::new(full.origin_m.0 as f32, full.origin_m.1 as f32));
        assert_eq!((x, y), (0.0, full.height as f64));
    }

    #[test]
    fn places_a_world_apart_do_not_fill_the_memory() {
        let mut map = OccupancyMap::new(config());
        for pose in [Pose2::new(-3e8, 0.0, 0.0), Pose2::new(3e8, 3e8, 0.0), Pose2::new(f32::NAN, 0.0, 0.0)] {
            insert(&mut map, &[(0.0, Echo::Hit(2.0))], pose);
        }
        assert!(map.memory_bytes() < 1 << 20);
        let raster = map.raster(2000).unwrap();
        assert!(raster.width <= 2000 && raster.height <= 2000);
        assert!(OccupancyMap::new(config()).raster(10).is_none());
    }
}
