//! The robot link end to end on bad lines: what the host has in the end is what it has on a good one, to the bit.
//!
//! Robot and laser see the same in all runs; only the line between robot and host differs.

use lrfslam_core::time::Duration;
use lrfslam_firmware_sim::scenario::Scenario;
use lrfslam_firmware_sim::virtual_lrf::hokuyo::{HokuyoModel, VirtualHokuyo};
use lrfslam_host::robot::Tiles;
use lrfslam_robot::wire::message::{ScanPose, Segment, ToRobot};
use lrfslam_robot::{LaserConfig, LaserFamily, RobotConfig};
use lrfslam_tests::robot_rig::{Life, LineFaults, RobotRig};

/// Until then the robot is configured, whatever the line does.
pub const LASER_AT: Duration = Duration::from_millis(6000);
/// From plugging the laser in to plugging it out: some 170 scans.
pub const DRIVE: Duration = Duration::from_millis(20_000);
const QUARTER: Duration = Duration::from_millis(5000);

/// A search that is done in a tenth of the time of the default one.
pub fn config() -> RobotConfig {
    let laser = LaserConfig { family: LaserFamily::Hokuyo, baud: 0, cluster: 2 };
    let mut config = RobotConfig { laser, ..RobotConfig::default() };
    (config.slam.de.population, config.slam.de.generations) = (20, 15);
    (config.slam.recovery.population, config.slam.recovery.generations) = (40, 20);
    config
}

fn rig(faults: LineFaults, seed: u64) -> RobotRig {
    let scene = Box::new(Scenario::load("floor").expect("comes with the program").scene());
    let device = VirtualHokuyo::new(HokuyoModel::urg_04lx_ug01(), scene, 1);
    let mut rig = RobotRig::new(Box::new(device), &config(), faults, seed);
    rig.run_for(LASER_AT);
    rig
}

/// Plugs the laser out, and has the robot tell all of its map.
pub fn finish(rig: &mut RobotRig) {
    rig.plug_laser(false);
    rig.ask(&ToRobot::Stop);
    rig.run_until(|rig| rig.disk.lives.last().is_some_and(|life| life.map.is_complete()));
}

fn drive(rig: &mut RobotRig) {
    rig.plug_laser(true);
    rig.run_for(DRIVE);
    finish(rig);
}

/// All that was told of path and map.
type Result<'l> = (&'l [ScanPose], &'l [Segment], &'l Tiles, &'l [usize]);

fn result(life: &Life) -> Result<'_> {
    (life.map.scans(), &life.segments, life.map.tiles(), &life.sweeps)
}

fn check_order(life: &Life) {
    let first = life.numbers[0];
    let expected: Vec<u32> = (first..first + life.numbers.len() as u32).collect();
    assert_eq!(life.numbers, expected, "every message once and in order");
}

pub fn check_same(life: &Life, wanted: &Life) {
    check_order(life);
    assert_eq!(life.map.missing_scans(), 0);
    assert!(life.map.is_from_start());
    assert!(result(life) == result(wanted), "path, segments, map and scans are those of the good line");
    assert_eq!(life.map.path(), wanted.map.path());
}

pub fn good() -> Life {
    let mut rig = rig(LineFaults::default(), 1);
    drive(&mut rig);
    assert_eq!((rig.faults(), rig.host_counters().frames.damaged, rig.disk.lives.len()), (0, 0, 1));
    let life = rig.disk.lives.remove(0);
    let (scans, segments, tiles, sweeps) = result(&life);
    println!(
        "{} scans, {} segments, {} tiles, {} scans with beams",
        scans.len(),
        segments.len(),
        tiles.len(),
        sweeps.len()
    );
    assert!(scans.len() > 150 && segments.len() > 30 && tiles.len() > 50 && sweeps.len() > 50);
    assert_eq!(life.map.path().len(), scans.len());
    check_order(&life);
    life
}

#[test]
fn a_bad_line_changes_nothing() {
    let wanted = good();
    let chance = 0.01;
    let none = LineFaults::default();
    let alone = [
        LineFaults { flip: chance, ..none },
        LineFaults { lose_byte: chance, ..none },
        LineFaults { double_byte: chance, ..none },
        LineFaults { lose: chance, ..none },
        LineFaults { double: chance, ..none },
    ];
    let all = [LineFaults::all(chance); 3];
    for (seed, faults) in alone.into_iter().chain(all).enumerate() {
        let mut rig = rig(faults, seed as u64);
        drive(&mut rig);
        println!("{faults:?}: {} faults, {:?}", rig.faults(), rig.host_counters());
        assert!(rig.faults() > 0);
        check_same(&rig.disk.lives[0], &wanted);
    }
}

/// It has stored what it acknowledged, and goes on there; the robot keeps the rest meanwhile.
#[test]
fn a_host_that_is_killed_and_started_again_misses_nothing() {
    let wanted = good();
    for seed in 1..=3 {
        let mut rig = rig(LineFaults::all(0.01), seed);
        rig.plug_laser(true);
        for _ in 0..3 {
            rig.run_for(QUARTER);
            rig.kill_host();
            rig.run_for(Duration::from_millis(100));
            rig.start_host(true);
        }
        rig.run_for(Duration::from_micros(DRIVE.micros - 3 * (QUARTER.micros + 100_000)));
        finish(&mut rig);
        check_order(&rig.disk.lives[0]);
        let (life, wanted) = (&rig.disk.lives[0], &wanted);
        // To a host that was started anew one scan more is told with its beams, since it may have lost its disk.
        assert!((0..=3).contains(&(life.sweeps.len() - wanted.sweeps.len())), "{} scans with beams", life.sweeps.len());
        let wanted = Life { sweeps: life.sweeps.clone(), ..wanted.clone() };
        check_same(life, &wanted);
        assert_eq!(rig.disk.lives.len(), 1);
    }
}

/// What an earlier run has acknowledged is gone; everything from there on is here, and the map is whole in the end.
#[test]
fn a_host_without_memory_has_the_path_from_where_it_came_and_the_whole_map() {
    let wanted = good();
    let mut rig = rig(LineFaults::all(0.01), 7);
    rig.plug_laser(true);
    rig.run_for(Duration::from_millis(9000));
    rig.kill_host();
    rig.start_host(false);
    rig.run_for(Duration::from_millis(11_000));
    finish(&mut rig);
    let life = &rig.disk.lives[0];
    check_order(life);
    assert_eq!((life.map.missing_scans(), life.map.is_from_start()), (0, false));
    let (scans, segments, tiles, _) = result(life);
    assert!(scans.len() > 20 && wanted.map.scans().ends_with(scans), "{} scans", scans.len());
    assert!(segments.len() > 4 && wanted.segments.ends_with(segments));
    assert_eq!(tiles, wanted.map.tiles());
    let (path, whole) = (life.map.path(), wanted.map.path());
    // Those of its first scans that belong to a step before are led back to by laser odometry.
    let known = path.len() - 10;
    assert!(known > 20 && whole.ends_with(&path[10..]), "{known} poses");
}

/// What was acknowledged of its first life is here and stays; its second life is a map of its own, the same as on a good line.
#[test]
fn a_robot_that_is_reset_begins_a_map_of_its_own() {
    let lives = |faults, seed| {
        let mut rig = rig(faults, seed);
        rig.plug_laser(true);
        rig.run_for(Duration::from_millis(9000));
        rig.reset_robot();
        rig.run_for(LASER_AT);
        drive(&mut rig);
        assert_eq!(rig.disk.lives.len(), 2, "{:?}", rig.disk.said);
        rig.disk.lives
    };
    let wanted = lives(LineFaults::default(), 1);
    for seed in 1..=3 {
        let lives = lives(LineFaults::all(0.01), seed);
        check_order(&lives[0]);
        let (before, wanted_before) = (&lives[0].map, &wanted[0].map);
        let common = before.scans().len().min(wanted_before.scans().len());
        assert!(common > 15 && before.scans()[..common] == wanted_before.scans()[..common]);
        let (told, wanted_told) = (&lives[0].segments, &wanted[0].segments);
        let common = told.len().min(wanted_told.len());
        assert!(common > 2 && told[..common] == wanted_told[..common]);
        check_same(&lives[1], &wanted[1]);
    }
}

/// The queue of 16 KiB is full after some seconds: segments are joined, scans' poses are lost, and both are said.
#[test]
fn an_absent_host_is_told_what_it_has_missed() {
    let wanted = good();
    let mut rig = rig(LineFaults::default(), 1);
    rig.plug_laser(true);
    rig.run_for(Duration::from_millis(6000));
    rig.kill_host();
    rig.run_for(Duration::from_millis(10_000));
    rig.start_host(true);
    rig.run_for(Duration::from_millis(4000));
    finish(&mut rig);
    let life = &rig.disk.lives[0];
    check_order(life);
    println!("{} of {} scans, {:?}", life.map.scans().len(), wanted.map.scans().len(), rig.status);
    assert_eq!(life.map.missing_scans() as usize, wanted.map.scans().len() - life.map.scans().len());
    assert!(life.map.missing_scans() > 0 || rig.status.untold_sweeps > 0, "the queue was never full");
    // The path still leads from the first step to the last, and ends where it ends on a good line.
    assert!(life.map.is_from_start());
    assert_eq!(life.map.path().len(), life.map.scans().len());
    let end = |life: &Life| life.map.path().last().copied();
    assert_eq!(end(life), end(&wanted));
    assert_eq!(life.map.tiles(), wanted.map.tiles());
}
