//! The tiles around the robot as one particle sees them.

use crate::ancestry::{Ancestry, NodeId};
use crate::chords::Chords;
use crate::geometry::Point2;
use crate::math::{floor, round_to_int};

use super::Square;
use super::tiles::{DistributedMap, TileId, TilePlace};

/// Squares kept clear of the needed rectangle's border, so that rounding in a walk cannot leave it: what is outside of it
/// has not been looked up.
const MARGIN_SQUARES: f32 = 1.0;
/// Positions in a window are multiples of 1/4096 square: moving them to its corner then rounds nothing up to 4096 squares from there, and so a
/// result does not depend on how large window and tiles are.
const PARTS_PER_SQUARE: f32 = 4096.0;
/// Tiles farther from the origin than this are never in a window.
const PLACE_MAX: f32 = 32_000.0;

/// The table lent to a [`Window`] is not square.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("window of {0} entries: expected a power of four, 4 to 4096 squared")]
pub struct WindowMemoryError(pub usize);

/// Where a window lies, and which part of it will be looked at. The same for every thread of a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct WindowFrame {
    /// The window's first column and row, tiles.
    column: i32,
    row: i32,
    /// Columns and rows of the window that are needed: first, and one past the last.
    columns: [i32; 2],
    rows: [i32; 2],
}

impl WindowFrame {
    /// A frame of `side` × `side` tiles of `tile_m` m about the rectangle from `low` to `high` (map frame, m), or about
    /// its centre if it is larger.
    pub fn around(low: Point2, high: Point2, side: usize, tile_m: f32) -> Self {
        let side = side as i32;
        let along = |low: f32, high: f32| {
            let place = |value: f32| floor((value / tile_m).clamp(-PLACE_MAX, PLACE_MAX));
            let (first, last) = (place(low), place(high));
            let origin = (first + last - side + 1).div_euclid(2);
            let within = |tiles: i32| tiles.max(0).min(side);
            (origin, [within(first - origin), within(last + 1 - origin)])
        };
        let ((column, columns), (row, rows)) = (along(low.x, high.x), along(low.y, high.y));
        Self { column, row, columns, rows }
    }
}

/// A table of the tiles in a [frame](WindowFrame), one thread's; see the [module](super).
#[derive(Debug)]
pub struct Window<'w> {
    slots: &'w mut [TileId],
    side_shift: u32,
    frame: WindowFrame,
    leaf: NodeId,
}

impl<'w> Window<'w> {
    /// A window of √`slots.len()` tiles a side.
    ///
    /// # Errors
    /// [`WindowMemoryError`] if that is not a power of two.
    pub fn new(slots: &'w mut [TileId]) -> Result<Self, WindowMemoryError> {
        let side_shift = slots.len().checked_ilog2().unwrap_or(0) / 2;
        if slots.len() != 1 << (2 * side_shift) || !(1..=12).contains(&side_shift) {
            return Err(WindowMemoryError(slots.len()));
        }
        Ok(Self { slots, side_shift, frame: WindowFrame::default(), leaf: NodeId::NONE })
    }

    /// Tiles along a side.
    pub fn side(&self) -> usize {
        1 << self.side_shift
    }

    /// The leaf whose map it shows.
    pub fn leaf(&self) -> NodeId {
        self.leaf
    }

    /// Shows the map of the particle at `leaf`.
    ///
    /// Cost: the tiles owned by it and its ancestors but the root, and the frame's needed places.
    pub fn open<const SIDE: usize>(
        &mut self,
        map: &DistributedMap<'_, SIDE>,
        ancestry: &Ancestry<'_>,
        frame: WindowFrame,
        leaf: NodeId,
    ) {
        self.slots.fill(TileId::NONE);
        self.frame = frame;
        self.leaf = leaf;
        for node in ancestry.upwards(leaf).filter(|node| *node != NodeId::ROOT) {
            for id in map.tiles_of(node) {
                if let Some(slot) = self.slot_at(map.header(id).place).filter(|slot| **slot == TileId::NONE) {
                    *slot = id;
                }
            }
        }
        for row in frame.rows[0]..frame.rows[1] {
            for column in frame.columns[0]..frame.columns[1] {
                let place = TilePlace { column: (frame.column + column) as i16, row: (frame.row + row) as i16 };
                if let Some(slot) = self.slot_at(place).filter(|slot| **slot == TileId::NONE) {
                    *slot = map.agreed(place);
                }
            }
        }
    }

    /// Shows the map of the next leaf in depth-first order and returns it; `None` after the last one.
    ///
    /// Cost: the tiles of the nodes between the two leaves.
    pub fn next_leaf<const SIDE: usize>(
        &mut self,
        map: &DistributedMap<'_, SIDE>,
        ancestry: &Ancestry<'_>,
    ) -> Option<NodeId> {
        let mut node = self.leaf;
        let sibling = loop {
            let parent = ancestry.parent(node)?;
            self.take_off(map, node);
            match ancestry.next_sibling(node) {
                Some(sibling) => break sibling,
                None => node = parent,
            }
        };
        self.put_on(map, sibling);
        self.leaf = sibling;
        while let Some(child) = ancestry.first_child(self.leaf) {
            self.put_on(map, child);
            self.leaf = child;
        }
        Some(self.leaf)
    }

    /// The leaf has got another name; what it sees stays.
    pub(crate) fn rename_leaf(&mut self, leaf: NodeId) {
        self.leaf = leaf;
    }

    fn put_on<const SIDE: usize>(&mut self, map: &DistributedMap<'_, SIDE>, node: NodeId) {
        for id in map.tiles_of(node) {
            if let Some(slot) = self.slot_at(map.header(id).place) {
                *slot = id;
            }
        }
    }

    fn take_off<const SIDE: usize>(&mut self, map: &DistributedMap<'_, SIDE>, node: NodeId) {
        for id in map.tiles_of(node) {
            let header = map.header(id);
            if let Some(slot) = self.slot_at(header.place) {
                *slot = header.base;
            }
        }
    }

    fn slot_at(&mut self, place: TilePlace) -> Option<&mut TileId> {
        let (column, row) = (i32::from(place.column) - self.frame.column, i32::from(place.row) - self.frame.row);
        let side = 1 << self.side_shift;
        let inside = (0..side).contains(&column) && (0..side).contains(&row);
        self.slots.get_mut(((row << self.side_shift) + column) as usize).filter(|_| inside)
    }

    /// Index of the slot that holds the square (`x`, `y`), squares from the window's corner.
    #[inline(always)]
    pub(super) fn slot_of<const SIDE: usize>(&self, x: i32, y: i32) -> usize {
        let shift = SIDE.trailing_zeros();
        (((y >> shift) << self.side_shift) + (x >> shift)) as u32 as usize
    }

    /// The tile in a slot.
    #[inline(always)]
    pub(super) fn tile_in(&self, slot: usize) -> TileId {
        self.slots.get(slot).copied().unwrap_or_default()
    }

    /// Puts a tile into a slot.
    pub(super) fn set_tile(&mut self, slot: usize, id: TileId) {
        if let Some(place) = self.slots.get_mut(slot) {
            *place = id;
        }
    }

    /// Which tile of the plane a slot stands for.
    pub(super) fn place_of(&self, slot: usize) -> TilePlace {
        let (column, row) = (slot & (self.side() - 1), slot >> self.side_shift);
        TilePlace { column: (self.frame.column + column as i32) as i16, row: (self.frame.row + row as i32) as i16 }
    }

    /// `point` (map frame, m) in squares from the window's corner.
    pub(super) fn to_squares<const SIDE: usize>(&self, point: Point2, square_size_m: f32) -> Point2 {
        let per_metre = 1.0 / square_size_m;
        let from_corner = |value: f32, corner: i32| {
            let parts = round_to_int(value * per_metre * PARTS_PER_SQUARE);
            parts as f32 / PARTS_PER_SQUARE - (corner * SIDE as i32) as f32
        };
        Point2::new(from_corner(point.x, self.frame.column), from_corner(point.y, self.frame.row))
    }

    /// The part inside the frame's needed rectangle of a ray from `start` (squares) along the unit vector `direction`; true
    /// if it was cut.
    #[inline]
    pub(super) fn ray<const SIDE: usize>(&self, start: Point2, direction: Point2, length: f32) -> (Chords, bool) {
        let along = |start: f32, direction: f32, [first, end]: [i32; 2]| {
            let low = (first * SIDE as i32) as f32 + MARGIN_SQUARES;
            let high = (end * SIDE as i32) as f32 - MARGIN_SQUARES;
            if start > low && start < high {
                let border = if direction > 0.0 { high } else { low };
                if direction == 0.0 { f32::INFINITY } else { (border - start) / direction }
            } else {
                0.0
            }
        };
        let room = along(start.x, direction.x, self.frame.columns).min(along(start.y, direction.y, self.frame.rows));
        (Chords::new(start, direction, length.min(room)), room < length)
    }
}

/// One particle's map, to be read.
#[derive(Debug, Clone, Copy)]
pub struct MapView<'a, 'm, const SIDE: usize> {
    map: &'a DistributedMap<'m, SIDE>,
    window: &'a Window<'a>,
}

impl<'a, 'm, const SIDE: usize> MapView<'a, 'm, SIDE> {
    /// The map that `window` shows.
    pub fn new(map: &'a DistributedMap<'m, SIDE>, window: &'a Window<'a>) -> Self {
        Self { map, window }
    }

    /// `point` (map frame, m) in squares from the window's corner.
    pub fn to_squares(&self, point: Point2) -> Point2 {
        self.window.to_squares::<SIDE>(point, self.map.config.square_size_m)
    }

    /// The part inside the window of a ray from `start` along the unit vector `direction`, all in squares from
    /// the window's corner; true if it was cut.
    #[inline]
    pub fn ray(&self, start: Point2, direction: Point2, length: f32) -> (Chords, bool) {
        self.window.ray::<SIDE>(start, direction, length)
    }

    /// True if the square (`x`, `y`) from the window's corner is on old ground: drawn before the robot went elsewhere.
    pub fn is_old(&self, x: i32, y: i32) -> bool {
        self.map.is_old(self.window.tile_in(self.window.slot_of::<SIDE>(x, y)))
    }

    /// What is known of the square (`x`, `y`) from the window's corner.
    #[inline(always)]
    pub fn square(&self, x: i32, y: i32) -> Square {
        let id = self.window.tile_in(self.window.slot_of::<SIDE>(x, y));
        self.map.square(id, x as usize & (SIDE - 1), y as usize & (SIDE - 1))
    }
}
