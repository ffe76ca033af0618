//! A cloud with one point for each small cube of space that has any.

use std::collections::HashMap;

use nalgebra::{Point3, Vector3};

use super::CloudPoint;

/// Replaces the points of every cube of side `voxel_m` by their centre of gravity, under the time of the first.
///
/// Cubes come in the order of their first points, so that the result does not depend on anything but the input. A side that
/// is not positive keeps every point.
pub fn thin(points: &[CloudPoint], voxel_m: f32) -> Vec<CloudPoint> {
    if voxel_m.is_nan() || voxel_m <= 0.0 {
        return points.to_vec();
    }
    let mut places: HashMap<[i32; 3], usize> = HashMap::new();
    let mut cubes: Vec<Cube> = Vec::new();
    for point in points {
        // Saturates for points farther than 2³¹ cubes away.
        let key = [point.position.x, point.position.y, point.position.z].map(|v| (v / voxel_m).floor() as i32);
        let index = *places.entry(key).or_insert(cubes.len());
        if index == cubes.len() {
            cubes.push(Cube { first: *point, sum: Vector3::zeros(), count: 0 });
        }
        let cube = &mut cubes[index];
        cube.sum += (point.position - cube.first.position).cast();
        cube.count += 1;
    }
    cubes.iter().map(Cube::centre).collect()
}

struct Cube {
    first: CloudPoint,
    /// Of the offsets from the first point: small, so that no digits are lost far from the origin.
    sum: Vector3<f64>,
    count: u32,
}

impl Cube {
    fn centre(&self) -> CloudPoint {
        let position: Point3<f64> = self.first.position.cast() + self.sum / f64::from(self.count);
        CloudPoint { position: position.cast(), stamp: self.first.stamp }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lrfslam_core::time::Instant;

    fn point(x: f32, y: f32, z: f32, micros: i64) -> CloudPoint {
        CloudPoint { position: Point3::new(x, y, z), stamp: Instant::from_micros(micros) }
    }

    #[test]
    fn a_cube_keeps_one_point_at_the_centre_of_its_points() {
        let points = [point(0.01, 0.0, 0.0, 5), point(-0.01, 0.0, 0.0, 6), point(0.03, 0.02, 0.04, 7)];
        let thinned = thin(&points, 0.05);
        assert_eq!(thinned.len(), 2, "−0.01 lies in another cube");
        assert!((thinned[0].position - Point3::new(0.02, 0.01, 0.02)).norm() < 1e-6);
        assert_eq!((thinned[0].stamp.micros, thinned[1]), (5, points[1]));
        assert_eq!(thin(&points, 0.0), points);
        assert!(thin(&[], 0.1).is_empty());
    }
}
