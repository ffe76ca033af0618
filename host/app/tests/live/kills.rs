//! Killed at any moment, a live command goes on, and ends with the map of one that was never killed; a full disk does not end it.

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use crate::attach::Bench;
use crate::common::{lrfslam, run};
use crate::laser::Laser;

/// Moments of a kill, ms after the start: any, and the same each time.
fn moments(seed: u64) -> impl Iterator<Item = u64> {
    let next =
        |state: &u64| Some(state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407));
    std::iter::successors(next(&seed), next).map(|state| 300 + (state >> 33) % 2700)
}

/// What of the results goes by nothing but the scans.
fn map_in(folder: &Path) -> Vec<Vec<u8>> {
    let read = |name: &str| fs::read(folder.join(name)).unwrap_or_else(|error| panic!("{name}: {error}"));
    ["trajectory.tum", "map.pgm", "map.yaml", "map.lrfslam"].map(read).to_vec()
}

fn report(folder: &Path) -> serde_json::Value {
    serde_json::from_slice(&fs::read(folder.join("run.json")).unwrap()).unwrap()
}

/// Starts `arguments`, with --resume if `grown` is there, and kills it after each of the moments; at the end it is left to itself with `last`.
fn kill_and_resume(folder: &Path, arguments: &[&str], grown: &str, moments: impl Iterator<Item = u64>, last: &[&str]) {
    let with_resume = || {
        let more: &[&str] = if folder.join(grown).exists() { &["--resume"] } else { &[] };
        [arguments, more].concat()
    };
    for moment in moments {
        let mut child = lrfslam(folder, &with_resume()).stderr(Stdio::null()).stdout(Stdio::null()).spawn().unwrap();
        std::thread::sleep(Duration::from_millis(moment));
        assert_eq!(child.try_wait().unwrap(), None, "it ended by itself before it was killed after {moment} ms");
        child.kill().unwrap();
        child.wait().unwrap();
    }
    let (code, _, stderr) = run(folder, &[&with_resume()[..], last].concat());
    assert_eq!(code, 0, "{stderr}");
}

fn recorded_runs(rounds: u64, kills: usize) {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let laser = Laser::hokuyo(folder);
    for round in 0..rounds {
        for name in ["out", "again"] {
            let _ = fs::remove_dir_all(folder.join(name));
        }
        let port = laser.port();
        let arguments = ["run", "--lrf", "hokuyo", "--port", &port, "--out", "out", "--save-every", "2", "-q"];
        // Longer than all that was recorded: it goes on live.
        let seconds = format!("{}", 6 * kills);
        kill_and_resume(folder, &arguments, "out/laser.rec", moments(round).take(kills), &["--seconds", &seconds]);
        let (code, _, stderr) =
            run(folder, &["replay", "out/laser.rec", "--fast", "--out", "again", "--seconds", &seconds]);
        assert_eq!(code, 0, "{stderr}");
        assert!(map_in(&folder.join("out")) == map_in(&folder.join("again")), "round {round}");
        let report = report(&folder.join("out"));
        assert!(report["partial"] == false && report["laser"]["overrun"] == 0, "{report}");
    }
}

fn attached_runs(rounds: u64, kills: usize) {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let bench = Bench::new(folder, false, 0.01);
    for round in 0..rounds {
        for name in ["out", "again"] {
            let _ = fs::remove_dir_all(folder.join(name));
        }
        let arguments = ["attach", "--lrf", "hokuyo", "--port", &bench.port, "--out", "out", "--save-every", "2", "-q"];
        let seconds = format!("{}", 5 * kills);
        kill_and_resume(folder, &arguments, "out/robot.journal", moments(round).take(kills), &["--seconds", &seconds]);
        assert_eq!(report(&folder.join("out"))["robot"]["missing_scans"], 0, "round {round}");
        fs::create_dir(folder.join("again")).unwrap();
        fs::copy(folder.join("out/robot.journal"), folder.join("again/robot.journal")).unwrap();
        // All that was told, from the journal alone: no robot is waited for.
        let again = ["attach", "--lrf", "hokuyo", "--port", "none", "--out", "again", "--resume", "--keep-running"];
        let (code, _, stderr) = run(folder, &[&again[..], &["--scans", "1", "-q"]].concat());
        assert_eq!((code, stderr.as_str()), (0, ""));
        assert!(map_in(&folder.join("out")) == map_in(&folder.join("again")), "round {round}");
    }
}

#[test]
fn killed_runs_go_on_and_end_with_the_map_of_one_that_was_not_killed() {
    recorded_runs(1, 3);
    attached_runs(1, 3);
}

#[test]
#[ignore = "half an hour; run with --ignored"]
fn a_hundred_killed_runs_of_each_end_with_the_same_map() {
    std::thread::scope(|scope| {
        scope.spawn(|| recorded_runs(10, 10));
        scope.spawn(|| attached_runs(10, 10));
    });
}

#[test]
fn what_is_no_unfinished_run_is_not_resumed() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let laser = Laser::hokuyo(folder);
    let port = laser.port();
    let arguments = ["run", "--lrf", "hokuyo", "--port", &port, "--out", "out", "-q", "--resume"];
    let refused = |more: &[&str]| run(folder, &[&arguments[..], more].concat());
    assert_eq!(refused(&[]), (2, String::new(), "lrfslam: out: nothing to resume, it is not there\n".to_owned()));
    fs::create_dir(folder.join("out")).unwrap();
    let (code, _, stderr) = refused(&[]);
    assert!(
        code == 2 && stderr.contains("nothing to resume: there is no ") && stderr.contains("laser.rec"),
        "{stderr}"
    );
    fs::remove_dir(folder.join("out")).unwrap();
    assert_eq!(run(folder, &[&arguments[..8], &["--seconds", "2"]].concat()).0, 0);
    let (code, _, stderr) = refused(&[]);
    assert_eq!((code, stderr.as_str()), (2, "lrfslam: out: nothing to resume, its run came to its end\n"));
    let text = fs::read_to_string(folder.join("out/run.json")).unwrap().replace("\"complete\"", "\"running\"");
    fs::write(folder.join("out/run.json"), text).unwrap();
    let (code, _, stderr) = refused(&["--seed", "2"]);
    assert!(code == 2 && stderr.contains("had another configuration or seed"), "{stderr}");
    let (code, _, stderr) = refused(&["--seconds", "5"]);
    assert_eq!((code, stderr.as_str()), (0, ""));
}

/// No file gets longer than this until there is room: blocks of 512 bytes. A signal for it is ignored, so that writing fails.
fn on_a_small_disk(folder: &Path, blocks: u32, arguments: &[&str]) -> std::process::Child {
    let program = env!("CARGO_BIN_EXE_lrfslam");
    let line = format!("trap '' XFSZ; ulimit -S -f {blocks}; exec {program} {}", arguments.join(" "));
    Command::new("sh").current_dir(folder).args(["-c", &line]).stderr(Stdio::piped()).spawn().unwrap()
}

fn room_again(child: &std::process::Child) {
    let pid = child.id().to_string();
    assert!(Command::new("prlimit").args(["--pid", &pid, "--fsize=unlimited"]).status().unwrap().success());
}

fn wait_until(what: &str, is_so: impl Fn() -> bool) {
    let started = Instant::now();
    while !is_so() {
        assert!(started.elapsed() < Duration::from_secs(60), "{what}: not within a minute");
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// Runs on a disk that is full for some seconds; what it said, and its report.
fn through_a_full_disk(folder: &Path, grown: &str, arguments: &[&str]) -> (String, serde_json::Value) {
    let grown = folder.join("out").join(grown);
    let child = on_a_small_disk(folder, 40, &[arguments, &["--out", "out"]].concat());
    wait_until("a full disk", || fs::metadata(&grown).is_ok_and(|about| about.len() >= 40 * 512));
    std::thread::sleep(Duration::from_secs(3));
    assert_eq!(fs::metadata(&grown).unwrap().len(), 40 * 512, "nothing more had room");
    room_again(&child);
    let done = child.wait_with_output().unwrap();
    let stderr = String::from_utf8(done.stderr).unwrap();
    assert_eq!(done.status.code(), Some(0), "{stderr}");
    assert!(stderr.contains("cannot be written") && stderr.contains("going on"), "{stderr}");
    assert!(stderr.contains("is written again; nothing is missing"), "{stderr}");
    (stderr, report(&folder.join("out")))
}

#[test]
fn a_disk_that_was_full_has_everything_when_there_is_room_again() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let bench = Bench::new(folder, false, 0.0);
    let arguments = ["attach", "--lrf", "hokuyo", "--port", &bench.port, "--scans", "110"];
    let (_, about) = through_a_full_disk(folder, "robot.journal", &arguments);
    assert_eq!(about["robot"]["missing_scans"], 0);
    assert_eq!(
        (about["partial"].as_bool(), about["robot"]["journal_holes"].as_array().map(Vec::len)),
        (Some(false), Some(0))
    );
    drop(bench);
    fs::remove_dir_all(folder.join("out")).unwrap();
    let laser = Laser::hokuyo(folder);
    let port = laser.port();
    let arguments = ["run", "--lrf", "hokuyo", "--port", &port, "--scans", "90"];
    let (_, about) = through_a_full_disk(folder, "laser.rec", &arguments);
    assert_eq!(about["recording"]["holes"].as_array().map(Vec::len), Some(0));
    let (code, _, stderr) = run(folder, &["replay", "out/laser.rec", "--fast", "--out", "again", "-q"]);
    assert_eq!((code, stderr.as_str()), (0, ""), "the recording is whole");
}
