//! Whole logs: what is tolerated, what is an error, and that nothing panics.

use super::*;
use flate2::{Compression, write::GzEncoder};
use lrfslam_core::scan::Echo;
use proptest::prelude::*;
use std::io::{Cursor, Write};

fn open(bytes: &[u8]) -> Result<LogReader, LogError> {
    LogReader::from_reader("a.log", Cursor::new(bytes.to_vec()), LogOptions::default())
}

fn read(bytes: &[u8]) -> (Vec<LogScan>, Option<LogError>, LogCounts) {
    let mut reader = open(bytes).unwrap();
    let mut scans = Vec::new();
    let mut fault = None;
    for scan in reader.by_ref() {
        match scan {
            Ok(scan) => scans.push(scan),
            Err(error) => fault = Some(error),
        }
    }
    assert!(reader.next().is_none());
    (scans, fault, reader.counts())
}

fn flaser(ranges: &str, robot_x: f64, time: f64) -> String {
    let count = ranges.split(' ').count();
    format!("FLASER {count} {ranges} {} 0 0 {robot_x} 0 0 {time:.6} host {time:.6}\n", robot_x + 0.2)
}

#[test]
fn scans_come_in_file_order_with_odometry_and_mounting() {
    let log = format!("# head\nPARAM a b\n{}{}", flaser("1 2 3", 0.0, 5.0), flaser("1 nan -1", 1.0, 4.5));
    let (scans, fault, counts) = read(log.as_bytes());
    assert!(fault.is_none());
    assert_eq!((counts.scans, counts.backward_times, counts.skipped_lines), (2, 1, 0));
    assert_eq!(scans[1].stamp, Instant::from_micros(4_500_000));
    assert_eq!(scans[1].line, 4);
    assert_eq!(scans[1].map_from_robot_odometry, Some(Pose2::new(1.0, 0.0, 0.0)));
    assert_eq!(scans[1].robot_from_lrf, Some(Pose2::new(0.2, 0.0, 0.0)));
    let echoes: Vec<Echo> = scans[1].beams.iter().map(|b| b.echo).collect();
    assert_eq!(echoes, [Echo::Hit(1.0), Echo::Invalid, Echo::Invalid]);
    assert_eq!(scans[0].beams[0].bearing_rad.to_degrees().round(), -90.0);
}

#[test]
fn gzip_is_known_by_its_bytes() {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(flaser("1 2", 0.0, 5.0).as_bytes()).unwrap();
    let packed = encoder.finish().unwrap();
    assert_eq!(read(&packed).0.len(), 1);
}

#[test]
fn truncated_gzip_says_how_many_scans_were_read() {
    let log: String = (0..3000).map(|i| flaser("1.23 2.34 3.45", f64::from(i * i % 97), f64::from(i))).collect();
    let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(log.as_bytes()).unwrap();
    let mut packed = encoder.finish().unwrap();
    packed.truncate(packed.len() / 2);
    let (scans, fault, _) = read(&packed);
    let text = fault.unwrap().to_string();
    assert!(scans.len() > 100 && text.starts_with("a.log: "), "{text}");
    assert!(text.contains(&format!("{} scans read", scans.len())) && text.contains("cut off"), "{text}");
}

#[test]
fn cut_last_line_is_flagged_and_no_error() {
    let whole = format!("{}{}", flaser("1 2", 0.0, 1.0), flaser("3 4", 0.0, 2.0));
    for cut in 1..30 {
        let (scans, fault, counts) = read(&whole.as_bytes()[..whole.len() - cut]);
        assert!(fault.is_none());
        assert_eq!(counts.cut_last_line, scans.len() == 1, "cut by {cut}");
    }
}

#[test]
fn damaged_lines_are_left_out_and_named() {
    let whole = flaser("1 2", 0.0, 1.0);
    let wrong =
        ["FLASER 2 1 x 0 0 0 0 0 0 1 h 1\n", "FLASER 2 1 0 0 0 0 0 0 1\n", "FLASER 2 1 2 0 0 0 0 0 0 inf h 1\n"];
    let long = format!("{}\n", "FLASER ".repeat(300_000));
    let log = [&whole, wrong[0], wrong[1], &whole, wrong[2], &long, &whole].concat();
    let (scans, fault, counts) = read(log.as_bytes());
    assert!(fault.is_none(), "{fault:?}");
    assert_eq!(scans.iter().map(|scan| scan.line).collect::<Vec<_>>(), [1, 4, 7]);
    let named: Vec<String> = counts.damaged.iter().map(DamagedLine::to_string).collect();
    assert_eq!(named[0], "line 2: field range 2 of 2: expected a number (m), found \"x\"");
    assert!(named[1].starts_with("line 3: field 5 and on: expected 7 to 9 fields"), "{named:?}");
    assert_eq!(named[2], "line 5: field time: expected a finite number up to 1e12, found \"inf\"");
    assert_eq!(named[3], "line 6: field line: expected at most 1048576 bytes, found \"more\"");
    assert_eq!((counts.damaged_lines, named.len(), counts.is_badly_damaged()), (4, 4, true));
}

#[test]
fn beams_may_change_where_it_is_known_where_they_point() {
    let line = |beams: usize, time: f64| flaser(&vec!["2"; beams].join(" "), 0.0, time);
    let log = [line(180, 1.0), line(181, 2.0), line(3, 3.0), line(180, 4.0), line(361, 5.0)].concat();
    let (scans, fault, counts) = read(log.as_bytes());
    assert!(fault.is_none());
    assert_eq!(scans.iter().map(|scan| scan.beams.len()).collect::<Vec<_>>(), [180, 181, 180, 361]);
    let ends =
        |scan: &LogScan| [scan.beams[0], *scan.beams.last().unwrap()].map(|beam| beam.bearing_rad.to_degrees().round());
    assert_eq!([&scans[0], &scans[1], &scans[3]].map(ends), [[-90.0, 89.0], [-90.0, 90.0], [-90.0, 90.0]]);
    let expected =
        "line 3: field number of beams: expected 180 as in the first scan, or angles in the line, found \"3\"";
    assert_eq!((counts.damaged_lines, counts.damaged[0].to_string().as_str()), (1, expected));
}

#[test]
fn angles_in_the_line_count_for_its_scan_alone() {
    let line = |first: f64, ranges: &str| {
        let count = ranges.split(' ').count();
        format!("ROBOTLASER1 0 {first} 1.5 0.5e-1 80 0.01 0 {count} {ranges} 0 0 0 0 0 0 0 0 0 0 0 0 12.5 host 12.5\n")
    };
    let log = [line(-1.0, "1 2 3"), line(-0.9, "1 2"), line(-0.8, "1 2 3 4")].concat();
    let (scans, fault, counts) = read(log.as_bytes());
    assert!(fault.is_none() && counts.damaged_lines == 0, "{counts:?}");
    let bearings: Vec<Vec<f32>> =
        scans.iter().map(|scan| scan.beams.iter().map(|beam| (beam.bearing_rad * 100.0).round()).collect()).collect();
    assert_eq!(bearings, [vec![-100.0, -95.0, -90.0], vec![-90.0, -85.0], vec![-80.0, -75.0, -70.0, -65.0]]);
}

#[test]
fn what_is_no_log_is_said_to_be_none() {
    let error = |bytes: &[u8]| open(bytes).err().unwrap();
    assert!(matches!(error(b""), LogError::Empty { .. }));
    assert!(matches!(error(b"\n\n# only a comment\n"), LogError::Empty { .. }));
    assert!(matches!(error(b"hello world\n1,2,3\n"), LogError::NotALog { lines: 2, .. }));
    assert!(matches!(error(b"hello"), LogError::NotALog { .. }));
    assert!(matches!(error(b"LRFREC01\x9c\0\0\0program = \"lrfslam\"\n"), LogError::Recording { .. }));
    assert!(matches!(error("x y\n".repeat(5000).as_bytes()), LogError::NotALog { lines: 1000, .. }));
    assert!(matches!(error(&vec![b'7'; 3 << 20]), LogError::NotALog { .. }));
    assert!(matches!(error(b"PARAM a b\nODOM 1 2 3\n"), LogError::NoScan { lines: 2, .. }));
    let damaged = error(b"FLASER 2 1\nFLASER 1\nFLASER");
    assert!(matches!(&damaged, LogError::AllDamaged { damaged: 2, first, .. } if first.line == 1), "{damaged}");
}

#[test]
fn dpslam_log_gets_times_at_a_fixed_rate_and_says_so() {
    let (scans, _, counts) = read(b"Odometry 1 2 0\nLaser 2 1 8.19\nOdometry 2 2 0\nLaser 2 1 2\n");
    assert!(counts.synthetic_times);
    assert_eq!(scans[1].stamp.since(scans[0].stamp), Duration::from_millis(200));
    assert_eq!((scans[0].robot_from_lrf, scans[1].map_from_robot_odometry), (None, Some(Pose2::new(2.0, 2.0, 0.0))));
}

#[test]
fn no_return_value_seen_in_the_third_scan_counts_in_the_first() {
    let log =
        [flaser("1 2 3 4 81.83", 0.0, 1.0), flaser("1 2 3 4 5", 0.0, 2.0), flaser(&["81.83"; 5].join(" "), 0.0, 3.0)];
    let (scans, ..) = read(log.concat().as_bytes());
    assert_eq!(scans[0].beams[4].echo, Echo::Miss);
    assert_eq!(scans[0].range_max_m, 81.83);
    assert!(scans[2].beams.iter().all(|beam| beam.echo == Echo::Miss));
}

#[test]
fn options_override_the_log() {
    let options = LogOptions {
        range_max_m: Some(2.5),
        field_of_view_rad: Some(2.0),
        robot_from_lrf: Some(Pose2::new(0.0, 0.1, 0.0)),
        ..LogOptions::default()
    };
    let log = Cursor::new(flaser("1 2 3", 0.0, 1.0).into_bytes());
    let scan = LogReader::from_reader("x", log, options).unwrap().next().unwrap().unwrap();
    assert_eq!(scan.beams.iter().map(|b| b.bearing_rad).collect::<Vec<_>>(), [-1.0, 0.0, 1.0]);
    assert_eq!((scan.beams[1].echo, scan.beams[2].echo), (Echo::Hit(2.0), Echo::Miss));
    assert_eq!(scan.robot_from_lrf, Some(Pose2::new(0.0, 0.1, 0.0)));
}

fn drain(bytes: &[u8]) {
    if let Ok(reader) = open(bytes) {
        for scan in reader.flatten() {
            for beam in &scan.beams {
                assert!(!matches!(beam.echo, Echo::Hit(r) if !(r.is_finite() && r > 0.0)));
            }
        }
    }
}

proptest! {
    #[test]
    fn arbitrary_bytes_never_panic(bytes in proptest::collection::vec(any::<u8>(), 0..2000)) {
        drain(&bytes);
    }

    #[test]
    fn almost_logs_never_panic(
        words in proptest::collection::vec(
            prop_oneof![
                Just("FLASER".to_owned()), Just("ROBOTLASER1".to_owned()), Just("Laser".to_owned()),
                Just("Odometry".to_owned()), Just("PARAM laser_max_range".to_owned()), Just("\n".to_owned()),
                Just("nan".to_owned()), Just("-inf".to_owned()), Just("1e39".to_owned()), Just("\u{e9}".to_owned()),
                any::<f32>().prop_map(|x| x.to_string()), (0u32..4).prop_map(|x| x.to_string()),
            ],
            0..200,
        )
    ) {
        drain(words.join(" ").as_bytes());
    }

    #[test]
    fn damaged_logs_never_panic(at in 0usize..3000, byte in any::<u8>()) {
        let mut log: Vec<u8> = (0..20).map(|i| flaser("1.5 2.5 81.83", f64::from(i), f64::from(i))).collect::<String>().into();
        let at = at % log.len();
        log[at] = byte;
        drain(&log);
    }

    #[test]
    fn written_scans_are_read_back(
        ranges in proptest::collection::vec(0.01..60.0_f32, 1..50), x in -1e3..1e3_f64, micros in -10_i64.pow(15)..10_i64.pow(15),
    ) {
        let text: Vec<String> = ranges.iter().map(f32::to_string).collect();
        let time = format!("{}{}.{:06}", if micros < 0 { "-" } else { "" }, micros.abs() / 1_000_000, micros.abs() % 1_000_000);
        let line = format!("FLASER {} {} {x} 0 0 {x} 0 0 {time} h 0\n", ranges.len(), text.join(" "));
        let options = LogOptions { range_max_m: Some(70.0), ..LogOptions::default() };
        let scan = LogReader::from_reader("x", Cursor::new(line.into_bytes()), options).unwrap().next().unwrap().unwrap();
        prop_assert_eq!(scan.stamp.micros, micros);
        let expected: Vec<Echo> = ranges.iter().map(|&r| Echo::Hit(r)).collect();
        prop_assert_eq!(scan.beams.iter().map(|b| b.echo).collect::<Vec<_>>(), expected);
    }
}
