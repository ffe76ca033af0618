//! Robots in Zenoh: found and watched by `lrfslam watch`, and by Eclipse's Python package where LRFSLAM_PYTHON (else python3) has it.
//!
//! ```sh
//! python3 -m venv guest && guest/bin/pip install eclipse-zenoh
//! LRFSLAM_PYTHON=$PWD/guest/bin/python cargo test -p lrfslam --features zenoh --test live fleet -- --nocapture
//! ```
//! All of it stays on 127.0.0.1.

use std::io::{BufRead as _, BufReader};
use std::net::TcpListener;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Instant;

use serde_json::Value;

use crate::browser::Browser;
use crate::common::{lrfslam, run};
use crate::page::{SOON, Watched, floor};

const SCANS: u64 = 40;

/// A run that tells of itself in Zenoh and stays, until dropped.
struct Robot(Child);

impl Robot {
    fn start(folder: &Path, name: &str, place: &str) -> Self {
        let (log, scans) = (floor(), SCANS.to_string());
        let args = ["map", log.to_str().unwrap(), "--out", name, "--scans", &scans, "--zenoh", place, "--monitor-stay"];
        let mut command = lrfslam(folder, &[&args[..], &["--zenoh-name", name]].concat());
        let mut child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
        let mut lines = BufReader::new(child.stderr.take().unwrap()).lines();
        let said = lines.next().unwrap().unwrap();
        assert_eq!(said, format!("in Zenoh: {name}"));
        // Nobody reads what else it says: it must not wait for that.
        std::thread::spawn(move || lines.count());
        Self(child)
    }
}

impl Drop for Robot {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn free_address() -> String {
    TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().to_string()
}

#[test]
fn robots_in_zenoh_are_watched_on_one_page_and_as_json() {
    let folder = tempfile::tempdir().unwrap();
    let (address, other) = (free_address(), free_address());
    let robot = Robot::start(folder.path(), "r1", &format!("listen:{address}"));
    // The page is there first, and listens; a robot comes to it.
    let (place, listening) = (format!("zenoh:{address}"), format!("zenoh:listen:{other}"));
    let page = Watched::run(folder.path(), &["watch", "--at", "0", &place, &listening]);
    let _second = Robot::start(folder.path(), "r2", &other);
    let begun = Instant::now();
    while page.status("GET /robots/1/status", "") != "200" {
        assert!(begun.elapsed() < SOON, "{}", page.said.lock().unwrap());
    }
    assert_eq!(page.status("GET /robots/0/changes?0-0", ""), "200");
    let token = format!("Authorization: Bearer {}\r\n", crate::page::TOKEN);
    assert_eq!(page.status("POST /robots/0/stop", &token), "403", "nobody commands by Zenoh");
    // Who comes late has all that a run has done.
    let mut command = lrfslam(folder.path(), &["watch", "--json", &place]);
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
    let lines = BufReader::new(child.stdout.take().unwrap()).lines();
    let said = lines.map(|line| serde_json::from_str::<Value>(&line.unwrap()).unwrap());
    let last = said.into_iter().find(|line| line["robot"] == "r1" && line["status"]["scans"] == SCANS);
    assert_eq!(last.unwrap()["status"]["mood"], "good");
    child.kill().unwrap();
    child.wait().unwrap();
    if let Some(mut browser) = Browser::start() {
        let both = browser.open(&page.url(), [1000, 700]);
        let are_there = "lrfslam.robots().length === 2 && lrfslam.robots().every((robot) => robot.map.tiles.size > 0)";
        browser.wait(&both, are_there, SOON);
        drop(robot);
        browser.wait(&both, "lrfslam.robots()[0].link === 'away' && lrfslam.robots()[1].link === 'there'", SOON);
        assert_eq!(browser.faults, Vec::<String>::new());
    }
}

#[test]
fn what_is_wrong_with_a_place_or_a_name_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let (address, log) = (free_address(), floor());
    let robot = Robot::start(folder.path(), "r1", &format!("listen:{address}"));
    let map = |more: &[&str]| run(folder.path(), &[&["map", log.to_str().unwrap(), "--out", "out"][..], more].concat());
    let (code, _, stderr) = map(&["--zenoh", &address, "--zenoh-name", "r1"]);
    assert!(code == 2 && stderr.contains("there is a robot r1 already"), "{stderr}");
    let (code, _, stderr) = map(&["--zenoh", &format!("listen:{address}")]);
    assert!(code == 2 && stderr.contains(&format!("zenoh:{address}: cannot be joined")), "{stderr}");
    let (code, _, stderr) = map(&["--zenoh", "tcp/router:1"]);
    assert!(code == 2 && stderr.contains("expected HOST[:PORT] of a Zenoh router"), "{stderr}");
    drop(robot);
}

#[test]
fn another_zenoh_reads_state_and_status() {
    let python = std::env::var("LRFSLAM_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let import = Command::new(&python).args(["-c", "import zenoh; zenoh.open"]).stderr(Stdio::null()).status();
    if !import.is_ok_and(|status| status.success()) {
        println!("skipped: {python} has no eclipse-zenoh (set LRFSLAM_PYTHON to one that has)");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let address = free_address();
    let _robot = Robot::start(folder.path(), "r1", &format!("listen:{address}"));
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/live/fleet_listen.py");
    let output = Command::new(&python).arg("-B").arg(script).arg(&address).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let said: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(said["alive"], serde_json::json!(["lrfslam/r1"]));
    assert_eq!(said["changes"][0][0], "lrfslam/r1/changes");
    assert!(said["changes"][0][1].as_u64().unwrap() > 100, "{said}");
    assert_eq!((&said["status"][0][0], &said["status"][0][1]["what"]), (&"lrfslam/r1/status".into(), &"map".into()));
    assert_eq!(said["wrong"], serde_json::json!(["expected INSTANCE-REVISION"]));
    let heard = said["heard"].as_array().unwrap();
    assert!(heard.len() >= 2 && heard.iter().all(|status| status["what"] == "map"), "{said}");
}
