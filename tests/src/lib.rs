//! Scenarios that need both ends: a host driver and a virtual device, one virtual clock between them.
//!
//! [`Rig`] moves bytes through the same cable and faults as the simulator on a pseudo-terminal, but jumps from one event to
//! the next, so that hours pass in seconds and every run is the same. It knows each scan that the device sent, read from
//! the undamaged bytes by code of its own ([`oracle`]), and so counts published scans that are none of them.

pub mod data;
pub mod drives;
pub mod entries;
pub mod laser_scripts;
pub mod mcu;
pub mod oracle;
pub mod rig;
pub mod robot_rig;
pub mod samples;
pub mod scenes;

pub use rig::{Rig, RigReport};
