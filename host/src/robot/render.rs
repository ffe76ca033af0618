//! A corrected map as a robot would have it in its own frame: the pages that it is given when it comes to a place that it knows from long ago.
//!
//! A loop that is closed here moves the old map, not the robot: its pose does not jump, and what it has in memory stays. But what it is given
//! from then on lies where it belongs as seen from where the robot is now.

use anyhow::Context as _;
use lrfslam_core::ancestry::Node;
use lrfslam_core::distributed_map::{MapMemory, Tile, TileHeader, TileId};
use lrfslam_core::filter;
use lrfslam_core::geometry::{Point2, Pose2};
use lrfslam_core::low_slam::{LowSlam, LowSlamMemory};
use lrfslam_core::ndt::{DirectoryEntry, NdtGrid, NdtTile, TILE_BYTES_MAX};
use lrfslam_core::particles::{Particle, Sample};
use lrfslam_core::rays::Ray;
use lrfslam_core::region::TileAddress;
use lrfslam_core::robot::{RobotConfig, TILE_SIDE};
use lrfslam_core::wire::message::{Page, PagedMap};

use super::pages::Pages;
use crate::high_slam::Correction;
use crate::scan_store::ScanStore;

/// Tiles of a map of 100 m by 100 m, all of it seen.
const TILES: usize = 16_384;
/// Tiles of cells, walls only, and places that they can be at.
const CELL_TILES: usize = 16_384;
const CELL_PLACES: usize = 256 * 256;
/// Tiles along the side of a window that any beam fits in.
const WINDOW_SIDE: usize = 256;
/// Most beams of a scan.
const BEAMS: usize = 2048;

/// The pages of a robot's maps that the scans of `correction` make.
///
/// * `frame_from_map` — where the corrected map lies in the robot's frame
///
/// # Errors
/// If the configuration does not suit the memory, or a scan is larger than it.
pub fn render(
    config: &RobotConfig,
    frame_from_map: Pose2,
    correction: &Correction,
    scans: &ScanStore,
) -> anyhow::Result<Pages> {
    let mut pages = Pages::default();
    squares(config, frame_from_map, correction, scans, &mut pages)?;
    cells(config, frame_from_map, correction, scans, &mut pages)?;
    Ok(pages)
}

fn squares(
    config: &RobotConfig,
    frame_from_map: Pose2,
    correction: &Correction,
    scans: &ScanStore,
    pages: &mut Pages,
) -> anyhow::Result<()> {
    let mut tiles = vec![Tile::<TILE_SIDE>::UNSEEN; TILES];
    let mut headers = vec![TileHeader::FREE; TILES];
    let memory = LowSlamMemory {
        map: MapMemory {
            tiles: &mut tiles,
            headers: &mut headers,
            node_tiles: &mut [TileId::NONE; 2],
            directory: &mut vec![TileId::NONE; TILES],
        },
        nodes: &mut [Node::FREE; 2],
        particles: &mut [Particle::UNUSED; 1],
        samples: &mut vec![Sample::UNUSED; usize::from(config.particles.samples_per_particle)],
        rays: &mut vec![Ray::UNUSED; BEAMS],
        window: &mut vec![TileId::NONE; WINDOW_SIDE * WINDOW_SIDE],
    };
    let mut filter = LowSlam::new(&config.low_slam(), config.seed, memory).context("drawing the robot's map")?;
    let mut beams = Vec::new();
    for (map_from_scan, scan) in &correction.reference {
        if let Some(sweep) = scans.sweep(*scan as usize, &mut beams) {
            filter.refer_to(&sweep, frame_from_map * *map_from_scan)?;
        }
    }
    for place in filter.map().settled_places() {
        let mut bytes = [0; TILE_BYTES_MAX];
        let address = TileAddress { layer: 0, column: place.column, row: place.row };
        if let Some(bytes) = filter.map().settled_tile(place).and_then(|tile| tile.to_bytes(&mut bytes)) {
            pages.keep(&Page { map: PagedMap::Squares, address, bytes });
        }
    }
    Ok(())
}

fn cells(
    config: &RobotConfig,
    frame_from_map: Pose2,
    correction: &Correction,
    scans: &ScanStore,
    pages: &mut Pages,
) -> anyhow::Result<()> {
    let layers = if config.ndt.overlapping { 4 } else { 1 };
    let mut directory = vec![DirectoryEntry::EMPTY; layers * CELL_PLACES];
    let mut tiles = vec![NdtTile::EMPTY; layers * CELL_TILES];
    let mut grid = NdtGrid::new(&config.ndt, &mut directory, &mut tiles).context("drawing the robot's reference")?;
    let (mut beams, mut hits) = (Vec::new(), vec![Point2::default(); BEAMS]);
    for (map_from_scan, scan) in &correction.reference {
        if let Some(sweep) = scans.sweep(*scan as usize, &mut beams) {
            grid.insert(filter::hits(&sweep, &mut hits)?, frame_from_map * *map_from_scan);
        }
    }
    for address in grid.addresses() {
        let mut bytes = [0; TILE_BYTES_MAX];
        if let Some(bytes) = grid.tile_bytes(address, &mut bytes) {
            pages.keep(&Page { map: PagedMap::Cells, address, bytes });
        }
    }
    Ok(())
}
