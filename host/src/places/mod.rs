//! Places recognised, and poses solved for: what closes loops, and what finds the robot in a known map.

pub mod closing;
pub mod correlation;
pub mod pose_graph;
mod reach;
pub mod submap;
mod variance_factor;

pub use closing::ClosureConfig;
pub use reach::{Reach, reach_from};
pub use variance_factor::VarianceFactor;
