//! Lasers that spin have another number of beams in nearly every turn: nothing on the way to a map minds.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use crate::common::{real_data, run};
use lrfslam_core::scan::Echo;
use lrfslam_core::time::Instant;
use lrfslam_host::runs::scans::read_scans;
use lrfslam_host::scans::family::{LrfFamily, LrfOptions};
use lrfslam_host::scans::log::{LogFormat, LogOptions, LogReader};
use lrfslam_host::scans::recording::{RecordPlan, Recorder, RecordingHeader};
use lrfslam_lrf::driver::Input;
use lrfslam_lrf::ldrobot::{Packet, Point};

/// Samples a second.
const RATE: f64 = 4500.0;

/// A wall of a room of 5 m by 4 m, seen from a place that drives ahead slowly, mm.
fn wall_mm(clockwise_deg: f64, at_s: f64) -> u16 {
    let (sin, cos) = clockwise_deg.to_radians().sin_cos();
    let ahead_m = if cos > 0.0 { 3.0 - 0.1 * at_s } else { 2.0 + 0.1 * at_s };
    let aside_m = if sin > 0.0 { 1.5 } else { 2.5 };
    (1000.0 * (ahead_m / cos.abs()).min(aside_m / sin.abs())) as u16
}

/// Records an LD06 whose motor never holds its speed.
pub fn write_recording(path: &Path) {
    let lrf = LrfOptions::new(LrfFamily::Ld06);
    let header = RecordingHeader { program: "test".to_owned(), port: "test".to_owned(), lrf };
    let mut recorder = Recorder::new(&RecordPlan::new(path), header).unwrap();
    recorder.begin(LrfFamily::Ld06).unwrap();
    recorder.input(Instant::from_micros(0), Input::Connected).unwrap();
    let mut angle_deg = 0.0;
    for packet in 0..6000 {
        let at_s = f64::from(packet) * 12.0 / RATE;
        let speed_degps = 3600.0 + 400.0 * (at_s * 1.7).sin();
        let angle = |sample: usize| angle_deg + speed_degps / RATE * sample as f64;
        let points = std::array::from_fn(|i| Point { distance_mm: wall_mm(angle(i), at_s), intensity: 200 });
        let cdeg = |sample| ((angle(sample) * 100.0) as u32 % 36_000) as u16;
        let stamp_ms = ((1000.0 * at_s) as u32 % 30_000) as u16;
        let packet =
            Packet { speed_degps: speed_degps as u16, start_cdeg: cdeg(0), points, end_cdeg: cdeg(11), stamp_ms };
        recorder.input(Instant::from_secs_f64(at_s + 0.003), Input::Bytes(&packet.emit())).unwrap();
        angle_deg = (angle_deg + speed_degps / RATE * 12.0) % 360.0;
    }
    recorder.finish().unwrap();
}

#[test]
fn turns_as_they_are_are_replayed_mapped_and_localised() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_recording(&folder.join("laser.rec"));
    let scans = read_scans(&folder.join("laser.rec"), LogOptions::default()).unwrap();
    let numbers: BTreeSet<usize> = scans.iter().map(|scan| scan.beams.len()).collect();
    assert!(scans.len() > 150 && numbers.len() > 20, "{} scans, beams {numbers:?}", scans.len());
    let (code, stdout, stderr) = run(folder, &["map", "laser.rec", "--out", "room"]);
    assert_eq!(code, 0, "{stdout}{stderr}");
    let lines = fs::read_to_string(folder.join("room/trajectory.tum")).unwrap();
    assert_eq!(lines.lines().count(), scans.len());
    let x_m = |line: &str| line.split(' ').nth(1).unwrap().parse::<f64>().unwrap();
    let end_m = x_m(lines.lines().last().unwrap());
    assert!((end_m - 1.6).abs() < 0.1, "it drove 0.1 m/s for 16 s, and came {end_m} m");
    let (code, _, stderr) = run(folder, &["replay", "laser.rec", "--fast", "--out", "again", "-q"]);
    assert_eq!((code, stderr.as_str()), (0, ""));
    let (code, stdout, _) =
        run(folder, &["localize", "laser.rec", "--map", "room", "--start", "0,0,0", "--out", "where"]);
    assert_eq!(code, 0, "{stdout}");
}

#[test]
fn real_turns_of_a_cheap_laser_come_with_their_own_angles() {
    for (name, scans, beams) in [("1", 213, 413..=2005), ("2", 215, 419..=1683)] {
        let Some(file) = real_data(&format!("logs/ydlidar-x4/ydlidar-x4-{name}.dat.gz")) else { return };
        let mut log = LogReader::open(&file, LogOptions::default()).unwrap();
        assert_eq!(log.format(), Some(LogFormat::Ydlidar));
        let read: Vec<_> = log.by_ref().collect::<Result<_, _>>().unwrap();
        assert_eq!((read.len(), log.counts().damaged_lines), (scans, 0));
        for scan in &read {
            assert!(beams.contains(&scan.beams.len()), "line {}: {}", scan.line, scan.beams.len());
            let view = scan.beams[0].bearing_rad - scan.beams.last().unwrap().bearing_rad;
            let gap = std::f32::consts::TAU - view;
            assert!(gap > 0.0 && gap < 0.02, "line {}: all round", scan.line);
            let is_sane = |echo| !matches!(echo, Echo::Hit(range) if !(0.25..10.0).contains(&range));
            assert!(scan.beams.iter().all(|beam| is_sane(beam.echo)), "line {}", scan.line);
        }
        let seconds = read.last().unwrap().stamp.as_secs_f64();
        assert!((29.0..31.0).contains(&seconds), "{seconds} s");
    }
}

#[test]
fn key_frames_are_read_with_their_own_times() {
    for (name, scans, beams) in [("seattle", 241, 361), ("edmonton", 340, 180), ("acapulco", 861, 181)] {
        let Some(file) = real_data(&format!("logs/keyframes/{name}.log.gz")) else { return };
        let mut log = LogReader::open(&file, LogOptions::default()).unwrap();
        let read: Vec<_> = log.by_ref().collect::<Result<_, _>>().unwrap();
        assert_eq!((read.len(), log.counts().damaged_lines, log.counts().skipped_lines), (scans, 0, 0), "{name}");
        for (number, scan) in read.iter().enumerate() {
            assert_eq!((scan.beams.len(), scan.stamp.as_secs_f64()), (beams, number as f64), "{name}");
        }
    }
}
