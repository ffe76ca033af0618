#![doc = include_str!("../README.md")]
#![cfg_attr(not(test), no_std)]
#![forbid(unsafe_code)]

use serde::{Deserialize, Serialize};

use crate::time::{Duration, Instant};

pub mod time;

/// What one beam says.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum Echo {
    /// Something reflected at this range, m; finite and positive.
    Hit(f32),
    /// Nothing up to the scan's `range_max_m`.
    Miss,
    /// No measurement: dazzled, too weak, too near, or damaged.
    Invalid,
}

impl Echo {
    /// Reads a plain range: a hit below `range_max_m`, a miss from there on (also +∞), invalid if NaN, zero or negative.
    pub fn from_range(range_m: f32, range_max_m: f32) -> Self {
        if range_m.is_nan() || range_m <= 0.0 {
            Echo::Invalid
        } else if range_m < range_max_m {
            Echo::Hit(range_m)
        } else {
            Echo::Miss
        }
    }
}

/// One ray of a scan.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Beam {
    /// Direction in the lrf frame, rad, counter-clockwise from +x.
    pub bearing_rad: f32,
    /// Time after the scan's stamp; negative before it.
    pub offset: Duration,
    /// What it measured.
    pub echo: Echo,
}

impl Beam {
    /// Straight ahead, and nothing measured: for memory that a driver is lent.
    pub const BLANK: Self = Self { bearing_rad: 0.0, offset: Duration::ZERO, echo: Echo::Invalid };
}

/// One sweep: beams in the order in which they were measured, lent by their owner.
#[derive(Debug, Clone, Copy)]
pub struct RangeScan<'a> {
    /// Reference time of the sweep.
    pub stamp: Instant,
    /// A miss means: nothing nearer than this, m.
    pub range_max_m: f32,
    /// In order of bearing.
    pub beams: &'a [Beam],
}

impl RangeScan<'_> {
    /// From its time to the middle of the sweep.
    pub fn middle(&self) -> Duration {
        match (self.beams.first(), self.beams.last()) {
            (Some(first), Some(last)) => Duration::from_micros(first.offset.micros.midpoint(last.offset.micros)),
            _ => Duration::ZERO,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn echo_tells_hit_miss_and_invalid_apart() {
        assert_eq!(Echo::from_range(3.0, 8.0), Echo::Hit(3.0));
        assert_eq!(Echo::from_range(8.0, 8.0), Echo::Miss);
        assert_eq!(Echo::from_range(f32::INFINITY, 8.0), Echo::Miss);
        for bad in [0.0, -1.0, f32::NAN, f32::NEG_INFINITY] {
            assert_eq!(Echo::from_range(bad, 8.0), Echo::Invalid);
        }
    }
}
