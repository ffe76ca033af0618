use super::*;
use crate::ancestry::{Ancestry, Node, NodeId};
use crate::distributed_map::{
    DistributedMap, MapMemory, ParticleMapConfig, Print, Tile, TileHeader, TileId, Window, WindowFrame,
};
use crate::math::uniform;
use crate::random::RandomStream;
use proptest::prelude::*;
use std::vec;
use std::vec::Vec;

const SIDE: usize = 8;
const SIZE: f32 = 0.1;

/// Calls `test` with a view of a map into which `scans` were printed.
fn with_map(scans: &[(Vec<Ray>, Pose2)], test: impl FnOnce(MapView<'_, '_, SIDE>)) {
    let mut nodes = [Node::default(); 4];
    let (mut tiles, mut headers) = (vec![Tile::<SIDE>::UNSEEN; 600], vec![TileHeader::default(); 600]);
    let (mut node_tiles, mut directory) = ([TileId::NONE; 4], vec![TileId::NONE; 1024]);
    let mut slots = vec![TileId::NONE; 32 * 32];
    let memory = MapMemory {
        tiles: &mut tiles,
        headers: &mut headers,
        node_tiles: &mut node_tiles,
        directory: &mut directory,
        ages: &mut [],
    };
    let tree = Ancestry::new(&mut nodes).unwrap();
    let mut map = DistributedMap::new(&ParticleMapConfig { square_size_m: SIZE, print_step: 1 }, memory).unwrap();
    let mut window = Window::new(&mut slots).unwrap();
    let frame = WindowFrame::around(Point2::new(-9.0, -9.0), Point2::new(9.0, 9.0), 32, SIZE * SIDE as f32);
    window.open(&map, &tree, frame, NodeId::ROOT);
    for (rays, pose) in scans {
        Print::new(rays, *pose).run(&mut map, &mut window).unwrap();
    }
    test(MapView::new(&map, &window));
}

/// Rays of a laser at the pose in a square room of `half` m to each side about the origin.
fn room(half: f32, pose: Pose2, count: usize) -> Vec<Ray> {
    (0..count)
        .map(|i| {
            let bearing = i as f32 * (core::f32::consts::TAU / count as f32);
            let (sin, cos) = sin_cos(pose.heading + bearing);
            let along = |at: f32, d: f32| if d > 0.0 { (half - at) / d } else { (-half - at) / d };
            let length_m = along(pose.x, cos).min(along(pose.y, sin));
            let (sin, cos) = sin_cos(bearing);
            Ray { direction: Point2::new(cos, sin), length_m, hit: true }
        })
        .collect()
}

/// Eq. (3.36)–(3.39) as written, in f64, over exact intersections of every square of the plane with the ray.
fn oracle(config: &PerceptionConfig, view: MapView<'_, '_, SIDE>, ray: &Ray, pose: Pose2) -> f64 {
    let start = view.to_squares(pose.position());
    let angle = f64::from(pose.heading) + f64::from(ray.direction.y).atan2(f64::from(ray.direction.x));
    let size = f64::from(SIZE);
    let (sigma, end) = (f64::from(config.sigma_m), f64::from(ray.length_m));
    let last = if ray.hit { end + f64::from(REACH_SIGMAS) * sigma } else { end };
    let mut stops = Vec::new();
    for x in 0..256 {
        for y in 0..256 {
            let slab = |start: f32, direction: f64, square: i32| {
                let a = (f64::from(square) - f64::from(start)) / direction * size;
                let b = (f64::from(square) + 1.0 - f64::from(start)) / direction * size;
                (a.min(b), a.max(b))
            };
            let (column, row) = (slab(start.x, angle.cos(), x), slab(start.y, angle.sin(), y));
            let (enter, leave) = (column.0.max(row.0).max(0.0), column.1.min(row.1).min(last));
            if leave > enter {
                let square = view.square(x, y);
                let distance = f64::from(square.distance()) / 8.0 * size + f64::from(PRIOR_DISTANCE_M);
                let hits = f64::from(square.hits()) + f64::from(PRIOR_DISTANCE_M) / f64::from(UNSEEN_FREE_M);
                stops.push((enter, leave, hits / distance));
            }
        }
    }
    stops.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (mut pass, mut likelihood) = (1.0, 0.0);
    for (enter, leave, density) in stops {
        let stop = 1.0 - (-density * (leave - enter)).exp();
        let off = (enter + leave) / 2.0 - end;
        if off.abs() < f64::from(REACH_SIGMAS) * sigma {
            likelihood += pass * stop * (-off * off / (2.0 * sigma * sigma)).exp();
        }
        pass *= 1.0 - stop;
    }
    if ray.hit { likelihood } else { pass }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn likelihood_is_that_of_the_equations(seed in any::<u64>()) {
        let mut rng = RandomStream::new(seed, 0, 0);
        let config = PerceptionConfig { gain: 1.0, ..PerceptionConfig::default() };
        let model = PerceptionModel::with_floor(&config, SIZE, 1e-6);
        let mut pose = || {
            let (x, y) = (uniform(&mut rng) - 0.5, uniform(&mut rng) - 0.5);
            Pose2::new(x, y, 6.0 * uniform(&mut rng))
        };
        let scans: Vec<_> = (0..4).map(|_| pose()).map(|at| (room(3.0, at, 60), at)).collect();
        let at = pose();
        let mut rays = room(3.0, at, 7);
        rays[1].length_m = 1.0;
        rays[2].hit = false;
        rays[3].length_m = 6.0;
        with_map(&scans, |view| {
            for ray in &rays {
                let ours = model.log_likelihood(view, core::slice::from_ref(ray), at);
                let exact = oracle(&config, view, ray, at).max(1e-6).ln();
                assert!((f64::from(ours) - exact).abs() < 0.05, "{ours} {exact} {ray:?}");
            }
        });
    }
}

#[test]
fn the_true_pose_is_likeliest() {
    let at = Pose2::new(0.2, -0.3, 0.4);
    let scans: Vec<_> = (0..5).map(|_| (room(3.0, at, 180), at)).collect();
    let model = PerceptionModel::new(&PerceptionConfig::default(), SIZE);
    with_map(&scans, |view| {
        let rays = room(3.0, at, 90);
        let best = model.log_likelihood(view, &rays, at);
        for off in [Pose2::new(0.3, 0.0, 0.0), Pose2::new(0.0, -0.3, 0.0), Pose2::new(0.0, 0.0, 0.1)] {
            let there = model.log_likelihood(view, &rays, at * off);
            assert!(there < best - 2.0, "{there} {best}");
        }
    });
}

#[test]
fn rays_out_of_the_window_and_wild_poses_give_finite_or_no_chance() {
    let model = PerceptionModel::new(&PerceptionConfig::default(), SIZE);
    with_map(&[], |view| {
        let rays = room(300.0, Pose2::IDENTITY, 8);
        for pose in [Pose2::IDENTITY, Pose2::new(50.0, 0.0, 0.0), Pose2::new(-1e9, 1e30, 0.0)] {
            let value = model.log_likelihood(view, &rays, pose);
            assert!(value.is_finite() && value <= 0.0, "{value} at {pose:?}");
        }
        let nowhere = Pose2 { x: f32::NAN, ..Pose2::IDENTITY };
        assert_eq!(model.log_likelihood(view, &rays, nowhere), f32::NEG_INFINITY);
    });
}

#[test]
fn one_ray_takes_no_more_than_the_floor_allows() {
    let at = Pose2::IDENTITY;
    let model = PerceptionModel::new(&PerceptionConfig { gain: 1.0, ..Default::default() }, SIZE);
    with_map(&[(room(3.0, at, 180), at)], |view| {
        let wrong = [Ray { direction: Point2::new(1.0, 0.0), length_m: 1.0, hit: true }];
        let value = model.log_likelihood(view, &wrong, at);
        assert!((value - libm::logf(FLOOR)).abs() < 1e-6);
    });
}

#[test]
fn beam_step_and_gain_scale_the_sum() {
    let at = Pose2::IDENTITY;
    let rays = room(3.0, at, 180);
    let config = PerceptionConfig { beam_step: 3, gain: 0.5, ..PerceptionConfig::default() };
    let every_third: Vec<Ray> = rays.iter().step_by(3).copied().collect();
    with_map(&[(rays.clone(), at)], |view| {
        let sparse = PerceptionModel::new(&config, SIZE).log_likelihood(view, &rays, at);
        let plain = PerceptionConfig { gain: 1.0, beam_step: 1, ..PerceptionConfig::default() };
        let full = PerceptionModel::new(&plain, SIZE).log_likelihood(view, &every_third, at);
        assert!((sparse - 0.5 * full).abs() < 1e-3);
    });
}
