#![doc = include_str!("../README.md")]
//!
//! # How it is built
//! [`scans`] (logs, recordings, lasers) → [`mapping`] (poses, loops closed) or [`localize`] (in a map that is there) → [`maps`] (drawn) →
//! [`output`] (folders of results), put together by [`runs`]. [`robot`] takes the place of mapping where a robot does it itself.
#![forbid(unsafe_code)]

pub mod doctor;
pub mod foxglove;
pub mod input;
pub mod landmarks;
pub mod localize;
pub mod mapping;
pub mod maps;
pub mod monitor;
pub mod output;
pub mod places;
pub mod plural;
pub mod pose_f64;
pub mod program;
pub mod results;
pub mod robot;
pub mod runs;
pub mod scans;
pub mod trajectory;
