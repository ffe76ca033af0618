//! The element that every world is made of.

use nalgebra::Vector3;

/// A point or direction in the world's frame: x and y span the floor, z is up; m.
pub type Vector = Vector3<f64>;

/// How far outside its sides a rectangle still stops a ray, as a part of the side: no ray slips through between neighbours.
const SEAM: f64 = 1e-9;
/// How far four corners may be from a rectangle, m.
const FLATNESS_M: f64 = 1e-4;

/// A flat piece of the world, both of its sides alike.
///
/// Source: thesis, eq. (4.38)–(4.39): the plane n·(x − a) = 0 with n = (b − a) × (c − a).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rectangle {
    corner: Vector,
    side_u: Vector,
    side_v: Vector,
    normal: Vector,
    /// Sides over their squared lengths: dot products with them run from 0 to 1 over the rectangle.
    along_u: Vector,
    along_v: Vector,
}

/// A ray from a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray {
    /// Where it starts, m.
    pub from: Vector,
    /// Where it goes, length 1.
    pub direction: Vector,
}

impl Ray {
    /// The point at `range_m`.
    pub fn at(&self, range_m: f64) -> Vector {
        self.from + self.direction * range_m
    }
}

impl Rectangle {
    /// The rectangle between `corner` and the far ends of two sides; `None` if a side has no length, the sides are not square to
    /// each other, or a number is not finite.
    pub fn new(corner: Vector, side_u: Vector, side_v: Vector) -> Option<Self> {
        let (length_u, length_v) = (side_u.norm(), side_v.norm());
        let finite = corner.iter().all(|x| x.is_finite()) && (length_u * length_v).is_finite();
        let lean_m = side_u.dot(&side_v).abs() / length_u.max(length_v);
        if !finite || length_u.min(length_v) <= FLATNESS_M || lean_m > FLATNESS_M {
            return None;
        }
        Some(Self {
            corner,
            side_u,
            side_v,
            normal: side_u.cross(&side_v),
            along_u: side_u / side_u.norm_squared(),
            along_v: side_v / side_v.norm_squared(),
        })
    }

    /// The rectangle with these corners, in order round it; `None` if they are none, to a tenth of a millimetre.
    pub fn from_corners([a, b, c, d]: [Vector; 4]) -> Option<Self> {
        let closes = (b + d - a - c).norm() <= FLATNESS_M;
        if closes { Self::new(a, b - a, d - a) } else { None }
    }

    /// Its corners, in order round it.
    pub fn corners(&self) -> [Vector; 4] {
        let (b, d) = (self.corner + self.side_u, self.corner + self.side_v);
        [self.corner, b, b + self.side_v, d]
    }

    /// Distance along `ray` to where it meets the rectangle, m; `None` if it does not, or runs within its plane.
    ///
    /// Source: thesis, eq. (4.40)–(4.41), solved for the distance.
    #[inline]
    pub fn range_m(&self, ray: &Ray) -> Option<f64> {
        let range_m = self.normal.dot(&(self.corner - ray.from)) / self.normal.dot(&ray.direction);
        // Also false for NaN, from a ray within the plane.
        if !(range_m > 0.0 && range_m < f64::INFINITY) {
            return None;
        }
        let offset = ray.at(range_m) - self.corner;
        let within = |along: &Vector| (-SEAM..=1.0 + SEAM).contains(&along.dot(&offset));
        (within(&self.along_u) && within(&self.along_v)).then_some(range_m)
    }

    /// Distance from `point` to the nearest point of the rectangle, m.
    pub fn distance_m(&self, point: &Vector) -> f64 {
        let offset = point - self.corner;
        let (u, v) = (self.along_u.dot(&offset).clamp(0.0, 1.0), self.along_v.dot(&offset).clamp(0.0, 1.0));
        (offset - self.side_u * u - self.side_v * v).norm()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wall() -> Rectangle {
        Rectangle::new(Vector::new(2.0, -1.0, 0.0), Vector::new(0.0, 2.0, 0.0), Vector::new(0.0, 0.0, 2.5)).unwrap()
    }

    #[test]
    fn rays_stop_at_the_wall_and_only_there() {
        let range = |direction: Vector| {
            wall().range_m(&Ray { from: Vector::new(0.0, 0.0, 1.0), direction: direction.normalize() })
        };
        assert_eq!(range(Vector::x()), Some(2.0));
        assert!((range(Vector::new(1.0, 0.4, 0.0)).unwrap() - 2.0 * 1.16_f64.sqrt()).abs() < 1e-12);
        assert_eq!(range(Vector::new(1.0, 0.6, 0.0)), None, "past its end");
        assert_eq!(range(-Vector::x()), None, "behind");
        assert_eq!(range(Vector::y()), None, "along it");
        assert_eq!(range(Vector::new(1.0, 0.0, 1.0)), None, "over it");
    }

    #[test]
    fn ray_within_the_plane_meets_nothing() {
        let ray = Ray { from: Vector::new(2.0, -3.0, 1.0), direction: Vector::y() };
        assert_eq!(wall().range_m(&ray), None);
    }

    #[test]
    fn distance_is_to_face_edge_or_corner() {
        let distance = |x, y, z| wall().distance_m(&Vector::new(x, y, z));
        assert_eq!(distance(1.5, 0.0, 1.0), 0.5);
        assert!((distance(2.0, 1.3, 1.0) - 0.3).abs() < 1e-12);
        assert!((distance(2.0, 4.0, 6.5) - 5.0).abs() < 1e-12);
    }

    #[test]
    fn corners_that_are_no_rectangle_are_refused() {
        let square = wall().corners();
        assert_eq!(Rectangle::from_corners(square), Some(wall()));
        let mut bent = square;
        bent[2].x += 0.01;
        assert_eq!(Rectangle::from_corners(bent), None);
        let lean = Vector::new(0.0, 0.3, 2.5);
        assert_eq!(Rectangle::new(square[0], Vector::new(0.0, 2.0, 0.0), lean), None);
        assert_eq!(Rectangle::new(square[0], Vector::zeros(), lean), None);
        assert_eq!(Rectangle::new(Vector::new(f64::NAN, 0.0, 0.0), Vector::x(), Vector::y()), None);
    }
}
