//! Maps of all particles in one: tiles of squares, owned by the nodes of the ancestry tree, copied when first written.
//!
//! A tile belongs to the node whose particle changed it. A particle sees, at each place, the tile of its nearest ancestor
//! that owns one there; it writes to its own tiles only, and gets one by copying what it sees. So particles share
//! what they have in common, and what they disagree about is as small as the patches that changed.
//!
//! * [`DistributedMap`] — pool of tiles; told by the [ancestry](crate::ancestry) what died and what merged
//! * [`Window`] — table of the tiles around the robot as one particle sees them; moves from leaf to leaf by putting on
//!   and taking off the tiles of the nodes between them, so that reading is one look-up however deep the tree is
//! * [`Print`] — writes one scan into the map of one particle
//!
//! Sources: thesis §3.2.3.2 (whose arrays per square this replaces); Eliazar & Parr, *DP-SLAM 2.0*, ICRA 2004.
//!
//! # Invariants
//! * A tile's `base` is the tile that its owner's parent sees at the same place (0 if none): taking a node off needs
//!   no memory of what it had covered.
//! * Tile 0 is nobody's and stays unseen everywhere: every place without a tile reads it, and a first tile is a copy of it.
//! * Every tile is free or owned by a living node. With P particles that each see T tiles, 2 P T tiles are in use
//!   at most, besides history outside of everybody's sight.
//! * The root's tiles, the history all agree on, are found by place through the directory, so that the cost of a scan
//!   does not grow with the map; those of other nodes hang in a list at their node.
//!
//! Cost: a scan reads each tile header of the living nodes once, and one square for each square that a ray crosses.
//!
//! The figures of a tile of 16 × 16 squares: 512 bytes and a header of 20; of 8 × 8: 128 and 20.

mod ages;
mod exchange;
mod look_up;
mod print;
mod region;
mod square;
mod tiles;
mod window;

pub use ages::TileAge;
pub use exchange::{HeldTile, Restored};
pub use print::{Print, PrintReport};
pub use region::Region;
pub use square::{DISTANCE_UNITS, Square};
pub use tiles::{DistributedMap, MapMemory, MapMemoryError, PoolFullError, Tile, TileHeader, TileId, TilePlace};
pub use window::{MapView, Window, WindowFrame, WindowMemoryError};

crate::config! {
    /// Maps of the particles (thesis 3.2.3).
    pub struct ParticleMapConfig {
        /// Side of a square, m. The original: 0.0286. Cost per ray is in inverse proportion, memory in inverse square.
        square_size_m: f32 = 0.1, in 0.01..=1.0;
        /// Every so many rays are printed, the others at the next steps; cost is in inverse proportion. The thesis: 1.
        print_step: u16 = 2, in 1..=100;
    }
}

#[cfg(test)]
mod tests;
