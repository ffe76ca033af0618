//! Poses in double precision, for what is measured over hundreds of metres: mountings, ground truth, errors.
//!
//! The robot estimates in `f32` ([`Pose2`]); whoever judges it should not add rounding of his own.

use std::f64::consts::PI;

use lrfslam_core::geometry::Pose2;

/// Position (m) and heading (rad, counter-clockwise) in the plane; composes like [`Pose2`].
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct PoseF64 {
    /// m.
    pub x: f64,
    /// m.
    pub y: f64,
    /// rad, in (−π, π] for the results of [`between`](Self::between) and [`then`](Self::then).
    pub heading: f64,
}

impl PoseF64 {
    /// The pose (`x` m, `y` m, `heading` rad), heading as given.
    pub const fn new(x: f64, y: f64, heading: f64) -> Self {
        Self { x, y, heading }
    }

    /// `inner` of this frame in the outer frame: self ⊕ inner.
    pub fn then(self, inner: Self) -> Self {
        let (sin, cos) = self.heading.sin_cos();
        Self::new(
            self.x + cos * inner.x - sin * inner.y,
            self.y + sin * inner.x + cos * inner.y,
            wrap(self.heading + inner.heading),
        )
    }

    /// Pose of `other` seen from here: self⁻¹ ⊕ other.
    pub fn between(self, other: Self) -> Self {
        let (sin, cos) = self.heading.sin_cos();
        let (dx, dy) = (other.x - self.x, other.y - self.y);
        Self::new(cos * dx + sin * dy, cos * dy - sin * dx, wrap(other.heading - self.heading))
    }

    /// Halfway from this pose to `other`.
    pub fn midway(self, other: Self) -> Self {
        Self {
            x: 0.5 * (self.x + other.x),
            y: 0.5 * (self.y + other.y),
            heading: wrap(self.heading + 0.5 * wrap(other.heading - self.heading)),
        }
    }

    /// Distance of the position from the origin, m.
    pub fn distance_m(self) -> f64 {
        self.x.hypot(self.y)
    }

    /// True if all three numbers are finite.
    pub fn is_finite(self) -> bool {
        self.x.is_finite() && self.y.is_finite() && self.heading.is_finite()
    }

    /// The same in single precision.
    pub fn to_f32(self) -> Pose2 {
        Pose2::new(self.x as f32, self.y as f32, wrap(self.heading) as f32)
    }
}

impl From<Pose2> for PoseF64 {
    fn from(pose: Pose2) -> Self {
        Self::new(f64::from(pose.x), f64::from(pose.y), f64::from(pose.heading))
    }
}

/// Angle wrapped into (−π, π]; NaN for what is not finite.
pub fn wrap(angle: f64) -> f64 {
    let wrapped = angle.rem_euclid(2.0 * PI);
    if wrapped > PI { wrapped - 2.0 * PI } else { wrapped }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn between_undoes_then() {
        let (a, b) = (PoseF64::new(3.0, -2.0, 2.5), PoseF64::new(-1.0, 0.5, 1.9));
        let back = a.between(a.then(b));
        assert!(
            (back.x - b.x).abs() < 1e-12 && (back.y - b.y).abs() < 1e-12 && (back.heading - b.heading).abs() < 1e-12
        );
    }

    #[test]
    fn midway_goes_the_short_way_round() {
        let middle = PoseF64::new(1.0, 4.0, 3.0).midway(PoseF64::new(2.0, 2.0, -3.0));
        assert!(middle.x == 1.5 && middle.y == 3.0 && (middle.heading - PI).abs() < 1e-12, "{middle:?}");
    }

    #[test]
    fn wrap_is_half_open() {
        assert_eq!(wrap(PI), PI);
        assert_eq!(wrap(-PI), PI);
        assert!((wrap(7.0) - (7.0 - 2.0 * PI)).abs() < 1e-12);
        assert!(wrap(f64::NAN).is_nan());
    }
}
