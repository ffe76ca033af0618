//! One sweep of a laser range finder, in polar form.
//!
//! A beam says one of three things, and they are never mixed up: it **hit** something at a range, it **missed**
//! (nothing up to the maximum range: the way is free), or it is **invalid** (the sensor could not measure: nothing is
//! known). Each beam carries its own bearing and time, so that irregular and interlaced scans are ordinary.

use serde::{Deserialize, Serialize};

use crate::geometry::Point2;
use crate::time::{Duration, Instant};

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
    /// End point of a hit, lrf frame, m; `None` for a miss or an invalid beam.
    pub fn hit_in_lrf(&self) -> Option<Point2> {
        match self.echo {
            Echo::Hit(range_m) => Some(Point2::from_polar(range_m, self.bearing_rad)),
            Echo::Miss | Echo::Invalid => None,
        }
    }
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

/// The geometry that all scans of a regular laser range finder share.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LrfModel {
    /// Bearing of beam 0, lrf frame, rad.
    pub angle_min_rad: f32,
    /// From one beam to the next, rad; positive is counter-clockwise.
    pub angle_increment_rad: f32,
    /// From one beam to the next.
    pub time_increment: Duration,
    /// Number of beams.
    pub beams: u16,
    /// Nothing nearer is a measurement, m.
    pub range_min_m: f32,
    /// Ranges from here on are misses, m.
    pub range_max_m: f32,
}

impl LrfModel {
    /// Beam `index` with the plain range `range_m` of this sensor.
    ///
    /// Below `range_min_m` it is invalid; for the rest see [`Echo::from_range`].
    pub fn beam(&self, index: u16, range_m: f32) -> Beam {
        let echo = if range_m < self.range_min_m { Echo::Invalid } else { Echo::from_range(range_m, self.range_max_m) };
        Beam {
            bearing_rad: self.angle_min_rad + f32::from(index) * self.angle_increment_rad,
            offset: Duration::from_micros(self.time_increment.micros.saturating_mul(i64::from(index))),
            echo,
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

    #[test]
    fn model_gives_each_beam_its_angle_and_time() {
        let urg = LrfModel {
            angle_min_rad: -2.0,
            angle_increment_rad: 0.25,
            time_increment: Duration::from_micros(98),
            beams: 17,
            range_min_m: 0.02,
            range_max_m: 5.6,
        };
        let beam = urg.beam(8, 1.5);
        assert_eq!((beam.bearing_rad, beam.offset.micros, beam.echo), (0.0, 784, Echo::Hit(1.5)));
        assert_eq!(urg.beam(0, 0.01).echo, Echo::Invalid);
        assert_eq!(beam.hit_in_lrf(), Some(Point2::new(1.5, 0.0)));
    }
}
