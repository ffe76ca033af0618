//! Tiles on their way back.

use crate::wire::message::{FromRobot, TileUpdate};
use crate::wire::session::{QueueFullError, Session};
use lrfslam_core::distributed_map::{DistributedMap, HeldTile, Region, Restored, Tile, TilePlace};
use lrfslam_core::time::Instant;

use super::super::square::KEPT_FREE_MAX;
use super::{ANSWER_TIME, TileCounts};
use lrfslam_core::slam::TILE_SIDE;

/// Requests that the host has not answered, or whose answer is not due.
const REQUESTS: usize = 4;

#[derive(Debug)]
struct Request {
    region: Region,
    /// When its tiles are seen.
    due: Instant,
    /// Tiles kept free for it.
    room: u16,
    /// Tiles that have come.
    tiles: u16,
    is_sent: bool,
    is_answered: bool,
    is_late: bool,
}

/// See the [module](self): in the order in which they were asked for.
#[derive(Debug, Default)]
pub(super) struct Returning {
    /// The part of the square of which everything is here or asked for.
    home: Region,
    requests: heapless::Deque<Request, REQUESTS>,
    held: heapless::Deque<HeldTile, KEPT_FREE_MAX>,
}

impl Returning {
    /// In the first square nothing was seen before.
    pub(super) fn begin(&mut self, square: &Region) {
        self.home = *square;
    }

    /// What is outside of the square now is to be asked for when it is inside again.
    pub(super) fn square_moved(&mut self, square: &Region) {
        self.home = self.home.intersection(square);
    }

    /// The tiles of requests that are due at `now` are seen from now on, where the robot has nothing.
    pub(super) fn settle(
        &mut self,
        now: Instant,
        square: &Region,
        map: &mut DistributedMap<'_, TILE_SIDE>,
        counts: &mut TileCounts,
    ) {
        while let Some(request) = self.requests.front_mut().filter(|request| now >= request.due) {
            if !request.is_answered {
                counts.late = counts.late.saturating_add(u32::from(!request.is_late));
                request.is_late = true;
                return;
            }
            for _ in 0..request.tiles {
                let Some(tile) = self.held.pop_front() else { break };
                let is_done = map.restore(tile, square) == Restored::Done;
                counts.restored = counts.restored.saturating_add(u32::from(is_done));
            }
            let _ = self.requests.pop_front();
        }
    }

    /// Asks for what is missing in the square, as far as there is room for all that may come.
    pub(super) fn ask(&mut self, now: Instant, square: &Region, map: &DistributedMap<'_, TILE_SIDE>) {
        let kept_free = map.kept_free();
        while let Some(region) = self.home.next_strip_of(square, kept_free).filter(|_| !self.requests.is_full()) {
            let room = region.places().min(kept_free) as u16;
            let taken: u16 = self.requests.iter().map(|request| request.room).sum();
            if usize::from(taken + room) > map.room_to_hold() {
                return;
            }
            let due = now + ANSWER_TIME;
            let request = Request { region, due, room, tiles: 0, is_sent: false, is_answered: false, is_late: false };
            let _ = self.requests.push_back(request);
            self.home = self.home.with_strip(&region);
        }
    }

    /// Queues the requests.
    ///
    /// # Errors
    /// [`QueueFullError`] if something waits for room.
    pub(super) fn send(&mut self, link: &mut Session<'_>) -> Result<(), QueueFullError> {
        for request in self.requests.iter_mut().filter(|request| !request.is_sent) {
            link.send(&FromRobot::Recall(request.region))?;
            request.is_sent = true;
        }
        Ok(())
    }

    /// The host is new: what the last one was asked and has not answered, this one has not heard.
    pub(super) fn forget_requests(&mut self, map: &mut DistributedMap<'_, TILE_SIDE>) {
        for request in self.requests.iter_mut().filter(|request| !request.is_answered) {
            for _ in 0..request.tiles {
                let Some(tile) = self.held.pop_back() else { break };
                let _ = map.restore(tile, &Region::default());
            }
            (request.tiles, request.is_sent) = (0, false);
        }
    }

    /// Keeps a tile that has come until its request is due.
    pub(super) fn take(
        &mut self,
        tile: &TileUpdate<'_>,
        map: &mut DistributedMap<'_, TILE_SIDE>,
        counts: &mut TileCounts,
    ) {
        let place = TilePlace { column: tile.column, row: tile.row };
        let Some(request) = self.requests.iter_mut().find(|request| request.is_awaited()) else { return };
        let squares = Tile::from_bytes(tile.squares).filter(|_| request.region.contains(place));
        let Some(squares) = squares else { return };
        let is_room = request.tiles < request.room && !self.held.is_full();
        let held = if is_room { map.hold(place, squares).ok() } else { None };
        match held {
            Some(held) => {
                let _ = self.held.push_back(held);
                request.tiles += 1;
            }
            None => counts.forgotten = counts.forgotten.saturating_add(1),
        }
    }

    /// The host has given all that it has there.
    pub(super) fn recalled(&mut self, region: &Region) {
        let awaited = self.requests.iter_mut().find(|request| request.is_awaited());
        if let Some(request) = awaited.filter(|request| request.region == *region) {
            request.is_answered = true;
        }
    }

    #[cfg(test)]
    pub(super) fn home(&self) -> Region {
        self.home
    }
}

impl Request {
    /// The host answers in order.
    fn is_awaited(&self) -> bool {
        self.is_sent && !self.is_answered
    }
}
