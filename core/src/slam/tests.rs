use super::*;
use crate::de::Member;
use crate::low_slam::LowSlamPools;
use crate::math::uniform;
use crate::ndt::{DirectoryEntry, NdtConfig, NdtTile};
use crate::scan::{Beam, Echo};
use crate::test_world::World;
use crate::time::Instant;
use core::f32::consts::PI;
use rand_core::SeedableRng;
use rand_pcg::Pcg32;
use std::boxed::Box;
use std::vec;
use std::vec::Vec;

/// Drives `path` through `world` and calls `observe` after every scan.
fn drive(
    world: &World,
    path: impl Iterator<Item = Pose2>,
    mut blind: impl FnMut(usize) -> bool,
    mut observe: impl FnMut(&Slam<'_, 8>, &StepReport, Pose2),
) {
    let (mut directory, mut tiles) =
        (vec![DirectoryEntry::default(); NdtConfig::DIRECTORIES_MAX * 128 * 128], vec![NdtTile::EMPTY; 1600]);
    let mut population = vec![Member::EMPTY; 300];
    let (mut points, mut hits) = (vec![Point2::default(); 200], vec![Point2::default(); 200]);
    let odometry = OdometryMemory {
        directory: &mut directory,
        tiles: &mut tiles,
        population: &mut population,
        points: &mut points,
        hits: &mut hits,
        key_points: &mut [],
        key_scans: &mut [],
    };
    let mut pools = Box::new(LowSlamPools::<TILE_SIDE, 3264, 1024, 32, 64, 32, 682, 1024>::EMPTY);
    let memory = SlamMemory { odometry, particles: pools.lend() };
    let mut slam = Slam::new(&SlamConfig::default(), 3, memory).unwrap();
    let mut rng = Pcg32::seed_from_u64(7);
    for (index, pose) in path.enumerate() {
        let beams: Vec<Beam> = if blind(index) {
            let noise = |beam: Beam| Beam { echo: Echo::Hit(1.0 + 5.0 * uniform(&mut rng)), ..beam };
            world.scan(pose, 8.0, 0.01, &mut Pcg32::seed_from_u64(0)).into_iter().map(noise).collect()
        } else {
            world.scan(pose, 8.0, 0.01, &mut rng)
        };
        let scan = RangeScan { stamp: Instant::from_micros(index as i64 * 100_000), range_max_m: 8.0, beams: &beams };
        let report = slam.step(&scan, Pose2::IDENTITY).unwrap();
        observe(&slam, &report, pose);
    }
}

fn circle(step: usize) -> Pose2 {
    let angle = 2.0 * PI * step as f32 / 120.0;
    Pose2::new(libm::sinf(angle), 1.0 - libm::cosf(angle), angle)
}

#[test]
fn the_best_particle_stays_with_the_robot_and_the_filter_rests_between_its_steps() {
    let (mut steps, mut scans, mut worst) = (0, 0, 0.0_f32);
    drive(
        &World::room(),
        (0..240).map(circle),
        |_| false,
        |slam, report, pose| {
            scans += 1;
            steps += u32::from(report.filter.is_some());
            let best = report.filter.map(|filter| slam.filter().particles()[filter.best].map_from_robot);
            assert!(best.is_none_or(|best| best == report.map_from_robot));
            worst = worst.max((report.map_from_robot.position() - pose.position()).norm());
        },
    );
    // 5.2 cm and 3° a scan: every second one.
    assert_eq!((scans, steps), (240, 120));
    assert!(worst < 0.05, "off by up to {worst} m");
}

#[test]
fn the_best_particles_map_says_what_is_free_and_what_is_not() {
    // Where the robot drives, and beyond; walls, the pillar and the back of the alcove; outside of the room and inside of the pillar.
    let free = [(0.0, 0.0), (0.0, 2.0), (-2.5, 3.5), (4.5, 3.5), (5.5, 1.6)];
    let occupied = [(0.0, -2.0), (-3.0, 1.0), (2.0, 4.0), (5.0, 0.0), (6.5, 1.6), (1.5, 2.2)];
    let unknown = [(0.0, -2.5), (-4.0, 0.0), (6.0, 3.0), (1.8, 2.2), (f32::NAN, 0.0), (1e9, 0.0)];
    let mut wrong = vec![];
    let path = (0..120).map(circle);
    drive(
        &World::room(),
        path,
        |_| false,
        |slam, report, _| {
            assert_eq!(slam.filter().particles()[slam.best()].map_from_robot, slam.map_from_best, "{report:?}");
            // A wall lies in one square or in the one beside it.
            let about = |(x, y): (f32, f32)| {
                let near = [(0.0, 0.0), (0.06, 0.0), (-0.06, 0.0), (0.0, 0.06), (0.0, -0.06)];
                near.map(|(dx, dy)| slam.occupancy_at(Point2::new(x + dx, y + dy)))
            };
            wrong = free.into_iter().filter(|at| about(*at) != [Occupancy::Free; 5]).collect();
            wrong.extend(occupied.into_iter().filter(|at| !about(*at).contains(&Occupancy::Occupied)));
            wrong.extend(unknown.into_iter().filter(|at| about(*at) != [Occupancy::Unknown; 5]));
        },
    );
    assert!(wrong.is_empty(), "{wrong:?}");
}

/// Standard deviations of the particles' positions along x and y.
fn spread(slam: &Slam<'_, 8>) -> (f32, f32) {
    let particles = slam.filter().particles();
    let n = particles.len() as f32;
    let deviation = |of: fn(Pose2) -> f32| {
        let mean = particles.iter().map(|p| of(p.map_from_robot)).sum::<f32>() / n;
        let squares = particles.iter().map(|p| (of(p.map_from_robot) - mean) * (of(p.map_from_robot) - mean));
        libm::sqrtf(squares.sum::<f32>() / n)
    };
    (deviation(|pose| pose.x), deviation(|pose| pose.y))
}

#[test]
fn in_a_corridor_particles_spread_along_it_and_in_a_room_they_do_not() {
    // Boxes where the robot starts, none from 4 m on.
    let mut world = World::corridor();
    world.0.extend(World::polyline(&[(3.0, -1.0), (3.0, -0.6), (3.6, -0.6), (3.6, -1.0)]).0);
    world.0.extend(World::polyline(&[(1.0, 0.9), (1.0, 0.5), (1.7, 0.5), (1.7, 0.9)]).0);
    let along = (0..120).map(|step| Pose2::new(0.1 * step as f32, 0.0, 0.0));
    let mut corridor = (0.0, 0.0);
    drive(&world, along, |_| false, |slam, _, _| corridor = spread(slam));
    assert!(corridor.0 > 0.02 && corridor.1 < 0.01, "{corridor:?}");
    let mut room = (0.0, 0.0);
    drive(&World::room(), (0..120).map(circle), |_| false, |slam, _, _| room = spread(slam));
    assert!(room.0 < 0.01 && room.1 < 0.01, "{room:?}");
}

#[test]
fn scans_that_are_not_believed_are_not_shown_to_the_filter() {
    let (mut lost, mut last_error) = (0, 0.0);
    drive(
        &World::room(),
        (0..120).map(circle),
        |index| (50..54).contains(&index),
        |_, report, pose| {
            assert!(!report.odometry.is_lost || report.filter.is_none());
            lost += u32::from(report.odometry.is_lost);
            last_error = (report.map_from_robot.position() - pose.position()).norm();
        },
    );
    assert!((1..=10).contains(&lost), "{lost} scans lost");
    assert!(last_error < 0.05, "off by {last_error} m at the end");
}
