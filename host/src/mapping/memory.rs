//! The memory that a mapper works in: fixed from the start.

use lrfslam_core::ancestry::Node;
use lrfslam_core::de::Member;
use lrfslam_core::distributed_map::{MapMemory, Tile, TileAge, TileHeader, TileId};
use lrfslam_core::geometry::Point2;
use lrfslam_core::laser_odometry::{KeyScan, OdometryMemory};
use lrfslam_core::low_slam::{LowSlamConfigs, LowSlamMemory};
use lrfslam_core::ndt::{DirectoryEntry, NdtTile};
use lrfslam_core::particles::{Particle, Sample};
use lrfslam_core::perception::reach_m;
use lrfslam_core::rays::Ray;
use lrfslam_core::slam::SlamConfig;

lrfslam_core::config! {
    /// Memory, fixed from the start.
    pub struct MemoryConfig {
        /// Tiles of 2 × 2 NDT cells (0.14 kB each), for all overlapping grids together. When they are used up those farthest from the
        /// robot are forgotten.
        ndt_tiles: u16 = 65535, in 16..=65535;
        /// Points of one scan.
        scan_points: u16 = 4096, in 64..=65535;
        /// Tiles of 16 × 16 squares (0.5 kB each), for all particles' maps together. When they are used up the least likely particles go.
        map_tiles: u32 = 65536, in 256..=16777216;
    }
}

/// Tiles along the side of the NDT's directory: 614 m of cells of 0.3 m before places are told apart no more.
const NDT_DIRECTORY_SIDE: usize = 1024;
/// The same of the particles' maps; beyond that only time is lost.
const DIRECTORY_SIDE: usize = 256;
/// Squares along the side of a particle map's tile.
pub(crate) const SIDE: usize = 16;

/// Table of one thread's [`Window`](lrfslam_core::distributed_map::Window).
pub(crate) type WindowSlots = Vec<TileId>;

/// The memory that a [`Mapper`](super::mapper::Mapper) works in.
#[derive(Debug)]
pub struct MapperMemory {
    pub(super) odometry: MatcherPools,
    pub(super) particles: Option<ParticlePools>,
    /// Of the corrected map, while it is drawn.
    pub(super) beside: Option<(MatcherPools, ParticlePools)>,
}

impl MapperMemory {
    /// That of matching and particles; it does not grow. `threads` share the work, at least one; results do not depend on them.
    pub fn of_particles(slam: &SlamConfig, memory: &MemoryConfig, threads: usize) -> Self {
        let particles = ParticlePools::new(&slam.low_slam(), memory, threads);
        Self { odometry: MatcherPools::new(slam, memory), particles: Some(particles), beside: None }
    }

    /// The same, and as much again: a corrected map is drawn beside the one in use, a part with every scan.
    pub fn of_two_maps(slam: &SlamConfig, memory: &MemoryConfig, threads: usize) -> Self {
        let beside = (MatcherPools::new(slam, memory), ParticlePools::new(&slam.low_slam(), memory, 1));
        Self { beside: Some(beside), ..Self::of_particles(slam, memory, threads) }
    }

    /// That of matching alone.
    pub fn of_matching(slam: &SlamConfig, memory: &MemoryConfig) -> Self {
        Self { odometry: MatcherPools::new(slam, memory), particles: None, beside: None }
    }

    /// That of matching alone.
    pub fn lend_odometry(&mut self) -> OdometryMemory<'_> {
        self.odometry.lend()
    }
}

#[derive(Debug)]
pub(super) struct MatcherPools {
    directory: Vec<DirectoryEntry>,
    tiles: Vec<NdtTile>,
    population: Vec<Member<3>>,
    points: Vec<Point2>,
    hits: Vec<Point2>,
    key_points: Vec<Point2>,
    key_scans: Vec<KeyScan>,
}

impl MatcherPools {
    fn new(config: &SlamConfig, memory: &MemoryConfig) -> Self {
        let population = config.de.population.max(config.recovery.population);
        let points = usize::from(memory.scan_points);
        let key_scans = config.odometry.key_scans();
        Self {
            directory: vec![
                DirectoryEntry::default();
                config.ndt.directories() * NDT_DIRECTORY_SIDE * NDT_DIRECTORY_SIDE
            ],
            tiles: vec![NdtTile::EMPTY; usize::from(memory.ndt_tiles)],
            population: vec![Member::EMPTY; usize::from(population)],
            points: vec![Point2::default(); points],
            hits: vec![Point2::default(); points],
            key_points: vec![Point2::default(); points * key_scans],
            key_scans: vec![KeyScan::default(); key_scans],
        }
    }

    pub(super) fn lend(&mut self) -> OdometryMemory<'_> {
        OdometryMemory {
            directory: &mut self.directory,
            tiles: &mut self.tiles,
            population: &mut self.population,
            points: &mut self.points,
            hits: &mut self.hits,
            key_points: &mut self.key_points,
            key_scans: &mut self.key_scans,
        }
    }
}

/// The memory of a particle filter over whole maps, and of the threads that share its work.
#[derive(Debug)]
pub struct ParticlePools {
    tiles: Vec<Tile<SIDE>>,
    headers: Vec<TileHeader>,
    node_tiles: Vec<TileId>,
    directory: Vec<TileId>,
    ages: Vec<TileAge>,
    nodes: Vec<Node>,
    particles: Vec<Particle>,
    samples: Vec<Sample>,
    rays: Vec<Ray>,
    window: WindowSlots,
    /// For the other threads.
    windows: Vec<WindowSlots>,
}

impl ParticlePools {
    /// As much as `config` and `memory` say; `threads` share the work, at least one.
    pub fn new(config: &LowSlamConfigs, memory: &MemoryConfig, threads: usize) -> Self {
        let particles = usize::from(config.filter.particles);
        let tiles = memory.map_tiles as usize;
        let slots = vec![TileId::NONE; window_side(config).pow(2)];
        Self {
            tiles: vec![Tile::UNSEEN; tiles],
            headers: vec![TileHeader::FREE; tiles],
            node_tiles: vec![TileId::NONE; 2 * particles],
            directory: vec![TileId::NONE; DIRECTORY_SIDE * DIRECTORY_SIDE],
            ages: vec![TileAge::NEW; if config.closes_loops { tiles } else { 0 }],
            nodes: vec![Node::FREE; 2 * particles],
            particles: vec![Particle::UNUSED; particles],
            samples: vec![Sample::UNUSED; particles * usize::from(config.filter.samples_per_particle)],
            rays: vec![Ray::UNUSED; usize::from(memory.scan_points)],
            window: slots.clone(),
            windows: vec![slots; threads.max(1) - 1],
        }
    }

    /// The filter's memory, and the windows of the other threads.
    pub(crate) fn lend(&mut self) -> (LowSlamMemory<'_, SIDE>, &mut [WindowSlots]) {
        let memory = LowSlamMemory {
            map: MapMemory {
                tiles: &mut self.tiles,
                headers: &mut self.headers,
                node_tiles: &mut self.node_tiles,
                directory: &mut self.directory,
                ages: &mut self.ages,
            },
            nodes: &mut self.nodes,
            particles: &mut self.particles,
            samples: &mut self.samples,
            rays: &mut self.rays,
            window: &mut self.window,
        };
        (memory, &mut self.windows)
    }
}

/// Tiles along a window's side: what a scan reaches to all sides, and a few metres that particles may be apart.
fn window_side(config: &LowSlamConfigs) -> usize {
    let reach_m = config.rays.range_max_m + reach_m(&config.perception);
    let side_m = 2.0 * reach_m + 10.0;
    let tiles = side_m / (config.map.square_size_m * SIDE as f32);
    (tiles.ceil() as usize).next_power_of_two().clamp(2, 4096)
}
