use super::*;
use crate::scan::Echo;
use crate::test_world::World;
use crate::time::Instant;
use core::f32::consts::PI;
use rand_core::SeedableRng;
use rand_pcg::Pcg32;

/// Owns what an odometry borrows.
pub(super) struct Memory {
    directory: Vec<DirectoryEntry>,
    tiles: Vec<NdtTile>,
    population: Vec<Member<3>>,
    points: Vec<Point2>,
    hits: Vec<Point2>,
    key_points: Vec<Point2>,
    key_scans: Vec<KeyScan>,
}

impl Memory {
    pub(super) fn new(tiles: usize) -> Self {
        Self {
            directory: vec![DirectoryEntry::default(); NdtConfig::DIRECTORIES_MAX * 128 * 128],
            tiles: vec![NdtTile::EMPTY; tiles],
            population: vec![Member::EMPTY; 300],
            points: vec![Point2::default(); 200],
            hits: vec![Point2::default(); 200],
            key_points: vec![Point2::default(); 2000],
            key_scans: vec![KeyScan::default(); 10],
        }
    }

    pub(super) fn odometry(&mut self, config: &LaserOdometryConfig) -> LaserOdometry<'_> {
        let lent = OdometryMemory {
            directory: &mut self.directory,
            tiles: &mut self.tiles,
            population: &mut self.population,
            points: &mut self.points,
            hits: &mut self.hits,
            key_points: &mut self.key_points,
            key_scans: &mut self.key_scans,
        };
        LaserOdometry::new(config, 1, lent).unwrap()
    }
}

fn with_reference(reference: Reference) -> LaserOdometryConfig {
    LaserOdometryConfig { odometry: OdometryConfig { reference, ..Default::default() }, ..Default::default() }
}

/// Round the room in 120 scans, a full circle of 1 m radius.
pub(super) fn circle(step: usize) -> Pose2 {
    let angle = 2.0 * PI * step as f32 / 120.0;
    Pose2::new(libm::sinf(angle), 1.0 - libm::cosf(angle), angle)
}

/// Drives `path` through the room and returns the robot's final pose with the last report.
pub(super) fn drive(
    odometry: &mut LaserOdometry<'_>,
    path: impl Iterator<Item = Pose2>,
    robot_from_lrf: Pose2,
    seed: u64,
) -> (Pose2, Vec<OdometryReport>) {
    let world = World::room();
    let mut rng = Pcg32::seed_from_u64(seed);
    let mut reports = Vec::new();
    for map_from_robot in path {
        let beams = world.scan(map_from_robot * robot_from_lrf, 8.0, 0.01, &mut rng);
        let scan = RangeScan { stamp: Instant::default(), range_max_m: 8.0, beams: &beams };
        reports.push(odometry.step(&scan, robot_from_lrf, None).unwrap());
    }
    (odometry.map_from_robot(), reports)
}

#[test]
fn a_circle_closes_against_every_reference() {
    for (reference, tolerance_m) in
        [(Reference::WholeMap, 0.03), (Reference::RecentScans, 0.15), (Reference::PreviousScan, 0.4)]
    {
        for seed in 0..3 {
            let mut memory = Memory::new(2000);
            let mut odometry = memory.odometry(&with_reference(reference));
            let (end, reports) = drive(&mut odometry, (0..=120).map(circle), Pose2::IDENTITY, seed);
            assert!(end.position().norm() < tolerance_m, "{reference:?} seed {seed} ends at {end:?}");
            assert!(reports.iter().all(|r| !r.is_lost && r.inserted.dropped == 0));
        }
    }
}

#[test]
fn the_path_is_the_robots_and_not_the_lasers() {
    // Turning on the spot moves a laser that sits 0.4 m ahead on a circle; the robot stays.
    let robot_from_lrf = Pose2::new(0.4, -0.1, 0.3);
    let mut memory = Memory::new(2000);
    let mut odometry = memory.odometry(&LaserOdometryConfig::default());
    let turn = (0..60).map(|i| Pose2::new(0.0, 0.0, 0.08 * i as f32));
    let (end, _) = drive(&mut odometry, turn, robot_from_lrf, 1);
    let truth = Pose2::new(0.0, 0.0, 0.08 * 59.0);
    let error = truth.between(end);
    assert!(error.position().norm() < 0.03 && error.heading.abs() < 0.01, "{error:?}");
}

#[test]
fn a_standing_robot_does_not_drift() {
    let mut memory = Memory::new(2000);
    let mut odometry = memory.odometry(&LaserOdometryConfig::default());
    let (_, reports) = drive(&mut odometry, (0..300).map(|_| Pose2::IDENTITY), Pose2::IDENTITY, 1);
    let mean = |part: &[OdometryReport], of: fn(Pose2) -> f32| {
        part.iter().map(|r| of(r.matched.map_from_robot)).sum::<f32>() / part.len() as f32
    };
    let drift = |of| mean(&reports[250..], of) - mean(&reports[1..51], of);
    let (x, y, heading) = (drift(|p| p.x), drift(|p| p.y), drift(|p| p.heading).to_degrees());
    assert!(x.abs() < 0.003 && y.abs() < 0.003 && heading.abs() < 0.05, "{x} m {y} m {heading} deg");
    assert!(reports.iter().all(|r| r.matched.map_from_robot.position().norm() < 0.03));
    assert_eq!(reports.iter().filter(|r| r.is_key).count(), 10, "standing adds no more than the first scans");
}

/// With few beams in a hall all hits are far apart: drawn at no time before it moves there would be nothing to be matched with, drawn
/// with each scan they would be spots that go with the robot.
#[test]
fn far_hits_are_drawn_once_while_the_robot_stands() {
    let hall = [(-14.2, -10.9), (13.8, -10.9), (13.8, 3.1), (16.8, 3.1), (16.8, 11.1), (-14.2, 11.1), (-14.2, -10.9)];
    let hall = World::polyline(&hall);
    let mut rng = Pcg32::seed_from_u64(3);
    let few = |pose, noise_m, rng: &mut Pcg32| -> Vec<crate::scan::Beam> {
        hall.scan(pose, 30.0, noise_m, rng).into_iter().step_by(8).collect()
    };
    let mut memory = Memory::new(4000);
    let mut odometry = memory.odometry(&LaserOdometryConfig::default());
    let mut step = |odometry: &mut LaserOdometry<'_>, scan_index: i32| {
        let pose = Pose2::new(0.1 * (scan_index - 10).max(0) as f32, 0.0, 0.0);
        let beams = few(pose, 0.01, &mut rng);
        let stamp = Instant::from_micros(200_000 * i64::from(scan_index));
        let report =
            odometry.step(&RangeScan { stamp, range_max_m: 30.0, beams: &beams }, Pose2::IDENTITY, None).unwrap();
        let error = pose.between(report.matched.map_from_robot);
        assert!(!report.is_lost && error.position().norm() < 0.05, "scan {scan_index}: {error:?}");
    };
    (0..=10).for_each(|scan_index| step(&mut odometry, scan_index));
    for beam in few(Pose2::IDENTITY, 0.0, &mut Pcg32::seed_from_u64(1)) {
        let Echo::Hit(range_m) = beam.echo else { panic!("the hall has walls all round") };
        let hit = Point2::new(range_m * libm::cosf(beam.bearing_rad), range_m * libm::sinf(beam.bearing_rad));
        assert!(!odometry.ndt.is_seen_at(hit), "drawn more than once: {hit:?}");
    }
    (11..80).for_each(|scan_index| step(&mut odometry, scan_index));
}

/// Somebody covers the laser for so long, and stands in nearly half of its view then. Returns whether the robot is lost.
fn is_lost_after(covered_ms: i64) -> bool {
    let mut memory = Memory::new(2000);
    let mut odometry = memory.odometry(&LaserOdometryConfig::default());
    let mut rng = Pcg32::seed_from_u64(3);
    let mut step = |at: i64, pose: Pose2, beside: core::ops::Range<usize>, beside_m: f32| {
        let mut beams = World::room().scan(pose, 8.0, 0.01, &mut rng);
        beams.get_mut(beside).unwrap().iter_mut().for_each(|beam| beam.echo = Echo::Hit(beside_m));
        let scan = RangeScan { stamp: Instant::from_micros(1000 * at), range_max_m: 8.0, beams: &beams };
        odometry.step(&scan, Pose2::IDENTITY, None).unwrap()
    };
    let drive: Vec<Pose2> = (0..=120).map(circle).collect();
    let stops = *drive.last().unwrap();
    for (scan, pose) in drive.into_iter().enumerate() {
        assert!(!step(200 * scan as i64, pose, 0..0, 0.0).is_lost);
    }
    let covered = (1..=covered_ms / 200).map(|scan| 200 * (120 + scan)).collect::<Vec<_>>();
    for at in &covered {
        assert!(step(*at, stops, 0..181, 0.1).is_blind);
    }
    step(covered.last().unwrap() + 200, stops, 50..130, 1.2).is_lost
}

#[test]
fn a_robot_that_was_covered_for_a_moment_is_still_about_there() {
    assert!(!is_lost_after(600), "a good half of a scan is enough near where it was");
    assert!(is_lost_after(8000), "and too few where it may be anywhere");
}

#[test]
fn a_few_hits_beside_a_cover_do_not_say_that_the_robot_is_elsewhere() {
    for first in 0..15 {
        let mut memory = Memory::new(2000);
        let mut odometry = memory.odometry(&LaserOdometryConfig::default());
        let (from, _) = drive(&mut odometry, (0..=120).map(circle), Pose2::IDENTITY, 2);
        let mut beams = World::room().scan(from * Pose2::new(0.3, 0.0, 0.6), 8.0, 0.01, &mut Pcg32::seed_from_u64(3));
        let seen = 12 * first..12 * first + 10;
        for (_, beam) in beams.iter_mut().enumerate().filter(|(index, _)| !seen.contains(index)) {
            beam.echo = Echo::Hit(0.2);
        }
        let scan = RangeScan { stamp: Instant::default(), range_max_m: 8.0, beams: &beams };
        let report = odometry.step(&scan, Pose2::IDENTITY, None).unwrap();
        let moved = report.predicted.between(report.matched.map_from_robot);
        assert!(moved.heading.abs() < 0.7 && moved.position().norm() < 1.1, "{first}: {moved:?}");
    }
}

/// A square of 0.4 m about a point.
fn somebody(x: f32) -> World {
    let (left, right) = (x - 0.2, x + 0.2);
    World::polyline(&[(left, 0.1), (right, 0.1), (right, 0.5), (left, 0.5), (left, 0.1)])
}

/// Where somebody stood, another one comes by later and walks towards the robot. Nothing else tells where it is in its corridor.
#[cfg(feature = "witnesses")]
#[test]
fn who_comes_towards_the_robot_does_not_draw_it_along_a_corridor() {
    const STEP_M: f32 = 0.08;
    let mut memory = Memory::new(4000);
    let mut odometry = memory.odometry(&LaserOdometryConfig::default());
    let mut rng = Pcg32::seed_from_u64(3);
    let step = |at: i32| {
        let pose = Pose2::new(STEP_M * at as f32, 0.0, 0.0);
        let mut world = World::corridor();
        // Pillars, until the robot has passed them.
        for (x, wall, y) in [(0.8, -1.03, -0.5), (1.5, 0.97, 0.5), (2.6, -1.03, -0.6), (3.4, 0.97, 0.6)] {
            world.0.extend(World::polyline(&[(x, wall), (x, y), (x + 0.5, y), (x + 0.5, wall)]).0);
        }
        // The last beams that reach so far have passed what the first one has left in the map.
        let comes = 13.0 - 0.16 * (at - 65) as f32;
        world.0.extend(somebody(if at < 45 { 10.5 } else { comes }).0);
        let beams = world.scan(pose, 8.0, 0.01, &mut rng);
        let scan = RangeScan { stamp: Instant::from_micros(200_000 * i64::from(at)), range_max_m: 8.0, beams: &beams };
        odometry.step(&scan, Pose2::IDENTITY, None).unwrap().matched.map_from_robot.x
    };
    let way: Vec<f32> = (0..110).map(step).collect();
    let steps = way.windows(2).map(|pair| pair[1] - pair[0]).skip(60);
    let drawn_m = steps.map(|step_m| (step_m - STEP_M).abs()).fold(0.0, f32::max);
    assert!(drawn_m < 0.01, "by {drawn_m} m from one scan to the next");
}

/// Scans most of a metre apart: out of a room's door, nearly all that is seen is the corridor.
#[cfg(feature = "witnesses")]
#[test]
fn who_goes_through_a_door_is_not_lost() {
    let mut world = World::polyline(&[(5.0, -0.3), (5.0, -2.0), (-3.0, -2.0), (-3.0, 4.0), (5.0, 4.0), (5.0, 0.3)]);
    world.0.extend(World::polyline(&[(1.5, 2.0), (2.1, 2.0), (2.1, 2.4), (1.5, 2.4), (1.5, 2.0)]).0);
    world.0.extend(World::polyline(&[(5.0, -2.0), (5.0, -9.0), (7.0, -9.0), (7.0, 2.0), (8.0, 2.0), (8.0, 3.0)]).0);
    world.0.extend(
        World::polyline(&[(8.0, 3.0), (7.0, 3.0), (7.0, 5.0), (7.5, 5.0), (7.5, 7.0), (5.0, 7.0), (5.0, 4.0)]).0,
    );
    let mut memory = Memory::new(4000);
    let mut odometry = memory.odometry(&LaserOdometryConfig::default());
    let mut rng = Pcg32::seed_from_u64(3);
    let in_the_room = (0..7).map(|at| Pose2::new(0.6 * at as f32, 0.0, 0.0));
    let on = [(4.4, 0.0, 0.0), (5.3, 0.1, 0.65), (5.7, 0.7, 1.2), (5.9, 1.5, 1.5), (6.0, 2.4, 1.6)];
    let path = in_the_room.chain(on.map(|(x, y, heading)| Pose2::new(x, y, heading)));
    for (second, pose) in path.enumerate() {
        let beams = world.scan(pose, 8.0, 0.01, &mut rng);
        let stamp = Instant::from_micros(1_000_000 * second as i64);
        let scan = RangeScan { stamp, range_max_m: 8.0, beams: &beams };
        let report = odometry.step(&scan, Pose2::IDENTITY, None).unwrap();
        let error = pose.between(report.matched.map_from_robot);
        assert!(!report.is_lost && error.position().norm() < 0.15 && error.heading.abs() < 0.03, "{second}: {error:?}");
    }
}

#[test]
fn odometry_given_is_the_prediction() {
    let mut memory = Memory::new(2000);
    let mut odometry = memory.odometry(&LaserOdometryConfig::default());
    let world = World::room();
    let mut rng = Pcg32::seed_from_u64(1);
    let moved = Pose2::new(0.9, -0.4, 0.6);
    for (pose, displacement) in [(Pose2::IDENTITY, None), (moved, Some(moved))] {
        let beams = world.scan(pose, 8.0, 0.01, &mut rng);
        let scan = RangeScan { stamp: Instant::default(), range_max_m: 8.0, beams: &beams };
        let report = odometry.step(&scan, Pose2::IDENTITY, displacement).unwrap();
        assert_eq!(report.predicted, pose);
    }
    assert!(moved.between(odometry.map_from_robot()).position().norm() < 0.05);
}

#[test]
fn little_memory_is_reported_and_survived() {
    let mut memory = Memory::new(12);
    let mut odometry = memory.odometry(&LaserOdometryConfig::default());
    let (end, reports) = drive(&mut odometry, (0..60).map(circle), Pose2::IDENTITY, 1);
    assert!(reports.iter().any(|r| r.inserted.dropped > 0));
    assert!(end.is_finite());
    memory.points.truncate(20);
    let mut odometry = memory.odometry(&LaserOdometryConfig::default());
    let mut rng = Pcg32::seed_from_u64(1);
    let beams = World::room().scan(Pose2::IDENTITY, 8.0, 0.01, &mut rng);
    let scan = RangeScan { stamp: Instant::default(), range_max_m: 8.0, beams: &beams };
    assert_eq!(odometry.step(&scan, Pose2::IDENTITY, None).unwrap_err(), PointCapacityError { capacity: 20 });
}

#[test]
fn a_moving_window_of_scans_gives_its_tiles_back() {
    let mut memory = Memory::new(400);
    // Room for fewer scans than are asked for.
    memory.key_scans.truncate(3);
    let mut odometry = memory.odometry(&with_reference(Reference::RecentScans));
    let (_, reports) = drive(&mut odometry, (0..=480).map(circle), Pose2::IDENTITY, 1);
    assert!(reports.iter().all(|r| r.inserted.dropped == 0));
}

/// Each beam is measured where the turning robot is at the beam's time, over the whole interval from scan to scan.
#[test]
fn a_sweep_on_the_move_is_straightened_and_the_correction_does_not_feed_on_itself() {
    let world = World::room();
    let mut rng = Pcg32::seed_from_u64(4);
    let mut memory = Memory::new(2000);
    let mut odometry = memory.odometry(&LaserOdometryConfig::default());
    let turn = 0.08_f32;
    let mut headings = Vec::new();
    for scan_index in 0..80 {
        let mut beams = world.scan(Pose2::IDENTITY, 8.0, 0.0, &mut rng);
        for (i, beam) in beams.iter_mut().enumerate() {
            let part = i as f32 / 181.0;
            let map_from_robot = Pose2::new(0.0, 0.0, turn * (scan_index as f32 + part));
            let range = world.range(map_from_robot * Pose2::new(0.0, 0.0, beam.bearing_rad)).unwrap_or(f32::INFINITY);
            beam.echo = crate::scan::Echo::from_range(range + 0.01 * crate::math::normal(&mut rng), 8.0);
            beam.offset = Duration::from_micros((part * 1e5) as i64);
        }
        let scan = RangeScan { stamp: Instant::from_micros(scan_index * 100_000), range_max_m: 8.0, beams: &beams };
        let report = odometry.step(&scan, Pose2::IDENTITY, None).unwrap();
        headings.push(report.matched.map_from_robot.heading);
    }
    let steps = headings[20..].windows(2).map(|w| crate::math::wrap_angle(w[1] - w[0]));
    let worst = steps.map(|step| (step - turn).abs()).fold(0.0, f32::max);
    assert!(worst.to_degrees() < 1.0, "a step is {} deg off", worst.to_degrees());
}

#[test]
fn same_seed_same_bits() {
    let run = || {
        let mut memory = Memory::new(2000);
        let mut odometry = memory.odometry(&LaserOdometryConfig::default());
        drive(&mut odometry, (0..40).map(circle), Pose2::IDENTITY, 7).0
    };
    let (a, b) = (run(), run());
    assert_eq!(
        (a.x.to_bits(), a.y.to_bits(), a.heading.to_bits()),
        (b.x.to_bits(), b.y.to_bits(), b.heading.to_bits())
    );
}

/// Every bit of a drive, so that a difference between debug and release, one machine and another, or this crate built alone
/// and together with std does not go unnoticed. A change of the algorithm changes it; then put the new value here.
#[test]
fn fingerprint_of_a_drive_is_the_same_everywhere() {
    let mut memory = Memory::new(2000);
    let mut odometry = memory.odometry(&LaserOdometryConfig::default());
    let (_, reports) = drive(&mut odometry, (0..40).map(circle), Pose2::new(0.1, 0.0, 0.02), 2011);
    let fnv = |hash: u64, word: u32| (hash ^ u64::from(word)).wrapping_mul(0x0100_0000_01b3);
    let fingerprint = reports.iter().fold(0xcbf2_9ce4_8422_2325, |hash, report| {
        let Match { map_from_robot: pose, score, .. } = report.matched;
        [pose.x, pose.y, pose.heading, score].iter().fold(hash, |hash, number| fnv(hash, number.to_bits()))
    });
    assert_eq!(fingerprint, 0x35c3_1878_527b_2943, "{fingerprint:#018x}");
}
