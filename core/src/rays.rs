//! A scan as the map and the perception model see it: rays with a unit direction and a length, ready for many poses.
//!
//! Beams → [`rays_of`] → [`Ray`]s in the lrf frame, made once for each scan. Invalid beams are left out; a miss, and a hit
//! farther than is believed, is a ray that passed up to the believed range.

use crate::geometry::Point2;
use crate::scan::Echo;
use crate::sweep::Sweep;

crate::config! {
    /// How far the beams of a scan are believed.
    pub struct RayConfig {
        /// A hit farther away only says that the way up to here is free, m. Cost per ray is in proportion. The original: 7.95.
        range_max_m: f32 = 30.0, in 0.5..=200.0;
        /// A beam that saw nothing is believed to have passed freely this far, m; 0 ignores it. The thesis: the sensor's maximum
        /// range; but glass and black walls give misses too.
        miss_range_m: f32 = 3.0, in 0.0..=200.0;
    }
}

/// One beam, lrf frame.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Ray {
    /// Unit vector.
    pub direction: Point2,
    /// How far it is known to have gone, m.
    pub length_m: f32,
    /// True if it ended there; false if it went on.
    pub hit: bool,
}

impl Ray {
    /// A ray of an all-zero pool.
    pub const UNUSED: Self = Self { direction: Point2::new(0.0, 0.0), length_m: 0.0, hit: false };
}

/// More usable beams than the memory lent for them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("room for {capacity} rays, the scan has more")]
pub struct RayCapacityError {
    /// Rays that fit.
    pub capacity: usize,
}

/// The usable beams of `sweep` in their order, as they lie in the middle of it; written to the front of `memory`, returns their number.
///
/// A beam measured on the way is seen from where the laser is in the middle: its end stays, its length and direction follow.
///
/// # Errors
/// [`RayCapacityError`] if `memory` is too short.
pub fn rays_of(config: &RayConfig, sweep: &Sweep<'_>, memory: &mut [Ray]) -> Result<usize, RayCapacityError> {
    let capacity = memory.len();
    let middle_from_beam = sweep.middle_from_beam();
    let mut written = 0;
    for beam in sweep.scan.beams {
        let (length_m, hit) = match beam.echo {
            Echo::Hit(range_m) if range_m <= config.range_max_m => (range_m, true),
            Echo::Hit(range_m) if range_m.is_finite() => (config.range_max_m, false),
            Echo::Miss => (config.miss_range_m.min(sweep.scan.range_max_m), false),
            Echo::Hit(_) | Echo::Invalid => continue,
        };
        if length_m > 0.0 && beam.bearing_rad.is_finite() {
            let end = middle_from_beam(beam).transform(Point2::from_polar(length_m, beam.bearing_rad));
            let length_m = end.norm();
            if length_m > 0.0 {
                let slot = memory.get_mut(written).ok_or(RayCapacityError { capacity })?;
                *slot = Ray { direction: end * (1.0 / length_m), length_m, hit };
                written += 1;
            }
        }
    }
    Ok(written)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Pose2;
    use crate::scan::{Beam, RangeScan};
    use crate::time::{Duration, Instant};

    #[test]
    fn beams_become_rays_as_far_as_they_are_believed() {
        let beam = |echo| Beam { bearing_rad: 0.0, offset: Duration::ZERO, echo };
        let beams = [Echo::Hit(2.0), Echo::Hit(50.0), Echo::Miss, Echo::Invalid, Echo::Hit(f32::NAN)].map(beam);
        let scan = RangeScan { stamp: Instant::default(), range_max_m: 80.0, beams: &beams };
        let scan = Sweep::at_rest(scan, Pose2::IDENTITY);
        let mut memory = [Ray::default(); 4];
        assert_eq!(rays_of(&RayConfig::default(), &scan, &mut memory), Ok(3));
        let seen = memory.map(|ray| (ray.length_m, ray.hit));
        assert_eq!(seen[..3], [(2.0, true), (30.0, false), (3.0, false)]);
        assert_eq!(rays_of(&RayConfig::default(), &scan, &mut memory[..2]), Err(RayCapacityError { capacity: 2 }));
        let ignoring = RayConfig { miss_range_m: 0.0, ..RayConfig::default() };
        assert_eq!(rays_of(&ignoring, &scan, &mut memory), Ok(2));
    }
}
