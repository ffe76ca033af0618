//! Rays per second in the office world: `cargo bench -p lrfslam-firmware-sim --bench raycast`.
//!
//! `tree` is what the simulator uses, `every_rectangle` the brute force it is compared with. Level: bearings all round at the
//! laser's height; space: directions all over the sphere.

use divan::Bencher;
use divan::counter::ItemsCount;
use lrfslam_core::math::uniform;
use lrfslam_firmware_sim::raycast::RayCaster;
use lrfslam_firmware_sim::scenario::Scenario;
use lrfslam_firmware_sim::world::{Ray, Vector, World};
use rand_core::SeedableRng;
use rand_pcg::Pcg32;

fn main() {
    divan::main();
}

const RAYS: usize = 10_000;

#[divan::bench]
fn tree_level(bencher: Bencher<'_, '_>) {
    tree(bencher, false);
}

#[divan::bench]
fn tree_space(bencher: Bencher<'_, '_>) {
    tree(bencher, true);
}

#[divan::bench(sample_count = 10)]
fn every_rectangle(bencher: Bencher<'_, '_>) {
    let (world, rays) = (office(), rays(false));
    bencher
        .counter(ItemsCount::new(RAYS))
        .bench_local(|| rays.iter().filter_map(|ray| world.range_m(ray)).sum::<f64>());
}

fn tree(bencher: Bencher<'_, '_>, space: bool) {
    let (caster, rays) = (RayCaster::new(&office()), rays(space));
    bencher
        .counter(ItemsCount::new(RAYS))
        .bench_local(|| rays.iter().filter_map(|ray| caster.range_m(ray, 80.0)).sum::<f64>());
}

fn office() -> World {
    Scenario::load("office").expect("comes with the program").world
}

/// Scans of 500 beams from places along the southern corridor and in the rooms beside it.
fn rays(space: bool) -> Vec<Ray> {
    let mut rng = Pcg32::seed_from_u64(7);
    let mut draw = |low: f64, high: f64| low + (high - low) * f64::from(uniform(&mut rng));
    let mut rays = Vec::new();
    while rays.len() < RAYS {
        let from = Vector::new(draw(1.0, 35.0), draw(2.0, 10.0), 0.3);
        for beam in 0..500 {
            let (sin, cos) = (f64::from(beam) * 0.72).to_radians().sin_cos();
            let up = if space { draw(-0.1, 1.0) } else { 0.0 };
            rays.push(Ray { from, direction: Vector::new(cos, sin, up).normalize() });
        }
    }
    rays
}
