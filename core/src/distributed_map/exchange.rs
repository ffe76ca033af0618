//! Tiles of the root leave the map and come back: for a robot whose memory is smaller than the building.

use crate::ancestry::NodeId;

use super::tiles::{DistributedMap, PoolFullError, Tile, TileHeader, TileId, TilePlace};
use super::{Region, Square};

/// What became of a tile that came back.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Restored {
    /// It is seen again by all who had not seen something else there since.
    Done,
    /// Some particle has a tile there already, which is newer; this one is forgotten.
    IsKnown,
    /// It does not lie where tiles are wanted, and is forgotten.
    IsElsewhere,
}

/// A tile of the pool that nobody sees yet; see [`DistributedMap::hold`].
#[derive(Debug, PartialEq, Eq)]
pub struct HeldTile(TileId);

impl<const SIDE: usize> Tile<SIDE> {
    /// Writes hits and distance of every square, row by row, into `bytes`; returns those used, or `None` if there is no room.
    pub fn to_bytes<'b>(&self, bytes: &'b mut [u8]) -> Option<&'b [u8]> {
        let bytes = bytes.get_mut(..2 * SIDE * SIDE)?;
        for (pair, square) in bytes.chunks_exact_mut(2).zip(self.squares.iter().flatten()) {
            pair.copy_from_slice(&[square.hits(), square.distance()]);
        }
        Some(bytes)
    }

    /// The tile that [`to_bytes`](Self::to_bytes) wrote; `None` if the bytes are not as many.
    pub fn from_bytes(bytes: &[u8]) -> Option<Self> {
        let mut tile = Self::UNSEEN;
        let pairs = bytes.as_chunks::<2>().0.iter();
        for (square, [hits, distance]) in tile.squares.iter_mut().flatten().zip(pairs) {
            *square = Square::of(*hits, *distance);
        }
        (bytes.len() == 2 * SIDE * SIDE).then_some(tile)
    }
}

impl<const SIDE: usize> DistributedMap<'_, SIDE> {
    /// Leaves so many tiles of the pool to those that come back; see [`hold`](Self::hold).
    pub fn keep_free(&mut self, tiles: u16) {
        self.reserve = u32::from(tiles);
    }

    /// Places of the root's tiles that no particle has changed since: those that can be [let go](Self::let_go).
    pub fn settled_places(&self) -> impl Iterator<Item = TilePlace> + '_ {
        self.headers_taken().filter(|header| is_settled(header)).map(|header| header.place)
    }

    /// The root's tile at `place`, if no particle has changed it since.
    pub fn settled_tile(&self, place: TilePlace) -> Option<&Tile<SIDE>> {
        let id = self.agreed(place);
        self.tiles.get(id.index()).filter(|_| is_settled(&self.header(id)))
    }

    /// Gives the root's tile at `place` back to the pool: the place was never seen. False if there is none, or if a particle has changed it.
    pub fn let_go(&mut self, place: TilePlace) -> bool {
        let id = self.agreed(place);
        let is_settled = is_settled(&self.header(id));
        if is_settled {
            self.unlink(id);
            self.give_back(id);
        }
        is_settled
    }

    /// Tiles that are left to those that come back.
    pub fn kept_free(&self) -> usize {
        self.reserve as usize
    }

    /// Tiles that can be [held](Self::hold) at once: those kept free, as far as they are free.
    pub fn room_to_hold(&self) -> usize {
        (self.reserve as usize).min(self.tiles_max() - self.tiles_used())
    }

    /// Keeps `tile` for the root at `place` until it is [restored](Self::restore). Nobody sees it before, and it does not count as used: it is in
    /// one of the tiles that are [kept free](Self::keep_free).
    ///
    /// # Errors
    /// [`PoolFullError`] if there is no [room](Self::room_to_hold) for it; nothing has changed then.
    pub fn hold(&mut self, place: TilePlace, tile: Tile<SIDE>) -> Result<HeldTile, PoolFullError> {
        if self.held as usize >= self.room_to_hold() {
            return Err(PoolFullError);
        }
        let id = self.put(tile, place)?;
        (self.used, self.held) = (self.used - 1, self.held + 1);
        Ok(HeldTile(id))
    }

    /// Makes a tile that was held the root's, if it lies in `region` and no particle has one there. Cost: all headers are looked at.
    pub fn restore(&mut self, HeldTile(id): HeldTile, region: &Region) -> Restored {
        (self.used, self.held) = (self.used + 1, self.held.saturating_sub(1));
        let place = self.header(id).place;
        let is_known = || self.headers_taken().any(|header| header.owner != NodeId::NONE && header.place == place);
        let restored = match region.contains(place) {
            false => Restored::IsElsewhere,
            true if is_known() => Restored::IsKnown,
            true => Restored::Done,
        };
        match restored {
            Restored::Done => self.link(id, NodeId::ROOT),
            Restored::IsKnown | Restored::IsElsewhere => self.give_back(id),
        }
        restored
    }
}

fn is_settled(header: &TileHeader) -> bool {
    header.owner == NodeId::ROOT && header.covered_by == 0
}
