//! The program with a simulated laser, on the clock of the wall: apart from all that keeps the cores busy.

mod attach;
#[cfg(feature = "monitor")]
mod browser;
#[path = "../cli/common.rs"]
mod common;
#[cfg(feature = "demo")]
mod demo;
mod doctor;
#[cfg(feature = "demo")]
mod keeps;
mod keys;
mod kills;
mod laser;
#[path = "../cli/map_server.rs"]
mod map_server;
mod others;
#[cfg(feature = "monitor")]
mod page;
mod visits;
