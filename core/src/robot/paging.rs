//! Tiles far from the robot live with the host: so a building may be larger than the robot's memory.
//!
//! Around the robot lies a square of tiles, its **home**, of which everything is in memory. When the robot has gone on, the square moves:
//! tiles that are outside of it now are sent to the host ([`Page`]) and forgotten once the host has acknowledged them; what comes to lie inside is
//! asked for ([`Recall`]), and is part of the home again when the host has given all that it has there.
//!
//! The home reaches farther than the particles' beams. So if the answer comes before the robot has gone that far, their map is the one that a
//! larger memory would hold, to the bit. If it does not come in time the robot maps on; what it then has at a place stays, and the
//! host's page of it is not taken. Without a host what is outside waits in memory, up to a share of it; then it is forgotten, and counted.
//!
//! The matcher sees farther than its home, as far as its memory reaches: a tile that the host has stays until a nearer one needs its
//! memory. What it sees outside of its home is added to the page when that comes.

use crc::{CRC_32_ISO_HDLC, Crc};

use crate::distributed_map::{DistributedMap, TilePlace};
use crate::distributed_map::{Restored, Tile};
use crate::geometry::Point2;
use crate::math::floor;
use crate::ndt::{NdtGrid, TILE_BYTES_MAX};
use crate::region::{Region, TileAddress};
use crate::wire::message::{FromRobot, Page, PagedMap, Recall};
use crate::wire::session::{QueueFullError, Session};

/// Pages on their way to the host.
const LEAVING: usize = 8;
/// The home moves when the robot is so far from the middle of its central tile, tiles.
const OFF_CENTRE: f32 = 0.75;
/// Columns of the plane.
const PLACE_MAX: f32 = 32_000.0;
/// Room in the queue for what matters more.
const KEPT_FREE: usize = 2 * TILE_BYTES_MAX;

const CRC32: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);

/// A map whose tiles can leave and come back.
pub(super) trait PageStore {
    /// The first tile that can leave and `is_wanted`.
    fn find(&self, is_wanted: &mut dyn FnMut(TileAddress) -> bool) -> Option<TileAddress>;
    /// Writes one into `bytes` (of [`TILE_BYTES_MAX`]); `None` if it cannot leave.
    fn bytes_of<'b>(&self, address: TileAddress, bytes: &'b mut [u8]) -> Option<&'b [u8]>;
    /// The host has this one as it is: forgets it now, or when its memory is needed. False if it cannot be let go.
    fn hand_over(&mut self, address: TileAddress) -> bool;
    /// Forgets one without a host; false if that is not necessary, because whoever needs memory takes that of the farthest.
    fn forget(&mut self, address: TileAddress) -> bool;
    /// Takes one back; `None` if there is no room for it, or if it is none.
    fn restore(&mut self, page: &Page<'_>, robot: Point2) -> Option<Restored>;
    /// Tiles that there is memory for.
    fn capacity(&self) -> usize;
    /// Of this region everything is here.
    fn home_is(&mut self, home: &Region);
}

impl<const SIDE: usize> PageStore for DistributedMap<'_, SIDE> {
    fn find(&self, is_wanted: &mut dyn FnMut(TileAddress) -> bool) -> Option<TileAddress> {
        let address = |TilePlace { column, row }| TileAddress { layer: 0, column, row };
        self.settled_places().map(address).find(|address| is_wanted(*address))
    }

    fn bytes_of<'b>(&self, address: TileAddress, bytes: &'b mut [u8]) -> Option<&'b [u8]> {
        self.settled_tile(place_of(address))?.to_bytes(bytes)
    }

    fn hand_over(&mut self, address: TileAddress) -> bool {
        self.let_go(place_of(address))
    }

    fn forget(&mut self, address: TileAddress) -> bool {
        self.let_go(place_of(address))
    }

    fn restore(&mut self, page: &Page<'_>, _: Point2) -> Option<Restored> {
        self.restore(place_of(page.address), Tile::from_bytes(page.bytes)?).ok()
    }

    fn capacity(&self) -> usize {
        self.tiles_max()
    }

    fn home_is(&mut self, _: &Region) {}
}

impl PageStore for NdtGrid<'_> {
    fn find(&self, is_wanted: &mut dyn FnMut(TileAddress) -> bool) -> Option<TileAddress> {
        self.unsaved().find(|address| is_wanted(*address))
    }

    fn bytes_of<'b>(&self, address: TileAddress, bytes: &'b mut [u8]) -> Option<&'b [u8]> {
        self.tile_bytes(address, bytes)
    }

    fn hand_over(&mut self, address: TileAddress) -> bool {
        self.set_saved(address)
    }

    fn forget(&mut self, _: TileAddress) -> bool {
        false
    }

    fn restore(&mut self, page: &Page<'_>, robot: Point2) -> Option<Restored> {
        self.restore(page.address, page.bytes, robot).ok()
    }

    fn capacity(&self) -> usize {
        self.tiles_max()
    }

    fn home_is(&mut self, home: &Region) {
        self.set_home(*home);
    }
}

fn place_of(TileAddress { column, row, .. }: TileAddress) -> TilePlace {
    TilePlace { column, row }
}

/// What happened so far.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct PageCounts {
    /// Pages that the host has and the robot has not any more.
    pub(super) left: u32,
    /// Pages that came back.
    pub(super) restored: u32,
    /// Tiles forgotten for want of a host, and pages for want of room.
    pub(super) forgotten: u32,
}

/// A page that the host has not acknowledged yet.
#[derive(Debug, Clone, Copy)]
struct Leaving {
    address: TileAddress,
    /// Of its bytes: who changes them makes it stay.
    crc: u32,
    /// Of the message.
    number: u32,
}

/// Of one map; see the [module](self).
#[derive(Debug)]
pub(super) struct Paging {
    map: PagedMap,
    tile_m: f32,
    /// Tiles from the central one to the edge of the square.
    radius: i16,
    /// The central tile's column and row.
    centre: [i16; 2],
    /// Where the home should be; `None` before the first scan.
    square: Option<Region>,
    /// The part of it of which everything is here.
    home: Region,
    asked: Option<Region>,
    leaving: heapless::Vec<Leaving, LEAVING>,
    /// There may be tiles outside of the square.
    is_due: bool,
    robot: Point2,
    pub(super) counts: PageCounts,
}

impl Paging {
    /// For tiles with sides of `tile_m` m, `radius` of them to each side of the robot's.
    pub(super) fn new(map: PagedMap, tile_m: f32, radius: i16) -> Self {
        Self {
            map,
            tile_m,
            radius,
            centre: [0, 0],
            square: None,
            home: Region::default(),
            asked: None,
            leaving: heapless::Vec::new(),
            is_due: false,
            robot: Point2::new(0.0, 0.0),
            counts: PageCounts::default(),
        }
    }

    /// The robot is at `robot` (map frame, m), and has mapped.
    pub(super) fn drive(&mut self, robot: Point2, store: &mut dyn PageStore) {
        self.robot = robot;
        self.is_due = true;
        let in_tiles = |value: f32| (value / self.tile_m).clamp(-PLACE_MAX, PLACE_MAX);
        let at = [in_tiles(robot.x), in_tiles(robot.y)];
        let is_off = |at: f32, centre: i16| (at - f32::from(centre) - 0.5).abs() > OFF_CENTRE;
        if self.square.is_none() || is_off(at[0], self.centre[0]) || is_off(at[1], self.centre[1]) {
            self.centre = at.map(|value| floor(value) as i16);
        }
        let square = Region::around(self.centre[0], self.centre[1], self.radius);
        if self.square != Some(square) {
            // Nothing was seen before the first scan.
            self.home = if self.square.is_some() { self.home.intersection(&square) } else { square };
            self.square = Some(square);
            store.home_is(&self.home);
        }
    }

    /// The host is new: what the last one was asked, this one has not heard.
    pub(super) fn forget_request(&mut self) {
        self.asked = None;
    }

    /// The host has given all that it has there.
    pub(super) fn recalled(&mut self, region: &Region, store: &mut dyn PageStore) {
        if let Some(square) = self.square.filter(|_| self.asked == Some(*region)) {
            self.asked = None;
            self.home = self.home.with_side(region).intersection(&square);
            store.home_is(&self.home);
        }
    }

    /// Takes a page back.
    pub(super) fn take(&mut self, page: &Page<'_>, store: &mut dyn PageStore) {
        if self.square.is_some_and(|square| square.contains(page.address)) {
            match store.restore(page, self.robot) {
                Some(Restored::Done) => self.counts.restored = self.counts.restored.saturating_add(1),
                Some(Restored::IsKnown) => {}
                None => self.counts.forgotten = self.counts.forgotten.saturating_add(1),
            }
        }
    }

    /// Lets go what the host has, asks for what is missing, and sends what is outside, as far as the queue has room.
    ///
    /// # Errors
    /// [`QueueFullError`] if something waits for room.
    pub(super) fn run(&mut self, store: &mut dyn PageStore, link: &mut Session<'_>) -> Result<(), QueueFullError> {
        let Some(square) = self.square else { return Ok(()) };
        self.settle(&square, store, link);
        if !link.is_live() {
            self.forget_surplus(&square, store);
            return Ok(());
        }
        if let Some(region) = self.home.next_side_of(&square).filter(|_| self.asked.is_none()) {
            link.send(&FromRobot::Recall(Recall { map: self.map, region }))?;
            self.asked = Some(region);
        }
        while self.is_due && !self.leaving.is_full() {
            let Some(address) = store.find(&mut |address| self.is_outside(&square, address)) else {
                self.is_due = false;
                break;
            };
            let mut memory = [0; TILE_BYTES_MAX];
            let Some(bytes) = store.bytes_of(address, &mut memory) else { break };
            if link.queue_room() < bytes.len() + KEPT_FREE {
                return Err(QueueFullError);
            }
            let number = link.send(&FromRobot::Left(Page { map: self.map, address, bytes }))?;
            let _ = self.leaving.push(Leaving { address, crc: CRC32.checksum(bytes), number });
        }
        Ok(())
    }

    /// What was acknowledged, and is as it was sent, goes.
    fn settle(&mut self, square: &Region, store: &mut dyn PageStore, link: &Session<'_>) {
        let Self { leaving, counts, is_due, .. } = self;
        leaving.retain(|page| {
            if !link.is_acknowledged(page.number) {
                return true;
            }
            let mut memory = [0; TILE_BYTES_MAX];
            let crc = store.bytes_of(page.address, &mut memory).map(|bytes| CRC32.checksum(bytes));
            if !square.contains(page.address) && crc == Some(page.crc) && store.hand_over(page.address) {
                counts.left = counts.left.saturating_add(1);
            }
            *is_due = true;
            false
        });
    }

    fn forget_surplus(&mut self, square: &Region, store: &mut dyn PageStore) {
        while self.is_due {
            let mut waiting = 0;
            let surplus = store.find(&mut |address| {
                waiting += usize::from(self.is_outside(square, address));
                waiting > store.capacity() / 8
            });
            match surplus {
                Some(address) if store.forget(address) => {
                    self.counts.forgotten = self.counts.forgotten.saturating_add(1);
                }
                _ => self.is_due = false,
            }
        }
    }

    /// True if it is outside of the square, and not on its way yet.
    fn is_outside(&self, square: &Region, address: TileAddress) -> bool {
        !square.contains(address) && self.leaving.iter().all(|page| page.address != address)
    }
}

#[cfg(test)]
mod tests;
