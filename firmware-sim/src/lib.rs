//! Devices that are not there: laser range finders that speak their makers' protocols, in a world of walls.
//!
//! Data flow: [`scene`] (what is where, when) → [`virtual_lrf`] (bytes in, bytes out, on a virtual clock) → [`cable`] (the
//! pace of the line, and what a wrong rate makes of it) → [`fault`] (damage) → a link: [`pty`], or a test's.
//!
//! Everything but [`pty`] is a pure function of its inputs, times and seeds.

pub mod cable;
pub mod fault;
pub mod pty;
pub mod scene;
pub mod virtual_lrf;
