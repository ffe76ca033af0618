//! All memory of SLAM in one value of fixed size, for a microcontroller's statics.

use super::{SlamMemory, TILE_SIDE};
use crate::de::Member;
use crate::geometry::Point2;
use crate::laser_odometry::OdometryMemory;
use crate::low_slam::LowSlamPools;
use crate::ndt::{DirectoryEntry, NdtTile};

/// Members of the widest search, that of a robot that is lost.
const POPULATION: usize = 100;

/// Pools of a [`Slam`](super::Slam) as arrays; all zero, so that a static of it costs no flash.
///
/// The parameters are the numbers of map tiles, map tiles about the robot (4ⁿ), particles, nodes (twice as many), beams, cells' tiles, and places
/// about the robot at which those can be (4ⁿ for each of two overlapping grids). They suit a configuration like [`SlamConfig::small`]: whole-map
/// reference, one sample for each particle. What is configured beyond them is cut down or refused by [`Slam::new`].
///
/// [`SlamConfig::small`]: super::SlamConfig::small
/// [`Slam::new`]: super::Slam::new
#[derive(Debug)]
pub struct SlamPools<
    const TILES: usize,
    const WINDOW: usize,
    const PARTICLES: usize,
    const NODES: usize,
    const BEAMS: usize,
    const NDT_TILES: usize,
    const NDT_PLACES: usize,
> {
    particles: LowSlamPools<TILE_SIDE, TILES, WINDOW, PARTICLES, NODES, PARTICLES, BEAMS, WINDOW>,
    ndt_directory: [DirectoryEntry; NDT_PLACES],
    ndt_tiles: [NdtTile; NDT_TILES],
    population: [Member<3>; POPULATION],
    points: [Point2; BEAMS],
    hits: [Point2; BEAMS],
}

/// 32 particles at 8 m, scans of up to 682 beams (URG-04LX): 0.5 MB. For [`SlamConfig::small`](super::SlamConfig::small).
pub type SmallPools = SlamPools<1728, 1024, 32, 64, 682, 966, 8192>;

impl<
    const TILES: usize,
    const WINDOW: usize,
    const PARTICLES: usize,
    const NODES: usize,
    const BEAMS: usize,
    const NDT_TILES: usize,
    const NDT_PLACES: usize,
> SlamPools<TILES, WINDOW, PARTICLES, NODES, BEAMS, NDT_TILES, NDT_PLACES>
{
    /// Pools that nobody uses yet.
    pub const EMPTY: Self = Self {
        particles: LowSlamPools::EMPTY,
        ndt_directory: [DirectoryEntry::EMPTY; NDT_PLACES],
        ndt_tiles: [NdtTile::EMPTY; NDT_TILES],
        population: [Member::EMPTY; POPULATION],
        points: [Point2::new(0.0, 0.0); BEAMS],
        hits: [Point2::new(0.0, 0.0); BEAMS],
    };

    /// The pools as slices.
    pub fn lend(&mut self) -> SlamMemory<'_, TILE_SIDE> {
        let odometry = OdometryMemory {
            directory: &mut self.ndt_directory,
            tiles: &mut self.ndt_tiles,
            population: &mut self.population,
            points: &mut self.points,
            hits: &mut self.hits,
            key_points: &mut [],
            key_scans: &mut [],
        };
        SlamMemory { odometry, particles: self.particles.lend() }
    }
}
