#![doc = include_str!("../README.md")]
//!
//! # How it is built
//! bytes of the laser → [`LrfDriver`](lrfslam_lrf::driver::LrfDriver) → [`Mapping`] (laser odometry, DP-SLAM) → segments and tiles
//! → [`Session`](wire::session::Session) → bytes to the host.
//!
//! A module uses only what stands to its left: `config | wire | program`.
#![cfg_attr(not(test), no_std)]
#![forbid(unsafe_code)]
#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::indexing_slicing,
        clippy::std_instead_of_core
    )
)]

mod config;
mod program;
pub mod wire;

pub use config::{LaserConfig, LaserFamily, ReportConfig, RobotConfig};
pub use program::{
    CompactPools, Input, LargePools, Mapped, Mapping, Misfit, Pools, Ports, Robot, RobotMemory, RobotPools,
    StandardPools,
};
