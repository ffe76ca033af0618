//! The readers over real logs: every scan, every beam, and the known oddities of each. Skipped where the logs are not.

use std::fs;

use crate::common::{real_data, run};
use lrfslam_core::geometry::Pose2;
use lrfslam_core::scan::Echo;
use lrfslam_core::time::Duration;
use lrfslam_host::scans::log::{LogCounts, LogFormat, LogOptions, LogReader, LogScan};
use lrfslam_host::trajectory::{TimedPose, read_trajectory};
use lrfslam_lab::evaluation::{evaluate_relations, read_relations};

struct Read {
    format: Option<LogFormat>,
    scans: Vec<LogScan>,
    counts: LogCounts,
}

fn read(name: &str) -> Option<Read> {
    let mut log = LogReader::open(&real_data(name)?, LogOptions::default()).unwrap();
    let format = log.format();
    let scans: Vec<LogScan> = log.by_ref().collect::<Result<_, _>>().unwrap();
    assert_eq!(log.bytes_read().get(), log.size_bytes());
    Some(Read { format, scans, counts: log.counts() })
}

fn assert_scans(read: &Read, scans: usize, beams: usize, range_max_m: f32) {
    assert_eq!((read.scans.len(), read.counts.scans), (scans, scans as u64));
    for scan in &read.scans {
        assert_eq!((scan.beams.len(), scan.range_max_m), (beams, range_max_m), "line {}", scan.line);
    }
    assert_eq!(
        (read.counts.skipped_lines, read.counts.mounting_contradictions, read.counts.cut_last_line),
        (0, 0, false)
    );
}

fn count(read: &Read, wanted: impl Fn(Echo) -> bool) -> usize {
    read.scans.iter().flat_map(|scan| &scan.beams).filter(|beam| wanted(beam.echo)).count()
}

/// Seconds from first to last scan, and metres by odometry.
fn span(scans: &[LogScan]) -> (f64, f32) {
    let seconds = scans.last().unwrap().stamp.as_secs_f64() - scans[0].stamp.as_secs_f64();
    let poses: Vec<Pose2> = scans.iter().filter_map(|scan| scan.map_from_robot_odometry).collect();
    (seconds, poses.windows(2).map(|pair| pair[0].between(pair[1]).position().norm()).sum())
}

#[test]
fn intel() {
    let Some(read) = read("logs/intel.log.gz") else { return };
    assert_scans(&read, 13_631, 180, 81.83);
    assert_eq!(read.format, Some(LogFormat::Carmen));
    assert!(read.counts.backward_times > 600, "{:?}", read.counts);
    assert_eq!(read.counts.repeated_times, 9);
    assert_eq!(count(&read, |echo| echo == Echo::Miss), 68_313);
    assert_eq!(read.scans[0].robot_from_lrf, Some(Pose2::IDENTITY));
    let (seconds, metres) = span(&read.scans);
    assert!((seconds - 2691.0).abs() < 1.0 && (metres - 508.0).abs() < 2.0, "{seconds} s, {metres} m");
}

#[test]
fn aces() {
    let Some(read) = read("logs/aces.log.gz") else { return };
    assert_scans(&read, 7374, 180, 50.0);
    assert_eq!(count(&read, |echo| echo == Echo::Miss), 11_137);
    let (seconds, metres) = span(&read.scans);
    assert!((seconds - 1366.0).abs() < 1.0 && (metres - 325.0).abs() < 2.0, "{seconds} s, {metres} m");
}

#[test]
fn loop5() {
    let Some(read) = read("logs/loop5.log.gz") else { return };
    assert_scans(&read, 551, 181, 8.183);
    assert_eq!((read.format, read.counts.synthetic_times), (Some(LogFormat::DpSlam), true));
    assert!(count(&read, |echo| matches!(echo, Echo::Hit(range) if range > 8.179)) == 0);
    assert!(read.scans.iter().all(|scan| scan.map_from_robot_odometry.is_some() && scan.robot_from_lrf.is_none()));
}

#[test]
fn urg04lx() {
    let Some(read) = read("logs/urg04lx-exp2.dat.gz") else { return };
    assert_scans(&read, 641, 682, 5.6);
    assert_eq!(read.format, Some(LogFormat::TinySlam));
    assert_eq!(count(&read, |echo| matches!(echo, Echo::Hit(range) if range < 0.02)), 0);
    let (seconds, metres) = span(&read.scans);
    assert!((seconds - 63.16).abs() < 0.01 && (40.0..50.0).contains(&metres), "{seconds} s, {metres} m");
}

#[test]
fn freiburg_clinic_alternates_between_180_and_181_beams() {
    let Some(read) = read("logs/fr-clinic.clf.gz") else { return };
    assert_eq!((read.scans.len(), read.counts.damaged_lines, read.counts.skipped_lines), (6917, 0, 0));
    // Four sets of angles in turn, a quarter of a degree apart, each line with its own.
    let mut sets: Vec<(usize, i32)> =
        read.scans.iter().map(|scan| (scan.beams.len(), (scan.beams[0].bearing_rad * 1e6) as i32)).collect();
    sets.sort_unstable();
    let counts: Vec<_> = sets.chunk_by(|a, b| a == b).map(|set| (set[0].0, set.len())).collect();
    assert_eq!(counts, [(180, 1709), (180, 1725), (180, 1735), (181, 1748)]);
    assert!(read.scans.iter().all(|scan| scan.robot_from_lrf.is_some_and(|pose| (pose.x - 0.22).abs() < 0.005)));
}

#[test]
fn odometry_of_intel_is_as_wrong_as_published() {
    let (Some(read), Some(file)) = (read("logs/intel.log.gz"), real_data("logs/intel.relations.gz")) else { return };
    let pose = |scan: &LogScan| Some(TimedPose { stamp: scan.stamp, map_from_robot: scan.map_from_robot_odometry? });
    let poses: Vec<TimedPose> = read.scans.iter().filter_map(pose).collect();
    let relations = read_relations(&file).unwrap();
    let report = evaluate_relations(&poses, &relations, Duration::from_millis(50)).unwrap();
    assert_eq!((report.relations, report.unmatched), (2984, 0));
    // Kümmerle et al. 2009 give 7.4 ± 14.4 m.
    let translation = report.translation_m;
    assert!((translation.mean - 7.4).abs() < 0.05 && (translation.std - 14.4).abs() < 0.1, "{translation:?}");
}

#[test]
fn aces_reference_path_is_read() {
    let Some(file) = real_data("logs/aces.rbpf.poses.gz") else { return };
    let poses = read_trajectory(&file).unwrap();
    assert_eq!((poses.len(), poses[0].stamp.micros), (440, 21_019_900));
}

#[test]
fn map_of_a_real_log_is_written() {
    let Some(log) = real_data("logs/loop5.log.gz") else { return };
    let folder = tempfile::tempdir().unwrap();
    let log = log.to_str().unwrap();
    let (code, stdout, stderr) = run(folder.path(), &["map", log, "--odometry", "--out", "out"]);
    assert_eq!((code, stderr.as_str()), (0, ""));
    assert!(stdout.contains("note: the log has no times"), "{stdout}");
    assert_eq!(fs::read_to_string(folder.path().join("out/trajectory.tum")).unwrap().lines().count(), 551);
}
