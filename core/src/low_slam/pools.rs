//! All memory of a filter in one value of fixed size, for a microcontroller's statics.

use crate::ancestry::Node;
use crate::distributed_map::{MapMemory, Tile, TileHeader, TileId};
use crate::particles::{Particle, Sample};
use crate::rays::Ray;

use super::LowSlamMemory;

/// Pools of a [`LowSlam`](super::LowSlam) as arrays; the parameters are their lengths, `SIDE` that of a tile in squares.
///
/// [`EMPTY`](Self::EMPTY) is all zero, so a static of it costs no flash. On a computer, slices made with `vec!` are as good.
#[derive(Debug)]
pub struct LowSlamPools<
    const SIDE: usize,
    const TILES: usize,
    const DIRECTORY: usize,
    const PARTICLES: usize,
    const NODES: usize,
    const SAMPLES: usize,
    const RAYS: usize,
    const WINDOW: usize,
> {
    tiles: [Tile<SIDE>; TILES],
    headers: [TileHeader; TILES],
    node_tiles: [TileId; NODES],
    directory: [TileId; DIRECTORY],
    nodes: [Node; NODES],
    particles: [Particle; PARTICLES],
    samples: [Sample; SAMPLES],
    rays: [Ray; RAYS],
    window: [TileId; WINDOW],
}

impl<
    const SIDE: usize,
    const TILES: usize,
    const DIRECTORY: usize,
    const PARTICLES: usize,
    const NODES: usize,
    const SAMPLES: usize,
    const RAYS: usize,
    const WINDOW: usize,
> LowSlamPools<SIDE, TILES, DIRECTORY, PARTICLES, NODES, SAMPLES, RAYS, WINDOW>
{
    /// Pools that nobody uses yet.
    pub const EMPTY: Self = Self {
        tiles: [Tile::UNSEEN; TILES],
        headers: [TileHeader::FREE; TILES],
        node_tiles: [TileId::NONE; NODES],
        directory: [TileId::NONE; DIRECTORY],
        nodes: [Node::FREE; NODES],
        particles: [Particle::UNUSED; PARTICLES],
        samples: [Sample::UNUSED; SAMPLES],
        rays: [Ray::UNUSED; RAYS],
        window: [TileId::NONE; WINDOW],
    };

    /// The pools as slices.
    pub fn lend(&mut self) -> LowSlamMemory<'_, SIDE> {
        LowSlamMemory {
            map: MapMemory {
                tiles: &mut self.tiles,
                headers: &mut self.headers,
                node_tiles: &mut self.node_tiles,
                directory: &mut self.directory,
                ages: &mut [],
            },
            nodes: &mut self.nodes,
            particles: &mut self.particles,
            samples: &mut self.samples,
            rays: &mut self.rays,
            window: &mut self.window,
        }
    }
}
