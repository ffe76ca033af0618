//! A corrected map as a robot would have it in its own frame: the tiles that it is given when it comes to a place that it knows from long ago.
//!
//! A loop that is closed here moves the old map, not the robot: its pose does not jump, and what it has in memory stays. But what it is given
//! from then on lies where it belongs as seen from where the robot is now.

use anyhow::Context as _;
use lrfslam_core::ancestry::Node;
use lrfslam_core::distributed_map::{MapMemory, Tile, TileHeader, TileId, TilePlace};
use lrfslam_core::geometry::Pose2;
use lrfslam_core::low_slam::{LowSlam, LowSlamMemory};
use lrfslam_core::particles::{Particle, Sample};
use lrfslam_core::rays::Ray;
use lrfslam_core::slam::{SlamConfig, TILE_SIDE};

use super::map::Tiles;
use crate::mapping::Correction;
use crate::scans::store::ScanStore;

/// Tiles of a map of 200 m by 200 m in squares of 0.1 m, all of it seen.
const TILES: usize = 65_536;
/// Tiles along the side of a window that any beam fits in.
const WINDOW_SIDE: usize = 256;
/// Most beams of a scan.
const BEAMS: usize = 2048;

/// The tiles that the scans of `correction` make; `None` if there is no memory for all of them.
///
/// * `frame_from_map` — where the corrected map lies in the robot's frame
///
/// # Errors
/// If the configuration does not suit the memory, or a scan is larger than it.
pub fn render(
    (config, seed): (&SlamConfig, u64),
    frame_from_map: Pose2,
    correction: &Correction,
    scans: &ScanStore,
) -> anyhow::Result<Option<Tiles>> {
    let mut tiles = vec![Tile::<TILE_SIDE>::UNSEEN; TILES];
    let mut headers = vec![TileHeader::FREE; TILES];
    let memory = LowSlamMemory {
        map: MapMemory {
            tiles: &mut tiles,
            headers: &mut headers,
            node_tiles: &mut [TileId::NONE; 2],
            directory: &mut vec![TileId::NONE; TILES],
            ages: &mut [],
        },
        nodes: &mut [Node::FREE; 2],
        particles: &mut [Particle::UNUSED; 1],
        samples: &mut vec![Sample::UNUSED; usize::from(config.particles.samples_per_particle)],
        rays: &mut vec![Ray::UNUSED; BEAMS],
        window: &mut vec![TileId::NONE; WINDOW_SIDE * WINDOW_SIDE],
    };
    let mut filter = LowSlam::new(&config.low_slam(), seed, memory).context("drawing the robot's map")?;
    let mut beams = Vec::new();
    for (map_from_scan, scan) in &correction.reference {
        let Some(sweep) = scans.sweep(*scan as usize, &mut beams) else { continue };
        if filter.refer_to(&sweep, frame_from_map * *map_from_scan)? > 0 {
            return Ok(None);
        }
    }
    let map = filter.map();
    let bytes = |tile: &Tile<TILE_SIDE>| tile.to_bytes(&mut [0; 2 * TILE_SIDE * TILE_SIDE]).map(<[u8]>::to_vec);
    let places = map.settled_places();
    let tile = |place: TilePlace| Some(((place.column, place.row), bytes(map.settled_tile(place)?)?));
    Ok(Some(places.filter_map(tile).collect()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use lrfslam_core::scan::{Beam, Echo, RangeScan};
    use lrfslam_core::sweep::Sweep;
    use lrfslam_core::time::{Duration, Instant};
    use std::collections::BTreeSet;

    /// Columns and rows of the squares in which something was hit.
    fn hits(tiles: &Tiles) -> BTreeSet<(i32, i32)> {
        let side = TILE_SIDE as i32;
        let squares = tiles.iter().flat_map(|(place, bytes)| {
            bytes.chunks_exact(2).zip(0..).filter(|(square, _)| square[0] > 0).map(move |(_, index)| {
                (i32::from(place.0) * side + index % side, i32::from(place.1) * side + index / side)
            })
        });
        squares.collect()
    }

    #[test]
    fn map_lies_where_the_robots_frame_has_it() {
        // A wall 2.03 m ahead, 1 m to each side.
        let beam = |step: i32| {
            let bearing_rad = 0.01 * step as f32;
            let echo = Echo::Hit(2.03 / bearing_rad.cos());
            Beam { bearing_rad, offset: Duration::ZERO, echo }
        };
        let beams: Vec<Beam> = (-46..=46).map(beam).collect();
        let scan = RangeScan { stamp: Instant::default(), range_max_m: 8.0, beams: &beams };
        let mut scans = ScanStore::default();
        scans.add(&Sweep::at_rest(scan, Pose2::IDENTITY));
        let config = SlamConfig::small();
        let map_from_scan = Pose2::new(1.0, 0.5, 0.0);
        let correction = Correction { map_from_robot: Pose2::IDENTITY, reference: vec![(map_from_scan, 0)] };
        let drawn = |frame_from_map| hits(&render((&config, 1), frame_from_map, &correction, &scans).unwrap().unwrap());
        let here = drawn(Pose2::IDENTITY);
        assert!(
            here.len() > 15 && here.iter().all(|(column, row)| *column == 30 && (-6..=15).contains(row)),
            "{here:?}"
        );
        let moved: BTreeSet<_> = here.iter().map(|(column, row)| (column + 20, row - 30)).collect();
        let apart = drawn(Pose2::new(2.0, -3.0, 0.0));
        assert!(apart.intersection(&moved).count() + 2 >= moved.len(), "{apart:?} for {moved:?}");
        // Turned to the left by a right angle: what was at x is at y, and what was at y is at −x.
        let turned = drawn(Pose2::new(0.0, 0.0, std::f32::consts::FRAC_PI_2));
        assert!(turned.iter().all(|(column, row)| *row == 30 && (-17..=5).contains(column)), "{turned:?}");
    }
}
