//! The whole chain with a microcontroller in it: virtual laser → firmware on QEMU → host. Its map and path must be those of the
//! same program on this computer, bit for bit.

use std::sync::Mutex;

use lrfslam_core::scan::RangeScan;
use lrfslam_firmware_sim::scenario::Scenario;
use lrfslam_firmware_sim::scene::RobotScene;
use lrfslam_firmware_sim::virtual_lrf::VirtualLrf;
use lrfslam_firmware_sim::virtual_lrf::hokuyo::{HokuyoModel, VirtualHokuyo};
use lrfslam_firmware_sim::virtual_lrf::sick::{SickModel, VirtualSick};
use lrfslam_robot::wire::message::{ScanPose, Segment};
use lrfslam_robot::{LaserConfig, LaserFamily, Mapping, Pools, RobotConfig, StandardPools};
use lrfslam_tests::mcu::{Drive, Mcu, drive, scans_on};

/// What `mapping` makes of the scans on the line, at the times that the robot gave them.
fn on_this_computer(mapping: &mut Mapping<'_>, drive: &Drive) -> (Vec<ScanPose>, Vec<Segment>) {
    let scans = scans_on(&drive.laser_line, mapping.config());
    let (mut poses, mut segments) = (Vec::new(), Vec::new());
    for ((_, beams, range_max_m), told) in scans.iter().zip(drive.map.scans()) {
        let scan = RangeScan { stamp: told.stamp, range_max_m: *range_max_m, beams };
        let mapped = mapping.add_scan(&scan).expect("the scan fits, as it did on the robot");
        poses.push(mapped.pose);
        segments.extend(mapping.segment());
        mapping.segment_told();
    }
    (poses, segments)
}

fn bits(pose: &ScanPose) -> ([u32; 3], i64, u32, bool) {
    let moved = pose.moved;
    ([moved.x, moved.y, moved.heading].map(f32::to_bits), pose.stamp.micros, pose.step, pose.is_lost)
}

fn segment_bits(segment: &Segment) -> Vec<(u8, [u32; 3])> {
    let node = |pose: lrfslam_core::geometry::Pose2| [pose.x, pose.y, pose.heading].map(f32::to_bits);
    segment.particles.iter().map(|particle| (particle.parent, node(particle.map_from_robot))).collect()
}

/// Every tile that the best particle sees.
fn tiles(mapping: &Mapping<'_>) -> lrfslam_host::robot::Tiles {
    let filter = mapping.slam().filter();
    let leaf = mapping.best().expect("there is a particle").node;
    let mut tiles = lrfslam_host::robot::Tiles::new();
    for (place, tile) in filter.map().tiles_seen_from(filter.ancestry(), leaf) {
        let squares = tile.rows().iter().flatten().flat_map(|square| [square.hits(), square.distance()]);
        tiles.entry((place.column, place.row)).or_insert_with(|| squares.collect());
    }
    tiles
}

fn check(drive: &Drive, config: &RobotConfig, scans: usize) {
    println!("{:?}\n{:?}", drive.said, drive.status);
    assert_eq!(drive.robots, 1, "the microcontroller was reset");
    assert_eq!((drive.status.health.lrf_overrun, drive.status.health.link_overrun), (0, 0));
    assert!(drive.map.scans().len() >= scans && drive.segments.len() >= scans / 5);
    let mut pools = Box::new(StandardPools::EMPTY);
    let mut mapping = Mapping::new(config, pools.lend().mapping).expect("the memory is the robot's");
    let (poses, segments) = on_this_computer(&mut mapping, drive);
    assert_eq!(poses.len(), drive.map.scans().len(), "scans on the line and scans mapped");
    for (here, there) in poses.iter().zip(drive.map.scans()) {
        assert_eq!(bits(here), bits(there), "scan at {:?}", here.stamp);
    }
    assert_eq!(segments.len(), drive.segments.len());
    for (here, there) in segments.iter().zip(&drive.segments) {
        assert_eq!((here.step, here.best), (there.step, there.best));
        assert_eq!(segment_bits(here), segment_bits(there), "step {}", here.step);
    }
    assert_eq!(&tiles(&mapping), drive.map.tiles());
    assert_eq!(drive.map.path().len(), poses.len());
}

fn room() -> Box<RobotScene> {
    Box::new(Scenario::load("room").expect("comes with the program").scene())
}

/// A search that QEMU gets done in a tenth of the time of the default one; the bits show the same as in a long one.
fn light(laser: LaserConfig) -> RobotConfig {
    let mut config = RobotConfig { laser, ..RobotConfig::default() };
    (config.slam.de.population, config.slam.de.generations) = (30, 25);
    (config.slam.recovery.population, config.slam.recovery.generations) = (60, 30);
    config
}

/// One microcontroller at a time: two would be in each other's way.
static BENCH: Mutex<()> = Mutex::new(());

fn run(machine: &'static str, device: &mut dyn VirtualLrf, laser: LaserConfig, scans: usize, slow: u32) {
    let Some(mcu) = Mcu::find(machine) else { return };
    let _bench = BENCH.lock();
    let config = light(laser);
    let drive = drive(&mcu, device, &config, scans, slow).expect("the drive ends");
    check(&drive, &config, scans);
}

#[test]
fn urg_04lx_on_a_cortex_m7_maps_as_this_computer_does() {
    let mut device = VirtualHokuyo::new(HokuyoModel::urg_04lx(), room(), 1);
    device.set_baud(250_000); // QEMU's UART takes any rate, so that the first one tried is the one found
    let laser = LaserConfig { family: LaserFamily::Hokuyo, baud: 250_000, cluster: 1 };
    run("mps2-an500", &mut device, laser, 60, 4);
}

#[test]
fn lms200_on_a_cortex_m4f_maps_as_this_computer_does() {
    let mut device = VirtualSick::new(SickModel::lms200(), room(), 1);
    device.set_baud(38_400); // as above
    let laser = LaserConfig { family: LaserFamily::Sick, baud: 38_400, cluster: 1 };
    run("mps2-an386", &mut device, laser, 60, 4);
}
