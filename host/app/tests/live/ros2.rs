//! ROS 2 against a DDS that is not ours: Eclipse Cyclone DDS, in a Python that has `cyclonedds` of PyPI (LRFSLAM_PYTHON, else python3).
//!
//! ```sh
//! python3 -m venv dds && dds/bin/pip install cyclonedds
//! LRFSLAM_PYTHON=dds/bin/python cargo test -p lrfslam --features ros2 --test live ros2 -- --nocapture
//! ```
//! All of it stays on 127.0.0.1.

use std::fs;
use std::io::{BufRead as _, BufReader, Read as _};
use std::path::Path;
use std::process::{Child, ChildStdout, Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::common::{lrfslam, read_positions, run};
use crate::laser::Laser;
use lrfslam_core::scan::Echo;
use lrfslam_host::pose_f64::PoseF64;
use lrfslam_host::runs::scans::read_scans;
use lrfslam_host::scans::log::LogOptions;

/// One for each run of each test: nobody meets another's messages.
fn domain(test: u32) -> String {
    (1 + (2 * std::process::id() + test) % 100).to_string()
}

/// A script beside this file, ended when dropped.
struct Script {
    child: Child,
    said: BufReader<ChildStdout>,
}

impl Script {
    /// `None` where Python lacks Cyclone, which is said.
    fn start(name: &str, domain: &str, arguments: &[&str]) -> Option<Self> {
        let python = std::env::var("LRFSLAM_PYTHON").unwrap_or_else(|_| "python3".to_owned());
        let import = Command::new(&python).args(["-c", "import cyclonedds"]).stderr(Stdio::null()).status();
        if !import.is_ok_and(|status| status.success()) {
            println!("skipped: {python} has no cyclonedds (set LRFSLAM_PYTHON to one that has)");
            return None;
        }
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/live").join(name);
        let mut command = Command::new(python);
        command.arg("-B").arg(script).args(arguments).env("ROS_DOMAIN_ID", domain);
        let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().expect("it starts");
        let said = BufReader::new(child.stdout.take().expect("piped"));
        Some(Self { child, said })
    }

    fn line(&mut self) -> String {
        let mut line = String::new();
        self.said.read_line(&mut line).expect("text");
        line.trim_end().to_owned()
    }

    /// Nothing more comes: what it says then.
    fn finish(mut self) -> String {
        drop(self.child.stdin.take());
        let mut said = String::new();
        self.said.read_to_string(&mut said).expect("text");
        said
    }
}

impl Drop for Script {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().expect("numbers").iter().filter_map(Value::as_f64).collect()
}

fn pose(value: &Value) -> PoseF64 {
    let numbers = numbers(value);
    PoseF64::new(numbers[0], numbers[1], numbers[2])
}

fn all(heard: &Value, topic: &str) -> Vec<Value> {
    heard[topic].as_array().expect("messages").clone()
}

fn are_near(one: PoseF64, other: PoseF64) -> bool {
    let off = one.between(other);
    off.distance_m() < 1e-5 && off.heading.abs() < 1e-5
}

#[test]
fn another_dds_receives_scan_map_frames_and_poses_of_a_run() {
    let domain = domain(0);
    let Some(mut listener) = Script::start("ros2_listen.py", &domain, &[]) else { return };
    assert_eq!(listener.line(), "ready");
    let folder = tempfile::tempdir().unwrap();
    let laser = Laser::hokuyo(folder.path());
    let arguments =
        ["run", "--lrf", "hokuyo", "--port", &laser.port(), "--ros2", "--scans", "80", "--out", "out", "-q"];
    let mut program = lrfslam(folder.path(), &arguments);
    let output = program.env("ROS_DOMAIN_ID", &domain).env("ROS_LOCALHOST_ONLY", "1").output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let heard: Value = serde_json::from_str(&listener.finish()).expect("JSON");
    let out = folder.path().join("out");
    scans_are_those_recorded(&heard, &out);
    frames_and_poses_agree(&heard, &out);
    last_map_is_the_file(&heard, &out);
}

/// To the bit, with their times.
fn scans_are_those_recorded(heard: &Value, out: &Path) {
    let recorded = read_scans(&out.join("laser.rec"), LogOptions::default()).unwrap();
    let scans = all(heard, "scan");
    assert!(scans.len() >= 60, "{} of 80 scans", scans.len());
    for scan in &scans {
        let begins = |stamp: i64, offset: i64| Some(stamp + offset) == scan[0].as_i64();
        let same = recorded.iter().find(|of| begins(of.stamp.micros, of.beams[0].offset.micros)).expect("recorded");
        let range = |echo| match echo {
            Echo::Hit(range_m) => range_m,
            Echo::Miss => f32::INFINITY,
            Echo::Invalid => f32::NAN,
        };
        let ranges: Vec<f32> =
            scan[6].as_array().unwrap().iter().map(|range| range.as_str().unwrap().parse().unwrap()).collect();
        let are_equal =
            |(beam, found): (&lrfslam_core::scan::Beam, &f32)| range(beam.echo).to_bits() == found.to_bits();
        assert!(ranges.len() == same.beams.len() && same.beams.iter().zip(&ranges).all(are_equal), "{scan}");
        assert_eq!(scan[1], "laser");
        let last = scan[2].as_f64().unwrap() + scan[3].as_f64().unwrap() * (ranges.len() - 1) as f64;
        assert!((last - f64::from(same.beams.last().unwrap().bearing_rad)).abs() < 1e-4, "{scan}");
    }
}

/// map → odom → base_link is the pose that is told, the last one that of the trajectory, and odom has no jumps.
fn frames_and_poses_agree(heard: &Value, out: &Path) {
    let (poses, odometry) = (all(heard, "pose"), all(heard, "odom"));
    let mut last: Option<PoseF64> = None;
    let mut compared = 0;
    for frames in all(heard, "tf") {
        let names: Vec<_> =
            frames.as_array().unwrap().iter().map(|frame| (frame[1].clone(), frame[2].clone())).collect();
        let expected = [("map", "odom"), ("odom", "base_link"), ("base_link", "laser")];
        assert_eq!(names, expected.map(|(parent, child)| (parent.into(), child.into())));
        let [map_from_odom, odom_from_robot] = [0, 1].map(|index| pose(&frames[index][3]));
        let told = |of: &[Value]| of.iter().find(|message| message[0] == frames[0][0]).map(|message| pose(&message[1]));
        if let Some((placed, by_odometry)) = told(&poses).zip(told(&odometry)) {
            assert!(are_near(map_from_odom.then(odom_from_robot), placed) && are_near(odom_from_robot, by_odometry));
            compared += 1;
        }
        let moved = last.replace(odom_from_robot).map_or(0.0, |last| last.between(odom_from_robot).distance_m());
        assert!(moved < 0.5, "odom jumps by {moved} m");
    }
    assert!(compared >= 60, "{compared} compared");
    let (stamp, x, y) = read_positions(&out.join("trajectory.tum")).pop().unwrap();
    let end = poses.last().unwrap();
    let stamp_us = (stamp.parse::<f64>().unwrap() * 1e6).round();
    assert!((stamp_us - end[0].as_f64().unwrap()).abs() <= 1.0, "{stamp} {end}");
    let off = pose(&end[1]).between(PoseF64::new(x, y, 0.0)).distance_m();
    assert!(off < 1e-4, "{off} m from the end of the trajectory");
    assert!(numbers(end)[1..].iter().all(|variance| *variance > 0.0 && *variance < 1.0), "{end}");
}

/// Cell by cell.
fn last_map_is_the_file(heard: &Value, out: &Path) {
    let maps = all(heard, "map");
    let map = maps.last().expect("a map");
    let image = fs::read(out.join("map.pgm")).unwrap();
    let sizes = [&map[1], &map[2]].map(|side| side.as_u64().unwrap() as usize);
    let cells = &image[image.len() - sizes[0] * sizes[1]..];
    let as_told = |cell: &u8| match cell {
        254 => "00",
        0 => "64",
        _ => "ff",
    };
    let expected: String = cells.chunks(sizes[0]).rev().flatten().map(as_told).collect();
    assert!(map[0] == "map" && map[6] == expected, "{} x {}", map[1], map[2]);
    let about = fs::read_to_string(out.join("map.yaml")).unwrap();
    let origin = about.lines().find_map(|line| line.strip_prefix("origin: ")).unwrap();
    let origin: Vec<f64> = serde_json::from_str(origin).unwrap();
    assert!((map[4].as_f64().unwrap() - origin[0]).abs() < 1e-6 && (map[5].as_f64().unwrap() - origin[1]).abs() < 1e-6);
}

/// Scans of the floor that are published.
const PUBLISHED: usize = 200;
/// A second. The log has 4.
const RATE: &str = "15";
/// Where scans got lost on the way, the paths agree within this, m.
const NEAR_M: f64 = 0.05;

#[test]
fn what_another_dds_publishes_is_mapped_as_its_log_is() {
    let domain = domain(1);
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let log = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/floor.log.gz");
    let log = log.to_str().unwrap();
    let published = folder.join("scans.txt");
    fs::write(&published, published_lines(log)).unwrap();
    let Some(mut publisher) = Script::start("ros2_publish.py", &domain, &[RATE, published.to_str().unwrap()]) else {
        return;
    };
    let scans = PUBLISHED.to_string();
    let arguments = ["run", "--lrf", "ros2:/left/scan", "--scans", &scans, "--seconds", "49.6", "--out", "told", "-q"];
    let mut program = lrfslam(folder, &arguments);
    let mut program =
        program.env("ROS_DOMAIN_ID", &domain).env("ROS_LOCALHOST_ONLY", "1").stderr(Stdio::piped()).spawn().unwrap();
    assert_eq!(publisher.line(), scans);
    end_of(&mut program);
    let (code, _, stderr) = run(folder, &["map", log, "--scans", &scans, "--out", "logged", "-q"]);
    assert_eq!(code, 0, "{stderr}");
    let [told, logged] = ["told", "logged"].map(|name| read_positions(&folder.join(name).join("trajectory.tum")));
    let report: Value = serde_json::from_slice(&fs::read(folder.join("told/run.json")).unwrap()).unwrap();
    println!("{} of {PUBLISHED} scans mapped, {} lost", told.len(), report["laser"]["overrun"]);
    if told.len() == PUBLISHED {
        let same = |name: &str| {
            fs::read(folder.join("told").join(name)).unwrap() == fs::read(folder.join("logged").join(name)).unwrap()
        };
        assert!(same("trajectory.tum") && same("map.pgm"), "all scans came, and the results differ");
        return;
    }
    assert!(told.len() > PUBLISHED * 9 / 10, "{} scans came", told.len());
    for (stamp, x, y) in &told {
        let (_, log_x, log_y) = logged.iter().find(|(of, ..)| of == stamp).expect("published");
        assert!((x - log_x).hypot(y - log_y) < NEAR_M, "at {stamp}");
    }
}

/// A run that lacks its last scan waits for it: it is told to end.
fn end_of(program: &mut Child) {
    let waited = Instant::now();
    while program.try_wait().unwrap().is_none() {
        if waited.elapsed() > Duration::from_secs(30) {
            let id = rustix::process::Pid::from_child(program);
            rustix::process::kill_process(id, rustix::process::Signal::INT).unwrap();
        }
        std::thread::sleep(Duration::from_millis(100));
    }
}

/// Stamp (µs), first bearing and step (rad), largest range and ranges (m), as the log's lines have them.
fn published_lines(log: &str) -> String {
    let scans = read_scans(Path::new(log), LogOptions::default()).unwrap();
    let line = |scan: &lrfslam_host::scans::log::LogScan| {
        let first = scan.beams[0].bearing_rad;
        let step = 0.01745329_f32;
        let range = |echo| match echo {
            Echo::Hit(range_m) => range_m,
            Echo::Miss => f32::INFINITY,
            Echo::Invalid => f32::NAN,
        };
        let ranges: Vec<String> = scan.beams.iter().map(|beam| range(beam.echo).to_string()).collect();
        format!("{} {first} {step} {} {}\n", scan.stamp.micros, scan.range_max_m, ranges.join(" "))
    };
    scans.iter().take(PUBLISHED).map(line).collect()
}
