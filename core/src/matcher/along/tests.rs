use super::*;
use crate::filter::{FilterConfig, hits, thin};
use crate::matcher::objective::Prior;
use crate::ndt::{DirectoryEntry, NdtConfig, NdtTile};
use crate::scan::RangeScan;
use crate::sweep::Sweep;
use crate::test_world::World;
use crate::time::Instant;
use rand_core::SeedableRng;
use rand_pcg::Pcg32;

const AHEAD: Point2 = Point2::new(1.0, 0.0);
/// Much shorter than the corridor.
const RANGE_MAX_M: f32 = 4.0;

fn points(world: &World, x: f32, radius_m: f32, rng: &mut Pcg32) -> Vec<Point2> {
    let beams = world.scan(Pose2::new(x, 0.0, 0.0), RANGE_MAX_M, 0.01, rng);
    let scan = RangeScan { stamp: Instant::default(), range_max_m: RANGE_MAX_M, beams: &beams };
    let (mut raw, mut memory) = (vec![Point2::default(); 200], vec![Point2::default(); 200]);
    let hits = hits(&Sweep::at_rest(scan, Pose2::IDENTITY), &mut raw).unwrap();
    thin(&FilterConfig { radius_m }, hits, &mut memory).unwrap().to_vec()
}

/// How far along the axis a robot is put by all points and by those that tell, m: it has driven up to 0, is at `x` and expected at `predicted`.
fn places(world: &World, x: f32, predicted: f32, seed: u64) -> [f32; 2] {
    let mut rng = Pcg32::seed_from_u64(seed);
    let mut directory = vec![DirectoryEntry::default(); NdtConfig::DIRECTORIES_MAX * 128 * 128];
    let mut tiles = vec![NdtTile::EMPTY; 3200];
    let mut ndt = NdtGrid::new(&NdtConfig::default(), &mut directory, &mut tiles).unwrap();
    for step in -20..=0 {
        let at = 0.05 * step as f32;
        ndt.insert(&points(world, at, 0.0, &mut rng), Pose2::new(at, 0.0, 0.0));
    }
    let all = points(world, x, 0.1, &mut rng);
    let pose = Pose2::new(predicted, 0.0, 0.0);
    let prior = Prior { predicted: pose, position: 0.15_f32.powi(-2), heading: 1.0 };
    let mut telling = Chosen::new();
    choose_telling(&ndt, &all, pose, AHEAD, &mut telling);
    [&all[..], &telling].map(|points| climb(&Objective::new(&ndt, points, prior), pose, AHEAD).pose.x)
}

#[test]
fn how_far_the_laser_sees_does_not_hold_a_robot_back() {
    let (mut by_all, mut by_telling) = (0.0, 0.0);
    for seed in 0..40 {
        let [all, telling] = places(&World::corridor(), 0.1, 0.1, seed);
        (by_all, by_telling) = (by_all + (all - 0.1) / 40.0, by_telling + (telling - 0.1) / 40.0);
    }
    assert!(by_all < -0.02, "all points do hold it back, or this test says nothing: {by_all}");
    assert!(by_telling.abs() < 0.01, "{by_telling}");
}

#[test]
fn the_end_of_the_corridor_tells_where_it_is() {
    let mut world = World::corridor();
    world.0.push((Point2::new(3.0, -2.0), Point2::new(3.0, 2.0)));
    for seed in 0..10 {
        let [_, by_telling] = places(&world, 0.15, 0.05, seed);
        assert!((by_telling - 0.15).abs() < 0.03, "seed {seed}: {by_telling}");
    }
}
