//! People: boxes that walk.

use lrfslam_core::time::Instant;
use serde::Deserialize;

use crate::world::building::{PartFault, Place, check};
use crate::world::{Ray, Vector};

/// Somebody in a world file.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PersonPlan {
    /// Corners of the way, walked there and back, for ever, m.
    pub way: Vec<Place>,
    /// m/s.
    #[serde(default = "usual_speed")]
    pub speed_mps: f64,
    /// From front to back, from left to right, from the floor to the head, m.
    #[serde(default = "usual_size")]
    pub size_m: [f64; 3],
    /// How far along the way at the start, m.
    #[serde(default)]
    pub start_m: f64,
}

fn usual_speed() -> f64 {
    1.2
}

fn usual_size() -> [f64; 3] {
    [0.3, 0.5, 1.75]
}

/// Somebody who walks there and back.
#[derive(Debug, Clone)]
pub struct Person {
    plan: PersonPlan,
    /// Distance from the way's start to each corner, m.
    distances_m: Vec<f64>,
}

impl Person {
    /// Somebody with a way.
    ///
    /// # Errors
    /// If a value makes no person.
    pub fn new(plan: &PersonPlan) -> Result<Self, PartFault> {
        let lengths: Vec<f64> = plan.way.windows(2).map(|p| (p[1][0] - p[0][0]).hypot(p[1][1] - p[0][1])).collect();
        let apart = !lengths.is_empty() && lengths.iter().all(|length| *length > 1e-3 && length.is_finite());
        check(apart, "way", "at least two corners that differ from their neighbours")?;
        check(plan.speed_mps >= 0.0 && plan.speed_mps.is_finite(), "speed_mps", "a speed, or 0")?;
        check(plan.size_m.iter().all(|side| *side > 0.0), "size_m", "three positive lengths")?;
        check(plan.start_m.is_finite(), "start_m", "a length")?;
        let sum = |sum: &mut f64, length: f64| {
            *sum += length;
            Some(*sum)
        };
        let distances_m = std::iter::once(0.0).chain(lengths.into_iter().scan(0.0, sum)).collect();
        Ok(Self { plan: plan.clone(), distances_m })
    }

    /// Middle of the feet, m, and the direction of the way there, length 1.
    fn stands(&self, at: Instant) -> (Place, Place) {
        let total = self.distances_m.last().copied().unwrap_or(0.0);
        let gone = (self.plan.start_m + self.plan.speed_mps * at.as_secs_f64()).rem_euclid(2.0 * total);
        let along = if gone > total { 2.0 * total - gone } else { gone };
        let next = self.distances_m.partition_point(|distance| *distance <= along).clamp(1, self.plan.way.len() - 1);
        let (from, to) = (self.plan.way[next - 1], self.plan.way[next]);
        let length = self.distances_m[next] - self.distances_m[next - 1];
        let direction = [(to[0] - from[0]) / length, (to[1] - from[1]) / length];
        let rest = along - self.distances_m[next - 1];
        ([from[0] + direction[0] * rest, from[1] + direction[1] * rest], direction)
    }

    /// Distance along `ray` to the person as they stand then, m; 0 from within.
    pub fn range_m(&self, at: Instant, ray: &Ray) -> Option<f64> {
        let ([x, y], [cos, sin]) = self.stands(at);
        let in_box = |v: Vector| Vector::new(cos * v.x + sin * v.y, cos * v.y - sin * v.x, v.z);
        let (from, direction) = (in_box(ray.from - Vector::new(x, y, 0.0)), in_box(ray.direction));
        let [depth, width, height] = self.plan.size_m;
        let sides = [[-depth / 2.0, depth / 2.0], [-width / 2.0, width / 2.0], [0.0, height]];
        let (mut enters, mut leaves) = (0.0_f64, f64::INFINITY);
        for (axis, [low, high]) in sides.into_iter().enumerate() {
            let (a, b) = ((low - from[axis]) / direction[axis], (high - from[axis]) / direction[axis]);
            // min and max pass over the NaN of a ray that runs within a face.
            enters = enters.max(a.min(b));
            leaves = leaves.min(a.max(b));
        }
        (enters <= leaves).then_some(enters)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn person() -> Person {
        let plan =
            PersonPlan { way: vec![[2.0, -2.0], [2.0, 2.0]], speed_mps: 1.0, size_m: usual_size(), start_m: 0.0 };
        Person::new(&plan).unwrap()
    }

    fn ahead(at_s: f64, z: f64) -> Option<f64> {
        let ray = Ray { from: Vector::new(0.0, 0.0, z), direction: Vector::x() };
        person().range_m(Instant::from_secs_f64(at_s), &ray)
    }

    #[test]
    fn person_crosses_the_ray_there_and_back() {
        assert_eq!(
            [ahead(1.0, 1.0), ahead(2.0, 1.0), ahead(3.0, 1.0), ahead(6.0, 1.0)],
            [None, Some(1.75), None, Some(1.75)]
        );
        assert_eq!(ahead(2.0, 1.9), None, "over the head");
    }

    #[test]
    fn people_turn_with_their_way() {
        let plan = PersonPlan { way: vec![[0.0, 0.0], [4.0, 0.0]], speed_mps: 0.0, size_m: usual_size(), start_m: 1.0 };
        let ray = Ray { from: Vector::new(0.0, 0.0, 1.0), direction: Vector::x() };
        let range = Person::new(&plan).unwrap().range_m(Instant::default(), &ray);
        assert!((range.unwrap() - 0.85).abs() < 1e-12);
    }
}
