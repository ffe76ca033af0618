//! The robot's program: laser in, map and path out, over a link to the host. The same on a microcontroller and on Linux.
//!
//! bytes of the laser → [`LrfDriver`](crate::lrf::driver::LrfDriver) → [`Mapping`] (laser odometry, DP-SLAM) → segments and tiles
//! → [`Session`](crate::wire::session::Session) → bytes to the host.
//!
//! [`Robot`] is sans-IO: bytes and the time go in; what goes out is given to [`Ports`]. It waits for a host to configure it,
//! then maps whether the host is there or not. What the host has not taken waits in memory of fixed size: when that is full,
//! segments are joined to longer ones and tiles wait, and nothing is wrong but the detail of the path.
//!
//! # Memory
//! [`RobotPools`] holds all of it, is all zero at first, and costs no flash as a static.

mod config;
mod fit;
mod laser;
mod machine;
mod mapping;
mod paging;
mod pools;
mod report;
mod requests;
mod sweep_report;

pub use config::{LaserConfig, LaserFamily, RobotConfig};
pub use fit::Misfit;
pub use machine::{Input, Ports, Robot};
pub use mapping::{Mapped, Mapping};
pub use pools::{CompactPools, LargePools, RobotMemory, RobotPools, StandardPools, TILE_SIDE};
pub use sweep_report::ReportConfig;
