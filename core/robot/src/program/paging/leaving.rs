//! Tiles on their way to the host.

use crate::wire::message::{FromRobot, TileUpdate};
use crate::wire::session::{QueueFullError, Session};
use lrfslam_core::distributed_map::{DistributedMap, Region, TilePlace};
use lrfslam_core::time::Instant;

use super::super::report::TILE_BYTES;
use super::super::sweep_report::KEPT_FREE;
use super::{ANSWER_TIME, TileCounts};
use crate::wire::frame::CRC32;
use lrfslam_core::slam::TILE_SIDE;

/// Most that are on their way.
const LEAVING: usize = 32;
/// Most that are chosen at one scan.
const AT_ONCE: usize = 4;

/// A tile that is still in memory.
#[derive(Debug, Clone, Copy)]
struct Tile {
    place: TilePlace,
    /// Of its squares when it was chosen: who changes them makes it stay.
    crc: u32,
    /// When it goes.
    due: Instant,
    /// Of the message.
    number: u32,
    is_sent: bool,
    is_late: bool,
}

/// See the [module](self): in the order in which they were chosen.
#[derive(Debug, Default)]
pub(super) struct Leaving {
    tiles: heapless::Vec<Tile, LEAVING>,
    /// There may be more outside of the square.
    is_due: bool,
}

impl Leaving {
    /// The square or the map has changed.
    pub(super) fn map_changed(&mut self) {
        self.is_due = true;
    }

    /// What is due at `now`, was acknowledged and is as it was chosen goes; what has changed or is wanted again stays.
    pub(super) fn settle(
        &mut self,
        now: Instant,
        square: &Region,
        map: &mut DistributedMap<'_, TILE_SIDE>,
        link: &Session<'_>,
        counts: &mut TileCounts,
    ) {
        self.tiles.retain_mut(|tile| {
            if now < tile.due {
                return true;
            }
            let is_to_go = !square.contains(tile.place) && crc_at(map, tile.place) == Some(tile.crc);
            let is_there = tile.is_sent && link.is_acknowledged(tile.number);
            if is_to_go && is_there && map.let_go(tile.place) {
                counts.left = counts.left.saturating_add(1);
            } else if is_to_go && !is_there {
                counts.late = counts.late.saturating_add(u32::from(!tile.is_late));
                tile.is_late = true;
                return true;
            }
            self.is_due = true;
            false
        });
    }

    /// Chooses tiles that are outside of the square, in the order of their places: which, depends on nothing but the map.
    pub(super) fn choose(&mut self, now: Instant, square: &Region, map: &DistributedMap<'_, TILE_SIDE>) {
        for _ in 0..AT_ONCE {
            if !self.is_due || self.tiles.is_full() {
                return;
            }
            let place = map.settled_places().filter(|place| self.is_outside(square, *place)).min();
            let Some((place, crc)) = place.and_then(|place| Some((place, crc_at(map, place)?))) else {
                self.is_due = false;
                return;
            };
            let due = now + ANSWER_TIME;
            let _ = self.tiles.push(Tile { place, crc, due, number: 0, is_sent: false, is_late: false });
        }
    }

    /// Queues what was chosen.
    ///
    /// # Errors
    /// [`QueueFullError`] if something waits for room.
    pub(super) fn send(
        &mut self,
        map: &DistributedMap<'_, TILE_SIDE>,
        link: &mut Session<'_>,
    ) -> Result<(), QueueFullError> {
        for tile in self.tiles.iter_mut().filter(|tile| !tile.is_sent) {
            let mut memory = [0; TILE_BYTES];
            let squares = map.settled_tile(tile.place).and_then(|squares| squares.to_bytes(&mut memory));
            let Some(squares) = squares.filter(|squares| CRC32.checksum(squares) == tile.crc) else { continue };
            if link.queue_room() < TILE_BYTES + KEPT_FREE {
                return Err(QueueFullError);
            }
            let update = TileUpdate { column: tile.place.column, row: tile.place.row, squares };
            tile.number = link.send(&FromRobot::Left(update))?;
            tile.is_sent = true;
        }
        Ok(())
    }

    /// Without a host: forgets what is outside of the square and more than `most`.
    pub(super) fn forget_surplus(
        &mut self,
        square: &Region,
        most: usize,
        map: &mut DistributedMap<'_, TILE_SIDE>,
        counts: &mut TileCounts,
    ) {
        while self.is_due {
            let surplus = map.settled_places().filter(|place| self.is_outside(square, *place)).nth(most);
            self.is_due = surplus.is_some_and(|place| map.let_go(place));
            counts.forgotten = counts.forgotten.saturating_add(u32::from(self.is_due));
        }
    }

    /// True if it is outside of the square, and not on its way yet.
    fn is_outside(&self, square: &Region, place: TilePlace) -> bool {
        !square.contains(place) && self.tiles.iter().all(|tile| tile.place != place)
    }
}

/// Of the root's tile at `place`, if no particle has changed it.
fn crc_at(map: &DistributedMap<'_, TILE_SIDE>, place: TilePlace) -> Option<u32> {
    let mut memory = [0; TILE_BYTES];
    Some(CRC32.checksum(map.settled_tile(place)?.to_bytes(&mut memory)?))
}
