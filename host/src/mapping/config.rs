//! The configuration of mapping: that of SLAM, and what a computer does besides.

use lrfslam_core::low_slam::LowSlamConfigs;
use lrfslam_core::slam::SlamConfig;

use super::high::{HighConfig, HighConfigs, filter_config};
use super::memory::{MapperMemory, MemoryConfig};
use crate::maps::occupancy::MapConfig;
use crate::places::ClosureConfig;

lrfslam_core::config! {
    /// Levels of SLAM.
    pub struct HierarchyConfig {
        /// 0: scan matching alone. 1: particles over whole maps, DP-SLAM's low level. 2: loops closed between segments of its path.
        levels: u16 = 2, in 0..=2;
        /// What closes loops at level 2. The thesis: "particles".
        closing: Closing = Closing::Graph;
    }
}

lrfslam_core::config_choice! {
    /// What closes loops.
    pub enum Closing {
        /// Places recognised, and a graph of poses.
        Graph = "graph",
        /// Particles that are histories of segments (the thesis).
        Particles = "particles",
    }
    choices "\"graph\" or \"particles\""
}

/// Everything that decides what map is made of scans.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct MappingConfig {
    /// The low level's.
    pub slam: SlamConfig,
    /// Levels of SLAM.
    pub hierarchy: HierarchyConfig,
    /// High level.
    pub high: HighConfig,
    /// Closing of loops.
    pub closure: ClosureConfig,
    /// Memory.
    pub memory: MemoryConfig,
    /// How the map is drawn.
    pub map: MapConfig,
}

impl MappingConfig {
    /// The memory of a mapper: as much as this says. `threads` share the work, at least one; results do not depend on them.
    pub fn mapper_memory(&self, threads: usize) -> MapperMemory {
        match self.hierarchy.levels {
            0 => MapperMemory::of_matching(&self.slam, &self.memory),
            2 if self.high.feedback => MapperMemory::of_two_maps(&self.slam, &self.memory, threads),
            _ => MapperMemory::of_particles(&self.slam, &self.memory, threads),
        }
    }

    /// The part that the high level works with.
    pub fn high_slam(&self) -> HighConfigs {
        HighConfigs { high: self.high, closure: self.closure, ndt: self.slam.ndt }
    }

    /// What core's particle filter works with at the high level, if loops are closed by particles.
    pub fn high_particles(&self) -> Option<LowSlamConfigs> {
        let wanted = self.hierarchy.levels > 1 && self.hierarchy.closing == Closing::Particles;
        wanted.then(|| filter_config(&self.slam))
    }
}
