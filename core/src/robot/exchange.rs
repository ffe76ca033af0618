//! Both maps of a robot, of which the host keeps what is far away.

use super::mapping::Mapping;
use super::paging::{PageCounts, Paging};
use super::pools::TILE_SIDE;
use crate::math::floor;
use crate::ndt::TILE_CELLS;
use crate::wire::message::{Page, PagedMap, Recall};
use crate::wire::session::{QueueFullError, Session};

/// Tiles about the robot beyond the reach of its beams: what particles are apart, and the way that it goes while the host answers.
const MARGIN: i16 = 2;
/// This share of the particles' tiles, or so many if that is less, is kept free for those that come back.
const RESERVE_SHARE: usize = 16;
const RESERVE_MAX: usize = 32;

/// See the [module](self).
#[derive(Debug)]
pub(super) struct Exchange {
    squares: Paging,
    cells: Paging,
}

impl Exchange {
    /// For maps in which nothing was seen yet.
    pub(super) fn new(mapping: &mut Mapping<'_>) -> Self {
        let config = *mapping.config();
        let (map, ndt) = mapping.maps_mut();
        let tile_m = TILE_SIDE as f32 * map.square_size_m();
        // The configuration bounds it: 1000 m over tiles of 8 cm.
        let radius = |tile_m: f32| floor(config.rays.range_max_m / tile_m) as i16 + 1 + MARGIN;
        let reserve = (map.tiles_max() / RESERVE_SHARE).min(RESERVE_MAX);
        map.keep_free(reserve as u16);
        let cells_m = TILE_CELLS as f32 * config.ndt.cell_size_m;
        let cells_radius = radius(cells_m).min((ndt.side() as i16 - 1) / 2);
        let mut exchange = Self {
            squares: Paging::new(PagedMap::Squares, tile_m, radius(tile_m)),
            cells: Paging::new(PagedMap::Cells, cells_m, cells_radius),
        };
        exchange.drive(mapping);
        exchange
    }

    /// The robot has mapped a scan, and goes on from where it is now.
    pub(super) fn drive(&mut self, mapping: &mut Mapping<'_>) {
        let robot = mapping.slam().odometry().map_from_robot().position();
        let (map, ndt) = mapping.maps_mut();
        self.squares.drive(robot, map);
        self.cells.drive(robot, ndt);
    }

    /// Sends, asks and forgets what is due.
    ///
    /// # Errors
    /// [`QueueFullError`] if something waits for room.
    pub(super) fn run(&mut self, mapping: &mut Mapping<'_>, link: &mut Session<'_>) -> Result<(), QueueFullError> {
        let (map, ndt) = mapping.maps_mut();
        // The matcher's first: without its reference the robot is lost.
        self.cells.run(ndt, link)?;
        self.squares.run(map, link)
    }

    /// The host gives a page back.
    pub(super) fn take(&mut self, page: &Page<'_>, mapping: &mut Mapping<'_>) {
        let (map, ndt) = mapping.maps_mut();
        match page.map {
            PagedMap::Squares => self.squares.take(page, map),
            PagedMap::Cells => self.cells.take(page, ndt),
        }
    }

    /// The host has given all that it has there.
    pub(super) fn recalled(&mut self, recall: &Recall, mapping: &mut Mapping<'_>) {
        let (map, ndt) = mapping.maps_mut();
        match recall.map {
            PagedMap::Squares => self.squares.recalled(&recall.region, map),
            PagedMap::Cells => self.cells.recalled(&recall.region, ndt),
        }
    }

    /// The host is new, and was asked for nothing.
    pub(super) fn forget_requests(&mut self) {
        self.squares.forget_request();
        self.cells.forget_request();
    }

    /// What happened so far.
    pub(super) fn counts(&self) -> PageCounts {
        let (a, b) = (self.squares.counts, self.cells.counts);
        PageCounts {
            left: a.left.saturating_add(b.left),
            restored: a.restored.saturating_add(b.restored),
            forgotten: a.forgotten.saturating_add(b.forgotten),
        }
    }
}
