//! A configuration that does not fit the robot is refused in words, takes none of its memory, and the next one is accepted.

use lrfslam_core::geometry::Pose2;
use lrfslam_core::laser_odometry::Reference;
use lrfslam_core::time::Duration;
use lrfslam_firmware_sim::scenario::Scenario;
use lrfslam_firmware_sim::virtual_lrf::hokuyo::{HokuyoModel, VirtualHokuyo};
use lrfslam_robot::wire::message::ToRobot;
use lrfslam_robot::{LaserConfig, LaserFamily, RobotConfig};
use lrfslam_tests::robot_rig::{Build, Disk, PoolSize, RobotRig};

fn good() -> RobotConfig {
    let laser = LaserConfig { family: LaserFamily::Hokuyo, baud: 0, cluster: 2 };
    let mut config = RobotConfig { laser, ..RobotConfig::default() };
    (config.slam.de.population, config.slam.de.generations) = (20, 15);
    (config.slam.recovery.population, config.slam.recovery.generations) = (40, 20);
    config
}

/// The good one with something changed.
fn with(change: impl Fn(&mut RobotConfig)) -> RobotConfig {
    let mut config = good();
    change(&mut config);
    config
}

/// Configurations that do not fit the memory for 32 particles, 1024 tiles about the robot and two grids, and why.
#[expect(clippy::too_many_lines, reason = "a table")]
fn misfits() -> Vec<(RobotConfig, &'static str)> {
    vec![
        (with(|config| config.slam.ndt.grids = 1), "ndt.grids is 1, the memory is divided for 2"),
        (with(|config| config.slam.ndt.grids = 3), "ndt.grids is 3, the memory is divided for 2"),
        (with(|config| config.slam.ndt.grids = 9), "ndt.grids is out of its bounds"),
        (with(|config| config.slam.ndt.cell_size_m = f32::NAN), "ndt.cell_size_m is out of its bounds"),
        (with(|config| config.slam.filter.radius_m = -1.0), "filter.radius_m is out of its bounds"),
        (with(|config| config.report.sweep_distance_m = f32::INFINITY), "report.sweep_distance_m is out of its bounds"),
        (
            with(|config| config.slam.particles.particles = 33),
            "particles.particles is 33, with 1 samples each there is memory for 32",
        ),
        (
            with(|config| config.slam.particles.samples_per_particle = 4),
            "particles.particles is 32, with 4 samples each there is memory for 8",
        ),
        (with(|config| config.slam.de.population = 101), "de.population is 101, there is memory for 100"),
        (with(|config| config.slam.recovery.population = 300), "recovery.population is 300, there is memory for 100"),
        (
            with(|config| config.slam.odometry.reference = Reference::RecentScans),
            "odometry.reference: there is memory for \"whole-map\" only",
        ),
        (
            with(|config| config.slam.rays.range_max_m = 30.0),
            "rays.range_max_m: of this map there is memory for 10.4 m about the robot",
        ),
        (
            with(|config| config.slam.rays.miss_range_m = 11.0),
            "rays.miss_range_m: of this map there is memory for 10.4 m about the robot",
        ),
        (
            with(|config| config.slam.particle_map.square_size_m = 0.01),
            "rays.range_max_m: of this map there is memory for 0.0 m about the robot",
        ),
        (
            with(|config| config.robot_from_lrf = Pose2 { x: f32::NAN, ..Pose2::IDENTITY }),
            "the laser's place on the robot is out of its bounds",
        ),
        (
            with(|config| config.robot_from_lrf = Pose2 { heading: 7.0, ..Pose2::IDENTITY }),
            "the laser's place on the robot is out of its bounds",
        ),
        (with(|config| config.laser.baud = 1), "laser.baud is 1: this laser has no such rate"),
        (
            with(|config| (config.laser.family, config.laser.baud) = (LaserFamily::Sick, 115_200)),
            "laser.baud is 115200: this laser has no such rate",
        ),
        (with(|config| config.laser.cluster = 255), "laser.cluster is out of its bounds"),
    ]
}

fn rig(config: &RobotConfig, pools: &'static [PoolSize]) -> RobotRig {
    let scene = Box::new(Scenario::load("floor").expect("comes with the program").scene());
    let device = VirtualHokuyo::new(HokuyoModel::urg_04lx_ug01(), scene, 1);
    let memory = Box::new(move || Build::Standard.memory(pools));
    let mut rig = RobotRig::with(Disk::default(), memory, Box::new(device), config);
    rig.start();
    rig
}

/// What the robot answers.
fn answer(rig: &mut RobotRig, request: &ToRobot<'_>) -> Option<String> {
    rig.disk.said.clear();
    rig.ask(request);
    rig.run_for(Duration::from_millis(500));
    rig.disk.said.first().cloned()
}

#[test]
fn a_refused_configuration_leaves_the_robot_usable() {
    let (first, why) = misfits().swap_remove(0);
    let mut rig = rig(&first, &[]);
    rig.run_for(Duration::from_millis(1000));
    assert_eq!(rig.disk.said, [why], "the host configures it as soon as it knows it");
    for (config, why) in misfits() {
        assert_eq!(answer(&mut rig, &ToRobot::Configure(config)).as_deref(), Some(why));
    }
    assert_eq!(answer(&mut rig, &ToRobot::Stop).as_deref(), Some("not configured"));
    assert_eq!(answer(&mut rig, &ToRobot::Configure(good())), None, "it is accepted");
    rig.plug_laser(true);
    rig.run_for(Duration::from_millis(8000));
    assert!(rig.tally.scans > 30 && rig.tally.lost == 0 && rig.status.steps > 5, "{:?} {:?}", rig.tally, rig.status);
    let scans = rig.tally.scans;
    // One that maps is not disturbed either.
    let other = answer(&mut rig, &ToRobot::Configure(misfits().swap_remove(0).0));
    assert_eq!(other.as_deref(), Some("it maps with another configuration: restart it first"));
    assert_eq!(answer(&mut rig, &ToRobot::Configure(good())), None);
    assert!(rig.tally.scans > scans);
    rig.plug_laser(false);
    rig.ask(&ToRobot::Stop);
    rig.run_until(|rig| rig.disk.lives.last().is_some_and(|life| life.map.is_complete()));
    assert!(rig.disk.lives[0].map.tiles().len() > 20);
}

/// The host asks for no more than there is memory for, where less will do.
#[test]
fn a_host_gives_a_small_robot_what_fits_it() {
    let pools = &[PoolSize::Particles(10), PoolSize::Window(256)];
    let mut rig = rig(&with(|config| config.slam.particles.samples_per_particle = 2), pools);
    rig.run_for(Duration::from_millis(1000));
    assert_eq!(rig.disk.said, [""; 0]);
    rig.plug_laser(true);
    rig.run_for(Duration::from_millis(8000));
    assert!(rig.tally.scans > 30 && (1..=5).contains(&rig.status.particles), "{:?}", rig.status);
}
