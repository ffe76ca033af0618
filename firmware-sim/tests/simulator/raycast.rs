//! The tree of boxes against the oracle that looks at every rectangle: the same range, to the last bit.

use lrfslam_core::math::{normal, uniform};
use lrfslam_firmware_sim::raycast::RayCaster;
use lrfslam_firmware_sim::world::building::{Block, CurvedWall, Part};
use lrfslam_firmware_sim::world::wall::Room;
use lrfslam_firmware_sim::world::{Ray, Rectangle, Vector, World};
use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg32;

struct Draw(Pcg32);

impl Draw {
    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * f64::from(uniform(&mut self.0))
    }

    fn place(&mut self) -> [f64; 2] {
        [self.between(-8.0, 8.0), self.between(-8.0, 8.0)]
    }

    /// Anywhere, or where numbers are round and walls may lie in one plane.
    fn point(&mut self) -> Vector {
        let point = Vector::new(self.between(-9.0, 9.0), self.between(-9.0, 9.0), self.between(-0.5, 3.5));
        if self.0.next_u32().is_multiple_of(4) { point.map(f64::round) } else { point }
    }

    fn direction(&mut self) -> Vector {
        let any = Vector::from_fn(|_, _| f64::from(normal(&mut self.0)));
        match self.0.next_u32() % 4 {
            0 => Vector::new(any.x, any.y, 0.0).normalize(),
            1 => Vector::ith(any.imax(), any[any.imax()].signum()),
            _ => any.normalize(),
        }
    }

    fn rectangle(&mut self) -> Option<Rectangle> {
        let (u, v) = (self.direction(), self.direction());
        let v = (v - u * u.dot(&v)) * self.between(0.1, 4.0);
        Rectangle::new(self.point(), u * self.between(0.1, 4.0), v)
    }

    /// Rooms side by side, boxes, a round wall, and rectangles anyhow; some twice.
    fn world(&mut self) -> World {
        let mut world = World::default();
        for _ in 0..4 {
            let [x, y] = self.place().map(f64::round);
            let room = Room { from: [x, y], to: [x + 4.0, y + 3.0], thickness_m: 0.0, opening: Vec::new() };
            room.build(&mut world, 2.5).unwrap();
            let size_m = [self.between(0.2, 2.0), self.between(0.2, 2.0)];
            let block = Block { centre: self.place(), size_m, heading_deg: self.between(0.0, 90.0), z_m: None };
            block.build(&mut world, 2.0).unwrap();
        }
        let round =
            CurvedWall { centre: self.place(), radius_m: 3.0, from_deg: 0.0, to_deg: 200.0, pieces: 30, z_m: None };
        round.build(&mut world, 3.0).unwrap();
        (0..80).for_each(|_| world.add(self.rectangle()));
        let again = world.rectangles()[..10].to_vec();
        again.into_iter().for_each(|rectangle| world.add(Some(rectangle)));
        world
    }
}

/// Compares `rays` rays in as many worlds as that takes at 10,000 each; returns how many hit something.
fn compare(rays: usize) -> usize {
    let mut draw = Draw(Pcg32::seed_from_u64(2011));
    let mut hits = 0;
    for _ in 0..rays / 10_000 {
        let world = draw.world();
        let caster = RayCaster::new(&world);
        for _ in 0..10_000 {
            let ray = Ray { from: draw.point(), direction: draw.direction() };
            let (expected, found) = (world.range_m(&ray), caster.range_m(&ray, 1000.0));
            assert_eq!(found, expected, "{ray:?}");
            hits += usize::from(found.is_some());
            let near = expected.map(|range_m| caster.range_m(&ray, range_m * 0.999));
            assert!(near.is_none_or(|near| near.is_none()), "{ray:?}: nothing is nearer");
        }
    }
    hits
}

#[test]
fn tree_agrees_with_brute_force() {
    let hits = compare(50_000);
    assert!(hits > 20_000, "{hits}");
}

/// `cargo test --release -p lrfslam-firmware-sim --test simulator raycast -- --ignored`
#[test]
#[ignore = "a million rays take a while"]
fn tree_agrees_with_brute_force_on_a_million_rays() {
    let hits = compare(1_000_000);
    assert!(hits > 400_000, "{hits}");
}

#[test]
fn empty_and_tiny_worlds_are_no_trouble() {
    let ray = Ray { from: Vector::zeros(), direction: Vector::x() };
    assert_eq!(RayCaster::new(&World::default()).range_m(&ray, 10.0), None);
    let mut world = World::default();
    world.add(Rectangle::new(Vector::new(3.0, -1.0, -1.0), Vector::y() * 2.0, Vector::z() * 2.0));
    let caster = RayCaster::new(&world);
    assert_eq!([caster.range_m(&ray, 10.0), caster.range_m(&ray, 2.9)], [Some(3.0), None]);
}
