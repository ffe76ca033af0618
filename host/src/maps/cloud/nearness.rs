//! How near two clouds come to each other: a judge that knows neither planes nor matching.

use std::collections::HashMap;

use nalgebra::{Isometry3, Point3};
use serde::Serialize;

/// Farther apart, two points have nothing to do with each other, m.
const REACH_M: f64 = 0.10;

/// Of the points of one cloud: how near the other cloud's nearest point is.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Nearness {
    /// Share of the points with a neighbour within 10 cm, 0 to 1.
    pub share: f64,
    /// Root of the mean square distance to it, of these points, m.
    pub rms_m: f64,
}

/// Looks for the nearest point of `target` to every point of `source`, once that is placed.
pub fn nearness(target: &[Point3<f64>], source: &[Point3<f64>], target_from_source: &Isometry3<f64>) -> Nearness {
    let cell = |point: &Point3<f64>| [point.x, point.y, point.z].map(|v| (v / REACH_M).floor() as i32);
    let mut cells: HashMap<[i32; 3], Vec<Point3<f64>>> = HashMap::new();
    for point in target {
        cells.entry(cell(point)).or_default().push(*point);
    }
    let nearest_squared = |point: &Point3<f64>| {
        let [x, y, z] = cell(point);
        let around = (-1..=1).flat_map(|i| (-1..=1).flat_map(move |j| (-1..=1).map(move |k| [x + i, y + j, z + k])));
        let squared = around.filter_map(|key| cells.get(&key)).flatten().map(|other| (other - point).norm_squared());
        squared.min_by(f64::total_cmp).filter(|&squared| squared <= REACH_M * REACH_M)
    };
    let squares: Vec<f64> = source.iter().filter_map(|point| nearest_squared(&(target_from_source * point))).collect();
    Nearness {
        share: squares.len() as f64 / source.len().max(1) as f64,
        rms_m: (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shifted_cloud_is_as_far_as_it_was_shifted() {
        let target: Vec<Point3<f64>> = (0..100).map(|i| Point3::new(f64::from(i), 0.0, -0.05)).collect();
        let by = |x: f64| nearness(&target, &target, &Isometry3::translation(x, 0.04, 0.0));
        assert!((by(0.03).rms_m - 0.05).abs() < 1e-12 && by(0.03).share == 1.0);
        assert_eq!(by(0.5), Nearness { share: 0.0, rms_m: 0.0 });
        assert_eq!(nearness(&target, &[], &Isometry3::identity()).share, 0.0);
    }
}
