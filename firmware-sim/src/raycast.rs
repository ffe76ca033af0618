//! Rays against many rectangles: a tree of boxes finds the few that a ray may meet.
//!
//! The tree is parry's, in single precision, with every box a little larger than what is in it; the rectangles in them are met
//! in double precision. So the answer is the same, to the last bit, as that of [`World::range_m`], which looks at all.

use std::cell::Cell;

use parry3d::bounding_volume::Aabb;
use parry3d::math::Vector as Vector32;
use parry3d::partitioning::{Bvh, BvhBuildStrategy};
use parry3d::query::Ray as Ray32;

use crate::world::{Ray, Rectangle, Vector, World};

/// By how much boxes are larger than what is in them, m.
///
/// More than single precision loses over 1 km. And walls, which are flat, get a volume: parry's builders weigh the volume of
/// boxes, and make a poor tree where all are zero.
const MARGIN_M: f32 = 0.02;

/// A world, ready for rays.
#[derive(Debug)]
pub struct RayCaster {
    rectangles: Vec<Rectangle>,
    reflects: Vec<bool>,
    tree: Bvh,
}

impl RayCaster {
    /// Builds the tree.
    pub fn new(world: &World) -> Self {
        let (rectangles, reflects) = (world.rectangles().to_vec(), world.reflectors().to_vec());
        let boxes: Vec<Aabb> = rectangles.iter().map(box_round).collect();
        Self { rectangles, reflects, tree: Bvh::from_leaves(BvhBuildStrategy::Binned, &boxes) }
    }

    /// Distance along `ray` to the nearest rectangle up to `range_max_m`, m.
    pub fn range_m(&self, ray: &Ray, range_max_m: f64) -> Option<f64> {
        self.nearest(ray, range_max_m).map(|(range_m, _)| range_m)
    }

    /// Distance along `ray` to the nearest rectangle up to `range_max_m`, m, if that is a reflector.
    pub fn reflector_m(&self, ray: &Ray, range_max_m: f64) -> Option<f64> {
        let (range_m, index) = self.nearest(ray, range_max_m)?;
        self.reflects.get(index).is_some_and(|reflects| *reflects).then_some(range_m)
    }

    fn nearest(&self, ray: &Ray, range_max_m: f64) -> Option<(f64, usize)> {
        let nearest = Cell::new((f64::INFINITY, 0));
        let single = Ray32::new(to_single(&ray.from), to_single(&ray.direction));
        self.tree.cast_ray(&single, range_max_m as f32 + MARGIN_M, |index, _| {
            let range_m = self.rectangles[index as usize].range_m(ray)?;
            if range_m < nearest.get().0 {
                nearest.set((range_m, index as usize));
            }
            // Rounded up, so that what is nearer by less than single precision tells is still looked at.
            Some(range_m as f32 + MARGIN_M)
        });
        Some(nearest.get()).filter(|(range_m, _)| *range_m <= range_max_m)
    }
}

fn to_single(vector: &Vector) -> Vector32 {
    Vector32::new(vector.x as f32, vector.y as f32, vector.z as f32)
}

fn box_round(rectangle: &Rectangle) -> Aabb {
    let corners = rectangle.corners().map(|corner| to_single(&corner));
    let (low, high) =
        corners.iter().fold((corners[0], corners[0]), |(low, high), corner| (low.min(*corner), high.max(*corner)));
    let margin = Vector32::splat(MARGIN_M);
    Aabb::new(low - margin, high + margin)
}
