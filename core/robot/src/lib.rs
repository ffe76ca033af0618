//! The robot's program: laser in, map and path out, over a link to the host. The same on a microcontroller and on Linux.
//!
//! bytes of the laser → [`LrfDriver`](lrfslam_lrf::driver::LrfDriver) → [`Mapping`] (laser odometry, DP-SLAM) → segments and tiles
//! → [`Session`](wire::session::Session) → bytes to the host.
//!
//! [`Robot`] is sans-IO: bytes and the time go in; what goes out is given to [`Ports`]. It waits for a host to configure it,
//! then maps whether the host is there or not. What the host has not taken waits in memory of fixed size: when that is full,
//! segments are joined to longer ones and tiles wait, and nothing is wrong but the detail of the path.
//!
//! `no_std`, no heap, no `unsafe`, no panic on data. A module uses only what stands to its left: `config | wire | program`.
//!
//! # Memory
//! [`RobotPools`] holds all of it, is all zero at first, and costs no flash as a static.
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
    CompactPools, Input, LargePools, Mapped, Mapping, Misfit, Ports, Robot, RobotMemory, RobotPools, StandardPools,
};
