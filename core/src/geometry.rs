//! Points and poses of the plane: the group SE(2).

use core::ops::{Add, Mul, Sub};

use serde::{Deserialize, Serialize};

use lrfslam_scan::{Beam, Echo};

use crate::config::{Layout, NO_LAYOUT, layout_with};
use crate::facing::Facing;
use crate::math::{atan2, hypot, sin_cos, wrap_angle};

/// A point or a displacement in the plane, m.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Point2 {
    /// Forward (or east), m.
    pub x: f32,
    /// Left (or north), m.
    pub y: f32,
    /// Which way the wall faces that it lies on, if it was seen.
    #[serde(skip)]
    pub facing: Facing,
}

impl Point2 {
    /// The point (`x`, `y`).
    pub const fn new(x: f32, y: f32) -> Self {
        Self { x, y, facing: Facing::UNKNOWN }
    }

    /// The point at `range_m` in the direction `bearing_rad`.
    pub fn from_polar(range_m: f32, bearing_rad: f32) -> Self {
        let (sin, cos) = sin_cos(bearing_rad);
        Self::new(range_m * cos, range_m * sin)
    }

    /// End point of a hit, lrf frame, m; `None` for a miss or an invalid beam.
    pub fn of_hit(beam: &Beam) -> Option<Self> {
        match beam.echo {
            Echo::Hit(range_m) => Some(Self::from_polar(range_m, beam.bearing_rad)),
            Echo::Miss | Echo::Invalid => None,
        }
    }

    /// Direction from the origin, counter-clockwise from +x, rad in [−π, π]; 0 at the origin itself.
    pub fn bearing_rad(self) -> f32 {
        atan2(self.y, self.x)
    }

    /// Square of the distance from the origin, m².
    pub fn norm_squared(self) -> f32 {
        self.x * self.x + self.y * self.y
    }

    /// Distance from the origin, m.
    pub fn norm(self) -> f32 {
        hypot(self.x, self.y)
    }
}

impl Add for Point2 {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self { x: self.x + other.x, y: self.y + other.y, ..self }
    }
}

impl Sub for Point2 {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Self { x: self.x - other.x, y: self.y - other.y, ..self }
    }
}

impl Mul<f32> for Point2 {
    type Output = Self;
    fn mul(self, factor: f32) -> Self {
        Self { x: self.x * factor, y: self.y * factor, ..self }
    }
}

/// Position and heading in the plane; as a transform `a_from_b`, the pose of frame b in frame a.
///
/// `a * b` composes (⊕), [`inverse`](Self::inverse) inverts, [`between`](Self::between) is a⁻¹ ⊕ b. Headings stay in (−π, π].
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Pose2 {
    /// m.
    pub x: f32,
    /// m.
    pub y: f32,
    /// Counter-clockwise from +x, rad, in (−π, π].
    pub heading: f32,
}

impl Pose2 {
    /// The origin: no displacement, no rotation.
    pub const IDENTITY: Self = Self { x: 0.0, y: 0.0, heading: 0.0 };

    /// The pose (`x` m, `y` m, `heading` rad), heading wrapped.
    pub fn new(x: f32, y: f32, heading: f32) -> Self {
        Self { x, y, heading: wrap_angle(heading) }
    }

    /// The transform that undoes this one.
    pub fn inverse(self) -> Self {
        let (sin, cos) = sin_cos(self.heading);
        Self::new(-(cos * self.x + sin * self.y), sin * self.x - cos * self.y, -self.heading)
    }

    /// Pose of `other` seen from here: self⁻¹ ⊕ other.
    pub fn between(self, other: Self) -> Self {
        let (sin, cos) = sin_cos(self.heading);
        let (dx, dy) = (other.x - self.x, other.y - self.y);
        Self::new(cos * dx + sin * dy, cos * dy - sin * dx, other.heading - self.heading)
    }

    /// `point` of the inner frame in the outer frame.
    #[inline]
    pub fn transform(self, point: Point2) -> Point2 {
        let (sin, cos) = sin_cos(self.heading);
        let facing = point.facing.turned(self.heading);
        Point2 { x: self.x + cos * point.x - sin * point.y, y: self.y + sin * point.x + cos * point.y, facing }
    }

    /// Where it is, without the heading.
    pub const fn position(self) -> Point2 {
        Point2::new(self.x, self.y)
    }

    /// True if all three numbers are finite.
    pub fn is_finite(self) -> bool {
        self.x.is_finite() && self.y.is_finite() && self.heading.is_finite()
    }
}

impl Mul for Pose2 {
    type Output = Self;
    #[allow(clippy::suspicious_arithmetic_impl, reason = "headings add when transforms compose")]
    /// Composition: `a_from_b * b_from_c` is `a_from_c`.
    fn mul(self, inner: Self) -> Self {
        let Point2 { x, y, .. } = self.transform(inner.position());
        Self::new(x, y, self.heading + inner.heading)
    }
}

impl Layout for Pose2 {
    const LAYOUT: u32 = layout_with(NO_LAYOUT, "x, y, heading: f32");
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f32::consts::PI;
    use proptest::prelude::*;

    fn pose() -> impl Strategy<Value = Pose2> {
        (-50.0..50.0_f32, -50.0..50.0_f32, -PI..PI).prop_map(|(x, y, h)| Pose2::new(x, y, h))
    }

    fn close(a: Pose2, b: Pose2) -> bool {
        (a.position() - b.position()).norm() < 1e-4 && wrap_angle(a.heading - b.heading).abs() < 2e-6
    }

    proptest! {
        #[test]
        fn composition_is_associative(a in pose(), b in pose(), c in pose()) {
            prop_assert!(close((a * b) * c, a * (b * c)));
        }

        #[test]
        fn inverse_undoes(a in pose()) {
            prop_assert!(close(a * a.inverse(), Pose2::IDENTITY));
            prop_assert!(close(a.inverse() * a, Pose2::IDENTITY));
        }

        #[test]
        fn between_is_inverse_composed(a in pose(), b in pose()) {
            prop_assert!(close(a.between(b), a.inverse() * b));
            prop_assert!(close(a * a.between(b), b));
        }

        #[test]
        fn transform_is_an_action(a in pose(), b in pose(), x in -50.0..50.0_f32, y in -50.0..50.0_f32) {
            let p = Point2::new(x, y);
            prop_assert!(((a * b).transform(p) - a.transform(b.transform(p))).norm() < 2e-4);
        }
    }

    #[test]
    fn quarter_turn_sends_forward_to_left() {
        let p = Pose2::new(1.0, 2.0, PI / 2.0).transform(Point2::new(3.0, 0.0));
        assert!((p.x - 1.0).abs() < 1e-6 && (p.y - 5.0).abs() < 1e-6);
    }
}
