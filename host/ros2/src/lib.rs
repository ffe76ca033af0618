#![doc = include_str!("../README.md")]
//!
//! # How it is built
//! [`messages`] (bytes, no effects) → `Node` (the network). Scans that come are read by [`lrfslam_host::scans::log::ToldScans`], as those
//! of bags are. Nothing here knows of SLAM but where it says the robot is.
#![forbid(unsafe_code)]

mod cdr;
pub mod messages;
#[cfg(feature = "dds")]
mod node;
#[cfg(feature = "dds")]
mod raw;
#[cfg(feature = "dds")]
mod subscription;
#[cfg(feature = "dds")]
mod topics;

#[cfg(feature = "dds")]
pub use node::{Node, NodeError};
#[cfg(feature = "dds")]
pub use subscription::{Patience, Subscription};
#[cfg(feature = "dds")]
pub use topics::{Step, Topics};

/// The largest number of a domain whose ports exist: 7400 + 250 · domain and some more.
pub const DOMAIN_MAX: u16 = 232;
