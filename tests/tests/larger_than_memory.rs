//! A building larger than the robot's memory: what the host has in the end is what a robot with memory for all of it tells, to the bit.

use lrfslam_core::robot::{LaserConfig, LaserFamily, RobotConfig};
use lrfslam_core::time::Duration;
use lrfslam_core::wire::message::{Status, ToRobot};
use lrfslam_firmware_sim::scenario::Scenario;
use lrfslam_firmware_sim::virtual_lrf::hokuyo::{HokuyoModel, VirtualHokuyo};
use lrfslam_tests::robot_rig::{Build, Disk, Life, LineFaults, PoolSize, RobotRig};

/// Until then the robot is configured.
const LASER_AT: Duration = Duration::from_millis(6000);
/// Once along the corridors of the floor, through a room and home.
const DRIVE: Duration = Duration::from_millis(150_000);

/// Tiles of the small memory.
const TILES: usize = 260;

/// One particle, whose tiles may all leave, with small squares and a view of 2 m: so a floor of 18 m is large.
fn config() -> RobotConfig {
    let laser = LaserConfig { family: LaserFamily::Hokuyo, baud: 0, cluster: 4 };
    let mut config = RobotConfig { laser, ..RobotConfig::default() };
    (config.de.population, config.de.generations) = (20, 15);
    (config.recovery.population, config.recovery.generations) = (40, 20);
    config.particles.particles = 1;
    config.particle_map.square_size_m = 0.05;
    config.rays.range_max_m = 2.0;
    config
}

/// What the host has, how the robot is, and most tiles that it had in use at a time.
///
/// * `is_alone` — the host is away while the robot drives, and so no tile leaves it
fn drive(tiles: usize, is_alone: bool, faults: LineFaults) -> (Life, Status, usize) {
    let scene = Box::new(Scenario::load("floor").expect("comes with the program").scene());
    let device = VirtualHokuyo::new(HokuyoModel::urg_04lx_ug01(), scene, 1);
    let memory = Box::new(move || Build::Standard.memory(&[PoolSize::Tiles(tiles)]));
    let mut rig = RobotRig::with(Disk::default(), memory, Box::new(device), &config());
    rig.set_faults(faults, 1);
    rig.start();
    rig.run_for(LASER_AT);
    if is_alone {
        rig.unplug_link();
    }
    rig.plug_laser(true);
    rig.run_for(DRIVE);
    rig.plug_laser(false);
    if is_alone {
        rig.plug_link();
    }
    rig.ask(&ToRobot::Stop);
    rig.run_until(|rig| rig.disk.lives.last().is_some_and(|life| life.map.is_complete()));
    rig.run_for(Duration::from_millis(1000));
    (rig.disk.lives.remove(0), rig.status, rig.tally.tiles)
}

#[test]
fn map_and_poses_are_those_of_a_robot_with_memory_for_all() {
    let (large, status, in_use) = drive(20_000, true, LineFaults::default());
    let tiles = large.map.tiles().len();
    assert_eq!((status.tiles_forgotten, status.dropped_particles), (0, 0));
    assert!(in_use >= tiles, "all of its map was in its memory");
    for faults in [LineFaults::default(), LineFaults::all(0.01)] {
        let (small, status, _) = drive(TILES, false, faults);
        assert!(TILES < tiles && status.tiles_left > 100 && status.tiles_restored > 20, "{tiles}, {status:?}");
        assert_eq!((status.tiles_forgotten, status.dropped_particles), (0, 0), "{status:?}");
        assert_eq!(small.map.scans().last(), large.map.scans().last(), "{faults:?}");
        assert!(small.map.tiles() == large.map.tiles(), "{faults:?}");
    }
}
