//! Tiles of the particles' maps that are far from the robot live with the host: so a building may be larger than the robot's memory.
//!
//! Around the robot lies a square of tiles, its **home**, of which everything is in memory. When the robot has gone on, the square moves:
//! tiles that are outside of it now are sent to the host ([`FromRobot::Left`]) and forgotten once the host has acknowledged them; what comes to lie
//! inside is asked for ([`FromRobot::Recall`]), and is part of the home again when the host has given all that it has there.
//!
//! The home reaches farther than the particles' beams. So if the answer comes before the robot has gone that far, the map is the one that a
//! larger memory would hold, to the bit. If it does not come in time the robot maps on; what it then has at a place stays, and the
//! host's tile is not taken. Only tiles that all particles agree on leave. Without a host what is outside waits in memory, up to a share
//! of it; then it is forgotten, and counted.
//!
//! The matcher's reference is not part of this: it forgets what is farthest and begins anew. A reference that came back would pull the robot to
//! where it was before a loop by as much as the loop is open, and the host, which closes loops by what the robot says that it has moved, would
//! count that twice.

use super::mapping::Mapping;
use super::pools::TILE_SIDE;
use super::report::{CRC32, TILE_BYTES};
use super::sweep_report::KEPT_FREE;
use crate::distributed_map::{DistributedMap, Region, Restored, Tile, TilePlace};
use crate::geometry::Point2;
use crate::math::floor;
use crate::wire::message::{FromRobot, TileUpdate};
use crate::wire::session::{QueueFullError, Session};

/// Tiles about the robot beyond the reach of its beams: what particles are apart, and the way that it goes while the host answers.
const MARGIN: i16 = 2;
/// This share of all tiles, or so many if that is less, is kept free for those that come back.
const RESERVE_SHARE: usize = 16;
const RESERVE_MAX: usize = 32;
/// Without a host this share of all tiles may be outside of the square.
const WAITING_SHARE: usize = 8;
/// Tiles on their way to the host.
const LEAVING: usize = 8;
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
}

/// A tile that the host has not acknowledged yet.
#[derive(Debug, Clone, Copy)]
struct Leaving {
    place: TilePlace,
    /// Of its squares: who changes them makes it stay.
    crc: u32,
    /// Of the message.
    number: u32,
}

/// See the [module](self).
#[derive(Debug)]
pub(super) struct Paging {
    tile_m: f32,
    /// Tiles from the central one to the edge of the square.
    radius: i16,
    centre: TilePlace,
    /// Where the home should be; `None` before the first scan.
    square: Option<Region>,
    /// The part of it of which everything is here.
    home: Region,
    asked: Option<Region>,
    /// The part of it that has been in the square ever since.
    awaited: Region,
    leaving: heapless::Vec<Leaving, LEAVING>,
    /// There may be tiles outside of the square.
    is_due: bool,
    pub(super) counts: TileCounts,
}

impl Paging {
    /// For a map in which nothing was seen yet; keeps some of its tiles free.
    pub(super) fn of(mapping: &mut Mapping<'_>) -> Self {
        let range_max_m = mapping.config().rays.range_max_m;
        let map = mapping.map_mut();
        map.keep_free((map.tiles_max() / RESERVE_SHARE).min(RESERVE_MAX) as u16);
        let tile_m = TILE_SIDE as f32 * map.square_size_m();
        // The configuration bounds it: 200 m over tiles of 8 cm.
        Self::new(tile_m, floor(range_max_m / tile_m) as i16 + 1 + MARGIN)
    }

    /// For tiles with sides of `tile_m` m, `radius` of them to each side of the robot's.
    fn new(tile_m: f32, radius: i16) -> Self {
        Self {
            tile_m,
            radius,
            centre: TilePlace::default(),
            square: None,
            home: Region::default(),
            asked: None,
            awaited: Region::default(),
            leaving: heapless::Vec::new(),
            is_due: false,
            counts: TileCounts::default(),
        }
    }

    /// The robot has mapped, and goes on from where it is now.
    pub(super) fn drive(&mut self, mapping: &Mapping<'_>) {
        self.drive_to(mapping.slam().odometry().map_from_robot().position());
    }

    fn drive_to(&mut self, robot: Point2) {
        self.is_due = true;
        let in_tiles = |value: f32| (value / self.tile_m).clamp(-PLACE_MAX, PLACE_MAX);
        let (x, y) = (in_tiles(robot.x), in_tiles(robot.y));
        let is_off = |at: f32, centre: i16| (at - f32::from(centre) - 0.5).abs() > OFF_CENTRE;
        if self.square.is_some() && !is_off(x, self.centre.column) && !is_off(y, self.centre.row) {
            return;
        }
        self.centre = TilePlace { column: floor(x) as i16, row: floor(y) as i16 };
        let square = Region::around(self.centre, self.radius);
        // Nothing was seen before the first scan.
        self.home = if self.square.is_some() { self.home.intersection(&square) } else { square };
        self.awaited = self.awaited.intersection(&square);
        self.square = Some(square);
    }

    /// The host is new: what the last one was asked, this one has not heard.
    pub(super) fn forget_request(&mut self) {
        self.asked = None;
    }

    /// The host has given all that it has there.
    pub(super) fn recalled(&mut self, region: &Region) {
        if self.asked == Some(*region) {
            self.asked = None;
            if !self.awaited.is_empty() {
                self.home = self.home.with_side(&self.awaited);
            }
        }
    }

    /// Takes a tile back.
    pub(super) fn take(&mut self, tile: &TileUpdate<'_>, map: &mut DistributedMap<'_, TILE_SIDE>) {
        let place = TilePlace { column: tile.column, row: tile.row };
        if self.square.is_some_and(|square| square.contains(place)) {
            match Tile::from_bytes(tile.squares).map(|tile| map.restore(place, tile)) {
                Some(Ok(Restored::Done)) => self.counts.restored = self.counts.restored.saturating_add(1),
                Some(Ok(Restored::IsKnown)) => {}
                Some(Err(_)) | None => self.counts.forgotten = self.counts.forgotten.saturating_add(1),
            }
        }
    }

    /// Lets go what the host has; without a host, what is too much.
    pub(super) fn let_go(&mut self, map: &mut DistributedMap<'_, TILE_SIDE>, link: &Session<'_>) {
        if let Some(square) = self.square {
            self.settle(&square, map, link);
            if is_alone(link) {
                self.forget_surplus(&square, map);
            }
        }
    }

    /// Asks for what is missing, and sends what is outside, as far as the queue has room.
    ///
    /// # Errors
    /// [`QueueFullError`] if something waits for room.
    pub(super) fn run(
        &mut self,
        map: &DistributedMap<'_, TILE_SIDE>,
        link: &mut Session<'_>,
    ) -> Result<(), QueueFullError> {
        let Some(square) = self.square.filter(|_| !is_alone(link)) else { return Ok(()) };
        if let Some(region) = self.home.next_side_of(&square).filter(|_| self.asked.is_none()) {
            link.send(&FromRobot::Recall(region))?;
            (self.asked, self.awaited) = (Some(region), region);
        }
        while self.is_due && !self.leaving.is_full() {
            let outside = map.settled_places().find(|place| self.is_outside(&square, *place));
            let mut memory = [0; TILE_BYTES];
            let tile = outside.and_then(|place| Some((place, map.settled_tile(place)?.to_bytes(&mut memory)?)));
            let Some((place, squares)) = tile else {
                self.is_due = false;
                break;
            };
            if link.queue_room() < TILE_BYTES + KEPT_FREE {
                return Err(QueueFullError);
            }
            let update = TileUpdate { column: place.column, row: place.row, squares };
            let number = link.send(&FromRobot::Left(update))?;
            let _ = self.leaving.push(Leaving { place, crc: CRC32.checksum(squares), number });
        }
        Ok(())
    }

    /// What was acknowledged, and is as it was sent, goes.
    fn settle(&mut self, square: &Region, map: &mut DistributedMap<'_, TILE_SIDE>, link: &Session<'_>) {
        let Self { leaving, counts, is_due, .. } = self;
        leaving.retain(|tile| {
            if !link.is_acknowledged(tile.number) {
                return true;
            }
            let mut memory = [0; TILE_BYTES];
            let squares = map.settled_tile(tile.place).and_then(|tile| tile.to_bytes(&mut memory));
            let is_as_sent = squares.is_some_and(|squares| CRC32.checksum(squares) == tile.crc);
            if is_as_sent && !square.contains(tile.place) && map.let_go(tile.place) {
                counts.left = counts.left.saturating_add(1);
            }
            *is_due = true;
            false
        });
    }

    fn forget_surplus(&mut self, square: &Region, map: &mut DistributedMap<'_, TILE_SIDE>) {
        while self.is_due {
            let waiting = map.tiles_max() / WAITING_SHARE;
            let surplus = map.settled_places().filter(|place| self.is_outside(square, *place)).nth(waiting);
            self.is_due = surplus.is_some_and(|place| map.let_go(place));
            self.counts.forgotten = self.counts.forgotten.saturating_add(u32::from(self.is_due));
        }
    }

    /// True if it is outside of the square, and not on its way yet.
    fn is_outside(&self, square: &Region, place: TilePlace) -> bool {
        !square.contains(place) && self.leaving.iter().all(|tile| tile.place != place)
    }
}

/// True if no host takes anything.
fn is_alone(link: &Session<'_>) -> bool {
    !link.is_live() || link.is_silent()
}

#[cfg(test)]
mod tests;
