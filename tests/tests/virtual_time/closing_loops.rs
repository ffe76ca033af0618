//! A robot comes back to its start after 125 m (thesis figure 3.11): the high level closes the loop.

use lrfslam_app::config::RunConfig;
use lrfslam_core::laser_odometry::Reference;
use lrfslam_core::time::Duration;
use lrfslam_firmware_sim::log::{LogFiles, LogPlan, Pace, write_log};
use lrfslam_firmware_sim::lrf_model::{LrfErrors, LrfModel};
use lrfslam_firmware_sim::scenario::Scenario;
use lrfslam_host::mapping::Closing;
use lrfslam_host::mapping::high::HighCounts;
use lrfslam_host::runs::map::{MapRun, RunMemory};
use lrfslam_host::scans::log::{LogOptions, LogReader, LogScan};
use lrfslam_host::trajectory::{TimedPose, read_trajectory};
use lrfslam_lab::evaluation::{TruthReport, evaluate_truth};

/// The scans, and the true path.
type Drive = (Vec<LogScan>, Vec<TimedPose>);

/// Once round the loop and 18 m on, with a laser noisy enough for the low level to drift by half a metre.
fn drive() -> Drive {
    let folder = tempfile::tempdir().unwrap();
    let scenario = Scenario::load("loop").unwrap().driving_on(&[[29.5, 9.5]]).unwrap();
    let lrf = LrfModel { errors: LrfErrors::gaussian(0.04), ..LrfModel::LMS200 };
    let plan = LogPlan { lrf, pace: Pace::Count(183), snapshot: false, seed: 1 };
    let (mut log, mut truth) = (Vec::new(), Vec::new());
    write_log(&scenario, &plan, &mut LogFiles { log: &mut log, truth: &mut truth, tilted: None, tilt: None }).unwrap();
    let files = [("loop.log", log), ("loop.tum", truth)].map(|(name, bytes)| {
        let file = folder.path().join(name);
        std::fs::write(&file, bytes).unwrap();
        file
    });
    let scans = LogReader::open(&files[0], LogOptions::default()).unwrap().collect::<Result<_, _>>().unwrap();
    (scans, read_trajectory(&files[1]).unwrap())
}

/// Maps the drive on `threads`; path, its errors, and what the high level did.
fn map(
    config: &RunConfig,
    scans: &[LogScan],
    truth: &[TimedPose],
    threads: usize,
) -> (Vec<TimedPose>, TruthReport, HighCounts) {
    let mapping = config.mapping();
    let mut memory = RunMemory::new(&mapping, threads);
    let mut run = MapRun::new(&mapping, 1, &mut memory).unwrap();
    for scan in scans {
        run.add_scan(&scan.scan(), scan.robot_from_lrf.unwrap_or_default(), None).unwrap();
    }
    let path = run.trajectory();
    let report = evaluate_truth(&path, truth, Duration::from_millis(50), 10.0).unwrap();
    (path, report, run.high_counts().unwrap())
}

#[test]
fn places_recognised_close_the_loop() {
    let (scans, truth) = drive();
    let (_, report, counts) = map(&RunConfig::default(), &scans, &truth, 2);
    assert!(counts.closures >= 1 && counts.largest_move_m > 0.1, "{counts:?}");
    assert!(report.revisit_m.count > 5 && report.revisit_m.max < 0.5, "{:?}", report.revisit_m);
}

/// Without anything that closes loops the same drive stays open: the test above shows the closures, not a good low level.
#[test]
fn without_closures_the_loop_stays_open() {
    let (scans, truth) = drive();
    let mut config = RunConfig::default();
    config.closure.enabled = false;
    let (_, report, counts) = map(&config, &scans, &truth, 2);
    assert_eq!(counts.closures, 0);
    assert!(report.revisit_m.max > 0.4, "{:?}", report.revisit_m);
}

#[test]
#[ignore = "heavy: run by .ci/run"]
fn particles_at_the_high_level_do_not_depend_on_threads() {
    let (scans, truth) = drive();
    let mut config = RunConfig::default();
    config.hierarchy.closing = Closing::Particles;
    let (path, report, _) = map(&config, &scans, &truth, 1);
    let (on_three, _, _) = map(&config, &scans, &truth, 3);
    assert_eq!(path, on_three);
    assert!(report.absolute_m.rmse < 1.5, "{:?}", report.absolute_m);
}

/// The drive mapped by one level with so many particles, on so many threads: the path, and the largest error at a place revisited, m.
fn map_by_one_level(particles: u16, seed: u64, threads: usize, drive: &Drive) -> (Vec<TimedPose>, f64) {
    let (scans, truth) = drive;
    let mut config = RunConfig::default();
    config.hierarchy.levels = 1;
    config.odometry.reference = Reference::RecentScans;
    config.particles.particles = particles;
    let mapping = config.mapping();
    let mut memory = RunMemory::new(&mapping, threads);
    let mut run = MapRun::new(&mapping, seed, &mut memory).unwrap();
    for scan in scans {
        run.add_scan(&scan.scan(), scan.robot_from_lrf.unwrap_or_default(), None).unwrap();
    }
    let path = run.trajectory();
    let report = evaluate_truth(&path, truth, Duration::from_millis(50), 10.0).unwrap();
    (path, report.revisit_m.max)
}

/// Each particle closes the loop in its own map; one alone has nothing to choose from.
#[test]
#[ignore = "heavy: run by .ci/run"]
fn particles_of_one_level_close_the_loop_and_one_does_not() {
    let drive = drive();
    let worst = |particles| (1..=8).map(|seed| map_by_one_level(particles, seed, 2, &drive).1).collect::<Vec<_>>();
    let (hundred, one) = (worst(100), worst(1));
    let closed = |worst: &[f64]| worst.iter().filter(|worst| **worst < 0.5).count();
    println!("largest error at a place revisited, m: {hundred:.2?} with 100 particles, {one:.2?} with one");
    assert!(closed(&hundred) >= 7 && closed(&hundred) > closed(&one), "{hundred:?} {one:?}");
    assert!(hundred.iter().sum::<f64>() < 0.75 * one.iter().sum::<f64>(), "{hundred:?} {one:?}");
}

#[test]
#[ignore = "heavy: run by .ci/run"]
fn particles_that_close_a_loop_do_not_depend_on_threads() {
    let drive = drive();
    let (path, _) = map_by_one_level(50, 1, 1, &drive);
    assert_eq!(path, map_by_one_level(50, 1, 3, &drive).0);
}
