//! Planes in a cloud: floor, ceiling, walls, and how well the points lie on them.
//!
//! RANSAC finds them one after the other (three points, counted support, its points are taken out), then least squares settles
//! all together (smallest axis of the covariance of each one's points). Source: Fischler & Bolles 1981. Seeded: the same cloud
//! gives the same planes.

use lrfslam_core::random::RandomStream;
use nalgebra::{Matrix3, Point3, SymmetricEigen, Unit, UnitVector3, Vector3};
use rand_core::Rng as _;
use serde::Serialize;

/// How planes are looked for.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PlaneConfig {
    /// A point this near to a plane belongs to it, m. Several times the laser's noise, so that the fit's RMS is not cut off.
    pub inlier_m: f64,
    /// A plane has at least this share of all points.
    pub share_min: f64,
    /// At most so many planes.
    pub planes_max: usize,
    /// Triples of points tried for each plane.
    pub trials: u32,
    /// Of the draws.
    pub seed: u64,
}

impl Default for PlaneConfig {
    fn default() -> Self {
        Self { inlier_m: 0.06, share_min: 0.02, planes_max: 8, trials: 2000, seed: 1 }
    }
}

/// All points p with normal · p = offset.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane {
    /// Unit length.
    pub normal: UnitVector3<f64>,
    /// m.
    pub offset_m: f64,
}

impl Plane {
    /// Distance of `point` from the plane, m; positive on the normal's side.
    pub fn distance_m(&self, point: &Point3<f64>) -> f64 {
        self.normal.dot(&point.coords) - self.offset_m
    }

    /// The plane through three points; `None` if they are in line.
    fn through(a: &Point3<f64>, b: &Point3<f64>, c: &Point3<f64>) -> Option<Self> {
        let normal = Unit::try_new((b - a).cross(&(c - a)), 1e-6)?;
        Some(Self { normal, offset_m: normal.dot(&a.coords) })
    }

    /// The plane of least squares through `points`; `None` if they do not span one.
    fn fitted(points: &[Point3<f64>]) -> Option<Self> {
        if points.len() < 3 {
            return None;
        }
        let count = points.len() as f64;
        let centre = points.iter().map(|point| point.coords).sum::<Vector3<f64>>() / count;
        let spread = |point: &Point3<f64>| (point.coords - centre) * (point.coords - centre).transpose();
        let eigen = SymmetricEigen::new(points.iter().map(spread).sum::<Matrix3<f64>>() / count);
        let normal = Unit::try_new(eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned(), 1e-9)?;
        Some(Self { normal, offset_m: normal.dot(&centre) })
    }

    /// The same plane, its normal on `up`'s side.
    fn towards(self, up: &Vector3<f64>) -> Self {
        if self.normal.dot(up) < 0.0 { Self { normal: -self.normal, offset_m: -self.offset_m } } else { self }
    }
}

/// A plane and how well its points lie on it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlaneFit {
    /// Normal towards the origin (the laser).
    pub plane: Plane,
    /// Points on it.
    pub points: usize,
    /// Root of their mean square distance from it, m.
    pub rms_m: f64,
}

/// The planes of `points`, the one with most points first; normals point to the origin's side.
///
/// Where planes meet, a point belongs to the nearest one: the foot of a wall is no part of the floor.
pub fn find_planes(points: &[Point3<f64>], config: &PlaneConfig) -> Vec<PlaneFit> {
    let mut rng = RandomStream::new(config.seed, 0, 0);
    let (mut left, mut found) = (points.to_vec(), Vec::new());
    while found.len() < config.planes_max {
        let Some(plane) = best_plane(&left, config, &mut rng) else { break };
        let on_it = |point: &Point3<f64>| plane.distance_m(point).abs() <= config.inlier_m;
        let before = left.len();
        left.retain(|point| !on_it(point));
        if ((before - left.len()) as f64) < config.share_min * points.len() as f64 {
            break;
        }
        found.push(plane);
    }
    refine(points, &found, config.inlier_m)
}

/// The planes again, fitted to the points of `points` that are nearer to them than to any other; the largest first.
pub fn refine(points: &[Point3<f64>], planes: &[Plane], inlier_m: f64) -> Vec<PlaneFit> {
    const ROUNDS: usize = 5;
    let mut planes = planes.to_vec();
    for _ in 0..ROUNDS {
        let fitted = shares(points, &planes, inlier_m).into_iter().map(|share| Plane::fitted(&share));
        planes = fitted.flatten().collect();
    }
    let shares = shares(points, &planes, inlier_m);
    let fit = |(plane, share): (&Plane, &Vec<Point3<f64>>)| {
        let squares: f64 = share.iter().map(|point| plane.distance_m(point).powi(2)).sum();
        let plane = plane.towards(&(-plane.offset_m * plane.normal.into_inner()));
        PlaneFit { plane, points: share.len(), rms_m: (squares / share.len().max(1) as f64).sqrt() }
    };
    let mut fits: Vec<PlaneFit> = planes.iter().zip(&shares).map(fit).collect();
    fits.sort_by_key(|fit| std::cmp::Reverse(fit.points));
    fits
}

/// For each plane the points that are nearer to it than to any other, and near enough.
fn shares(points: &[Point3<f64>], planes: &[Plane], inlier_m: f64) -> Vec<Vec<Point3<f64>>> {
    let mut shares = vec![Vec::new(); planes.len()];
    for point in points {
        let distances = planes.iter().map(|plane| plane.distance_m(point).abs()).enumerate();
        let nearest = distances.min_by(|a, b| a.1.total_cmp(&b.1)).filter(|&(_, distance)| distance <= inlier_m);
        if let Some((index, _)) = nearest {
            shares[index].push(*point);
        }
    }
    shares
}

/// The floor among planes seen from the laser at the origin: the largest that is level to within 20° and below; its normal
/// points up.
pub fn floor_of(planes: &[PlaneFit]) -> Option<PlaneFit> {
    let upright = 20_f64.to_radians().cos();
    planes.iter().find(|fit| fit.plane.normal.z > upright && fit.plane.offset_m < 0.0).copied()
}

/// The plane with most points among `config.trials` proposals.
fn best_plane(points: &[Point3<f64>], config: &PlaneConfig, rng: &mut RandomStream) -> Option<Plane> {
    let mut best: Option<(usize, Plane)> = None;
    for _ in 0..config.trials {
        let [a, b, c] = [draw(points, rng)?, draw(points, rng)?, draw(points, rng)?];
        let Some(plane) = Plane::through(a, b, c) else { continue };
        let support = points.iter().filter(|point| plane.distance_m(point).abs() <= config.inlier_m).count();
        if best.is_none_or(|(most, _)| support > most) {
            best = Some((support, plane));
        }
    }
    best.map(|(_, plane)| plane)
}

fn draw<'p>(points: &'p [Point3<f64>], rng: &mut RandomStream) -> Option<&'p Point3<f64>> {
    points.get(((u64::from(rng.next_u32()) * points.len() as u64) >> 32) as usize)
}

#[cfg(test)]
mod tests {
    use super::*;
    use lrfslam_core::math::{normal, uniform};

    /// A floor 1 m below, a wall 3 m ahead, both with 1 cm of noise, and clutter.
    fn room() -> Vec<Point3<f64>> {
        let mut rng = RandomStream::new(4, 0, 0);
        let mut number = |scale: f32| f64::from(scale * (2.0 * uniform(&mut rng) - 1.0));
        let mut points: Vec<Point3<f64>> = (0..4000).map(|_| Point3::new(number(3.0), number(3.0), -1.0)).collect();
        points.extend((0..2000).map(|_| Point3::new(3.0, number(3.0), number(1.0))));
        let mut rng = RandomStream::new(5, 0, 0);
        for point in &mut points {
            let noise = 0.01 * f64::from(normal(&mut rng));
            if point.z == -1.0 { point.z += noise } else { point.x += noise }
        }
        let mut number = || f64::from(2.0 * uniform(&mut rng) - 1.0);
        points.extend((0..1500).map(|_| Point3::new(2.0 * number(), 2.0 * number(), number())));
        points
    }

    #[test]
    fn floor_and_wall_are_found_among_clutter_to_the_millimetre() {
        let planes = find_planes(&room(), &PlaneConfig { share_min: 0.1, ..PlaneConfig::default() });
        assert_eq!(planes.len(), 2, "{planes:?}");
        let (floor, wall) = (planes[0].plane, planes[1].plane);
        assert!(floor.normal.z > 0.99999 && (floor.offset_m + 1.0).abs() < 2e-3, "{floor:?}");
        assert!(wall.normal.x < -0.9999 && (wall.offset_m + 3.0).abs() < 5e-3, "{wall:?}");
        assert!(planes[0].rms_m > 0.008 && planes[0].rms_m < 0.015 && planes[0].points > 3900, "{planes:?}");
    }

    #[test]
    fn the_foot_of_a_wall_is_no_part_of_the_floor() {
        let mut points = room();
        points.extend(room().iter().filter(|p| p.x > 2.9).flat_map(|p| [*p, *p, *p]));
        let planes = find_planes(&points, &PlaneConfig { share_min: 0.1, ..PlaneConfig::default() });
        assert!(planes[0].plane.normal.x < -0.999, "the wall is larger: {planes:?}");
        let floor = floor_of(&planes).unwrap();
        assert!(floor.plane.normal.z > 0.99999 && (floor.plane.offset_m + 1.0).abs() < 1e-3, "{floor:?}");
    }

    #[test]
    fn no_plane_is_no_plane() {
        let config = PlaneConfig::default();
        assert!(find_planes(&[], &config).is_empty());
        let line: Vec<Point3<f64>> = (0..50).map(|i| Point3::new(f64::from(i), 0.0, -1.0)).collect();
        assert!(find_planes(&line, &config).is_empty() && floor_of(&[]).is_none());
    }
}
