#![doc = include_str!("../README.md")]
//!
//! # How it is built
//! Bytes and meaning are split: a *view* checks a telegram once and reads its fields in place, a *value* (`Request`,
//! `Command`, …) can be emitted and parsed. Host and device side are both here, so that a simulator says the same bytes.
//!
//! Data flow: bytes → incremental decoder → view → scan of [`Beam`](lrfslam_scan::Beam)s, driven by a
//! [`LrfDriver`](driver::LrfDriver), which asks the world for nothing: bytes and time come in, bytes and events go out.
//!
//! Invariants: no byte sequence panics; the same bytes give the same events, however they are cut; a scan is
//! published only whole and verified; memory is lent by the caller and never grows.
//!
//! Sources: the facts about each protocol are cited where they are used, as "manual" (the maker's), "capture" (bytes
//! recorded from a real device) or "drivers" (at least two independent open drivers agree).

#![cfg_attr(not(test), no_std)]
#![forbid(unsafe_code)]
#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::indexing_slicing,
        clippy::std_instead_of_core
    )
)]

pub mod beat;
pub mod clock;
#[cfg(test)]
mod desk;
mod dialogue;
pub mod driver;
pub mod hokuyo_scip;
pub mod ldrobot;
pub mod pace;
pub mod rplidar;
mod session;
pub mod sick_lms;
mod trouble;
pub mod turn;

pub use lrfslam_scan as scan;
pub use lrfslam_scan::time;
