//! The host's end of a robot that does the SLAM itself: configures it, and keeps what it tells.
//!
//! [`RobotLink`] (port) → [`RobotClient`] (session, requests) → [`Journal`] (on disk, then acknowledged) → [`Judge`] (can that be?) → [`RobotMap`] (paths of the particles, tiles
//! of the best one's map), [`Sweeps`] (scans) → high level, path and pictures. The protocol is in `docs/robot-link.md`.
#![cfg_attr(not(test), deny(clippy::indexing_slicing))]

mod client;
mod journal;
mod judge;
mod key;
mod link;
mod map;
mod paths;
mod render;
mod sweeps;

pub use client::{ClientMemory, Recall, RobotClient, RobotEvent, Told};
pub use journal::{JOURNAL, Journal, Skipped};
pub use judge::{Absurd, Judge};
pub use key::{KeyFileError, entropy, new_key_file, read_key_file};
pub use link::{LinkEvent, RobotLink};
pub use map::{RobotMap, Tiles};
pub use sweeps::{Sweeps, ToldSweep};
