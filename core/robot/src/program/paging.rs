//! Tiles of the particles' maps that are far from the robot live with the host: so a building may be larger than the robot's memory.
//!
//! Around the robot lies a square of tiles. When the robot has gone on, the square moves: tiles that are outside of it now are sent to the host
//! ([`FromRobot::Left`](crate::wire::message::FromRobot::Left)) and forgotten; what comes to lie inside is asked for
//! ([`FromRobot::Recall`](crate::wire::message::FromRobot::Recall)) and comes back.
//!
//! The square reaches farther than the particles' beams. So if the answer comes before the robot has gone that far, the map is the one that a
//! larger memory would hold, to the bit. If it does not come in time the robot maps on; what it then has at a place stays, and the
//! host's tile is not taken. Only tiles that all particles agree on leave. Without a host what is outside waits in memory, up to a share
//! of it; then it is forgotten, and counted.
//!
//! # When
//! All is decided at scans, and goes by nothing but scans. What is outside is chosen at one scan, some tiles at a time in the order of their
//! places, and is forgotten at the first scan [`ANSWER_TIME`] later. Tiles that are asked for at one scan are seen from the first scan that much later
//! on; those that come earlier wait unseen, in tiles of the pool that were never anybody else's. So how many tiles are free, and with it which particles find
//! room, does not depend on the link, as long as the host acknowledges and answers within that time. What it has not is waited for, and
//! counted as late.
//!
//! The matcher's reference is not part of this: it forgets what is farthest and begins anew. A reference that came back would pull the robot to
//! where it was before a loop by as much as the loop is open, and the host, which closes loops by what the robot says that it has moved, would
//! count that twice.

mod leaving;
mod returning;

use self::leaving::Leaving;
use self::returning::Returning;
use super::square::{radius, tile_m};
use crate::wire::message::TileUpdate;
use crate::wire::session::{QueueFullError, Session};
use lrfslam_core::distributed_map::{DistributedMap, Region, TilePlace};
use lrfslam_core::geometry::Point2;
use lrfslam_core::math::floor;
use lrfslam_core::slam::{Slam, SlamConfig, TILE_SIDE};
use lrfslam_core::time::{Duration, Instant};

/// From the scan at which a tile is sent or asked for to that at which it is gone or there.
const ANSWER_TIME: Duration = Duration::from_millis(1000);
/// Without a host this share of all tiles may be outside of the square.
const WAITING_SHARE: usize = 8;
/// The square moves when the robot is so far from the middle of its central tile, tiles.
const OFF_CENTRE: f32 = 0.75;
/// Columns of the plane.
const PLACE_MAX: f32 = 32_000.0;

/// What happened so far.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct TileCounts {
    /// Tiles that only the host has.
    pub(super) left: u32,
    /// Tiles that came back.
    pub(super) restored: u32,
    /// Tiles forgotten for want of a host, and not taken back for want of room.
    pub(super) forgotten: u32,
    /// Tiles acknowledged, and requests answered, later than they were due.
    pub(super) late: u32,
}

/// See the [module](self).
#[derive(Debug)]
pub(super) struct Paging {
    tile_m: f32,
    /// Tiles from the central one to the edge of the square.
    radius: i16,
    centre: TilePlace,
    /// `None` before the first scan.
    square: Option<Region>,
    leaving: Leaving,
    returning: Returning,
    pub(super) counts: TileCounts,
}

impl Paging {
    /// For a map in which nothing was seen yet.
    pub(super) fn of(slam: &Slam<'_, TILE_SIDE>, config: &SlamConfig) -> Self {
        Self::new(tile_m(slam), radius(config, tile_m(slam)))
    }

    /// For tiles with sides of `tile_m` m, `radius` of them to each side of the robot's.
    fn new(tile_m: f32, radius: i16) -> Self {
        Self {
            tile_m,
            radius,
            centre: TilePlace::default(),
            square: None,
            leaving: Leaving::default(),
            returning: Returning::default(),
            counts: TileCounts::default(),
        }
    }

    /// A scan was mapped at `now`: everything is decided here.
    ///
    /// * `robot` — where the robot goes on from, if the filter has taken a step
    pub(super) fn scan_mapped(
        &mut self,
        now: Instant,
        robot: Option<Point2>,
        map: &mut DistributedMap<'_, TILE_SIDE>,
        link: &Session<'_>,
    ) {
        robot.into_iter().for_each(|robot| self.drive_to(robot));
        let Self { square: Some(square), leaving, returning, counts, .. } = self else { return };
        returning.settle(now, square, map, counts);
        leaving.settle(now, square, map, link, counts);
        if is_alone(link) {
            leaving.forget_surplus(square, map.tiles_max() / WAITING_SHARE, map, counts);
        } else {
            returning.ask(now, square, map);
            leaving.choose(now, square, map);
        }
    }

    fn drive_to(&mut self, robot: Point2) {
        self.leaving.map_changed();
        let in_tiles = |value: f32| (value / self.tile_m).clamp(-PLACE_MAX, PLACE_MAX);
        let (x, y) = (in_tiles(robot.x), in_tiles(robot.y));
        let is_off = |at: f32, centre: i16| (at - f32::from(centre) - 0.5).abs() > OFF_CENTRE;
        if self.square.is_some() && !is_off(x, self.centre.column) && !is_off(y, self.centre.row) {
            return;
        }
        self.centre = TilePlace { column: floor(x) as i16, row: floor(y) as i16 };
        let square = Region::around(self.centre, self.radius);
        match self.square.replace(square) {
            Some(_) => self.returning.square_moved(&square),
            None => self.returning.begin(&square),
        }
    }

    /// Queues what was decided, as far as there is room.
    ///
    /// # Errors
    /// [`QueueFullError`] if something waits for room.
    pub(super) fn send(
        &mut self,
        map: &DistributedMap<'_, TILE_SIDE>,
        link: &mut Session<'_>,
    ) -> Result<(), QueueFullError> {
        if is_alone(link) {
            return Ok(());
        }
        self.returning.send(link)?;
        self.leaving.send(map, link)
    }

    /// The host is new.
    pub(super) fn forget_requests(&mut self, map: &mut DistributedMap<'_, TILE_SIDE>) {
        self.returning.forget_requests(map);
    }

    /// A tile comes back.
    pub(super) fn take(&mut self, tile: &TileUpdate<'_>, map: &mut DistributedMap<'_, TILE_SIDE>) {
        self.returning.take(tile, map, &mut self.counts);
    }

    /// The host has given all that it has there.
    pub(super) fn recalled(&mut self, region: &Region) {
        self.returning.recalled(region);
    }
}

/// True if no host takes anything.
fn is_alone(link: &Session<'_>) -> bool {
    !link.is_live() || link.is_silent()
}

#[cfg(test)]
mod tests;
