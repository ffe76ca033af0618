//! A map made with a laser, and the robot found in it again: by the laser's recording, and by the laser itself.

use std::fs;
use std::path::Path;

use crate::common::{read_positions, run};
use crate::laser::Laser;

/// A position as near as this is right.
const RIGHT_M: f64 = 0.25;

fn report(folder: &Path) -> serde_json::Value {
    serde_json::from_slice(&fs::read(folder.join("run.json")).unwrap()).unwrap()
}

/// A robot begins to drive where all robots on this floor do, and its laser is mapped, or whatever else `arguments` say.
fn drive(folder: &Path, name: &str, arguments: &[&str]) -> String {
    let place = folder.join(format!("laser-{name}"));
    fs::create_dir(&place).unwrap();
    let laser = Laser::far_sighted(&place);
    let port = ["--lrf", "hokuyo", "--port", &laser.port(), "--out", name];
    let (code, _, stderr) = run(folder, &[arguments, &port].concat());
    assert_eq!(code, 0, "{name}: {stderr}");
    stderr
}

/// The largest distance between poses of the same time; a busy computer maps not every scan that it records.
fn farthest_apart(path: &Path, other: &Path) -> f64 {
    let other = read_positions(&other.join("trajectory.tum"));
    let distance = |(stamp, x, y): (String, f64, f64)| {
        let (_, other_x, other_y) = other.iter().find(|(of, ..)| *of == stamp)?;
        Some((x - other_x).hypot(y - other_y))
    };
    let apart: Vec<f64> = read_positions(&path.join("trajectory.tum")).into_iter().filter_map(distance).collect();
    assert!(2 * apart.len() >= other.len(), "{} poses at the same times as {}", apart.len(), other.len());
    apart.into_iter().fold(0.0, f64::max)
}

#[test]
fn a_robot_is_found_in_the_map_that_its_own_laser_made() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    drive(folder, "visit", &["run", "--seconds", "12", "-q"]);
    let scans = report(&folder.join("visit"))["cost"]["scans"].as_u64().unwrap();
    let map = fs::read(folder.join("visit/map.lrfslam")).unwrap();
    std::thread::scope(|scope| {
        scope.spawn(|| by_recording(folder, scans));
        scope.spawn(|| by_laser(folder));
        scope.spawn(|| going_on_live(folder, scans));
    });
    assert!(fs::read(folder.join("visit/map.lrfslam")).unwrap() == map, "the map is not changed");
}

fn by_recording(folder: &Path, scans: u64) {
    // The folder of a run stands for its recording.
    let localize = |of: &str, out: &str| {
        let (code, stdout, stderr) = run(folder, &["localize", of, "--map", "visit", "--start", "0,0,0", "--out", out]);
        assert_eq!(code, 0, "{stdout}{stderr}");
        assert!(stdout.contains("; lost 0 times, found again 0 times"), "{stdout}");
        let localisation = &report(&folder.join(out))["localisation"];
        assert!(localisation["tracked_scans"].as_u64() >= Some(scans) && localisation["searching_scans"] == 0);
    };
    localize("visit", "found");
    let apart = farthest_apart(&folder.join("found"), &folder.join("visit"));
    assert!(apart < RIGHT_M, "{apart} m");
    assert_eq!(report(&folder.join("found"))["port"], "visit/laser.rec");

    fs::copy(folder.join("visit/laser.rec"), folder.join("alone")).unwrap();
    localize("alone", "found-alone");

    let go_on = ["map", "alone", "--continue", "visit", "--start", "0,0,0", "--out", "both", "-q"];
    assert_eq!(run(folder, &go_on), (0, String::new(), String::new()));
    let both = report(&folder.join("both"));
    assert!(both["continues"] == "visit" && both["cost"]["scans"].as_u64() >= Some(scans), "{}", both["cost"]);
    let apart = farthest_apart(&folder.join("both"), &folder.join("visit"));
    assert!(apart < RIGHT_M, "{apart} m");

    let not_piped = ["map", "-", "--out", "none"];
    let piped =
        crate::common::lrfslam(folder, &not_piped).stdin(fs::File::open(folder.join("alone")).unwrap()).output();
    let piped = piped.unwrap();
    let message = String::from_utf8(piped.stderr).unwrap();
    assert!(piped.status.code() == Some(2) && message.contains("the recording of a laser: name its file"), "{message}");
}

fn by_laser(folder: &Path) {
    let localize = ["localize", "--map", "visit", "--start", "0,0,0", "--seconds", "8"];
    let said = drive(folder, "now", &localize);
    assert!(said.contains("the robot is at ") && said.contains(" in the map"), "{said}");
    let report = report(&folder.join("now"));
    assert_eq!((&report["localisation"]["lost"], &report["partial"]), (&0.into(), &false.into()));
    let (_, x, y) = read_positions(&folder.join("now/trajectory.tum")).remove(0);
    assert!(x.hypot(y) < RIGHT_M, "it began where the first drive did: {x} {y}");
}

fn going_on_live(folder: &Path, scans: u64) {
    let go_on = ["run", "--continue", "visit", "--start", "0,0,0", "--seconds", "18"];
    let said = drive(folder, "again", &go_on);
    assert!(said.contains("it has to drive a few metres"), "{said}");
    let poses = read_positions(&folder.join("again/trajectory.tum")).len() as u64;
    let report = report(&folder.join("again"));
    let added = report["cost"]["scans"].as_u64().unwrap();
    assert_eq!((report["continues"].as_str(), poses), (Some("visit"), scans + added));
    assert!(folder.join("again/laser.rec").exists(), "it is recorded as any run");
}

#[test]
fn a_laser_elsewhere_is_refused_and_stays_recorded() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    drive(folder, "visit", &["run", "--seconds", "8", "-q"]);
    let laser = Laser::far_sighted(folder);
    let wrong = ["run", "--lrf", "hokuyo", "--port", &laser.port(), "--continue", "visit", "--start", "0.5,0.7,90"];
    let (code, _, stderr) = run(folder, &[&wrong[..], &["--seconds", "5", "--out", "wrong", "-q"]].concat());
    assert!(code == 3 && stderr.contains("does not fit the map in visit at 0.50,0.70,90.0"), "{code} {stderr}");
    assert!(stderr.contains("No map was written"), "{stderr}");
    assert!(folder.join("wrong/laser.rec").exists() && !folder.join("wrong/run.json").exists());
    let (code, _, stderr) = run(folder, &["localize", "visit", "--lrf", "hokuyo", "--port", "none", "--map", "visit"]);
    assert!(code == 2 && stderr.contains("cannot be used with"), "{stderr}");
    let (code, _, stderr) = run(folder, &["localize", "--map", "visit"]);
    assert!(code == 2 && stderr.contains("required arguments were not provided"), "{stderr}");
    let (code, _, stderr) = run(folder, &["localize", "--lrf", "hokuyo", "--map", "visit"]);
    assert!(code == 2 && stderr.contains("--port is missing"), "{stderr}");
}
