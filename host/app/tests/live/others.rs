//! Hosts and robots that nobody asked for: a second host, and a robot that is broken or hostile.

use std::io::{Read as _, Write as _};
use std::net::{TcpListener, TcpStream};
use std::time::{Duration, Instant};

use crate::attach::Bench;
use crate::common::{lrfslam, run};
use lrfslam_core::distributed_map::Region;
use lrfslam_core::geometry::Pose2;
use lrfslam_core::time::Instant as RobotTime;
use lrfslam_robot::wire::frame::{MAX_FRAME, encode};
use lrfslam_robot::wire::message::{Capacities, FromRobot, Identity, ScanPose, TileUpdate};
use lrfslam_robot::wire::session::{LAYOUT, Packet, VERSION};

#[test]
fn a_second_host_is_told_and_the_first_loses_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let bench = Bench::new(folder.path(), true, 0.0);
    let arguments = ["attach", "--port", &bench.port, "--lrf", "hokuyo", "-q", "--out"];
    let first = [&arguments[..], &["first", "--scans", "150"]].concat();
    let mut first = lrfslam(folder.path(), &first).spawn().unwrap();
    std::thread::sleep(Duration::from_secs(3));
    let (code, _, stderr) = run(folder.path(), &[&arguments[..], &["second", "--scans", "20"]].concat());
    let told = format!("{}: another host is attached to this robot", bench.port);
    assert!(code == 1 && stderr.starts_with(&told) && stderr.contains("given up after 10 s"), "{code} {stderr}");
    assert_eq!(stderr.matches("another host").count(), 2, "at once, and at the end: {stderr}");
    assert_eq!(first.wait().unwrap().code(), Some(0));
    let report = std::fs::read_to_string(folder.path().join("first/run.json")).unwrap();
    assert!(report.contains("\"missing_scans\": 0") && report.contains("\"partial\": false"), "{report}");
    // The first has gone: the robot is to be had.
    assert_eq!(run(folder.path(), &[&arguments[..], &["third", "--scans", "5"]].concat()).0, 0);
}

fn send(line: &mut TcpStream, packet: &Packet<'_>) -> std::io::Result<()> {
    let (mut payload, mut frame) = ([0; MAX_FRAME], [0; MAX_FRAME]);
    let payload = postcard::to_slice(packet, &mut payload).unwrap();
    line.write_all(encode(payload, &mut frame).unwrap())
}

/// A robot that says hello and what it is, and then these messages, for ever.
fn robot_that_says<'a>(message: impl Fn(u32) -> FromRobot<'a> + Send + 'static) -> String {
    let robot = TcpListener::bind(("127.0.0.1", 0)).unwrap();
    let port = format!("tcp:{}", robot.local_addr().unwrap());
    std::thread::spawn(move || {
        let (mut line, _) = robot.accept().unwrap();
        let mut ears = line.try_clone().unwrap();
        std::thread::spawn(move || while ears.read(&mut [0; 4096]).is_ok_and(|count| count > 0) {});
        let hello = Packet::Hello {
            version: VERSION,
            epoch: 7,
            peer: None,
            next: 0,
            base: 0,
            credit: 32,
            is_heard: false,
            layout: LAYOUT,
        };
        send(&mut line, &hello).unwrap();
        let capacities =
            Capacities { beams: 682, particles: 32, tiles: 1728, tile_side: 8, ndt_tiles: 966, window_side: 33 };
        for sequence in 0.. {
            let said = match sequence {
                0 => FromRobot::Identity(Identity { board: "evil\u{1b}[2J", is_configured: false, capacities }),
                _ => message(sequence),
            };
            let mut memory = [0; MAX_FRAME];
            let message = &*postcard::to_slice(&said, &mut memory).unwrap();
            if send(&mut line, &Packet::Reliable { epoch: 7, sequence, message }).is_err() {
                return;
            }
        }
    });
    port
}

fn pose(number: u32, x: f32) -> FromRobot<'static> {
    let stamp = RobotTime::from_micros(100_000 * i64::from(number));
    let odometry = Pose2::new(x, 0.0, 0.0);
    FromRobot::Scan(ScanPose { stamp, number, step: 0, moved: odometry, odometry, undetermined: None, is_lost: false })
}

#[test]
fn what_no_robot_says_ends_the_session_and_is_named() {
    const REGION: Region = Region { columns: [-3000, 3000], rows: [-3000, 3000] };
    let apart = |index: u32| (index as i32 * 300 - 27_000) as i16;
    let place = move |number: u32| (apart(number % 180), apart(number / 180));
    let tile = move |number| {
        let (column, row) = place(number);
        FromRobot::Left(TileUpdate { column, row, squares: &[1; 128] })
    };
    let folder = tempfile::tempdir().unwrap();
    for (port, why) in [
        (robot_that_says(|_| FromRobot::Recall(REGION)), "message Recall cannot be true"),
        (robot_that_says(tile), "message Left cannot be true: a map of 8193 tiles in 8193 blocks"),
        (robot_that_says(|number| pose(number, if number > 9 { 9000.0 } else { 0.0 })), "message Scan cannot be true"),
        (robot_that_says(|_| FromRobot::Said("\u{1b}]0;mine\u{7}")), "more than 2000 messages a second"),
    ] {
        let started = Instant::now();
        let arguments = ["attach", "--port", &port, "--lrf", "hokuyo", "--out", "map", "--overwrite"];
        let (code, _, stderr) = run(folder.path(), &arguments);
        assert!(code == 1 && stderr.contains(why), "{why}: {code} {}", &stderr[..stderr.len().min(1000)]);
        assert!(!stderr.contains(['\u{1b}', '\u{7}']), "control characters are shown, not sent");
        assert!(started.elapsed() < Duration::from_secs(60), "{why}: {:?}", started.elapsed());
        let _ = std::fs::remove_dir_all(folder.path().join("map"));
    }
}
