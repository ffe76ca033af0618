//! Recordings that others open: MCAP, read by the package `mcap` of PyPI where that is installed (`LRFSLAM_PYTHON`, else `python3`).

use std::fs;
use std::io::Cursor;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use crate::attach::Bench;
use crate::common::{lrfslam, run};
use crate::laser::Laser;
use lrfslam_host::scans::mcap::{McapReader, RAW_TOPIC};

/// Runs a script beside this file if Python has the package; says so if it has not.
fn python(package: &str, script: &str, arguments: &[&Path]) -> Option<String> {
    let python = std::env::var("LRFSLAM_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let import = Command::new(&python).args(["-c", &format!("import {package}")]).stderr(Stdio::null()).status();
    if !import.is_ok_and(|status| status.success()) {
        println!("skipped: {script} was not run ({python} has no package {package})");
        return None;
    }
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/live").join(script);
    let output = Command::new(python).arg(script).args(arguments).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    Some(String::from_utf8(output.stdout).unwrap())
}

fn read_by_others(file: &Path) -> Option<serde_json::Value> {
    python("mcap", "read_mcap.py", &[file]).map(|text| serde_json::from_str(&text).unwrap())
}

/// What of the results goes by nothing but the scans.
fn map_in(folder: &Path) -> Vec<Vec<u8>> {
    let read = |name: &str| fs::read(folder.join(name)).unwrap_or_else(|error| panic!("{name}: {error}"));
    ["trajectory.tum", "map.pgm", "map.yaml"].map(read).to_vec()
}

fn done(folder: &Path, arguments: &[&str]) {
    let (code, _, stderr) = run(folder, arguments);
    assert_eq!(code, 0, "{arguments:?}: {stderr}");
}

#[test]
fn a_run_in_mcap_replays_to_the_same_map_and_others_read_it() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let laser = Laser::hokuyo(folder);
    let port = laser.port();
    done(
        folder,
        &["run", "--lrf", "hokuyo", "--port", &port, "--out", "out", "--record", "a.mcap", "--scans", "40", "-q"],
    );
    // Its laser's bytes drive the same driver again; while that happens, its scans are recorded in turn.
    done(folder, &["replay", "a.mcap", "--fast", "--out", "again", "--record", "b.mcap", "--scans", "40", "-q"]);
    let report: serde_json::Value = serde_json::from_slice(&fs::read(folder.join("out/run.json")).unwrap()).unwrap();
    match report["laser"]["overrun"].as_u64() {
        Some(0) => assert!(map_in(&folder.join("out")) == map_in(&folder.join("again"))),
        overrun => println!("skipped: a busy computer left scans out of the run, {overrun:?}, not of the recording"),
    }
    // Without bytes, the scans are there to the bit.
    done(folder, &["map", "b.mcap", "--out", "third", "-q"]);
    assert!(map_in(&folder.join("again")) == map_in(&folder.join("third")));
    // A flipped bit is mended by the checks of the bytes themselves.
    fs::copy(folder.join("a.mcap"), folder.join("flipped.mcap")).unwrap();
    flip_a_bit(&folder.join("flipped.mcap"));
    let (code, _, stderr) = run(folder, &["replay", "flipped.mcap", "--fast", "--out", "mended"]);
    assert!(code == 0 && stderr.contains("1 flipped bit, which was mended"), "{stderr}");
    done(folder, &["replay", "a.mcap", "--fast", "--out", "whole", "-q"]);
    assert!(map_in(&folder.join("whole")) == map_in(&folder.join("mended")));
    let (code, _, stderr) = run(folder, &["replay", "b.mcap", "--out", "x"]);
    assert!(code == 2 && stderr.contains("without the bytes of a laser"), "{stderr}");
    let (code, _, stderr) = run(folder, &["map", "b.mcap", "--out", "x", "--record", "b.mcap", "--overwrite"]);
    assert!(code == 2 && stderr.contains("is what is read"), "{stderr}");
    for file in ["a.mcap", "b.mcap"] {
        let Some(read) = read_by_others(&folder.join(file)) else { continue };
        let counts = &read["counts"];
        let with_map = counts["/map"].as_u64().unwrap();
        assert!(read["is_closed"] == true && counts["/scan"] == 40 && counts["/pose"] == 40 && with_map >= 1, "{read}");
        assert!(counts["/tf"] == 40 && counts["/log"].as_u64().unwrap() >= 1, "{read}");
        assert_eq!(counts["/laser/bytes"].is_null(), file == "b.mcap");
    }
}

/// Flips a bit in the middle of the longest piece of the laser's bytes.
fn flip_a_bit(file: &Path) {
    let mut bytes = fs::read(file).unwrap();
    let mut reader = McapReader::new(Cursor::new(bytes.clone())).unwrap();
    let blocks = std::iter::from_fn(|| reader.next_message()).filter(|message| message.channel.topic == RAW_TOPIC);
    let longest = blocks.map(|message| message.data).max_by_key(Vec::len).unwrap();
    let at = bytes.windows(longest.len()).position(|window| window == longest).unwrap();
    bytes[at + longest.len() / 2] ^= 4;
    fs::write(file, bytes).unwrap();
}

#[test]
fn what_a_robot_tells_is_recorded() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let bench = Bench::new(folder, false, 0.0);
    let record = ["--out", "out", "--record", "robot.mcap", "--scans", "30", "-q"];
    done(folder, &[&["attach", "--lrf", "hokuyo", "--port", &bench.port][..], &record].concat());
    done(folder, &["map", "robot.mcap", "--out", "again", "-q"]);
    if let Some(read) = read_by_others(&folder.join("robot.mcap")) {
        let count = |topic: &str| read["counts"][topic].as_u64().unwrap_or(0);
        assert!(
            read["is_closed"] == true && count("/pose") >= 30 && count("/scan") > 0 && count("/map") >= 1,
            "{read}"
        );
    }
}

/// Kills recorded runs, each so long after its file began; what is there opens, lacks a second at most, and can be mapped.
fn killed(moments_ms: impl Iterator<Item = u64>) {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let laser = Laser::hokuyo(folder);
    let port = laser.port();
    for moment in moments_ms {
        for name in ["out", "out.part", "again"] {
            let _ = fs::remove_dir_all(folder.join(name));
        }
        let file = folder.join("a.mcap");
        let _ = fs::remove_file(&file);
        let arguments = ["run", "--lrf", "hokuyo", "--port", &port, "--out", "out", "--record", "a.mcap", "-q"];
        let mut child = lrfslam(folder, &arguments).stderr(Stdio::null()).stdout(Stdio::null()).spawn().unwrap();
        let started = Instant::now();
        // Some scans are in it then.
        while fs::metadata(&file).map_or(0, |about| about.len()) < 40_000 {
            assert!(started.elapsed() < Duration::from_secs(60), "nothing is recorded");
            std::thread::sleep(Duration::from_millis(10));
        }
        std::thread::sleep(Duration::from_millis(moment));
        let at_ns = SystemTime::now().duration_since(UNIX_EPOCH).unwrap().as_nanos() as u64;
        child.kill().unwrap();
        child.wait().unwrap();
        let read = read_by_others(&file);
        if let Some(read) = &read {
            let last_ns = read["last_ns"]["/laser/bytes"].as_u64().unwrap();
            let missing_ms = at_ns.saturating_sub(last_ns) / 1_000_000;
            println!("killed after {moment} ms: {missing_ms} ms missing, {}", read["counts"]);
            assert!(read["is_closed"] == false && missing_ms <= 1000, "{missing_ms} ms are missing after {moment} ms");
        }
        let (code, _, stderr) = run(folder, &["replay", "a.mcap", "--fast", "--out", "again", "-q"]);
        assert!(code == 1 && stderr.contains("ends in the middle"), "after {moment} ms: {code}, {stderr}");
        // Scans that were mapped before the bytes of the last half second were written are at most so many.
        let mapped = fs::read_to_string(folder.join("again/trajectory.tum")).unwrap().lines().count() as u64;
        let scans = read.as_ref().map_or(1, |read| read["counts"]["/scan"].as_u64().unwrap_or(0));
        assert!(mapped > 0 && mapped + 8 >= scans, "after {moment} ms: {mapped} of {scans} scans");
    }
}

#[test]
fn killed_at_any_moment_a_recording_opens_and_lacks_a_second_at_most() {
    killed([210, 1321, 2477].into_iter());
}

#[test]
#[ignore = "two minutes; run with --ignored"]
fn killed_at_twenty_moments_a_recording_opens_each_time() {
    let mut state = 1u64;
    killed((0..20).map(move |_| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) % 3500
    }));
}

#[test]
fn a_bag_of_another_tool_gives_the_map_of_its_log() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let log = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/floor.log.gz");
    let log = log.to_str().unwrap();
    for kind in ["mcap", "sqlite3"] {
        let bag = folder.join(kind);
        if python("rosbags", "bag_of_log.py", &[Path::new(log), &bag, Path::new(kind)]).is_none() {
            return;
        }
        let out = format!("of-{kind}");
        done(folder, &["map", kind, "--out", &out, "--scans", "100", "-q"]);
        if kind == "mcap" {
            done(folder, &["map", log, "--out", "of-log", "--scans", "100", "-q"]);
        }
        let path =
            |name: &str| lrfslam_host::trajectory::read_trajectory(&folder.join(name).join("trajectory.tum")).unwrap();
        let (ours, theirs) = (path("of-log"), path(&out));
        assert_eq!(ours.len(), theirs.len());
        for (a, b) in ours.iter().zip(&theirs) {
            let apart = a.map_from_robot.between(b.map_from_robot);
            assert!(a.stamp == b.stamp && apart.position().norm() < 0.02, "{kind} at {:?}: {apart:?}", a.stamp);
        }
    }
}
