//! The robot's memory: that of one of its builds, some of its pools perhaps of another size.

use lrfslam_core::ancestry::Node;
use lrfslam_core::distributed_map::{Tile, TileHeader, TileId};
use lrfslam_core::ndt::{DirectoryEntry, NdtTile};
use lrfslam_core::particles::{Particle, Sample};
use lrfslam_robot::{CompactPools, LargePools, Pools, RobotMemory, StandardPools};

/// Builds of the robot.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Build {
    /// The image for 512 KiB.
    #[default]
    Standard,
    /// The image for 192 KiB.
    Compact,
    /// For a Linux computer.
    Large,
}

/// A pool, and how many it holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PoolSize {
    /// Tiles of the particles' maps.
    Tiles(usize),
    /// Tiles about the robot, 4ⁿ: beams reach up to half of its side.
    Window(usize),
    /// Particles.
    Particles(usize),
    /// Tiles of the matcher's reference.
    NdtTiles(usize),
    /// Places of such tiles that are told apart, 4ⁿ in each layer.
    NdtPlaces(usize),
}

impl PoolSize {
    /// Reads `NAME=COUNT`.
    ///
    /// # Errors
    /// If it is not of this form, in words.
    pub fn parse(text: &str) -> Result<Self, String> {
        let expected = "expected tiles=N, window=N, particles=N, ndt_tiles=N or ndt_places=N";
        let (name, count) = text.split_once('=').ok_or(expected)?;
        let count = count.parse().map_err(|_| format!("{count:?} is not a number: {expected}"))?;
        match name {
            "tiles" => Ok(Self::Tiles(count)),
            "window" => Ok(Self::Window(count)),
            "particles" => Ok(Self::Particles(count)),
            "ndt_tiles" => Ok(Self::NdtTiles(count)),
            "ndt_places" => Ok(Self::NdtPlaces(count)),
            _ => Err(format!("{name:?} is no pool: {expected}")),
        }
    }

    fn replace(self, memory: &mut RobotMemory<'static>) {
        let RobotMemory { mapping, ledger, .. } = memory;
        let particles = &mut mapping.particles;
        match self {
            Self::Tiles(count) => {
                particles.map.tiles = many(Tile::UNSEEN, count);
                particles.map.headers = many(TileHeader::FREE, count);
            }
            Self::Window(count) => {
                particles.window = many(TileId::NONE, count);
                *ledger = many(Default::default(), count);
            }
            Self::Particles(count) => {
                particles.particles = many(Particle::UNUSED, count);
                particles.samples = many(Sample::UNUSED, count);
                particles.nodes = many(Node::FREE, 2 * count);
                particles.map.node_tiles = many(TileId::NONE, 2 * count);
            }
            Self::NdtTiles(count) => mapping.odometry.tiles = many(NdtTile::EMPTY, count),
            Self::NdtPlaces(count) => mapping.odometry.directory = many(DirectoryEntry::EMPTY, count),
        }
    }
}

fn many<T: Clone>(value: T, count: usize) -> &'static mut [T] {
    Box::leak(vec![value; count].into_boxed_slice())
}

fn leaked<M: Pools + 'static>() -> RobotMemory<'static> {
    Box::leak(Box::new(M::EMPTY)).lend()
}

impl Build {
    /// Its memory, never given back, with these pools of another size.
    pub fn memory(self, pools: &[PoolSize]) -> RobotMemory<'static> {
        let mut memory = match self {
            Self::Standard => leaked::<StandardPools>(),
            Self::Compact => leaked::<CompactPools>(),
            Self::Large => leaked::<LargePools>(),
        };
        pools.iter().for_each(|pool| pool.replace(&mut memory));
        memory
    }
}
