//! The map as it is drawn for watchers, and its tiles in the form in which they are sent.
//!
//! Two layers: the map, and above it the piece in which a robot is that was lost and has not recognised a place yet.

use std::collections::{BTreeMap, BTreeSet};

use lrfslam_core::geometry::{Point2, Pose2};
use lrfslam_core::grid::{CellIndex, Occupancy, cells_on_ray};
use lrfslam_core::scan::Echo;
use lrfslam_core::sweep::Sweep;

use crate::maps::occupancy::{MapConfig, OccupancyMap};

/// The map.
pub(super) const MAP: u8 = 0;
/// The piece apart.
pub(super) const APART: u8 = 1;

/// Layer, column, row.
pub(super) type TileKey = (u8, i32, i32);

/// See the [module](self).
#[derive(Debug)]
pub(super) struct Layers {
    config: MapConfig,
    maps: [OccupancyMap; 2],
    /// Passed by rays since they were sent.
    touched: BTreeSet<TileKey>,
}

impl Layers {
    pub fn new(config: MapConfig) -> Self {
        Self { config, maps: [MAP, APART].map(|_| OccupancyMap::new(config)), touched: BTreeSet::new() }
    }

    /// Draws a scan, and notes which tiles its rays pass.
    pub fn insert(&mut self, layer: u8, sweep: &Sweep<'_>, map_from_robot: Pose2) {
        let map_from_lrf = map_from_robot * sweep.robot_from_lrf;
        if !map_from_lrf.is_finite() {
            return;
        }
        self.maps[usize::from(layer)].insert(sweep, map_from_robot);
        let tile_m = self.config.cell_size_m * OccupancyMap::TILE_CELLS as f32;
        let mut last = None;
        for beam in sweep.scan.beams {
            let way_m = match beam.echo {
                Echo::Hit(range_m) => range_m.min(self.config.draw_range_m),
                Echo::Miss => self.config.miss_clears_m.min(sweep.scan.range_max_m),
                Echo::Invalid => continue,
            };
            let end = map_from_lrf.transform(Point2::from_polar(way_m, beam.bearing_rad));
            for CellIndex { column, row } in cells_on_ray(map_from_lrf.position(), end, tile_m) {
                let tile = (layer, column, row);
                if last.replace(tile) != Some(tile) {
                    self.touched.insert(tile);
                }
            }
        }
    }

    pub fn has_touched(&self) -> bool {
        !self.touched.is_empty()
    }

    /// Tiles that rays have passed since the last call, as they are sent.
    pub fn take_touched(&mut self) -> Vec<(TileKey, Box<[u8]>)> {
        let touched = std::mem::take(&mut self.touched);
        touched.into_iter().map(|key| (key, self.packed(key))).collect()
    }

    /// All tiles as they are sent.
    pub fn take_all(&mut self) -> BTreeMap<TileKey, Box<[u8]>> {
        self.touched.clear();
        let keys = [MAP, APART]
            .into_iter()
            .flat_map(|layer| self.maps[usize::from(layer)].tiles().map(move |(column, row)| (layer, column, row)));
        keys.map(|key| (key, self.packed(key))).collect()
    }

    fn packed(&self, (layer, column, row): TileKey) -> Box<[u8]> {
        pack(self.maps[usize::from(layer)].tile((column, row)))
    }

    /// How well a hit fits what was drawn before: see [`Fit`].
    pub fn fit(&self, layer: u8, hit_in_map: Point2) -> Fit {
        let map = &self.maps[usize::from(layer)];
        let cell = CellIndex::containing(hit_in_map, self.config.cell_size_m);
        let near = |reach: i32| {
            let cells = (-reach..=reach).flat_map(move |row| (-reach..=reach).map(move |column| (column, row)));
            cells.into_iter().any(|(column, row)| {
                let there = CellIndex { column: cell.column + column, row: cell.row + row };
                map.occupancy(there) == Occupancy::Occupied
            })
        };
        if near(1) {
            Fit::Wall
        } else if near(3) {
            Fit::Near
        } else if map.occupancy(cell) == Occupancy::Free {
            Fit::Against
        } else {
            Fit::New
        }
    }
}

/// How a hit fits the map.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub(super) enum Fit {
    /// On a wall, to a cell.
    Wall = 0,
    /// Up to three cells from a wall.
    Near = 1,
    /// Where nothing was seen before.
    New = 2,
    /// Where the map is free.
    Against = 3,
}

/// Runs of equal cells, a byte each: two bits of what (0 unknown, 1 free, 2 occupied), six of how many less one. A tile of which nothing is
/// known is empty.
fn pack(cells: impl Iterator<Item = Occupancy>) -> Box<[u8]> {
    let mut runs: Vec<u8> = Vec::new();
    for cell in cells {
        let what = match cell {
            Occupancy::Unknown => 0,
            Occupancy::Free => 1,
            Occupancy::Occupied => 2,
        };
        match runs.last_mut() {
            Some(run) if *run >> 6 == what && *run & 63 < 63 => *run += 1,
            _ => runs.push(what << 6),
        }
    }
    if runs.iter().all(|run| run >> 6 == 0) { Box::default() } else { runs.into_boxed_slice() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_tell_every_cell() {
        let known = [Occupancy::Free; 70].into_iter().chain([Occupancy::Occupied, Occupancy::Unknown]);
        assert_eq!(*pack(known), [1 << 6 | 63, 1 << 6 | 5, 2 << 6, 0]);
        assert!(pack([Occupancy::Unknown; 4096].into_iter()).is_empty());
    }

    #[test]
    fn every_tile_that_a_scan_changes_is_noted() {
        use lrfslam_core::scan::{Beam, RangeScan};
        use lrfslam_core::time::{Duration, Instant};
        let mut layers = Layers::new(MapConfig::default());
        let beam = |degrees: i32| {
            let echo = if degrees % 7 == 0 { Echo::Miss } else { Echo::Hit(2.0 + 0.05 * degrees as f32) };
            Beam { bearing_rad: (degrees as f32).to_radians(), offset: Duration::ZERO, echo }
        };
        let beams: Vec<Beam> = (0..360).map(beam).collect();
        let scan = RangeScan { stamp: Instant::default(), range_max_m: 30.0, beams: &beams };
        layers.insert(MAP, &Sweep::at_rest(scan, Pose2::IDENTITY), Pose2::new(0.4, -1.3, 0.3));
        let touched: BTreeMap<_, _> = layers.take_touched().into_iter().collect();
        let all = layers.take_all();
        let told: BTreeMap<_, _> = touched.into_iter().filter(|(_, cells)| !cells.is_empty()).collect();
        let known: BTreeMap<_, _> = all.into_iter().filter(|(_, cells)| !cells.is_empty()).collect();
        assert_eq!(told, known);
    }
}
