//! From scans to a folder of results.

pub mod localize;
pub mod map;
pub mod robot;
pub mod scans;
