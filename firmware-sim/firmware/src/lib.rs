//! What the firmware's programs share: the board, and the size of the memory.
#![no_std]
#![deny(unsafe_code)]

pub mod board;
pub mod port;

/// The robot's memory.
#[cfg(not(feature = "compact"))]
pub type Pools = lrfslam_robot::StandardPools;
/// The robot's memory.
#[cfg(feature = "compact")]
pub type Pools = lrfslam_robot::CompactPools;
