//! Devices that are not there: laser range finders that speak their makers' protocols, in a world of walls.
//!
//! Data flow: [`world`] (rectangles) and [`drive`] (a robot's way), from a world file ([`scenario`]) → [`raycast`] → [`scene`] (how far is what, when) → [`virtual_lrf`] (bytes in, bytes out, on a virtual clock) → [`cable`] (the
//! pace of the line, and what a wrong rate makes of it) → [`fault`] (damage) → a link: [`pty`], or a test's.
//!
//! [`robot_process`] is the other end of that link: the robot's program, which is core's, as a process.
//!
//! Everything but [`pty`] and [`robot_process`] is a pure function of its inputs, times and seeds.

pub mod cable;
pub mod drive;
pub mod fault;
pub mod log;
pub mod lrf_model;
pub mod people;
pub mod pty;
pub mod raycast;
pub mod robot_process;
pub mod scenario;
pub mod scene;
pub mod tilt;
pub mod virtual_lrf;
pub mod world;
