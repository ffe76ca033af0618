//! Bags that others have written: `golden/bags/make.py` makes them with rosbags, and says with which version.

use std::path::{Path, PathBuf};

use lrfslam_core::geometry::Pose2;
use lrfslam_core::scan::Echo;
use lrfslam_core::time::Instant;
use lrfslam_host::scans::bags::TfWanted;
use lrfslam_host::scans::log::{LogError, LogFormat, LogOptions, LogReader, LogScan};

const SCANS: usize = 12;
const BAGS: [(&str, LogFormat); 6] = [
    ("ros2.mcap", LogFormat::Mcap),
    ("ros2-zstd.mcap", LogFormat::Mcap),
    ("ros2.db3", LogFormat::RosSqlite),
    ("ros1.bag", LogFormat::Ros1),
    ("ros1-bz2.bag", LogFormat::Ros1),
    ("ros1-lz4.bag", LogFormat::Ros1),
];

/// Their odometry and the laser's place are among frames.
const FRAMED: [&str; 3] = ["tf-ros2.mcap", "tf-ros2.db3", "tf-ros1.bag"];

fn golden(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/bags").join(name)
}

/// What `make.py` has put into scan `number`.
fn check(number: usize, scan: &LogScan, name: &str) {
    let place = format!("{name}, scan {number}");
    assert_eq!(scan.stamp, Instant::from_micros(1_000_000_000 + 100_000 * number as i64), "{place}");
    assert_eq!((scan.beams.len(), scan.range_max_m), (40 + number % 3, 8.0), "{place}");
    for (index, beam) in scan.beams.iter().enumerate() {
        assert!((beam.bearing_rad - (-1.0 + 0.05 * index as f32)).abs() < 1e-5, "{place}");
        assert_eq!(beam.offset.micros, 1000 * index as i64, "{place}");
        let range_m = (1.0 + 0.01 * number as f64 + 0.1 * index as f64) as f32;
        let wanted = match index {
            5 => Echo::Miss,
            6 | 7 => Echo::Invalid,
            _ => Echo::Hit(range_m),
        };
        assert_eq!(beam.echo, wanted, "{place}, beam {index}");
    }
    let odometry = scan.map_from_robot_odometry.unwrap();
    let error = odometry.between(Pose2::new(0.1 * number as f32, 2.0, 0.5));
    assert!(error.position().norm() < 1e-5 && error.heading.abs() < 1e-6, "{place}: {odometry:?}");
}

#[test]
fn bags_of_others_are_read_scan_by_scan_with_odometry_between_messages() {
    for (name, format) in BAGS {
        let mut reader = LogReader::open(&golden(name), LogOptions::default()).unwrap();
        assert_eq!(reader.format(), Some(format), "{name}");
        let scans: Vec<_> = reader.by_ref().map(Result::unwrap).collect();
        assert_eq!(scans.len(), SCANS, "{name}");
        scans.iter().enumerate().for_each(|(number, scan)| check(number, scan, name));
        let counts = reader.counts();
        assert!(counts.damaged_lines == 0 && !counts.cut_last_line && counts.backward_times == 0, "{name}: {counts:?}");
        assert_eq!(reader.sha256().len(), 64, "{name}");
    }
}

/// What is wanted of frames: odometry from `odometry`, and the laser on `robot`.
fn wanted(odometry: Option<&'static str>, robot: Option<&'static str>) -> LogOptions {
    let tf = TfWanted { odometry_frame: odometry, mounting: true, robot_frame: robot };
    LogOptions { tf, ..LogOptions::default() }
}

#[test]
fn frames_of_bags_tell_odometry_and_where_the_laser_is() {
    for name in FRAMED {
        let mut reader = LogReader::open(&golden(name), wanted(Some("odom"), None)).unwrap();
        let scans: Vec<_> = reader.by_ref().map(Result::unwrap).collect();
        assert_eq!(scans.len(), SCANS, "{name}");
        for (number, scan) in scans.iter().enumerate() {
            // The same as those of the bags with messages of odometry.
            check(number, scan, name);
            let off = scan.robot_from_lrf.unwrap().between(Pose2::new(0.1, 0.3, std::f32::consts::PI));
            assert!(off.position().norm() < 1e-6 && off.heading.abs() < 1e-6, "{name}: {scan:?}");
        }
        assert_eq!(reader.counts().damaged_lines, 0, "{name}");
        let words = reader.frames_found().join("; ");
        let parts = ["odom → base_footprint → base_link", "base_link → plate → a_laser", "0.100 m forward", "180.00°"];
        assert!(parts.iter().all(|part| words.contains(part)), "{name}: {words}");
        // Another frame of the robot moves both.
        let mut reader = LogReader::open(&golden(name), wanted(Some("odom"), Some("base_footprint"))).unwrap();
        let scan = reader.next().unwrap().unwrap();
        let (robot, lrf) = (scan.map_from_robot_odometry.unwrap(), scan.robot_from_lrf.unwrap());
        assert!((lrf.x - 1.1).abs() < 1e-6 && (robot.y - (2.0 - 0.5_f32.sin())).abs() < 1e-6, "{name}");
        // Where nothing of it is wanted, none is read.
        let scan = LogReader::open(&golden(name), LogOptions::default()).unwrap().next().unwrap().unwrap();
        assert_eq!((scan.map_from_robot_odometry, scan.robot_from_lrf), (None, None), "{name}");
    }
}

#[test]
fn a_frame_that_is_missing_is_said_with_those_that_there_are() {
    let fault = |name: &str, options| LogReader::open(&golden(name), options).err().unwrap().to_string();
    for name in FRAMED {
        let text = fault(name, wanted(Some("odom_combined"), None));
        let parts = [
            name,
            "odom_combined → base_link or base_footprint",
            "base_link → plate (static)",
            "odom → base_footprint,",
        ];
        assert!(parts.iter().all(|part| text.contains(part)), "{text}");
        let text = fault(name, wanted(None, Some("wheel")));
        assert!(text.contains("no transforms wheel → a_laser"), "{text}");
    }
    let text = fault("ros2.mcap", wanted(Some("odom"), None));
    assert!(text.contains("no transforms odom → base_link or base_footprint") && text.ends_with("are none"), "{text}");
    let log = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/floor.log.gz");
    let text = LogReader::open(&log, wanted(None, None)).err().unwrap().to_string();
    assert!(text.contains("only bags of ROS have them"), "{text}");
}

#[test]
fn damaged_frames_are_told_and_end_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    for name in FRAMED {
        let whole = std::fs::read(golden(name)).unwrap();
        let path = folder.path().join(name);
        let mut read = 0;
        for at in (16..whole.len()).step_by(whole.len() / 60) {
            let mut bytes = whole.clone();
            bytes[at] ^= 0x40;
            std::fs::write(&path, &bytes).unwrap();
            if let Ok(reader) = LogReader::open(&path, wanted(Some("odom"), None)) {
                let count = reader.filter(Result::is_ok).count();
                assert!(count <= SCANS, "{name} {at}");
                read += usize::from(count > 0);
            }
        }
        assert!(read > 0, "{name}");
    }
}

#[test]
fn a_cut_bag_is_read_as_far_as_it_goes() {
    let folder = tempfile::tempdir().unwrap();
    for (name, _) in BAGS {
        let whole = std::fs::read(golden(name)).unwrap();
        let (mut most, path) = (0, folder.path().join(name));
        for cut in (16..whole.len()).step_by(whole.len() / 40) {
            std::fs::write(&path, &whole[..cut]).unwrap();
            let Ok(reader) = LogReader::open(&path, LogOptions::default()) else { continue };
            let scans: Vec<_> = reader.map(Result::unwrap).collect();
            for (number, scan) in scans.iter().enumerate() {
                let is_last = number + 2 >= scans.len();
                // The last ones may lack the odometry behind them.
                if !is_last {
                    check(number, scan, name);
                }
            }
            most = most.max(scans.len());
        }
        // A packed bag is one chunk: there is nothing before its end.
        assert!(most == SCANS, "{name}: {most} scans at most");
    }
}

#[test]
fn damage_is_told_and_ends_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    for (name, _) in BAGS {
        let whole = std::fs::read(golden(name)).unwrap();
        let path = folder.path().join(name);
        for at in (16..whole.len()).step_by(whole.len() / 60) {
            let mut bytes = whole.clone();
            bytes[at] ^= 0x40;
            std::fs::write(&path, &bytes).unwrap();
            if let Ok(reader) = LogReader::open(&path, LogOptions::default()) {
                assert!(reader.filter(Result::is_ok).count() <= SCANS, "{name} {at}");
            }
        }
    }
}

#[test]
fn what_is_wrong_with_a_bag_is_said_with_file_topic_and_type() {
    let folder = tempfile::tempdir().unwrap();
    let fault = |path: &Path, topic| match LogReader::open(path, LogOptions { topic, ..LogOptions::default() }) {
        Ok(_) => panic!("{}: is read", path.display()),
        Err(error) => error.to_string(),
    };
    for (name, _) in BAGS {
        let text = fault(&golden(name), Some("/odom"));
        let parts =
            [name, "on /odom", "sensor_msgs/LaserScan", "/scan (sensor_msgs/LaserScan)", "/odom (nav_msgs/Odometry)"];
        assert!(parts.iter().all(|part| text.contains(part)), "{text}");
        assert!(LogReader::open(&golden(name), LogOptions { topic: Some("/scan"), ..LogOptions::default() }).is_ok());
    }
    // In a folder, as `ros2 bag record` leaves it, in several files.
    let bag = folder.path().join("drive");
    std::fs::create_dir(&bag).unwrap();
    std::fs::write(bag.join("metadata.yaml"), "").unwrap();
    assert!(fault(&bag, None).contains("it is a folder"));
    for part in 0..2 {
        std::fs::copy(golden("ros2.mcap"), bag.join(format!("drive_{part}.mcap"))).unwrap();
    }
    let scans = LogReader::open(&bag, LogOptions::default()).unwrap();
    assert_eq!(scans.map(Result::unwrap).count(), 2 * SCANS);
    let other = folder.path().join("other.db3");
    std::fs::write(&other, [b"SQLite format 3\0".as_slice(), &[0; 200]].concat()).unwrap();
    let text = fault(&other, None);
    assert!(text.contains("other.db3: cannot be read as a bag: an SQLite file with pages of 0 bytes"), "{text}");
    // The broken message is named, and what it should be.
    let bytes = std::fs::read(golden("ros2.mcap")).unwrap();
    let at = bytes.windows(16).position(|bytes| bytes == b"\x08\0\0\0a_laser\0\0\0\x80\xbf").unwrap();
    let mut broken = bytes;
    // The number of ranges of the first scan.
    broken[at + 12 + 28 + 3] = 0x7f;
    let path = folder.path().join("broken.mcap");
    std::fs::write(&path, broken).unwrap();
    match LogReader::open(&path, LogOptions::default()) {
        Ok(mut reader) => {
            let count = reader.by_ref().count();
            let first = reader.counts().damaged.first().cloned().unwrap();
            assert!(count <= SCANS && reader.counts().damaged_lines > 0, "{first}");
        }
        Err(LogError::AllDamaged { first, .. }) => assert!(!first.fault.expected.is_empty()),
        Err(other) => panic!("{other}"),
    }
}
