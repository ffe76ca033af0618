//! The command `lrfslam`: arguments in, [`lrfslam_host`] at work, words and exit codes out.
#![forbid(unsafe_code)]

pub mod cli;
pub mod config;
mod held;
#[cfg(feature = "tui")]
mod tui;
#[cfg(not(feature = "tui"))]
#[path = "no_tui.rs"]
mod tui;
