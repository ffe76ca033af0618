use super::*;
use crate::filter::{FilterConfig, hits, thin};
use crate::math::uniform;
use crate::math::wrap_angle;
use crate::ndt::{DirectoryEntry, NdtConfig, NdtTile};
use crate::scan::RangeScan;
use crate::sweep::Sweep;
use crate::test_world::World;
use crate::time::Instant;
use rand_core::SeedableRng;
use rand_pcg::Pcg32;

const NDT: NdtConfig = NdtConfig { cell_size_m: 0.5, grids: 4, facings: 1, noise_m: 0.02 };

fn points(world: &World, pose: Pose2, radius_m: f32, range_max_m: f32, rng: &mut Pcg32) -> Vec<Point2> {
    points_with(world, pose, radius_m, (range_max_m, 0.01), rng)
}

fn points_with(
    world: &World,
    pose: Pose2,
    radius_m: f32,
    (range_max_m, noise_m): (f32, f32),
    rng: &mut Pcg32,
) -> Vec<Point2> {
    let beams = world.scan(pose, range_max_m, noise_m, rng);
    let scan = RangeScan { stamp: Instant::default(), range_max_m, beams: &beams };
    let (mut raw, mut memory) = (vec![Point2::default(); 200], vec![Point2::default(); 200]);
    let hits = hits(&Sweep::at_rest(scan, Pose2::IDENTITY), &mut raw).unwrap();
    thin(&FilterConfig { radius_m }, hits, &mut memory).unwrap().to_vec()
}

/// Matches a scan from `at` against a scan from the origin, both filtered as the thesis does.
fn match_from(world: &World, at: Pose2, config: &MatcherConfig, range_max_m: f32, seed: u64) -> (Match, Pose2) {
    matching(world, at, config, range_max_m, seed, |matcher, ndt, source, prediction, rng| {
        (matcher.align(ndt, source, prediction, rng), matcher.align_locally(ndt, source, prediction))
    })
}

fn matching<T>(
    world: &World,
    at: Pose2,
    config: &MatcherConfig,
    range_max_m: f32,
    seed: u64,
    find: impl FnOnce(&mut ScanMatcher<'_>, &NdtGrid<'_>, &[Point2], &Prediction, &mut Pcg32) -> T,
) -> T {
    let mut rng = Pcg32::seed_from_u64(seed);
    let mut directory = vec![DirectoryEntry::default(); NDT.directories() * 128 * 128];
    let mut tiles = vec![NdtTile::EMPTY; 3200];
    let mut population = vec![Member::EMPTY; 100];
    let mut ndt = NdtGrid::new(&NDT, &mut directory, &mut tiles).unwrap();
    ndt.insert(&points(world, Pose2::IDENTITY, 0.0, range_max_m, &mut rng), Pose2::IDENTITY);
    let source = points(world, at, 0.1, range_max_m, &mut rng);
    let mut matcher = ScanMatcher::new(&SearchConfig::default(), &DeConfig::default(), config, &mut population);
    let prediction = Prediction::usual(Pose2::IDENTITY, source.len() as f32);
    find(&mut matcher, &ndt, &source, &prediction, &mut rng)
}

fn error(found: Pose2, truth: Pose2) -> (f32, f32) {
    let error = truth.between(found);
    (error.position().norm(), error.heading.abs().to_degrees())
}

/// Anywhere in the box of table 4.4.
fn displacement(rng: &mut Pcg32) -> Pose2 {
    Pose2::new(-0.5 + 1.5 * uniform(rng), 0.5 * uniform(rng) - 0.25, (40.0 * uniform(rng) - 20.0).to_radians())
}

#[test]
fn finds_displacements_all_over_the_box_where_newton_does_not() {
    let world = World::room();
    let mut rng = Pcg32::seed_from_u64(5);
    let (mut found, mut found_locally) = (0, 0);
    let config = MatcherConfig { prior_position_m: 0.0, ..MatcherConfig::default() };
    for seed in 0..60 {
        let truth = displacement(&mut rng);
        let (matched, local) = match_from(&world, truth, &config, 8.0, seed);
        let hit = |pose| error(pose, truth).0 < 0.05 && error(pose, truth).1 < 1.0;
        found += usize::from(hit(matched.map_from_robot));
        found_locally += usize::from(hit(local));
    }
    assert!(found >= 59, "{found} of 60 found");
    assert!(found_locally < 40, "Newton alone finds {found_locally} of 60");
}

#[test]
fn a_search_with_few_points_finds_displacements_all_over_the_box_too() {
    let world = World::room();
    let mut rng = Pcg32::seed_from_u64(7);
    let config = MatcherConfig { prior_position_m: 0.0, search_points: 24, ..MatcherConfig::default() };
    let hits = (0..60).filter(|seed| {
        let truth = displacement(&mut rng);
        let (distance, turn) = error(match_from(&world, truth, &config, 8.0, *seed).0.map_from_robot, truth);
        distance < 0.05 && turn < 1.0
    });
    let found = hits.count();
    assert!(found >= 55, "{found} of 60 found");
}

#[test]
fn a_lost_robot_is_found_with_few_points() {
    let world = World::room();
    let mut rng = Pcg32::seed_from_u64(9);
    let recovery = RecoveryConfig { search_points: 32, ..RecoveryConfig::default() };
    let found = (0..20).filter(|seed| {
        let truth = Pose2::new(uniform(&mut rng) - 0.5, uniform(&mut rng) - 0.5, 3.0 * uniform(&mut rng) - 1.5);
        let matched =
            matching(&world, truth, &MatcherConfig::default(), 8.0, *seed, |matcher, ndt, source, at, rng| {
                let anywhere = Prediction { prior: PriorSpread::NONE, ..*at };
                matcher.align_anywhere(ndt, source, &anywhere, &recovery, rng)
            });
        let (distance, turn) = error(matched.map_from_robot, truth);
        distance < 0.05 && turn < 1.0
    });
    let found = found.count();
    assert!(found >= 15, "{found} of 20 found");
}

#[test]
fn chosen_points_are_spread_over_the_scan() {
    let points: Vec<_> = (0..10).map(|i| Point2::new(i as f32, 0.0)).collect();
    let chosen = |count| {
        let mut chosen = Chosen::new();
        spread(&points, count, &mut chosen);
        chosen.iter().map(|point| point.x).collect::<Vec<_>>()
    };
    assert_eq!(chosen(4), [0.0, 2.0, 5.0, 7.0]);
    assert!([0, 10, 256].iter().all(|count| chosen(*count).is_empty()), "all are looked at");
}

#[test]
fn thesis_settings_find_the_displacement_too() {
    let config =
        MatcherConfig { newton_steps: 0, prior_position_m: 0.0, prior_heading_deg: 0.0, ..MatcherConfig::default() };
    let truth = Pose2::new(0.6, -0.1, 0.2);
    let (matched, _) = match_from(&World::room(), truth, &config, 8.0, 3);
    let (distance, turn) = error(matched.map_from_robot, truth);
    assert!(distance < 0.05 && turn < 1.0, "{distance} m {turn} deg");
    assert!(matched.generations > 0);
}

#[test]
fn a_featureless_corridor_is_noticed_and_its_axis_named() {
    let truth = Pose2::new(0.3, 0.05, 0.1);
    let (matched, _) = match_from(&World::corridor(), truth, &MatcherConfig::default(), 8.0, 1);
    let axis = matched.undetermined.expect("a corridor leaves its axis open");
    assert!(axis.x.abs() > 0.99, "{axis:?}");
    let (along, across) = (matched.covariance[(0, 0)], matched.covariance[(1, 1)]);
    assert!(along > 10.0 * across, "{along} {across}");
    let departure = truth.between(matched.map_from_robot);
    assert!(departure.y.abs() < 0.05 && departure.heading.abs() < 0.02, "{departure:?}");
    let (matched, _) = match_from(&World::room(), truth, &MatcherConfig::default(), 8.0, 1);
    assert_eq!(matched.undetermined, None);
}

#[test]
fn nothing_seen_stays_at_the_prediction() {
    let mut directory = [DirectoryEntry::default(); 4];
    let mut tiles = vec![NdtTile::EMPTY; 2];
    let mut population = [Member::EMPTY; 10];
    let ndt = NdtGrid::new(&NDT, &mut directory, &mut tiles).unwrap();
    let mut matcher =
        ScanMatcher::new(&SearchConfig::default(), &DeConfig::default(), &MatcherConfig::default(), &mut population);
    let prediction = Prediction::usual(Pose2::new(1.0, 2.0, 3.0), 0.0);
    let found = matcher.align(&ndt, &[], &prediction, &mut Pcg32::seed_from_u64(0));
    assert_eq!(found.score, 0.0);
    assert!((found.map_from_robot.x - 1.0).abs() < 1e-3 && (found.map_from_robot.heading - 3.0).abs() < 1e-3);
    assert!(found.covariance[(0, 0)] > 1.0 && found.undetermined.is_some());
}

/// Squares of normalised errors of matches all over the room and the box, and how many lie within one standard deviation: x, y and heading.
fn normalised_errors(cell_size_m: f32, noise_m: f32, config: &MatcherConfig) -> (f32, [f32; 3]) {
    let (world, mut rng) = (World::room(), Pcg32::seed_from_u64(17));
    let directories = NdtConfig::default().directories();
    let mut directory = vec![DirectoryEntry::default(); directories * 128 * 128];
    let mut tiles = vec![NdtTile::EMPTY; 3200];
    let mut population = vec![Member::EMPTY; 100];
    let (mut squares, mut within, mut found) = (0.0, [0.0; 3], 0.0);
    for _ in 0..150 {
        let start = Pose2::new(2.0 * uniform(&mut rng) - 1.0, 2.0 * uniform(&mut rng) - 1.0, 6.0 * uniform(&mut rng));
        let truth = displacement(&mut rng);
        let ndt = NdtConfig { cell_size_m, ..NdtConfig::default() };
        let mut ndt = NdtGrid::new(&ndt, &mut directory, &mut tiles).unwrap();
        ndt.insert(&points_with(&world, start, 0.0, (8.0, noise_m), &mut rng), Pose2::IDENTITY);
        let source = points_with(&world, start * truth, 0.1, (8.0, noise_m), &mut rng);
        let mut matcher = ScanMatcher::new(&SearchConfig::default(), &DeConfig::default(), config, &mut population);
        let prediction = Prediction::usual(Pose2::IDENTITY, source.len() as f32);
        let matched = matcher.align(&ndt, &source, &prediction, &mut rng);
        let Pose2 { x, y, heading } = matched.map_from_robot;
        let off = Vector3::new(x - truth.x, y - truth.y, wrap_angle(heading - truth.heading));
        if off.norm() > 0.1 || matched.undetermined.is_some() {
            continue; // another optimum, of which no covariance speaks
        }
        found += 1.0;
        squares += (off.transpose() * matched.covariance.try_inverse().unwrap() * off)[0];
        for (axis, within) in within.iter_mut().enumerate() {
            *within += f32::from(u8::from(off[axis].abs() < libm::sqrtf(matched.covariance[(axis, axis)])));
        }
    }
    assert!(found >= 135.0, "{found} of 150 found");
    (squares / found, within.map(|count| count / found))
}

#[test]
fn a_match_is_off_by_as_much_as_its_covariance_says() {
    let free = MatcherConfig { prior_position_m: 0.0, prior_heading_deg: 0.0, ..MatcherConfig::default() };
    let polished = MatcherConfig::default();
    let evolution_alone = MatcherConfig { newton_steps: 0, ..free };
    for (cell_size_m, noise_m, config) in [
        (0.5, 0.0, free),
        (0.5, 0.01, free),
        (0.5, 0.03, free),
        (0.3, 0.0, free),
        (0.3, 0.01, free),
        (0.3, 0.0, polished),
        (0.3, 0.01, polished),
        (0.5, 0.01, evolution_alone),
    ] {
        let (mean, within) = normalised_errors(cell_size_m, noise_m, &config);
        assert!(
            (1.2..6.0).contains(&mean),
            "cells of {cell_size_m} m, noise {noise_m} m: mean square {mean}, expected 3"
        );
        assert!(
            within.iter().all(|share| (0.5..0.93).contains(share)),
            "{cell_size_m} {noise_m} {mean}: {within:?} within 1 σ"
        );
    }
}

#[test]
fn an_undetermined_axis_has_no_small_deviation() {
    for seed in 0..10 {
        let (matched, _) =
            match_from(&World::corridor(), Pose2::new(0.3, 0.05, 0.1), &MatcherConfig::default(), 8.0, seed);
        let (along, across) = (libm::sqrtf(matched.covariance[(0, 0)]), libm::sqrtf(matched.covariance[(1, 1)]));
        assert!(along > 0.1 && across < 0.02, "{along} m along, {across} m across");
    }
}
