//! A robot with a key on a network: who has the key, who has not, and how files with keys are made and refused.

use std::fs;
use std::io::{Read as _, Write as _};
use std::net::{SocketAddr, TcpStream};
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use crate::attach::Bench;
use crate::common::{lrfslam, run};
use lrfslam_firmware_sim::robot_process::{HostLine, Wiring, read_key_file, serve};
use lrfslam_robot::CompactPools;
use lrfslam_robot::wire::frame::{MAX_FRAME, encode};
use lrfslam_robot::wire::key::Key;
use lrfslam_robot::wire::session::{LAYOUT, Packet, VERSION};

/// Two keys in `folder`; the first is the robot's.
fn keys(folder: &Path) -> Key {
    for name in ["robot.key", "other.key"] {
        assert_eq!(run(folder, &["key", name]), (0, String::new(), String::new()));
    }
    read_key_file(&folder.join("robot.key")).unwrap()
}

/// Hosts without the key, each in another way, and one that says nothing.
fn strangers() -> Vec<Vec<u8>> {
    let framed = |payload: &[u8]| encode(payload, &mut [0; MAX_FRAME]).unwrap().to_vec();
    let hello = Packet::Hello {
        version: VERSION,
        epoch: 9,
        peer: None,
        next: 0,
        base: 0,
        credit: 32,
        is_heard: false,
        layout: LAYOUT,
    };
    let hello = framed(postcard::to_slice(&hello, &mut [0; 64]).unwrap());
    let knock = framed(&[65; 17]);
    let sealed = framed(&[67; 60]);
    vec![
        hello.clone(),
        [knock, sealed, hello].concat(),
        vec![7; 10_000],
        b"GET / HTTP/1.1\r\n\r\n".to_vec(),
        Vec::new(),
    ]
}

#[test]
fn two_hundred_connections_without_the_key_disturb_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let bench = Bench::with_key(folder, true, 0.0, Some(keys(folder)));
    let arguments = ["attach", "--port", &bench.port, "--lrf", "hokuyo", "--key-file", "robot.key", "-q", "--out"];
    let first = [&arguments[..], &["first", "--scans", "120"]].concat();
    let mut first = lrfslam(folder, &first).spawn().unwrap();
    let address: SocketAddr = bench.port.strip_prefix("tcp:").unwrap().parse().unwrap();
    let strangers = strangers();
    let mut lines = Vec::new();
    for stranger in strangers.iter().cycle().take(200) {
        let mut line = TcpStream::connect(address).unwrap();
        let _ = line.write_all(stranger);
        lines.push(line);
        std::thread::sleep(Duration::from_millis(20));
    }
    assert_eq!(first.wait().unwrap().code(), Some(0));
    let report = fs::read_to_string(folder.join("first/run.json")).unwrap();
    assert!(report.contains("\"missing_scans\": 0") && report.contains("\"partial\": false"), "{report}");
    // They have heard that there is a key, and of the robot nothing.
    for mut line in lines {
        let _ = line.set_read_timeout(Some(Duration::from_millis(3000)));
        let mut heard = Vec::new();
        let _ = line.read_to_end(&mut heard);
        assert!(heard.len() < 100, "{} bytes", heard.len());
    }
    // The next host with the key finds it.
    assert_eq!(run(folder, &[&arguments[..], &["second", "--scans", "5"]].concat()).0, 0);
}

#[test]
fn who_has_another_key_or_none_is_told_why_in_plain_words() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let key = keys(folder);
    let attach = |bench: &Bench, key: &[&str]| {
        let arguments = ["attach", "--port", &bench.port, "--lrf", "hokuyo", "-q", "--scans", "5", "--out", "map"];
        let done = run(folder, &[&arguments[..], key].concat());
        let _ = fs::remove_dir_all(folder.join("map"));
        (done.0, done.2)
    };
    for is_tcp in [true, false] {
        let bench = Bench::with_key(folder, is_tcp, 0.0, Some(key.clone()));
        let no_key = "lrfslam: this robot wants a key: --key-file\n".to_owned();
        assert_eq!(attach(&bench, &[]), (1, no_key));
        let other =
            "lrfslam: this robot has another key than this program: the same is to be at both ends\n".to_owned();
        assert_eq!(attach(&bench, &["--key-file", "other.key"]), (1, other));
        assert_eq!(attach(&bench, &["--key-file", "robot.key"]), (0, String::new()));
    }
    let bench = Bench::new(folder, true, 0.0);
    let (code, told) = attach(&bench, &["--key-file", "robot.key"]);
    assert!(code == 1 && told.starts_with("lrfslam: this robot has no key, and was to have one"), "{told}");
    assert_eq!(attach(&bench, &[]), (0, String::new()));
}

#[test]
fn a_second_host_with_the_key_is_told_that_there_is_one() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let bench = Bench::with_key(folder, true, 0.0, Some(keys(folder)));
    let digits = fs::read_to_string(folder.join("robot.key")).unwrap();
    let arguments = ["attach", "--port", &bench.port, "--lrf", "hokuyo", "-q", "--out"];
    let mut first = lrfslam(folder, &[&arguments[..], &["first", "--scans", "150"]].concat());
    // The environment's is taken, too.
    let mut first = first.env("LRFSLAM_KEY", digits.trim()).spawn().unwrap();
    std::thread::sleep(Duration::from_secs(3));
    let (code, _, told) = run(folder, &[&arguments[..], &["second", "--key-file", "robot.key"]].concat());
    assert!(code == 1 && told.contains("another host is attached to this robot"), "{code} {told}");
    assert_eq!(first.wait().unwrap().code(), Some(0));
}

#[test]
fn bad_files_with_keys_are_refused_before_anything_is_done() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let key = keys(folder);
    let (code, _, told) = run(folder, &["key", "robot.key"]);
    assert!(code == 2 && told.starts_with("lrfslam: robot.key: no key was made"), "{told}");
    assert_eq!(format!("{key:?}"), "Key", "it is not shown");
    fs::write(folder.join("short.key"), "0123\n").unwrap();
    fs::write(folder.join("open.key"), fs::read(folder.join("robot.key")).unwrap()).unwrap();
    for (name, mode) in [("short.key", 0o600), ("open.key", 0o640)] {
        fs::set_permissions(folder.join(name), fs::Permissions::from_mode(mode)).unwrap();
    }
    for (file, why) in [
        ("none.key", "none.key: No such file"),
        ("short.key", "short.key: this is no key: 64 hexadecimal digits"),
        ("open.key", "open.key: others can read this key: chmod 600 it"),
        (".", "this is no key"),
    ] {
        let (code, _, told) = run(folder, &["attach", "--port", "x", "--lrf", "hokuyo", "--key-file", file]);
        assert!(code == 2 && told.contains(why), "{code} {told}");
        let told = format!("{:#}", read_key_file(&folder.join(file)).unwrap_err());
        assert!(told.contains(why), "{told}");
    }
    let mut attach = lrfslam(folder, &["attach", "--port", "x", "--lrf", "hokuyo"]);
    let done = attach.env("LRFSLAM_KEY", "robot").output().unwrap();
    let told = String::from_utf8_lossy(&done.stderr).into_owned();
    assert!(done.status.code() == Some(2) && told.contains("LRFSLAM_KEY: this is no key"), "{told}");
    assert!(!folder.join("robot-map").exists());
}

#[test]
fn a_robot_without_a_key_is_not_for_others_on_the_network() {
    let everywhere = SocketAddr::from(([0, 0, 0, 0], 0));
    let wiring = Wiring { laser: "none".into(), host: HostLine::Tcp(everywhere), key: None, faults: (0.0, 1) };
    let stop = Arc::new(AtomicBool::new(true));
    let told = format!("{:#}", serve::<CompactPools>(&wiring, &stop, &|_| ()).unwrap_err());
    assert!(told.starts_with("0.0.0.0:0: whoever reaches this address commands the robot: give it a key"), "{told}");
    let wiring = Wiring { key: Some(Key::new([1; 32])), ..wiring };
    serve::<CompactPools>(&wiring, &stop, &|_| ()).unwrap();
}
