//! The program with a simulated laser, on the clock of the wall: apart from all that keeps the cores busy.

mod attach;
#[cfg(feature = "monitor")]
mod browser;
#[path = "../cli/common.rs"]
mod common;
#[cfg(feature = "demo")]
mod demo;
mod doctor;
#[cfg(feature = "monitor")]
mod fed;
#[cfg(feature = "zenoh")]
mod fleet;
#[cfg(feature = "foxglove")]
mod foxglove;
#[cfg(feature = "demo")]
mod keeps;
mod keys;
mod kills;
mod laser;
#[path = "../cli/map_server.rs"]
mod map_server;
mod mcap;
mod others;
#[cfg(feature = "monitor")]
mod page;
#[cfg(feature = "monitor")]
mod page_cost;
#[cfg(feature = "monitor")]
mod page_far;
#[cfg(feature = "monitor")]
mod page_hands;
#[cfg(feature = "monitor")]
mod page_landmarks;
#[cfg(feature = "monitor")]
mod page_mcu;
#[cfg(feature = "monitor")]
mod page_pictures;
#[cfg(feature = "monitor")]
mod page_sights;
#[cfg(feature = "monitor")]
mod page_watch;
#[cfg(feature = "ros2")]
mod ros2;
#[cfg(feature = "tui")]
mod terminal;
#[cfg(feature = "monitor")]
mod viewer;
mod visits;
