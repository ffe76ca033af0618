//! What the host is told of the map: tiles that it does not have yet, or, when the robot has stopped, all of it.

use super::mapping::Mapping;
use crate::wire::frame::CRC32;
use crate::wire::message::{FromRobot, TileUpdate};
use crate::wire::session::{QueueFullError, Session};
use lrfslam_core::distributed_map::TilePlace;
use lrfslam_core::geometry::Point2;
use lrfslam_core::slam::TILE_SIDE;

/// Bytes of a tile's squares.
pub(super) const TILE_BYTES: usize = 2 * TILE_SIDE * TILE_SIDE;
/// Most places that one pass can tell apart.
const PLACES: usize = 1024;

/// The tile that the host has at one place.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct LedgerEntry {
    place: TilePlace,
    /// Of its squares; 0 if it has none.
    crc: u32,
}

impl LedgerEntry {
    /// The host has nothing here.
    pub const EMPTY: Self = Self { place: TilePlace { column: 0, row: 0 }, crc: 0 };
}

/// How far the map has been told.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Task {
    /// Up to date.
    Nothing,
    /// Tiles about the robot may have changed.
    Changes,
    /// The whole map, from the beginning.
    Begin,
    /// The whole map, from the tile with this number on; so many were told.
    Whole { from: usize, told: u32 },
}

/// See the [module](self).
#[derive(Debug)]
pub(super) struct MapReport<'m> {
    /// One entry for each place of a square of tiles about the robot, columns and rows wrapped like a torus.
    ledger: &'m mut [LedgerEntry],
    side: usize,
    task: Task,
}

impl<'m> MapReport<'m> {
    pub(super) fn new(ledger: &'m mut [LedgerEntry]) -> Self {
        let side = 1 << (ledger.len().min(PLACES).checked_ilog2().unwrap_or(0) / 2);
        Self { ledger, side, task: Task::Nothing }
    }

    /// The host is new, and has nothing.
    pub(super) fn forget(&mut self) {
        self.ledger.fill(LedgerEntry::EMPTY);
        self.task = match self.task {
            Task::Nothing | Task::Changes => Task::Changes,
            Task::Begin | Task::Whole { .. } => Task::Begin,
        };
    }

    /// The filter has taken a step.
    pub(super) fn map_changed(&mut self) {
        if self.task == Task::Nothing {
            self.task = Task::Changes;
        }
    }

    /// The robot has stopped: all of the map is to be told.
    pub(super) fn tell_whole(&mut self) {
        self.task = Task::Begin;
    }

    /// True while the whole map is being told: no tile may leave it then.
    pub(super) fn is_telling_whole(&self) -> bool {
        matches!(self.task, Task::Begin | Task::Whole { .. })
    }

    /// Queues what there is room for.
    pub(super) fn run(&mut self, mapping: &Mapping<'_>, link: &mut Session<'_>) {
        let done = match self.task {
            Task::Nothing => Ok(()),
            Task::Changes => self.tell_changes(mapping, link),
            Task::Begin => link.send(&FromRobot::MapBegin).and_then(|_| self.tell_from(0, 0, mapping, link)),
            Task::Whole { from, told } => self.tell_from(from, told, mapping, link),
        };
        if done.is_ok() {
            self.task = Task::Nothing;
        }
    }

    fn tell_changes(&mut self, mapping: &Mapping<'_>, link: &mut Session<'_>) -> Result<(), QueueFullError> {
        let Some(best) = mapping.best() else { return Ok(()) };
        let filter = mapping.slam().filter();
        let half = 0.5 * self.side as f32 - 1.0;
        let tile_m = TILE_SIDE as f32 * filter.map().square_size_m();
        let centre = best.map_from_robot.position() * (1.0 / tile_m);
        let mut visited = [false; PLACES];
        let mut memory = [0; TILE_BYTES];
        for (place, tile) in filter.map().tiles_seen_from(filter.ancestry(), best.node) {
            if !is_near(place, centre, half) {
                continue;
            }
            let slot = self.slot(place);
            let Some(first_visit) = visited.get_mut(slot).filter(|visited| !**visited) else { continue };
            *first_visit = true;
            let Some(bytes) = tile.to_bytes(&mut memory) else { continue };
            let entry = LedgerEntry { place, crc: CRC32.checksum(bytes) };
            if self.ledger.get(slot).is_some_and(|known| *known != entry) {
                tell(place, bytes, link)?;
                self.ledger.get_mut(slot).into_iter().for_each(|known| *known = entry);
            }
        }
        Ok(())
    }

    fn tell_from(
        &mut self,
        from: usize,
        mut told: u32,
        mapping: &Mapping<'_>,
        link: &mut Session<'_>,
    ) -> Result<(), QueueFullError> {
        let filter = mapping.slam().filter();
        let leaf = mapping.best().map(|best| best.node).unwrap_or_default();
        let tiles = || filter.map().tiles_seen_from(filter.ancestry(), leaf);
        let mut memory = [0; TILE_BYTES];
        for (index, (place, tile)) in tiles().enumerate().skip(from) {
            self.task = Task::Whole { from: index, told };
            // The one seen is the first at its place.
            let is_seen = !tiles().take(index).any(|(other, _)| other == place);
            if let Some(bytes) = tile.to_bytes(&mut memory).filter(|_| is_seen) {
                tell(place, bytes, link)?;
                told += 1;
            }
        }
        self.task = Task::Whole { from: usize::MAX, told };
        link.send(&FromRobot::MapEnd(told)).map(|_| ())
    }

    fn slot(&self, place: TilePlace) -> usize {
        let wrap = |index: i16| usize::from(index as u16) & (self.side - 1);
        wrap(place.row) * self.side + wrap(place.column)
    }
}

fn is_near(place: TilePlace, centre: Point2, half: f32) -> bool {
    let distance = |index: i16, centre: f32| (f32::from(index) + 0.5 - centre).abs();
    distance(place.column, centre.x) < half && distance(place.row, centre.y) < half
}

fn tell(place: TilePlace, squares: &[u8], link: &mut Session<'_>) -> Result<(), QueueFullError> {
    // The other half of the queue is for what matters more.
    if link.queue_room() < link.queue_capacity() / 2 {
        return Err(QueueFullError);
    }
    let update = TileUpdate { column: place.column, row: place.row, squares };
    link.send(&FromRobot::Tile(update)).map(|_| ())
}
