use super::*;
use crate::laser_odometry::tests::{Memory, circle, drive};
use crate::laser_odometry::{LaserOdometryConfig, OdometryReport};
use crate::math::uniform;
use crate::scan::{Beam, Echo, RangeScan};
use crate::test_world::World;
use crate::time::Instant;
use rand_core::SeedableRng;
use rand_pcg::Pcg32;

#[test]
fn a_robot_pushed_aside_finds_itself_again_and_is_not_taken_to_go_on_so() {
    for turned in [0.0, 0.3, 0.6, 1.2] {
        let mut memory = Memory::new(2000);
        let mut odometry = memory.odometry(&LaserOdometryConfig::default());
        let pushed = Pose2::new(-1.2, 0.8, turned);
        let path = (0..=120).map(circle).chain((0..5).map(|_| pushed));
        let (_, reports) = drive(&mut odometry, path, Pose2::IDENTITY, 2);
        for (scan, report) in reports[reports.len() - 3..].iter().enumerate() {
            let error = pushed.between(report.matched.map_from_robot);
            let is_there = error.position().norm() < 0.05 && error.heading.abs() < 0.02;
            assert!(is_there && !report.is_lost, "turned by {turned}, {scan}: {error:?}");
        }
    }
}

#[test]
fn without_a_prior_nothing_is_a_leap() {
    let mut config = LaserOdometryConfig::default();
    (config.matcher.prior_position_m, config.matcher.prior_heading_deg) = (0.0, 0.0);
    let mut memory = Memory::new(2000);
    let (_, reports) = drive(&mut memory.odometry(&config), (0..=60).map(circle), Pose2::IDENTITY, 2);
    for (step, report) in reports.iter().enumerate().skip(20) {
        let off_m = circle(step).between(report.predicted).position().norm();
        assert!(!report.is_lost && off_m < 0.03, "{step}: expected {off_m} m off, as if it stood");
    }
}

/// A scan from `aside` times 1.4 m beside where the robot would have turned by `turned`, with beams changed, each by its number of so many. Returns
/// whether it is believed.
fn believes(aside: f32, turned: f32, change: impl Fn(usize, usize, &mut Echo)) -> bool {
    let mut memory = Memory::new(2000);
    let mut odometry = memory.odometry(&LaserOdometryConfig::default());
    let (from, _) = drive(&mut odometry, (0..=120).map(circle), Pose2::IDENTITY, 2);
    let there = from * Pose2::new(-1.2 * aside, 0.8 * aside, turned);
    let mut beams = World::room().scan(there, 8.0, 0.01, &mut Pcg32::seed_from_u64(3));
    let count = beams.len();
    beams.iter_mut().enumerate().for_each(|(index, beam)| change(index, count, &mut beam.echo));
    let scan = RangeScan { stamp: Instant::default(), range_max_m: 8.0, beams: &beams };
    let report = odometry.step(&scan, Pose2::IDENTITY, None).unwrap();
    let found = there.between(report.matched.map_from_robot);
    !report.is_lost && found.position().norm() < 0.2 && found.heading.abs() < 0.1
}

/// Every so many-th beam fits nowhere.
fn leaves(every: usize) -> impl Fn(usize, usize, &mut Echo) {
    move |index, _, echo| {
        if index.is_multiple_of(every) {
            *echo = Echo::Hit(0.5 + 0.04 * (index % 17) as f32);
        }
    }
}

#[test]
fn a_place_from_another_side_and_one_farther_off_must_fit_better() {
    assert!(believes(0.1, 0.6, leaves(5)), "seven tenths of the usual score");
    assert!(!believes(0.1, 1.2, leaves(5)), "a robot does not turn so from scan to scan");
    assert!(!believes(1.0, 0.6, leaves(5)), "nor drive so");
    assert!(believes(1.0, 0.6, leaves(15)), "unless nearly all fits");
    assert!(!believes(1.0, 1.2, leaves(5)) && believes(1.0, 1.2, leaves(15)), "nor both");
}

#[test]
fn a_wall_that_is_looked_through_tells_more_than_people_before_it() {
    let third = |times: f32| {
        move |index: usize, count: usize, echo: &mut Echo| {
            if let Echo::Hit(range_m) = echo
                && 3 * index < count
            {
                *range_m *= times;
            }
        }
    };
    assert!(believes(0.1, 0.1, third(0.5)), "people");
    assert!(!believes(0.1, 0.1, third(1.5)), "another room");
    assert!(believes(0.0, 0.0, third(1.5)), "a door, where the robot was expected");
}

#[test]
fn who_leaps_is_kept_where_it_was_if_somebody_else_finds_it() {
    let mut memory = Memory::new(2000);
    let mut odometry = memory.odometry(&LaserOdometryConfig::default());
    odometry.leave_returns();
    let (from, _) = drive(&mut odometry, (0..=120).map(circle), Pose2::IDENTITY, 2);
    let pushed = from * Pose2::new(-1.2, 0.8, 0.0);
    let mut rng = Pcg32::seed_from_u64(3);
    let mut step = |at: Pose2| {
        let beams = World::room().scan(at, 8.0, 0.01, &mut rng);
        let scan = RangeScan { stamp: Instant::default(), range_max_m: 8.0, beams: &beams };
        let report = odometry.step(&scan, Pose2::IDENTITY, None).unwrap();
        (report.is_lost, from.between(odometry.map_from_robot()).position().norm())
    };
    for scan in 0..10 {
        let (is_lost, off_m) = step(pushed);
        assert!(
            is_lost && off_m < 0.2,
            "scan {scan} fits there, but 1.4 m in a fifth of a second: {is_lost}, {off_m} m"
        );
    }
    let (is_lost, off_m) = step(from);
    assert!(!is_lost && off_m < 0.05, "set back, it goes on: {is_lost}, {off_m} m");
}

#[test]
fn a_robot_carried_into_a_room_like_the_last_one_is_lost() {
    let other = World::polyline(&[(-3.0, -2.0), (4.5, -2.0), (4.5, 3.6), (-3.0, 3.6), (-3.0, -2.0)]);
    for (turned, seed) in [0.0, 0.1, 0.2, 0.3].into_iter().zip(1..) {
        let mut memory = Memory::new(2000);
        let mut odometry = memory.odometry(&LaserOdometryConfig::default());
        odometry.leave_returns();
        let (from, _) = drive(&mut odometry, (0..=120).map(circle), Pose2::IDENTITY, seed);
        let there = from * Pose2::new(-1.2, 0.8, turned);
        let mut rng = Pcg32::seed_from_u64(seed);
        for scan in 0..10 {
            let beams = other.scan(there, 8.0, 0.01, &mut rng);
            let scan_there = RangeScan { stamp: Instant::default(), range_max_m: 8.0, beams: &beams };
            let report = odometry.step(&scan_there, Pose2::IDENTITY, None).unwrap();
            assert!(report.is_lost, "turned by {turned}, scan {scan}");
        }
    }
}

/// The scan after a drive round the room, with scans so many seconds apart, in `world`, two of three beams of it on leaves before its walls, taken so far
/// from where the drive would have gone on. Returns what it did, and by how far it is off, m.
fn among_leaves(world: &World, seconds: f32, aside: Pose2, seed: u64) -> (OdometryReport, f32) {
    let mut memory = Memory::new(2000);
    let mut odometry = memory.odometry(&LaserOdometryConfig::default());
    let mut rng = Pcg32::seed_from_u64(seed);
    let mut step = |scan: usize, beams: &[Beam]| {
        let stamp = Instant::from_micros((1e6 * seconds) as i64 * scan as i64);
        odometry.step(&RangeScan { stamp, range_max_m: 8.0, beams }, Pose2::IDENTITY, None).unwrap()
    };
    for scan in 0..=120 {
        let beams = World::room().scan(circle(scan), 8.0, 0.01, &mut rng);
        assert!(!step(scan, &beams).is_lost);
    }
    let there = circle(121) * aside;
    let mut beams = world.scan(there, 8.0, 0.01, &mut rng);
    for beam in beams.iter_mut().enumerate().filter(|(index, _)| index % 3 > 0).map(|(_, beam)| beam) {
        let Echo::Hit(range_m) = beam.echo else { continue };
        beam.echo = Echo::Hit(range_m * (0.4 + 0.5 * uniform(&mut rng)));
    }
    let report = step(121, &beams);
    (report, there.between(report.matched.map_from_robot).position().norm())
}

#[test]
fn a_scan_that_fits_badly_where_it_is_expected_and_nowhere_better_is_believed() {
    // Who turned, and turns no more; and who brakes in a bend.
    let driven = [Pose2::IDENTITY, Pose2::new(0.0, 0.0, 0.5), Pose2::new(-0.15, 0.05, -0.4)];
    for seed in 1..=10 {
        for aside in driven {
            let (report, off_m) = among_leaves(&World::room(), 1.0, aside, seed);
            assert!(!report.is_lost && off_m < 0.05, "{seed}: {aside:?}, {off_m} m");
        }
        let is_lost = |world: &World, seconds, aside| among_leaves(world, seconds, aside, seed).0.is_lost;
        assert!(is_lost(&World::room(), 0.2, Pose2::IDENTITY), "{seed}: the next one soon comes");
        assert!(is_lost(&World::room(), 1.0, Pose2::new(-0.3, 0.2, 0.0)), "{seed}: it leaps");
        assert!(is_lost(&World::corridor(), 1.0, Pose2::IDENTITY), "{seed}: elsewhere it is not");
    }
}

#[test]
fn who_is_lost_for_long_may_be_anywhere() {
    let is_found_after = |lost_scans: i64, every: usize| {
        let mut memory = Memory::new(2000);
        let mut odometry = memory.odometry(&LaserOdometryConfig::default());
        let mut rng = Pcg32::seed_from_u64(5);
        let mut step = |second: i64, change: &dyn Fn(usize, usize, &mut Echo)| {
            let mut beams = World::room().scan(Pose2::IDENTITY, 8.0, 0.01, &mut rng);
            let count = beams.len();
            beams.iter_mut().enumerate().for_each(|(index, beam)| change(index, count, &mut beam.echo));
            let scan = RangeScan { stamp: Instant::from_micros(1_000_000 * second), range_max_m: 8.0, beams: &beams };
            odometry.step(&scan, Pose2::IDENTITY, None).unwrap().is_lost
        };
        (0..30).for_each(|second| assert!(!step(second, &|_, _, _| {})));
        // People all about, who do not stand still.
        let crowd = |second: i64| {
            move |index: usize, _: usize, echo: &mut Echo| {
                *echo = Echo::Hit(0.5 + 0.04 * ((index as i64 * second) % 17) as f32);
            }
        };
        (30..30 + lost_scans).for_each(|second| assert!(step(second, &crowd(second))));
        !step(30 + lost_scans, &leaves(every))
    };
    assert!(is_found_after(3, 5), "seven tenths of the usual score");
    assert!(!is_found_after(6, 5) && is_found_after(6, 15), "rooms look alike");
}

/// A yard of 70 × 60 m with cars in it.
fn yard() -> World {
    let mut walls =
        World::polyline(&[(-30.0, -25.0), (40.0, -25.0), (40.0, 20.0), (30.0, 35.0), (-30.0, 35.0), (-30.0, -25.0)]);
    let mut rng = Pcg32::seed_from_u64(7);
    for _ in 0..60 {
        let (x, y) = (-25.0 + 60.0 * uniform(&mut rng), -22.0 + 50.0 * uniform(&mut rng));
        if y.abs() > 2.5 {
            let (w, h) = (1.5 + 3.0 * uniform(&mut rng), 1.5 + 2.0 * uniform(&mut rng));
            walls.0.extend(World::polyline(&[(x, y), (x + w, y), (x + w, y + h), (x, y + h), (x, y)]).0);
        }
    }
    walls
}

#[test]
fn who_is_under_way_already_is_followed_from_the_first_slow_scan_on() {
    let yard = yard();
    let at = |scan: i64| Pose2::new(0.9 * scan as f32, 0.0, 0.05 * (scan % 5) as f32);
    let is_followed = |seed: &u64| {
        let mut memory = Memory::new(2000);
        let mut odometry = memory.odometry(&LaserOdometryConfig::default());
        let mut rng = Pcg32::seed_from_u64(*seed);
        (0..8).all(|scan| {
            let beams = yard.scan(at(scan), 80.0, 0.1, &mut rng);
            let stamp = Instant::from_micros(1_000_000 * scan);
            let scan_there = RangeScan { stamp, range_max_m: 80.0, beams: &beams };
            let report = odometry.step(&scan_there, Pose2::IDENTITY, None).unwrap();
            let off_m = at(scan).between(report.matched.map_from_robot).position().norm();
            !report.is_lost && off_m < 0.3
        })
    };
    let followed = (1..=20).filter(is_followed).count();
    assert!(followed >= 10, "{followed} of 20");
}

/// After a drive round the room, with scans a second apart, ten of them in `world` from `there`, as seen from where the drive ended: how far from there
/// each is believed to be, m; `None` if it is not believed.
fn believed_in(config: &LaserOdometryConfig, world: &World, there: Pose2, seed: u64) -> Vec<Option<f32>> {
    let mut memory = Memory::new(2000);
    let mut odometry = memory.odometry(config);
    odometry.leave_returns();
    let mut rng = Pcg32::seed_from_u64(seed);
    let mut step = |scan: usize, world: &World, at: Pose2| {
        let beams = world.scan(at, 8.0, 0.01, &mut rng);
        let stamp = Instant::from_micros(1_000_000 * scan as i64);
        let scan = RangeScan { stamp, range_max_m: 8.0, beams: &beams };
        let report = odometry.step(&scan, Pose2::IDENTITY, None).unwrap();
        (!report.is_lost).then(|| at.between(report.matched.map_from_robot).position().norm())
    };
    (0..=120).for_each(|scan| assert!(step(scan, &World::room(), circle(scan)).is_some()));
    (121..=130).map(|scan| step(scan, world, circle(120) * there)).collect()
}

#[test]
fn between_slow_scans_too_who_is_carried_off_is_lost() {
    let other = World::polyline(&[(-3.0, -2.0), (4.0, -2.0), (4.0, 3.2), (-3.0, 3.2), (-3.0, -2.0)]);
    let config = LaserOdometryConfig::default();
    let mut lost = 0;
    for (turned, seed) in [-0.3, -0.2, -0.1, 0.0, 0.1, 0.2, 0.3, 0.4].into_iter().zip(1..) {
        let elsewhere = believed_in(&config, &other, Pose2::new(-1.2, 0.8, turned), seed);
        lost += usize::from(elsewhere.iter().all(Option::is_none));
        let thrown = believed_in(&config, &World::room(), Pose2::new(-2.0, 0.8, 1.8), seed);
        assert!(thrown.iter().all(Option::is_none), "no robot turns so besides: {thrown:?}");
    }
    assert!(lost >= 7, "{lost} of 8, in a room that is a metre smaller");
    let mut config = config;
    config.recovery.lost_share = 0.0;
    let elsewhere = believed_in(&config, &other, Pose2::new(-1.2, 0.8, 0.0), 4);
    assert!(elsewhere.iter().all(Option::is_some), "without a share nobody is lost");
}

/// By 1.4 m in a second, farther than the usual box reaches: half of the walls fit in it at a wrong place.
#[test]
fn who_leaps_between_slow_scans_is_found_where_it_is() {
    let config = LaserOdometryConfig::default();
    let is_found = |seed: &u64| {
        let there = Pose2::new(-1.2, 0.8, 0.035 * *seed as f32 - 0.3);
        believed_in(&config, &World::room(), there, *seed)
            .into_iter()
            .all(|off_m| off_m.is_some_and(|off_m| off_m < 0.1))
    };
    let found = (1..=20).filter(is_found).count();
    assert!(found >= 17, "{found} of 20");
}
