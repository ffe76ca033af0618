//! A robot on its link and `lrfslam run --levels 1` with the same configuration, seed and scans: the same bits.

use std::sync::{Arc, Mutex};

use lrfslam_app::config::RunConfig;
use lrfslam_core::geometry::Pose2;
use lrfslam_core::scan::RangeScan;
use lrfslam_core::time::{Duration, Instant};
use lrfslam_firmware_sim::scenario::Scenario;
use lrfslam_firmware_sim::virtual_lrf::hokuyo::{HokuyoModel, VirtualHokuyo};
use lrfslam_firmware_sim::virtual_lrf::{Emission, VirtualLrf};
use lrfslam_host::runs::map::{MapRun, RunMemory};
use lrfslam_robot::wire::message::ScanPose;
use lrfslam_robot::{LaserConfig, LaserFamily, RobotConfig};
use lrfslam_tests::mcu::{LaserBytes, scans_on};
use lrfslam_tests::robot_rig::{Build, Disk, RobotRig, Tally};

const SEED: u64 = 5;
const BAUD: u32 = 250_000;

/// What the laser has sent.
type LaserLine = Arc<Mutex<Vec<LaserBytes>>>;

/// A laser whose line is listened to.
struct Tapped {
    device: VirtualHokuyo,
    line: LaserLine,
}

impl VirtualLrf for Tapped {
    fn power_on(&mut self, now: Instant) {
        self.device.power_on(now);
    }
    fn receive(&mut self, now: Instant, bytes: &[u8]) {
        self.device.receive(now, bytes);
    }
    fn timeout(&mut self, now: Instant) {
        self.device.timeout(now);
    }
    fn poll(&mut self) -> Option<Emission> {
        let emission = self.device.poll()?;
        let piece = LaserBytes { at: emission.begins, is_from_laser: true, bytes: emission.bytes.clone() };
        self.line.lock().expect("nobody panicked").push(piece);
        Some(emission)
    }
    fn deadline(&self) -> Instant {
        self.device.deadline()
    }
    fn baud(&self, now: Instant) -> Option<u32> {
        self.device.baud(now)
    }
}

/// A robot with `config` that drives through the first half minute of a scenario, and what its laser has sent.
fn drive(config: &RobotConfig) -> (RobotRig, LaserLine) {
    let line = LaserLine::default();
    let scene = Box::new(Scenario::load("floor").expect("comes with the program").scene());
    let mut device = VirtualHokuyo::new(HokuyoModel::urg_04lx(), scene, 1);
    // The rate that a driver tries first: nothing on the line is lost to the search for it.
    device.set_baud(BAUD);
    let tapped = Box::new(Tapped { device, line: line.clone() });
    let mut rig = RobotRig::with(Disk::default(), Box::new(|| Build::Large.memory(&[])), tapped, config);
    rig.start();
    rig.run_for(Duration::from_millis(1000));
    rig.plug_laser(true);
    rig.run_for(Duration::from_millis(30_000));
    rig.plug_laser(false);
    rig.run_for(Duration::from_millis(2000));
    (rig, line)
}

fn bits(Pose2 { x, y, heading }: Pose2) -> [u32; 3] {
    [x, y, heading].map(f32::to_bits)
}

/// What the host makes of the scans on the line, at the times that the robot gave them: holds its matches against the robot's.
fn on_this_computer(run: &mut MapRun<'_>, line: &LaserLine, robot: &RobotConfig, told: &[ScanPose]) -> Tally {
    let mut tally = Tally::default();
    let scans = scans_on(&line.lock().expect("nobody panicked"), robot);
    assert!(scans.len().abs_diff(told.len()) <= 1, "{} scans sent, {} mapped", scans.len(), told.len());
    for ((_, beams, range_max_m), told) in scans.iter().zip(told) {
        let scan = RangeScan { stamp: told.stamp, range_max_m: *range_max_m, beams };
        let step = run.add_scan(&scan, robot.robot_from_lrf, None).expect("the scan fits, as it did on the robot");
        assert_eq!(bits(step.odometry.matched.map_from_robot), bits(told.odometry), "scan {}", told.number);
        tally.add_pose(step.map_from_robot);
    }
    tally
}

#[test]
fn robot_and_host_give_the_same_bits() {
    let mut config = RunConfig::for_robot();
    config.hierarchy.levels = 1;
    let robot = config.robot(SEED, LaserConfig { family: LaserFamily::Hokuyo, baud: BAUD, cluster: 1 });
    let (rig, line) = drive(&robot);
    let Tally { scans, dropped, ndt_dropped, ndt_evicted, .. } = rig.tally;
    assert_eq!((dropped, ndt_dropped, ndt_evicted), (0, 0, 0), "the robot has memory enough");
    let life = &rig.disk.lives[0];
    assert!(scans > 200 && life.segments.len() > 50, "{scans} scans, {} segments", life.segments.len());
    let map = &life.map;
    assert!(map.is_from_start() && map.scans().len() == scans as usize, "all is told: {}", map.scans().len());

    let mapping = config.mapping();
    let mut memory = RunMemory::new(&mapping, 2);
    let mut run = MapRun::new(&mapping, SEED, &mut memory).expect("memory fits");
    let tally = on_this_computer(&mut run, &line, &robot, map.scans());
    assert_eq!((tally.scans, tally.poses), (rig.tally.scans, rig.tally.poses), "poses as they came");
    let (there, here) = (map.path(), run.trajectory());
    let length: f32 = here
        .windows(2)
        .map(|pair| (pair[1].map_from_robot.position() - pair[0].map_from_robot.position()).norm())
        .sum();
    assert!(length > 5.0, "it has driven {length} m");
    assert_eq!(here.len(), there.len());
    for (here, there) in here.iter().zip(&there) {
        assert_eq!(bits(here.map_from_robot), bits(there.map_from_robot), "at {:?}", here.stamp);
    }
}
