//! The simulator: its rays, and its program.

mod log_command;
mod raycast;
