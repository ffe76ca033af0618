//! A particle that comes back to old ground is matched against its own map there (Grisetti, Stachniss & Burgard 2007), and weighed by it.
//!
//! Rays that end near → those whose end lies on old ground → a climb of the pose, within a small reach → pose and
//! evidence. On new ground nothing happens: what the last scans have seen, matching has used up already, and weights that
//! come of it would only use up the particles' variety before the loop closes.
//!
//! Departures from the source: the climb stays where it is unless the map says clearly something else, since squares are coarser than the matcher's
//! cells. A particle's weight is that of the pose found, without the integral over its neighbourhood.

use crate::distributed_map::MapView;
use crate::geometry::{Point2, Pose2};
use crate::grid::Occupancy;
use crate::math::{exp_neg, floor, sin_cos};
use crate::rays::Ray;

/// Rays that are looked at, at most; cost is in proportion.
const RAYS_MAX: usize = 256;
/// Every so many rays are looked at where there are few: neighbours see the same.
const RAY_STEP: usize = 2;
/// Longer rays are left out, m: old walls have been seen by few scans from far away, and a heading's error moves their ends by decimetres. Chosen.
const LENGTH_MAX_M: f32 = 8.0;
/// How far before its end a ray is looked at besides, m: the end may lie behind an old wall, where nothing was seen.
const BEFORE_END_M: f32 = 0.3;
/// Fewer rays on old ground say nothing …
const OLD_RAYS_MIN: usize = 10;
/// … and neither does a smaller share of them. Chosen: before, the old walls in sight are few and alike, as those of a corridor are.
const OLD_SHARE_MIN: f32 = 0.4;
/// σ of a ray's end about the nearest occupied square, m: the square's size, the laser's noise and what the map is off. Chosen.
const SIGMA_M: f32 = 0.15;
/// Occupied squares are looked for so far from a ray's end, m.
const NEAR_M: f32 = 0.2;
/// Least likelihood of a ray, so that what has changed since cannot kill a particle: that of [`perception`](crate::perception).
const FLOOR: f32 = 0.3;
/// So much of a ray is evidence of its own: neighbours see the same wall, and share the map's errors. Chosen …
const GAIN: f32 = 0.3;
/// … and no scan is worth more rays than this.
const EVIDENCE_RAYS_MAX: f32 = 90.0;
/// The climb goes no farther from where the particle was, m and rad. Chosen.
const REACH: (f32, f32) = (0.3, 0.035);
/// σ of the departure from there, m and rad, at a weight of one ray. Chosen.
const DEPARTURE: (f32, f32) = (0.05, 0.0087);
/// A pose nearer than this, m and rad, is not better than the matcher's: less than a square. Chosen.
const DEAD_BAND: (f32, f32) = (0.03, 0.0044);
/// Steps of the climb, m and rad: the first …
const STEP: (f32, f32) = (0.1, 0.02);
/// … and below this, m, it ends.
const STEP_MIN_M: f32 = 0.01;

/// What lies so far from the end of a ray is looked at, m.
pub(super) const REACH_M: f32 = REACH.0 + LENGTH_MAX_M * REACH.1 + NEAR_M;

type OldRays = heapless::Vec<Ray, RAYS_MAX>;

/// What old ground says of a particle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Placed {
    pub(super) map_from_robot: Pose2,
    /// Logarithm of the scan's likelihood there.
    pub(super) log_likelihood: f32,
}

/// One particle's map and the scan.
#[derive(Debug, Clone, Copy)]
pub(super) struct OldGround<'a, 'm, const SIDE: usize> {
    pub(super) view: MapView<'a, 'm, SIDE>,
    /// All rays of the scan, lrf frame.
    pub(super) rays: &'a [Ray],
    pub(super) particle_from_lrf: Pose2,
    pub(super) square_size_m: f32,
}

impl<const SIDE: usize> OldGround<'_, '_, SIDE> {
    /// Where the scan lies in the particle's own map, near `map_from_robot`; `None` on new ground, and for a pose that is not finite.
    pub(super) fn place(&self, map_from_robot: Pose2) -> Option<Placed> {
        let rays = self.old_rays(map_from_robot).filter(|_| map_from_robot.is_finite())?;
        let found = self.climb(map_from_robot, &rays);
        let off = map_from_robot.between(found);
        let is_same = off.position().norm() < DEAD_BAND.0 && off.heading.abs() < DEAD_BAND.1;
        let map_from_robot = if is_same { map_from_robot } else { found };
        let mut sum = 0.0;
        self.for_each_fit(map_from_robot, &rays, |fit| sum += libm::logf(FLOOR + (1.0 - FLOOR) * fit));
        let count = rays.len() as f32;
        Some(Placed { map_from_robot, log_likelihood: GAIN * sum * (EVIDENCE_RAYS_MAX / count).min(1.0) })
    }

    /// The rays whose ends lie on old ground, if they are many enough.
    fn old_rays(&self, map_from_robot: Pose2) -> Option<OldRays> {
        let step = RAY_STEP.max(self.rays.len().div_ceil(RAYS_MAX));
        let near = self.rays.iter().step_by(step).filter(|ray| ray.hit && ray.length_m <= LENGTH_MAX_M);
        let (mut old, mut looked_at) = (OldRays::new(), 0_usize);
        let place = self.seen_from(map_from_robot);
        for ray in near {
            looked_at += 1;
            let is_old = [0.0, BEFORE_END_M].iter().any(|before_m| {
                let at = place(ray, ray.length_m - before_m);
                self.view.is_old(floor(at.x), floor(at.y))
            });
            // There is room for as many as are looked at.
            let _ = if is_old { old.push(*ray) } else { Ok(()) };
        }
        let is_enough = old.len() >= OLD_RAYS_MIN && old.len() as f32 >= OLD_SHARE_MIN * looked_at as f32;
        is_enough.then_some(old)
    }

    /// Tells where a ray is after some metres, in squares from the window's corner.
    fn seen_from(&self, map_from_robot: Pose2) -> impl Fn(&Ray, f32) -> Point2 {
        let map_from_lrf = map_from_robot * self.particle_from_lrf;
        let start = self.view.to_squares(map_from_lrf.position());
        let (sin, cos) = sin_cos(map_from_lrf.heading);
        let squares_per_metre = 1.0 / self.square_size_m;
        move |ray, length_m| {
            let Point2 { x, y, .. } = ray.direction;
            let direction = Point2::new(cos * x - sin * y, sin * x + cos * y);
            start + direction * (length_m * squares_per_metre)
        }
    }

    /// Climbs to the pose at which most rays end near occupied squares: along each axis in turn, in steps that are halved.
    fn climb(&self, start: Pose2, rays: &[Ray]) -> Pose2 {
        let mut best = (start, self.score(start, start, rays));
        let (mut step_m, mut step_rad) = STEP;
        while step_m > STEP_MIN_M {
            let before = best.1;
            for (axis, sign) in [(0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0), (2, 1.0), (2, -1.0)] {
                let Pose2 { x, y, heading } = best.0;
                let next = match axis {
                    0 => Pose2 { x: x + sign * step_m, y, heading },
                    1 => Pose2 { x, y: y + sign * step_m, heading },
                    _ => Pose2::new(x, y, heading + sign * step_rad),
                };
                let off = start.between(next);
                if off.position().norm() > REACH.0 || off.heading.abs() > REACH.1 {
                    continue;
                }
                let score = self.score(start, next, rays);
                best = if score > best.1 { (next, score) } else { best };
            }
            if best.1 <= before {
                (step_m, step_rad) = (0.5 * step_m, 0.5 * step_rad);
            }
        }
        best.0
    }

    fn score(&self, start: Pose2, pose: Pose2, rays: &[Ray]) -> f32 {
        let off = start.between(pose);
        let (far, turned) = (off.position().norm() / DEPARTURE.0, off.heading / DEPARTURE.1);
        let mut sum = -0.5 * (far * far + turned * turned);
        self.for_each_fit(pose, rays, |fit| sum += fit);
        sum
    }

    /// Calls `add` for every ray with how near its end is to an occupied square: 1 in its middle, 0 if there is none near.
    fn for_each_fit(&self, map_from_robot: Pose2, rays: &[Ray], mut add: impl FnMut(f32)) {
        let place = self.seen_from(map_from_robot);
        let reach = floor(NEAR_M / self.square_size_m).clamp(1, 8);
        let sigma = SIGMA_M / self.square_size_m;
        for ray in rays {
            let end = place(ray, ray.length_m);
            let (column, row) = (floor(end.x), floor(end.y));
            let mut nearest = f32::INFINITY;
            for y in row - reach..=row + reach {
                for x in column - reach..=column + reach {
                    if self.view.square(x, y).occupancy() == Occupancy::Occupied {
                        let (dx, dy) = (x as f32 + 0.5 - end.x, y as f32 + 0.5 - end.y);
                        nearest = nearest.min(dx * dx + dy * dy);
                    }
                }
            }
            add(if nearest.is_finite() { exp_neg(-0.5 * nearest / (sigma * sigma)) } else { 0.0 });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ancestry::{Ancestry, Node, NodeId};
    use crate::distributed_map::{
        DistributedMap, MapMemory, ParticleMapConfig, Print, Tile, TileAge, TileHeader, TileId, Window, WindowFrame,
    };
    use crate::scan::Echo;
    use crate::test_world::World;
    use rand_pcg::Pcg32;
    use rand_pcg::rand_core::SeedableRng;
    use std::vec;
    use std::vec::Vec;

    const SIDE: usize = 8;
    const SIZE: f32 = 0.1;

    /// A room drawn from its middle, and the ways until it was and until it is looked at again, m.
    fn placed(drawn_m: f32, seen_m: f32, robot: Pose2, believed: Pose2) -> Option<Placed> {
        let mut rng = Pcg32::seed_from_u64(5);
        let mut rays_at = |pose: Pose2| -> Vec<Ray> {
            let beams = World::room().scan(pose, 8.0, 0.01, &mut rng);
            let ray = |bearing: f32, echo| match echo {
                Echo::Hit(length_m) => {
                    let (sin, cos) = sin_cos(bearing);
                    Some(Ray { direction: Point2::new(cos, sin), length_m, hit: true })
                }
                _ => None,
            };
            beams.iter().filter_map(|beam| ray(beam.bearing_rad, beam.echo)).collect()
        };
        let (mut tiles, mut headers) = (vec![Tile::<SIDE>::UNSEEN; 900], vec![TileHeader::default(); 900]);
        let (mut node_tiles, mut directory) = ([TileId::NONE; 4], vec![TileId::NONE; 1024]);
        let (mut ages, mut nodes) = (vec![TileAge::NEW; 900], [Node::default(); 4]);
        let mut slots = vec![TileId::NONE; 32 * 32];
        let memory = MapMemory {
            tiles: &mut tiles,
            headers: &mut headers,
            node_tiles: &mut node_tiles,
            directory: &mut directory,
            ages: &mut ages,
        };
        let tree = Ancestry::new(&mut nodes).unwrap();
        let mut map = DistributedMap::new(&ParticleMapConfig { square_size_m: SIZE, print_step: 1 }, memory).unwrap();
        let mut window = Window::new(&mut slots).unwrap();
        let frame = WindowFrame::around(Point2::new(-9.0, -9.0), Point2::new(9.0, 9.0), 32, SIZE * SIDE as f32);
        window.open(&map, &tree, frame, NodeId::ROOT);
        map.pass(drawn_m);
        for turn in 0..8 {
            let pose = Pose2::new(0.05 * turn as f32, 0.0, 0.8 * turn as f32);
            Print::new(&rays_at(pose), pose).run(&mut map, &mut window).unwrap();
        }
        map.pass(seen_m);
        let rays = rays_at(robot);
        let view = MapView::new(&map, &window);
        OldGround { view, rays: &rays, particle_from_lrf: Pose2::IDENTITY, square_size_m: SIZE }.place(believed)
    }

    #[test]
    fn a_particle_that_comes_back_is_moved_to_where_its_map_fits() {
        let robot = Pose2::new(0.3, -0.2, 0.4);
        let believed = robot * Pose2::new(0.15, -0.12, 0.02);
        let there = placed(1.0, 40.0, robot, believed).unwrap();
        let error = robot.between(there.map_from_robot);
        assert!(error.position().norm() < 0.11 && error.heading.abs() < 0.02, "a square, of 0.19 m: {error:?}");
        assert!(there.log_likelihood < 0.0 && there.log_likelihood > -15.0, "{there:?}");
    }

    #[test]
    fn one_that_is_too_far_off_is_left_behind_by_its_weight() {
        let robot = Pose2::new(0.3, -0.2, 0.4);
        let near = placed(1.0, 40.0, robot, robot).unwrap();
        let far = placed(1.0, 40.0, robot, robot * Pose2::new(1.0, 0.8, 0.1)).unwrap();
        assert!(near.log_likelihood > far.log_likelihood + 5.0, "{near:?} {far:?}");
        assert!(robot.between(near.map_from_robot).position().norm() < 0.08, "{near:?}");
    }

    #[test]
    fn new_ground_says_nothing() {
        let robot = Pose2::new(0.3, -0.2, 0.4);
        assert_eq!(placed(30.0, 40.0, robot, robot), None);
        assert_eq!(placed(1.0, 40.0, robot, Pose2 { x: f32::NAN, ..robot }), None);
    }
}
