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

/// Four particles that see 2 m, so that a floor of 18 m is large.
fn config() -> RobotConfig {
    let laser = LaserConfig { family: LaserFamily::Hokuyo, baud: 0, cluster: 4 };
    let mut config = RobotConfig { laser, ..RobotConfig::default() };
    (config.de.population, config.de.generations) = (20, 15);
    (config.recovery.population, config.recovery.generations) = (40, 20);
    config.particles.particles = 4;
    config.rays.range_max_m = 2.0;
    config
}

fn drive(tiles: usize, faults: LineFaults) -> (Life, Status) {
    let scene = Box::new(Scenario::load("floor").expect("comes with the program").scene());
    let device = VirtualHokuyo::new(HokuyoModel::urg_04lx_ug01(), scene, 1);
    let memory = Box::new(move || Build::Standard.memory(&[PoolSize::Tiles(tiles)]));
    let mut rig = RobotRig::with(Disk::default(), memory, Box::new(device), &config());
    rig.set_faults(faults, 1);
    rig.start();
    rig.run_for(LASER_AT);
    rig.plug_laser(true);
    rig.run_for(DRIVE);
    rig.plug_laser(false);
    rig.ask(&ToRobot::Stop);
    rig.run_until(|rig| rig.disk.lives.last().is_some_and(|life| life.map.is_complete()));
    (rig.disk.lives.remove(0), rig.status)
}

#[test]
fn map_and_path_are_those_of_a_robot_with_more_memory() {
    let (large, status) = drive(20_000, LineFaults::default());
    assert_eq!((status.tiles_forgotten, status.dropped_particles), (0, 0));
    assert!(large.map.tiles().len() > 200, "{} tiles", large.map.tiles().len());
    for faults in [LineFaults::default(), LineFaults::all(0.01)] {
        let (small, status) = drive(450, faults);
        assert!(status.tiles_left > 100 && status.tiles_restored > 20, "{status:?}");
        assert_eq!((status.tiles_forgotten, status.dropped_particles), (0, 0), "{status:?}");
        assert!(small.map.scans() == large.map.scans() && small.map.segments() == large.map.segments(), "{faults:?}");
        assert!(small.map.tiles() == large.map.tiles(), "{faults:?}");
    }
}
