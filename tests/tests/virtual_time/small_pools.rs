//! A filter of a microcontroller's size maps real logs: 32 particles at 8 m, all its pools within 512 KiB ([`SmallPools`]).
//!
//! The matcher has a computer's memory here; for all of a microcontroller see `hil_mcu`.

use lrfslam_app::config::RunConfig;
use lrfslam_core::de::Member;
use lrfslam_core::geometry::{Point2, Pose2};
use lrfslam_core::laser_odometry::OdometryMemory;
use lrfslam_core::low_slam::LowSlamPools;
use lrfslam_core::ndt::{DirectoryEntry, NdtTile};
use lrfslam_core::slam::{Slam, SlamConfig, SlamMemory};
use lrfslam_host::mapping::mapper::Mapper;
use lrfslam_host::scans::log::{LogOptions, LogReader, LogScan};
use lrfslam_tests::data;

/// 32 particles, 8 m range and 0.1 m squares: tiles of 8 × 8, a scan of up to 682 beams (URG-04LX), a window of 25.6 m.
type SmallPools = LowSlamPools<8, 3264, 1024, 32, 64, 32, 682, 1024>;
const _: () = assert!(size_of::<SmallPools>() <= 512 * 1024);

/// Both match in the one plane of cells that a microcontroller has.
const FACINGS: u16 = 1;

/// The scans of a real log, or nothing with a word about it.
fn real_scans(name: &str) -> Option<Vec<LogScan>> {
    let file = data::path(&format!("logs/{name}"))?;
    let log = LogReader::open(&file, LogOptions::default()).expect("the log can be read");
    Some(log.map(|scan| scan.expect("every scan can be read")).collect())
}

/// Poses of the best particle, scan by scan, and how many particles and squares found no room.
fn by_small_pools(scans: &[LogScan]) -> (Vec<Pose2>, usize, u64) {
    let mut config = SlamConfig::default();
    (config.particles.particles, config.rays.range_max_m) = (32, 8.0);
    config.ndt.facings = FACINGS;
    let directories = config.ndt.directories();
    let (mut directory, mut tiles) =
        (vec![DirectoryEntry::default(); directories * 256 * 256], vec![NdtTile::EMPTY; 16384]);
    let (mut population, mut points) = (vec![Member::EMPTY; 300], vec![Point2::default(); 1024]);
    let mut hits = points.clone();
    let odometry = OdometryMemory {
        directory: &mut directory,
        tiles: &mut tiles,
        population: &mut population,
        points: &mut points,
        hits: &mut hits,
        key_points: &mut [],
        key_scans: &mut [],
    };
    let mut pools = Box::new(SmallPools::EMPTY);
    let memory = SlamMemory { odometry, particles: pools.lend() };
    let mut slam = Slam::new(&config, 1, memory).expect("memory fits");
    assert_eq!(slam.filter().particles_max(), 32);
    let (mut poses, mut dropped, mut left_out) = (Vec::new(), 0, 0);
    for scan in scans {
        let robot_from_lrf = scan.robot_from_lrf.unwrap_or(Pose2::IDENTITY);
        let step = slam.step_with(&scan.scan(), robot_from_lrf, None, |weighing, samples, window| {
            weighing.weigh_all(samples, window);
        });
        let step = step.expect("the scan fits");
        poses.push(step.map_from_robot);
        dropped += step.filter.map_or(0, |filter| filter.dropped);
        left_out += step.filter.map_or(0, |filter| u64::from(filter.squares_left_out));
    }
    (poses, dropped, left_out)
}

fn by_a_computer(scans: &[LogScan]) -> Vec<Pose2> {
    let mut config = RunConfig::default();
    config.hierarchy.levels = 1;
    config.ndt.facings = FACINGS;
    let mut memory = config.mapping().mapper_memory(1);
    let mut mapper = Mapper::new(&config.slam(), 1, &mut memory).expect("memory fits");
    let pose = |scan: &LogScan| {
        let robot_from_lrf = scan.robot_from_lrf.unwrap_or(Pose2::IDENTITY);
        mapper.add_scan(&scan.scan(), robot_from_lrf, None).expect("the scan fits").0.map_from_robot
    };
    scans.iter().map(pose).collect()
}

/// Paths of other seeds are up to 0.66 m (loop5) and 0.41 m (URG-04LX) away from one another.
#[test]
fn small_pools_map_real_logs_as_a_computer_does() {
    for (name, near_m) in [("loop5.log.gz", 0.7), ("urg04lx-exp2.dat.gz", 0.8)] {
        let Some(scans) = real_scans(name) else { continue };
        let (small, dropped, left_out) = by_small_pools(&scans);
        let large = by_a_computer(&scans);
        let apart = small.iter().zip(&large).map(|(a, b)| (a.position() - b.position()).norm());
        let most = apart.fold(0.0, f32::max);
        println!(
            "{name}: {most:.3} m from the computer's path at most, {dropped} particles dropped, {left_out} squares left out"
        );
        assert!(most < near_m, "{name}: {most} m from the computer's path");
        assert_eq!(left_out, 0, "{name}");
    }
}
