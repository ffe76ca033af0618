//! From scans to a folder of results.

pub mod bag;
mod live;
pub mod localize;
pub mod map;
pub mod robot;
pub mod scans;
