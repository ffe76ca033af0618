//! A building larger than the robot's memory: what the host has in the end is what a robot with memory for all of it tells, to the bit; and with so
//! little memory that particles go for want of it, it is at least the same whatever the line does.

use lrfslam_core::time::Duration;
use lrfslam_firmware_sim::scenario::Scenario;
use lrfslam_firmware_sim::virtual_lrf::hokuyo::{HokuyoModel, VirtualHokuyo};
use lrfslam_robot::wire::message::{Status, ToRobot};
use lrfslam_robot::{LaserConfig, LaserFamily, RobotConfig};
use lrfslam_tests::robot_rig::{Build, Disk, LineFaults, PoolSize, RobotRig, Tally};

/// Until then the robot is configured.
const LASER_AT: Duration = Duration::from_millis(6000);
/// Once along the corridors of the floor, through a room and home.
const DRIVES: usize = 15;
const DRIVE: Duration = Duration::from_millis(9500);
const PAUSE: Duration = Duration::from_millis(500);

/// Tiles of the small memory: all of the square about the robot (15 by 15), the 30 kept free for those that return, and the 32 that leave at once.
const TILES: usize = 288;
/// Tiles that are too few for that.
const TILES_TOO_FEW: usize = 200;
/// Tiles for so many particles: some hundred more would do for all of them.
const TILES_OF_MANY: usize = 400;
const PARTICLES: u16 = 12;

/// Small squares and a view of 2 m: so a floor of 18 m is large. All tiles of a single particle may leave.
fn config(particles: u16) -> RobotConfig {
    let laser = LaserConfig { family: LaserFamily::Hokuyo, baud: 0, cluster: 4 };
    let mut config = RobotConfig { laser, ..RobotConfig::default() };
    (config.slam.de.population, config.slam.de.generations) = (20, 15);
    (config.slam.recovery.population, config.slam.recovery.generations) = (40, 20);
    config.slam.particles.particles = particles;
    config.slam.particle_map.square_size_m = 0.05;
    config.slam.rays.range_max_m = 2.0;
    config
}

/// What becomes of the host while the robot drives.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Host {
    Stays,
    /// … so that no tile leaves the robot.
    IsAway,
    /// … now and then, and goes on half a second later with what it has stored.
    IsKilled,
}

/// What the host has, how the robot is, and what it did.
///
/// * `faults` — of the line, and their seed
fn drive(particles: u16, tiles: usize, host: Host, (faults, seed): (LineFaults, u64)) -> (Disk, Status, Tally) {
    let scene = Box::new(Scenario::load("floor").expect("comes with the program").scene());
    let device = VirtualHokuyo::new(HokuyoModel::urg_04lx_ug01(), scene, 1);
    let memory = Box::new(move || Build::Standard.memory(&[PoolSize::Tiles(tiles)]));
    let mut rig = RobotRig::with(Disk::default(), memory, Box::new(device), &config(particles));
    rig.set_faults(faults, seed);
    rig.start();
    rig.run_for(LASER_AT);
    if host == Host::IsAway {
        rig.unplug_link();
    }
    rig.plug_laser(true);
    for _ in 0..DRIVES {
        rig.run_for(DRIVE);
        if host == Host::IsKilled {
            rig.kill_host();
        }
        rig.run_for(PAUSE);
        if host == Host::IsKilled {
            rig.start_host(true);
        }
    }
    rig.plug_laser(false);
    if host == Host::IsAway {
        rig.plug_link();
    }
    rig.ask(&ToRobot::Stop);
    rig.run_until(|rig| rig.disk.lives.last().is_some_and(|life| life.map.is_complete()));
    rig.run_for(Duration::from_millis(1000));
    (rig.disk, rig.status, rig.tally)
}

#[test]
fn map_and_poses_are_those_of_a_robot_with_memory_for_all() {
    let (large, status, with_large) = drive(1, 20_000, Host::IsAway, (LineFaults::default(), 1));
    let large = large.lives[0].map.tiles();
    let tiles = large.len();
    assert_eq!((status.tiles_forgotten, status.dropped_particles, status.squares_left_out), (0, 0, 0));
    assert!(with_large.tiles >= tiles, "all of its map was in its memory");
    let good = LineFaults::default();
    for (host, faults) in [(Host::Stays, good), (Host::Stays, LineFaults::all(0.01)), (Host::IsKilled, good)] {
        let (small, status, with_small) = drive(1, TILES, host, (faults, 1));
        assert!(TILES < tiles && status.tiles_left > 100 && status.tiles_restored > 20, "{tiles}, {status:?}");
        let lost = (status.tiles_forgotten, status.dropped_particles, status.squares_left_out);
        assert_eq!(lost, (0, 0, 0), "{status:?}");
        assert_eq!((with_small.scans, with_small.poses), (with_large.scans, with_large.poses), "{host:?} {faults:?}");
        assert!(small.lives[0].map.tiles() == large, "{host:?} {faults:?}");
    }
}

#[test]
fn memory_too_small_for_what_is_near_is_said() {
    let (disk, status, _) = drive(1, TILES_TOO_FEW, Host::Stays, (LineFaults::default(), 1));
    assert!(disk.lives[0].map.is_complete() && status.squares_left_out > 0, "{status:?}");
    let said = &disk.said;
    assert!(said.iter().any(|text| text.starts_with("the map's memory is full: ")), "{said:?}");
}

/// How many tiles are free decides which particles stay, and what has left and returned decides how many are free. So a map depends on the line if an
/// answer comes later than it is due, and then the robot says so: with 2 % of each fault on some lines, with 1 % on none.
#[test]
#[ignore = "heavy: run by .ci/run"]
fn particles_that_go_for_want_of_memory_are_the_same_on_a_bad_line() {
    let many = |faults| drive(PARTICLES, TILES_OF_MANY, Host::Stays, faults);
    let (good, status, on_good) = many((LineFaults::default(), 1));
    assert!(status.dropped_particles > 1000 && status.tiles_left > 100 && status.tiles_restored > 20, "{status:?}");
    let told = |disk: &Disk| {
        let [life] = disk.lives.as_slice() else { panic!("one life") };
        (life.map.scans().to_vec(), life.segments.clone(), life.sweeps.clone(), life.map.tiles().clone())
    };
    for (chance, seeds, late_max) in [(0.01, 1..=2, 0), (0.02, 1..=4, 3)] {
        let mut late = 0;
        for seed in seeds {
            let (bad, status, on_bad) = many((LineFaults::all(chance), seed));
            assert_eq!((status.tiles_forgotten, status.damaged), (0, 0), "faults at {chance}, {seed}: {status:?}");
            if bad.said.iter().any(|text| text.contains("the map depends on the link")) {
                late += 1;
                continue;
            }
            assert_eq!(on_bad, on_good, "faults at {chance}, {seed}: {status:?}");
            assert!(told(&bad) == told(&good), "faults at {chance}, {seed}");
        }
        assert!(late <= late_max, "faults at {chance}: answers came late on {late} lines");
    }
}

#[test]
fn robot_whose_host_is_silent_forgets_tiles_and_maps_on() {
    let scene = Box::new(Scenario::load("floor").expect("comes with the program").scene());
    let device = VirtualHokuyo::new(HokuyoModel::urg_04lx_ug01(), scene, 1);
    let memory = Box::new(move || Build::Standard.memory(&[PoolSize::Tiles(TILES)]));
    let mut rig = RobotRig::with(Disk::default(), memory, Box::new(device), &config(1));
    rig.start();
    rig.run_for(LASER_AT);
    rig.plug_laser(true);
    // A serial line does not say that nobody is there any more.
    rig.kill_host();
    (0..DRIVES).for_each(|_| rig.run_for(DRIVE));
    rig.start_host(true);
    rig.run_for(Duration::from_millis(5000));
    let Status { tiles_forgotten, dropped_particles, tiles, .. } = rig.status;
    assert!(tiles_forgotten > 20 && dropped_particles == 0 && usize::from(tiles) < TILES, "{:?}", rig.status);
}
