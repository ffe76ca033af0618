use super::*;
use crate::facing::face;
use crate::geometry::{Point2, Pose2};
use crate::math::uniform;
use proptest::prelude::*;
use rand_core::SeedableRng;
use rand_pcg::Pcg32;
use std::boxed::Box;
use std::vec;
use std::vec::Vec;

const SINGLE: NdtConfig = NdtConfig { cell_size_m: 0.5, grids: 1, facings: 1, noise_m: 0.02 };

/// Memory for a grid of 32 × 32 tiles.
struct Memory {
    directory: Box<[DirectoryEntry]>,
    tiles: Box<[NdtTile]>,
}

impl Memory {
    fn new(tiles: usize) -> Self {
        Self {
            directory: vec![DirectoryEntry::default(); NdtConfig::DIRECTORIES_MAX * 32 * 32].into(),
            tiles: vec![NdtTile::EMPTY; tiles].into(),
        }
    }

    fn grid(&mut self, config: &NdtConfig) -> NdtGrid<'_> {
        let entries = config.directories() * 32 * 32;
        NdtGrid::new(config, &mut self.directory[..entries], &mut self.tiles).unwrap()
    }
}

/// Two walls at a right angle, 5 cm apart from point to point.
fn corner() -> Vec<Point2> {
    let along = (0..80).map(|i| Point2::new(0.05 * i as f32, 2.0));
    along.chain((0..40).map(|i| Point2::new(4.0, 0.05 * i as f32))).collect()
}

/// Eq. (4.42) as it stands, cell by cell in f64: the oracle.
fn naive_score(config: &NdtConfig, reference: &[Point2], points: &[Point2], pose: Pose2) -> f64 {
    let size = f64::from(config.cell_size_m);
    let cell = |p: (f64, f64)| ((p.0 / size).floor() as i64, (p.1 / size).floor() as i64);
    let reference: Vec<(f64, f64)> = reference.iter().map(|p| (f64::from(p.x), f64::from(p.y))).collect();
    let (sin, cos) = (f64::from(pose.heading).sin(), f64::from(pose.heading).cos());
    let mut score = 0.0;
    for point in points {
        let (x, y) = (f64::from(point.x), f64::from(point.y));
        let p = (f64::from(pose.x) + cos * x - sin * y, f64::from(pose.y) + sin * x + cos * y);
        let members: Vec<_> = reference.iter().filter(|q| cell(**q) == cell(p)).collect();
        let n = members.len() as f64;
        if n < f64::from(cell::POINTS_MIN) {
            continue;
        }
        let mean = (members.iter().map(|q| q.0).sum::<f64>() / n, members.iter().map(|q| q.1).sum::<f64>() / n);
        let moment = |f: &dyn Fn(&(f64, f64)) -> f64| members.iter().map(|q| f(q)).sum::<f64>() / (n - 1.0);
        let noise = f64::from(config.noise_m).powi(2);
        let xx = moment(&|q| (q.0 - mean.0).powi(2)) + noise;
        let yy = moment(&|q| (q.1 - mean.1).powi(2)) + noise;
        let xy = moment(&|q| (q.0 - mean.0) * (q.1 - mean.1));
        let determinant = xx * yy - xy * xy;
        let d = (p.0 - mean.0, p.1 - mean.1);
        let mahalanobis = (yy * d.0 * d.0 - 2.0 * xy * d.0 * d.1 + xx * d.1 * d.1) / determinant;
        score += (-0.5 * mahalanobis).exp();
    }
    score
}

proptest! {
    #[test]
    fn score_is_equation_4_42(x in -0.6..0.6_f32, y in -0.6..0.6_f32, heading in -0.5..0.5_f32, seed in 0..1000_u64) {
        let mut rng = Pcg32::seed_from_u64(seed);
        let jitter = |p: &Point2, rng: &mut Pcg32| *p + Point2::new(0.02 * uniform(rng), 0.02 * uniform(rng));
        let reference: Vec<_> = corner().iter().map(|p| jitter(p, &mut rng)).collect();
        let points: Vec<_> = corner().iter().step_by(3).map(|p| jitter(p, &mut rng)).collect();
        let mut memory = Memory::new(40);
        let mut grid = memory.grid(&SINGLE);
        grid.insert(&reference, Pose2::IDENTITY);
        let pose = Pose2::new(x, y, heading);
        let expected = naive_score(&SINGLE, &reference, &points, pose);
        // A point within rounding of a cell's border may count to the neighbour.
        prop_assert!((f64::from(grid.score(&points, pose)) - expected).abs() < 0.02 * points.len() as f64 * 0.1 + 0.02,
            "{} against {expected}", grid.score(&points, pose));
    }

    #[test]
    fn derivatives_are_those_of_the_score(x in -0.2..0.2_f32, y in -0.2..0.2_f32, heading in -0.1..0.1_f32) {
        // One wide cell, so that no point changes its cell: the score is smooth.
        let config = NdtConfig { cell_size_m: 10.0, noise_m: 0.3, ..SINGLE };
        let mut memory = Memory::new(10);
        let mut grid = memory.grid(&config);
        let centred: Vec<_> = corner().iter().map(|p| *p + Point2::new(3.0, 3.0)).collect();
        grid.insert(&centred, Pose2::IDENTITY);
        let at = |dx: f32, dy: f32, dh: f32| {
            grid.linearise(&centred, Pose2::new(x + dx, y + dy, heading + dh))
        };
        let h = 5e-3;
        let here = at(0.0, 0.0, 0.0);
        let ends = [(at(h, 0.0, 0.0), at(-h, 0.0, 0.0)), (at(0.0, h, 0.0), at(0.0, -h, 0.0)), (at(0.0, 0.0, h), at(0.0, 0.0, -h))];
        for (i, (plus, minus)) in ends.iter().enumerate() {
            let slope = (plus.score - minus.score) / (2.0 * h);
            prop_assert!((slope - here.gradient[i]).abs() < 0.02 * here.gradient.norm() + 0.2, "slope {slope} {}", here.gradient[i]);
            let bend = (plus.gradient - minus.gradient) / (2.0 * h);
            for j in 0..3 {
                let expected = -here.hessian[(i, j)];
                prop_assert!((bend[j] - expected).abs() < 0.03 * here.hessian.norm() + 1.0, "{i}{j}: {} {expected}", bend[j]);
            }
        }
    }

    #[test]
    fn any_numbers_are_survived(x in proptest::num::f32::ANY, y in proptest::num::f32::ANY, h in proptest::num::f32::ANY) {
        let mut memory = Memory::new(40);
        let mut grid = memory.grid(&NdtConfig { grids: 4, ..SINGLE });
        grid.insert(&corner(), Pose2::IDENTITY);
        let wild = [Point2::new(x, y), Point2::new(h, x)];
        let pose = Pose2 { x, y, heading: h };
        grid.insert(&wild, Pose2::IDENTITY);
        grid.insert(&wild, pose);
        let score = grid.score(&wild, pose);
        prop_assert!(score.is_nan() || (0.0..=2.0).contains(&score));
        grid.linearise(&corner(), pose);
        grid.constraint(&corner(), pose);
    }
}

proptest! {
    /// Distributions are made once for points that follow one another in a cell; also where tiles run out, go and come again, or are frozen.
    #[test]
    fn points_at_once_are_points_one_by_one(seed in 0..1000_u64, tiles in 3..40_usize) {
        let mut rng = Pcg32::seed_from_u64(seed);
        let points: Vec<_> =
            corner().iter().map(|p| *p + Point2::new(0.3 * uniform(&mut rng), 0.3 * uniform(&mut rng))).collect();
        let (first, then) = points.split_at(50);
        let pose = Pose2::new(0.2, -0.1, 0.3);
        let (mut at_once, mut single) = (Memory::new(tiles), Memory::new(tiles));
        let (mut at_once, mut single) = (at_once.grid(&NdtConfig::default()), single.grid(&NdtConfig::default()));
        for points in [first, then] {
            let report = at_once.insert(points, pose);
            let one_by_one = points.iter().map(|point| single.insert(&[*point], pose));
            let dropped: u32 = one_by_one.map(|report| report.dropped).sum();
            prop_assert_eq!(report.dropped, dropped);
            let scores = points.iter().map(|p| [&at_once, &single].map(|grid| grid.score(&[*p], pose).to_bits()));
            prop_assert!(scores.clone().all(|[a, b]| a == b), "{:?}", scores.collect::<Vec<_>>());
            at_once.freeze();
            single.freeze();
        }
    }
}

#[test]
fn removal_leaves_no_trace() {
    let config = NdtConfig { grids: 4, ..SINGLE };
    let (mut memory, mut other_memory) = (Memory::new(120), Memory::new(120));
    let (mut grid, mut other) = (memory.grid(&config), other_memory.grid(&config));
    let (here, there) = (Pose2::new(0.1, 0.2, 0.3), Pose2::new(7.0, -9.0, -2.0));
    grid.insert(&corner(), here);
    other.insert(&corner(), here);
    let used = grid.tiles_used();
    for _ in 0..100 {
        grid.insert(&corner(), there);
        grid.remove(&corner(), there);
    }
    assert_eq!(grid.tiles_used(), used);
    for i in 0..50 {
        let pose = Pose2::new(0.02 * i as f32, 0.01 * i as f32, 0.3);
        assert_eq!(grid.score(&corner(), pose).to_bits(), other.score(&corner(), pose).to_bits());
    }
}

#[test]
fn insertion_order_does_not_matter() {
    let (mut memory, mut other_memory) = (Memory::new(120), Memory::new(120));
    let (mut grid, mut other) = (memory.grid(&SINGLE), other_memory.grid(&SINGLE));
    let backwards: Vec<_> = corner().into_iter().rev().collect();
    grid.insert(&corner(), Pose2::IDENTITY);
    other.insert(&backwards, Pose2::IDENTITY);
    let pose = Pose2::new(0.03, -0.02, 0.01);
    assert_eq!(grid.score(&corner(), pose).to_bits(), other.score(&corner(), pose).to_bits());
}

#[test]
fn full_pool_is_counted_and_survived() {
    let mut memory = Memory::new(3);
    let mut grid = memory.grid(&SINGLE);
    let far: Vec<_> = (0..10).map(|i| Point2::new(10.0 * i as f32, 0.0)).collect();
    assert_eq!(grid.insert(&far, Pose2::IDENTITY), InsertReport { dropped: 8, evicted: 0 });
    assert_eq!(grid.tiles_used(), 2);
    assert!(grid.score(&far, Pose2::IDENTITY).is_finite());
}

#[test]
fn full_pool_forgets_what_is_farthest_from_the_robot() {
    let mut memory = Memory::new(6);
    let mut grid = memory.grid(&SINGLE);
    let wall: Vec<_> = (0..10).map(|i| Point2::new(1.2, 0.05 * i as f32)).collect();
    let seen_from = |grid: &NdtGrid<'_>, x: f32| grid.score(&wall, Pose2::new(x, 0.0, 0.0)) > 1.0;
    for i in 0..15 {
        let x = 2.0 * i as f32;
        assert_eq!(grid.insert(&wall, Pose2::new(x, 0.0, 0.0)).dropped, 0);
        assert!(seen_from(&grid, x) && (i < 4 || seen_from(&grid, x - 8.0)), "what is near stays");
    }
    assert_eq!(grid.tiles_used(), 5);
    assert!((0..10).all(|i| !seen_from(&grid, 2.0 * i as f32)));
    assert_eq!(grid.insert(&wall, Pose2::new(0.0, 0.0, 0.0)).evicted, 1);
    assert!(seen_from(&grid, 0.0) && !seen_from(&grid, 28.0), "seen from the start, the last is the farthest");
}

#[test]
fn of_two_tiles_as_far_the_first_of_the_pool_is_forgotten() {
    let mut memory = Memory::new(3);
    let mut grid = memory.grid(&SINGLE);
    let at = |x: f32| vec![Point2::new(x, 1.0), Point2::new(x + 0.02, 1.02), Point2::new(x - 0.02, 1.01)];
    grid.insert(&at(9.25), Pose2::IDENTITY);
    grid.insert(&at(-7.25), Pose2::IDENTITY);
    // Tiles of 1 m: from 9 m to 10 m and from −8 m to −7 m; 1 m is halfway.
    assert_eq!(grid.insert(&at(0.25), Pose2::new(1.0, 0.0, 0.0)), InsertReport { dropped: 0, evicted: 1 });
    let seen = [9.25, -7.25, 1.25].map(|x| grid.score(&at(x), Pose2::IDENTITY) > 1.0);
    assert_eq!(seen, [false, true, true]);
}

#[test]
fn the_plane_wraps_and_says_so() {
    let mut memory = Memory::new(20);
    let mut grid = memory.grid(&SINGLE);
    grid.insert(&corner(), Pose2::IDENTITY);
    let at_home = grid.score(&corner(), Pose2::IDENTITY);
    // 32 tiles of 2 cells of 0.5 m: 32 m around. The same place in the directory must not be taken for the same place.
    let around = Pose2::new(32.0, 0.0, 0.0);
    assert_eq!(grid.score(&corner(), around), 0.0);
    let from_home = corner().into_iter().map(|p| around.transform(p)).collect::<Vec<_>>();
    assert_eq!(grid.insert(&from_home, Pose2::IDENTITY), InsertReport { dropped: from_home.len() as u32, evicted: 0 });
    assert!(grid.insert(&corner(), around).evicted > 0);
    assert!((grid.score(&corner(), around) - at_home).abs() < 0.05 * at_home);
    assert_eq!(grid.score(&corner(), Pose2::IDENTITY), 0.0);
}

#[test]
fn memory_of_the_wrong_form_is_refused() {
    let mut tiles = vec![NdtTile::EMPTY; 4];
    let mut odd = [DirectoryEntry::default(); 12];
    assert_eq!(NdtGrid::new(&SINGLE, &mut odd, &mut tiles).err(), Some(NdtMemoryError::Directory(12)));
    assert_eq!(NdtGrid::new(&SINGLE, &mut [], &mut tiles).err(), Some(NdtMemoryError::Directory(0)));
    let mut good = [DirectoryEntry::default(); 16];
    assert_eq!(NdtGrid::new(&SINGLE, &mut good, &mut []).err(), Some(NdtMemoryError::Tiles(0)));
    assert!(NdtGrid::new(&SINGLE, &mut good, &mut tiles).is_ok());
}

#[test]
fn memory_lent_again_starts_empty() {
    let mut memory = Memory::new(20);
    memory.grid(&SINGLE).insert(&corner(), Pose2::IDENTITY);
    let grid = memory.grid(&SINGLE);
    assert_eq!(grid.tiles_used(), 0);
    assert_eq!(grid.score(&corner(), Pose2::IDENTITY), 0.0);
}

#[test]
fn corridor_constrains_across_and_a_corner_both_ways() {
    let corridor: Vec<_> =
        (0..200).flat_map(|i| [-1.0, 1.0].map(|y| Point2::new(0.05 * i as f32 - 5.0, y + 0.13))).collect();
    let mut memory = Memory::new(40);
    let mut grid = memory.grid(&SINGLE);
    grid.insert(&corridor, Pose2::IDENTITY);
    let [xx, _, yy] = grid.constraint(&corridor, Pose2::IDENTITY);
    assert!(xx < 0.01 && yy > 0.5, "{xx} {yy}");
    let mut memory = Memory::new(40);
    let mut grid = memory.grid(&SINGLE);
    grid.insert(&corner(), Pose2::IDENTITY);
    let [xx, _, yy] = grid.constraint(&corner(), Pose2::IDENTITY);
    assert!(xx > 0.2 && yy > 0.2, "{xx} {yy}");
}

/// Cells cut a wall that stands across them into pieces, of which the short ones are no features.
#[test]
fn a_bare_corridor_says_nothing_along_itself_however_it_lies_in_the_grid() {
    let mut rng = crate::random::RandomStream::new(1, 0, 0);
    for degrees in [0, 3, 8, 15, 20, 30, 38, 45] {
        let turned = Pose2::new(0.0, 0.0, (degrees as f32).to_radians());
        let mut hit = |x: f32, y: f32| turned.transform(Point2::new(x, y + 0.01 * crate::math::normal(&mut rng)));
        let corridor: Vec<_> =
            (0..200).flat_map(|i| [-1.0, 1.0].map(|y| hit(0.05 * i as f32 - 5.0, y + 0.13))).collect();
        for cell_size_m in [0.3, 0.5] {
            let mut memory = Memory::new(160);
            let mut grid = memory.grid(&NdtConfig { cell_size_m, grids: 4, ..SINGLE });
            grid.insert(&corridor, Pose2::IDENTITY);
            let [xx, xy, yy] = grid.constraint(&corridor, Pose2::IDENTITY);
            let along = 0.5 * (xx + yy) - (0.25 * (xx - yy).powi(2) + xy * xy).sqrt();
            println!("{degrees} {cell_size_m} {along}");
            assert!(along < 0.02, "{degrees} degrees, cells of {cell_size_m} m: {along}");
        }
    }
}

#[test]
fn what_a_scene_says_does_not_depend_on_how_sharp_the_cells_are() {
    let corridor: Vec<_> =
        (0..200).flat_map(|i| [-1.0, 1.0].map(|y| Point2::new(0.05 * i as f32 - 5.0, y + 0.13))).collect();
    for noise_m in [0.005, 0.015, 0.025, 0.04] {
        let (mut memory, mut other_memory) = (Memory::new(80), Memory::new(80));
        let config = NdtConfig { cell_size_m: 0.3, noise_m, grids: 1, facings: 1 };
        let (mut grid, mut other) = (memory.grid(&config), other_memory.grid(&config));
        grid.insert(&corner(), Pose2::IDENTITY);
        let [xx, _, yy] = grid.constraint(&corner(), Pose2::IDENTITY);
        assert!(xx > 0.2 && yy > 0.4, "{noise_m}: {xx} {yy}");
        other.insert(&corridor, Pose2::IDENTITY);
        let [xx, _, yy] = other.constraint(&corridor, Pose2::IDENTITY);
        assert!(xx < 0.03 && yy > 0.7, "{noise_m}: {xx} {yy}");
    }
}

#[test]
fn every_grid_is_another_view_of_the_points() {
    let pose = Pose2::new(0.03, -0.02, 0.01);
    let seen = [1, 2, 3, 4].map(|grids| {
        let mut memory = Memory::new(160);
        let mut grid = memory.grid(&NdtConfig { grids, ..SINGLE });
        grid.insert(&corner(), Pose2::IDENTITY);
        let searched = grid.search_score(&corner(), pose, 0.0);
        (grid.tiles_used(), grid.score(&corner(), pose), searched)
    });
    for (fewer, more) in seen.iter().zip(&seen[1..]) {
        assert!(fewer.0 < more.0 && fewer.1 != more.1, "{seen:?}");
        assert_eq!(fewer.2, more.2, "the search looks at the first one");
    }
}

#[test]
fn frozen_cells_stay_and_others_take_points() {
    let mut memory = Memory::new(40);
    let mut grid = memory.grid(&SINGLE);
    let beyond = [Point2::new(-3.2, -3.2), Point2::new(-3.3, -3.1), Point2::new(-3.1, -3.3), Point2::new(-3.2, -3.1)];
    grid.insert(&corner(), Pose2::IDENTITY);
    grid.freeze();
    let before = grid.score(&corner(), Pose2::IDENTITY);
    let moved = Pose2::new(0.05, 0.08, 0.0);
    grid.insert(&corner(), moved);
    assert_eq!(grid.score(&corner(), Pose2::IDENTITY), before);
    assert_eq!(grid.score(&beyond, Pose2::IDENTITY), 0.0);
    grid.insert(&beyond, Pose2::IDENTITY);
    assert!(grid.score(&beyond, Pose2::IDENTITY) > 1.0);
    grid.clear();
    assert_eq!((grid.tiles_used(), grid.score(&corner(), Pose2::IDENTITY)), (0, 0.0));
    grid.insert(&corner(), moved);
    assert!(grid.score(&corner(), moved) > grid.score(&corner(), Pose2::IDENTITY));
}

#[test]
fn a_wall_seen_from_its_other_side_is_another_one() {
    let wall = |y: f32| {
        let mut hits: Vec<Point2> = (-30..=30).map(|i| Point2::new(0.05 * i as f32, y)).collect();
        face(&mut hits, Point2::default());
        hits
    };
    let score = |facings, sees: &[Point2], at: Pose2| {
        let config = NdtConfig { facings, ..NdtConfig::default() };
        let mut memory = Memory::new(200);
        let mut grid = memory.grid(&config);
        grid.insert(&wall(2.0), Pose2::IDENTITY);
        grid.score(sees, at) / sees.len() as f32
    };
    for heading in [0.0, 1.0, 2.5, -2.0] {
        let turned = Pose2::new(0.0, 0.0, heading);
        let same: Vec<Point2> = wall(2.0).iter().map(|point| turned.inverse().transform(*point)).collect();
        assert!(
            score(3, &same, turned) > 0.95 * score(1, &same, turned),
            "the same side from another heading, {heading}"
        );
    }
    // From behind it, looking back: its other side, 0.05 m off.
    let behind = Pose2::new(0.0, 4.05, std::f32::consts::PI);
    assert!(score(1, &wall(2.0), behind) > 0.1);
    assert_eq!(score(3, &wall(2.0), behind), 0.0);
}

#[test]
fn a_wall_seen_so_flat_that_its_hits_are_far_apart_is_found() {
    let face_from = |mut hits: Vec<Point2>, eye| {
        face(&mut hits, eye);
        hits
    };
    let near = face_from((0..=80).map(|i| Point2::new(2.0 - 0.05 * i as f32, 1.0)).collect(), Point2::default());
    let flat = face_from((0..5).map(|i| Point2::new(2.0 - 0.8 * i as f32, 1.0)).collect(), Point2::new(-10.0, 0.0));
    assert!(near.iter().all(|hit| hit.facing.is_seen()) && !flat.iter().any(|hit| hit.facing.is_seen()));
    let score = |drawn: &[Point2], seen: &[Point2]| {
        let mut memory = Memory::new(200);
        let mut grid = memory.grid(&NdtConfig::default());
        (0..5).for_each(|_| {
            grid.insert(drawn, Pose2::IDENTITY);
        });
        grid.score(seen, Pose2::IDENTITY) / seen.len() as f32
    };
    assert!(score(&near, &flat) > 0.5 && score(&flat, &near) > 0.05, "{} {}", score(&near, &flat), score(&flat, &near));
}
