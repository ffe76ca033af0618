//! A value that is known now and then, and interpolated between: the tilt from its encoder, the pose along the path.

use lrfslam_core::time::{Duration, Instant};
use nalgebra::Isometry3;

/// What can be interpolated.
pub trait Between: Clone {
    /// The value at `share` (0 to 1) of the way to `other`.
    fn between(&self, other: &Self, share: f64) -> Self;
}

impl Between for f64 {
    fn between(&self, other: &Self, share: f64) -> Self {
        self + share * (other - self)
    }
}

impl Between for Isometry3<f64> {
    /// Straight in position, by the shorter arc in orientation.
    fn between(&self, other: &Self, share: f64) -> Self {
        let rotation = self.rotation.try_slerp(&other.rotation, share, 1e-9).unwrap_or(self.rotation);
        let position = self.translation.vector.lerp(&other.translation.vector, share);
        Self::from_parts(position.into(), rotation)
    }
}

/// Readings by time.
#[derive(Debug, Clone)]
pub struct Track<T> {
    sorted: Vec<(i64, T)>,
    gap_max: Duration,
}

impl<T: Between> Track<T> {
    /// * `readings` — in any order; of several at the same time the first counts
    /// * `gap_max` — nothing is said between readings farther apart than this, nor farther than this beyond the ends
    pub fn new(readings: impl IntoIterator<Item = (Instant, T)>, gap_max: Duration) -> Self {
        let mut sorted: Vec<_> = readings.into_iter().map(|(stamp, value)| (stamp.micros, value)).collect();
        sorted.sort_by_key(|&(micros, _)| micros);
        sorted.dedup_by_key(|&mut (micros, _)| micros);
        Self { sorted, gap_max }
    }

    /// The value at a time: between two readings linear, beyond the first or last one theirs; `None` where the gap is too large.
    pub fn at(&self, stamp: Instant) -> Option<T> {
        let after = self.sorted.partition_point(|&(micros, _)| micros < stamp.micros);
        let near = |micros: i64| micros.abs_diff(stamp.micros) <= self.gap_max.micros.unsigned_abs();
        let before = after.checked_sub(1).and_then(|index| self.sorted.get(index));
        match (before, self.sorted.get(after)) {
            (_, Some((micros, value))) if *micros == stamp.micros => Some(value.clone()),
            (Some((from, a)), Some((to, b))) => {
                let gap = to.abs_diff(*from);
                let share = stamp.micros.abs_diff(*from) as f64 / gap as f64;
                (gap <= self.gap_max.micros.unsigned_abs()).then(|| a.between(b, share))
            }
            (Some((micros, value)), None) | (None, Some((micros, value))) => near(*micros).then(|| value.clone()),
            (None, None) => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{UnitQuaternion, Vector3};

    fn at(micros: i64) -> Instant {
        Instant::from_micros(micros)
    }

    #[test]
    fn tilt_between_two_readings_is_linear_and_a_large_gap_says_nothing() {
        let track = Track::new([(at(300), 3.0), (at(100), 1.0), (at(900), 5.0)], Duration::from_micros(200));
        assert_eq!([100, 150, 300].map(|t| track.at(at(t))), [Some(1.0), Some(1.5), Some(3.0)]);
        assert_eq!([99, 1100].map(|t| track.at(at(t))), [Some(1.0), Some(5.0)], "held at the ends");
        assert_eq!([-101, 301, 899, 1101].map(|t| track.at(at(t))), [None; 4]);
        assert_eq!(Track::<f64>::new([], Duration::from_micros(9)).at(at(0)), None);
    }

    #[test]
    fn poses_turn_the_short_way() {
        let pose = |x, heading: f64| {
            Isometry3::from_parts(
                Vector3::new(x, 0.0, 0.0).into(),
                UnitQuaternion::from_axis_angle(&Vector3::z_axis(), heading),
            )
        };
        let track = Track::new([(at(0), pose(0.0, 3.0)), (at(10), pose(2.0, -3.0))], Duration::from_micros(10));
        let middle = track.at(at(5)).unwrap();
        assert!((middle.translation.x - 1.0).abs() < 1e-12);
        assert!((middle.rotation.angle() - std::f64::consts::PI).abs() < 1e-9);
    }
}
