//! The command `lrfslam`: arguments in, [`lrfslam_host`] at work, words and exit codes out.
#![forbid(unsafe_code)]

pub mod cli;
pub mod config;
