//! The pool of tiles and who owns them.

use crate::ancestry::{Ancestry, NodeId, NodeObserver};
use crate::geometry::Point2;

use super::{ParticleMapConfig, Square, TileAge};

/// Name of a tile; 0 is none, so that zeroed memory is an empty pool.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct TileId(pub(super) u32);

impl TileId {
    /// No tile; reads as the unseen one.
    pub const NONE: Self = Self(0);

    fn some(self) -> Option<Self> {
        (self != Self::NONE).then_some(self)
    }

    #[inline(always)]
    pub(super) fn index(self) -> usize {
        self.0 as usize
    }
}

/// Which tile of the plane: it covers `[column, column + 1) × [row, row + 1)` times the tile's side.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct TilePlace {
    /// Along x.
    pub column: i16,
    /// Along y.
    pub row: i16,
}

/// A patch of `SIDE` × `SIDE` squares, row by row; `SIDE` is a power of two. All zero when unseen.
#[derive(Debug, Clone)]
pub struct Tile<const SIDE: usize> {
    pub(super) squares: [[Square; SIDE]; SIDE],
}

impl<const SIDE: usize> Tile<SIDE> {
    /// A tile never seen.
    pub const UNSEEN: Self = Self { squares: [[Square::UNSEEN; SIDE]; SIDE] };

    /// Its squares, row by row.
    pub fn rows(&self) -> &[[Square; SIDE]; SIDE] {
        &self.squares
    }
}

/// What is known of a tile besides its squares, apart from them so that walking over tiles is fast. All zero when free.
#[derive(Debug, Clone, Copy, Default)]
pub struct TileHeader {
    pub(super) place: TilePlace,
    pub(super) owner: NodeId,
    /// Tiles of which this is the base.
    pub(super) covered_by: u16,
    /// What the owner's parent sees here.
    pub(super) base: TileId,
    /// In the owner's list or the directory's chain; of a free tile, the next free one.
    pub(super) next: TileId,
    previous: TileId,
}

impl TileHeader {
    /// Of a tile that nobody owns.
    pub const FREE: Self = Self {
        place: TilePlace { column: 0, row: 0 },
        owner: NodeId::NONE,
        covered_by: 0,
        base: TileId::NONE,
        next: TileId::NONE,
        previous: TileId::NONE,
    };
}

/// Memory that a [`DistributedMap`] lives in, lent by the caller.
#[derive(Debug)]
pub struct MapMemory<'m, const SIDE: usize> {
    /// The pool; one tile stays empty.
    pub tiles: &'m mut [Tile<SIDE>],
    /// One for each tile.
    pub headers: &'m mut [TileHeader],
    /// One for each node of the ancestry's pool.
    pub node_tiles: &'m mut [TileId],
    /// Finds the root's tiles by place: 4ⁿ entries, about as many as tiles; fewer only cost time.
    pub directory: &'m mut [TileId],
    /// One for each tile where particles are to know old ground (what was drawn before the robot went elsewhere); else empty.
    pub ages: &'m mut [TileAge],
}

/// The memory lent to a [`DistributedMap`] does not fit together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum MapMemoryError {
    /// As many headers as tiles, at least 2.
    #[error("{tiles} tiles and {headers} headers: expected the same number, 2 or more")]
    Tiles {
        /// Length of the pool.
        tiles: usize,
        /// Number of headers.
        headers: usize,
    },
    /// The directory's length must be a power of four.
    #[error("directory of {0} entries: expected a power of four")]
    Directory(usize),
    /// A tile's side must be a power of two.
    #[error("tiles of {0} squares: expected a power of two from 2 to 128")]
    Side(usize),
}

/// No tile is free.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("no tile is free")]
pub struct PoolFullError;

/// Maps of all particles, over memory lent by the caller; see the [module](super).
#[derive(Debug)]
pub struct DistributedMap<'m, const SIDE: usize> {
    pub(super) config: ParticleMapConfig,
    pub(super) tiles: &'m mut [Tile<SIDE>],
    pub(super) headers: &'m mut [TileHeader],
    node_tiles: &'m mut [TileId],
    directory: &'m mut [TileId],
    /// Bits of a column or row that the directory tells apart.
    directory_bits: u32,
    /// Tiles ever taken, tile 0 included.
    taken: u32,
    free: TileId,
    pub(super) used: u32,
    /// Tiles that nobody may print into: those held, and free ones for more of them.
    pub(super) reserve: u32,
    /// Tiles of the reserve that hold something; they are not among those used.
    pub(super) held: u32,
    pub(super) ages: &'m mut [TileAge],
    /// Way so far.
    pub(super) way_dm: u32,
}

impl<'m, const SIDE: usize> DistributedMap<'m, SIDE> {
    /// A map in which nobody has seen anything.
    ///
    /// # Errors
    /// [`MapMemoryError`] if the slices' lengths do not fit together.
    pub fn new(config: &ParticleMapConfig, memory: MapMemory<'m, SIDE>) -> Result<Self, MapMemoryError> {
        let MapMemory { tiles, headers, node_tiles, directory, ages } = memory;
        if tiles.len() != headers.len() || tiles.len() < 2 || u32::try_from(tiles.len()).is_err() {
            return Err(MapMemoryError::Tiles { tiles: tiles.len(), headers: headers.len() });
        }
        let directory_bits = directory.len().checked_ilog2().unwrap_or(1) / 2;
        if directory.len() != 1 << (2 * directory_bits) {
            return Err(MapMemoryError::Directory(directory.len()));
        }
        if !SIDE.is_power_of_two() || !(2..=128).contains(&SIDE) {
            return Err(MapMemoryError::Side(SIDE));
        }
        if let (Some(tile), Some(header)) = (tiles.first_mut(), headers.first_mut()) {
            *tile = Tile::UNSEEN;
            *header = TileHeader::default();
        }
        node_tiles.fill(TileId::NONE);
        directory.fill(TileId::NONE);
        let config = *config;
        Ok(Self {
            config,
            tiles,
            headers,
            node_tiles,
            directory,
            directory_bits,
            taken: 1,
            free: TileId::NONE,
            used: 0,
            reserve: 0,
            held: 0,
            ages,
            way_dm: 0,
        })
    }

    /// Gives back all tiles, whoever owns them: nobody has seen anything.
    pub(crate) fn clear(&mut self) {
        self.node_tiles.fill(TileId::NONE);
        self.directory.fill(TileId::NONE);
        (self.taken, self.free, self.used, self.held) = (1, TileId::NONE, 0, 0);
    }

    /// Tiles in use; without those [held](Self::hold).
    pub fn tiles_used(&self) -> usize {
        self.used as usize
    }

    /// Tiles of the root: history that all particles agree on. Cost: all of them are looked at.
    pub fn tiles_agreed(&self) -> usize {
        self.directory.iter().map(|first| self.chain(*first).count()).sum()
    }

    /// Tiles that can be in use at once.
    pub fn tiles_max(&self) -> usize {
        self.tiles.len() - 1
    }

    /// Side of a square, m.
    pub fn square_size_m(&self) -> f32 {
        self.config.square_size_m
    }

    /// Lower left corner of the tile at `place`, map frame, m.
    pub fn corner(&self, place: TilePlace) -> Point2 {
        Point2::new(f32::from(place.column), f32::from(place.row)) * (SIDE as f32 * self.config.square_size_m)
    }

    /// Tiles that the particle at `leaf` sees, and older ones under them: its own first, then its parent's, the root's last.
    ///
    /// The first tile met at a place is the one that it sees there.
    pub fn tiles_seen_from(
        &self,
        ancestry: &Ancestry<'_>,
        leaf: NodeId,
    ) -> impl Iterator<Item = (TilePlace, &Tile<SIDE>)> {
        let own = ancestry.upwards(leaf).filter(|node| *node != NodeId::ROOT).flat_map(|node| self.tiles_of(node));
        let agreed = self.directory.iter().flat_map(|first| self.chain(*first));
        own.chain(agreed).filter_map(|id| Some((self.header(id).place, self.tiles.get(id.index())?)))
    }

    /// Tiles in the list of a node other than the root.
    pub(super) fn tiles_of(&self, node: NodeId) -> impl Iterator<Item = TileId> + '_ {
        self.chain(self.node_tiles.get(node.index()).copied().unwrap_or_default())
    }

    /// The root's tile at `place`.
    pub(super) fn agreed(&self, place: TilePlace) -> TileId {
        let first = self.directory.get(self.bucket(place)).copied().unwrap_or_default();
        self.chain(first).find(|id| self.header(*id).place == place).unwrap_or_default()
    }

    fn chain(&self, first: TileId) -> impl Iterator<Item = TileId> + '_ {
        core::iter::successors(first.some(), |id| self.header(*id).next.some())
    }

    /// A copy of a tile's header.
    #[inline]
    pub(super) fn header(&self, id: TileId) -> TileHeader {
        self.headers.get(id.index()).copied().unwrap_or_default()
    }

    /// Square (`x`, `y`) of a tile.
    #[inline(always)]
    pub(super) fn square(&self, id: TileId, x: usize, y: usize) -> Square {
        let row = self.tiles.get(id.index()).and_then(|tile| tile.squares.get(y));
        row.and_then(|row| row.get(x)).copied().unwrap_or_default()
    }

    /// Changes square (`x`, `y`) of a tile.
    #[inline(always)]
    pub(super) fn set_square(&mut self, id: TileId, x: usize, y: usize, square: Square) {
        let row = self.tiles.get_mut(id.index()).and_then(|tile| tile.squares.get_mut(y));
        if let Some(place) = row.and_then(|row| row.get_mut(x)) {
            *place = square;
        }
    }

    /// A tile of its own for `owner` at `place`, where it has seen `base` so far.
    pub(super) fn copy(&mut self, base: TileId, place: TilePlace, owner: NodeId) -> Result<TileId, PoolFullError> {
        if self.tiles_max() - self.tiles_used() <= self.reserve as usize {
            return Err(PoolFullError);
        }
        let seen = self.tiles.get(base.index()).cloned().unwrap_or(Tile::UNSEEN);
        let id = self.put(seen, place)?;
        self.inherit_age(id, base);
        self.edit(id, |header| header.base = base);
        self.edit(base, |header| header.covered_by += 1);
        self.link(id, owner);
        Ok(id)
    }

    /// A tile in use that nobody owns.
    pub(super) fn put(&mut self, seen: Tile<SIDE>, place: TilePlace) -> Result<TileId, PoolFullError> {
        let id = self.take()?;
        if let Some(tile) = self.tiles.get_mut(id.index()) {
            *tile = seen;
        }
        self.edit(id, |header| *header = TileHeader { place, ..TileHeader::default() });
        Ok(id)
    }

    /// Hangs a tile into the list of its new owner.
    pub(super) fn link(&mut self, id: TileId, owner: NodeId) {
        let place = self.header(id).place;
        let head = self.head(owner, place);
        let next = head.map(|head| core::mem::replace(head, id)).unwrap_or_default();
        self.edit(id, |header| *header = TileHeader { owner, next, previous: TileId::NONE, ..*header });
        self.edit(next, |header| header.previous = id);
    }

    /// Headers of all tiles that are or were in use.
    pub(super) fn headers_taken(&self) -> impl Iterator<Item = &TileHeader> {
        self.headers.iter().take(self.taken as usize).skip(1)
    }

    /// Takes a tile out of the list of its owner.
    pub(super) fn unlink(&mut self, id: TileId) {
        let TileHeader { place, owner, next, previous, .. } = self.header(id);
        self.edit(next, |header| header.previous = previous);
        self.edit(previous, |header| header.next = next);
        if previous == TileId::NONE
            && let Some(head) = self.head(owner, place)
        {
            *head = next;
        }
    }

    /// Where the list that a tile hangs in begins.
    fn head(&mut self, owner: NodeId, place: TilePlace) -> Option<&mut TileId> {
        match owner {
            NodeId::ROOT => self.directory.get_mut(self.bucket(place)),
            _ => self.node_tiles.get_mut(owner.index()),
        }
    }

    /// Neighbouring tiles never share a bucket: columns and rows wrap like a torus.
    fn bucket(&self, place: TilePlace) -> usize {
        let mask = (1_usize << self.directory_bits) - 1;
        (((place.row as usize) & mask) << self.directory_bits) | ((place.column as usize) & mask)
    }

    fn take(&mut self) -> Result<TileId, PoolFullError> {
        let id = self.free.some().unwrap_or(TileId(self.taken));
        if id.index() >= self.tiles.len() {
            return Err(PoolFullError);
        }
        if id == self.free {
            self.free = self.header(id).next;
        } else {
            self.taken += 1;
        }
        self.used += 1;
        Ok(id)
    }

    pub(super) fn give_back(&mut self, id: TileId) {
        let next = self.free;
        let base = self.header(id).base;
        self.edit(base, |header| header.covered_by = header.covered_by.saturating_sub(1));
        self.edit(id, |header| *header = TileHeader { next, ..TileHeader::default() });
        self.free = id;
        self.used -= 1;
    }

    fn edit(&mut self, id: TileId, change: impl FnOnce(&mut TileHeader)) {
        if let Some(header) = self.headers.get_mut(id.index()).filter(|_| id != TileId::NONE) {
            change(header);
        }
    }

    /// Empties the list of a node and returns what was its first tile.
    fn take_list(&mut self, node: NodeId) -> TileId {
        self.node_tiles.get_mut(node.index()).map(core::mem::take).unwrap_or_default()
    }
}

impl<const SIDE: usize> NodeObserver for DistributedMap<'_, SIDE> {
    /// Its tiles return to the pool.
    fn died(&mut self, node: NodeId) {
        let mut id = self.take_list(node);
        while id != TileId::NONE {
            let next = self.header(id).next;
            self.give_back(id);
            id = next;
        }
    }

    /// The child's tiles become the parent's and replace those they had covered.
    fn merged(&mut self, child: NodeId, parent: NodeId) {
        let mut id = self.take_list(child);
        while id != TileId::NONE {
            let TileHeader { next, base, .. } = self.header(id);
            let covered = self.header(base);
            if base != TileId::NONE && covered.owner == parent {
                self.edit(id, |header| header.base = covered.base);
                self.edit(covered.base, |header| header.covered_by += 1);
                self.unlink(base);
                self.give_back(base);
            }
            self.link(id, parent);
            id = next;
        }
    }
}
