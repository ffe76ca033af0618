//! Scans in, poses and a map out, at each level; and the map kept to go on with.

mod config;
mod drawing;
pub mod genealogy;
pub mod high;
mod low_level;
pub mod mapper;
mod memory;
pub mod saved_map;
mod threads;

pub use config::{Closing, HierarchyConfig, MappingConfig};
pub use low_level::{Correction, LowLevel, LowPose, MatchCounts};
pub use memory::{MapperMemory, MemoryConfig, ParticlePools};
