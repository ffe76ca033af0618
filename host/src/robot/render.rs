//! A corrected map as a robot would have it in its own frame: the tiles that it is given when it comes to a place that it knows from long ago.
//!
//! A loop that is closed here moves the old map, not the robot: its pose does not jump, and what it has in memory stays. But what it is given
//! from then on lies where it belongs as seen from where the robot is now.

use anyhow::Context as _;
use lrfslam_core::ancestry::Node;
use lrfslam_core::distributed_map::{MapMemory, Tile, TileHeader, TileId};
use lrfslam_core::geometry::Pose2;
use lrfslam_core::low_slam::{LowSlam, LowSlamMemory};
use lrfslam_core::particles::{Particle, Sample};
use lrfslam_core::rays::Ray;
use lrfslam_core::robot::{RobotConfig, TILE_SIDE};

use super::map::Tiles;
use crate::high_slam::Correction;
use crate::scan_store::ScanStore;

/// Tiles of a map of 100 m by 100 m, all of it seen.
const TILES: usize = 16_384;
/// Tiles along the side of a window that any beam fits in.
const WINDOW_SIDE: usize = 256;
/// Most beams of a scan.
const BEAMS: usize = 2048;

/// The tiles that the scans of `correction` make.
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
) -> anyhow::Result<Tiles> {
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
    let map = filter.map();
    let bytes = |tile: &Tile<TILE_SIDE>| tile.to_bytes(&mut [0; 2 * TILE_SIDE * TILE_SIDE]).map(<[u8]>::to_vec);
    let places = map.settled_places();
    Ok(places.filter_map(|place| Some(((place.column, place.row), bytes(map.settled_tile(place)?)?))).collect())
}
