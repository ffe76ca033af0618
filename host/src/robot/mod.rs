//! The host's end of a robot that does the SLAM itself: configures it, and keeps what it tells.
//!
//! bytes → [`RobotClient`] (session, requests) → [`RobotMap`] (paths of the particles, tiles of the best one's map) → path and picture.
//! The protocol is in `docs/robot-link.md`.

mod client;
mod map;

pub use client::{ClientMemory, RobotClient, RobotEvent};
pub use map::{RobotMap, Tiles};
