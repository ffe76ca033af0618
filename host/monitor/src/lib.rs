#![doc = include_str!("../README.md")]
//!
//! # How it is built
//! [`Monitor`](lrfslam_host::monitor::Monitor) (state, in the library) → [`Server`] (who may see it, and how much of the machine that may
//! take) → `page/` (what draws it in a browser). Nothing here knows of SLAM.
#![forbid(unsafe_code)]

mod access;
mod doors;
#[cfg(feature = "zenoh")]
mod fleet;
#[cfg(feature = "foxglove")]
mod foxglove;
#[cfg(feature = "zenoh")]
mod member;
#[cfg(not(feature = "zenoh"))]
#[path = "no_member.rs"]
mod member;
mod remote;
mod routes;
mod server;

pub use access::{Access, LOOPBACK, parse_address};
pub use doors::{CONNECTIONS_MAX, Tell};
#[cfg(feature = "zenoh")]
pub use fleet::{Fleet, Place};
pub use remote::Remote;
pub use server::{Robot, Server, ServerConfig, Source};
