//! Proof that core needs neither std nor a heap: a program without either, with a panic handler of its own and no
//! allocator. If std came into core's dependencies there would be two panic handlers, if alloc came in there would be no
//! allocator, and this would not build.
#![no_std]

use lrfslam_core::de::Member;
use lrfslam_core::geometry::{Point2, Pose2};
use lrfslam_core::laser_odometry::{KeyScan, LaserOdometry, LaserOdometryConfig, OdometryMemory};
use lrfslam_core::ndt::{DirectoryEntry, NdtTile};
use lrfslam_core::scan::{Beam, RangeScan};
use lrfslam_core::time::Instant;

#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    loop {}
}

/// Matches one scan in memory on the stack, so that all of the matcher is linked.
#[unsafe(no_mangle)]
pub extern "C" fn match_one_scan(bearing_rad: f32, range_m: f32) -> f32 {
    let beams = [Beam {
        bearing_rad,
        offset: lrfslam_core::time::Duration::ZERO,
        echo: lrfslam_core::scan::Echo::from_range(range_m, 8.0),
    }];
    let mut directory = [DirectoryEntry::default(); 16];
    let mut tiles = [NdtTile::EMPTY; 2];
    let mut population = [Member::EMPTY; 8];
    let (mut points, mut hits) = ([Point2::default(); 4], [Point2::default(); 4]);
    let memory = OdometryMemory {
        directory: &mut directory,
        tiles: &mut tiles,
        population: &mut population,
        points: &mut points,
        hits: &mut hits,
        key_points: &mut [],
        key_scans: &mut [KeyScan::default(); 0],
    };
    let scan = RangeScan { stamp: Instant::default(), range_max_m: 8.0, beams: &beams };
    let config = LaserOdometryConfig::default();
    match LaserOdometry::new(&config, 1, memory).map(|mut odometry| odometry.step(&scan, Pose2::IDENTITY, None)) {
        Ok(Ok(report)) => report.matched.score,
        _ => -1.0,
    }
}
