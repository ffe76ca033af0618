//! The square of tiles about the robot that its memory holds, and the tiles that are kept free for those that come back into it.

use lrfslam_core::math::floor;
use lrfslam_core::slam::{Slam, SlamConfig, TILE_SIDE};

/// Tiles about the robot beyond the reach of its beams: what particles are apart, and the way that it goes while the host answers.
const MARGIN: i16 = 2;
/// Tiles kept free for those that come back are two sides of the square, for a robot that drives at an angle to its sides, but no more than this.
pub(super) const KEPT_FREE_MAX: usize = 64;

/// Keeps tiles free for those that come back, whether or not any ever leaves: which particles find room is the same on every computer.
pub(super) fn reserve(slam: &mut Slam<'_, TILE_SIDE>, config: &SlamConfig) {
    let radius = radius(config, tile_m(slam));
    let map = slam.map_mut();
    map.keep_free(kept_free(radius, map.tiles_max()));
}

/// Of a pool of `tiles`, for a square that reaches `radius` tiles to each side.
pub(super) fn kept_free(radius: i16, tiles: usize) -> u16 {
    let side = 2 * usize::from(radius.unsigned_abs()) + 1;
    // A pool that is hardly larger than that still has room for a map.
    (2 * side).min(KEPT_FREE_MAX).min(tiles / 4) as u16
}

/// Side of a tile, m.
pub(super) fn tile_m(slam: &Slam<'_, TILE_SIDE>) -> f32 {
    TILE_SIDE as f32 * slam.filter().map().square_size_m()
}

/// Tiles from the central one to the edge of the square. The configuration bounds it: 200 m over tiles of 8 cm.
pub(super) fn radius(config: &SlamConfig, tile_m: f32) -> i16 {
    floor(config.rays.range_max_m / tile_m) as i16 + 1 + MARGIN
}
