//! What was earned is kept: results of an earlier run, and of one that is stopped, killed or has no room.

use std::fs;
use std::io::Write as _;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use lrfslam_host::mapping::saved_map::SavedMap;

use crate::common::{lrfslam, run};

/// Scans from the middle of a room of 5 m by 6 m: unlike a round one it tells a robot's heading.
fn log_of(scans: u32) -> String {
    let range = |beam: usize| {
        let (sin, cos) = (beam as f64).to_radians().sin_cos();
        format!("{:.2}", (2.5 / sin.max(1e-6)).min(3.0 / cos.abs().max(1e-6)))
    };
    let ranges = (0..180).map(range).collect::<Vec<_>>().join(" ");
    (0..scans).map(|i| format!("FLASER 180 {ranges} 0 0 0 0 0 0 {i}.000000 host {i}.000000\n")).collect()
}

/// Every file of a folder, by name.
fn files(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let file = |entry: std::io::Result<fs::DirEntry>| {
        let entry = entry.unwrap();
        (entry.file_name().into_string().unwrap(), fs::read(entry.path()).unwrap())
    };
    let mut files: Vec<_> = fs::read_dir(folder).unwrap().map(file).collect();
    files.sort();
    files
}

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<_> =
        fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

fn report(folder: &Path) -> serde_json::Value {
    serde_json::from_slice(&fs::read(folder.join("run.json")).unwrap()).unwrap()
}

fn poses(folder: &Path) -> usize {
    fs::read_to_string(folder.join("trajectory.tum")).unwrap().lines().count()
}

fn wait_until(what: &str, is_so: impl Fn() -> bool) {
    let started = Instant::now();
    while !is_so() {
        assert!(started.elapsed() < Duration::from_secs(120), "{what}: not within two minutes");
        std::thread::sleep(Duration::from_millis(20));
    }
}

fn interrupt(child: &Child) {
    send(child, "-INT");
}

fn send(child: &Child, signal: &str) {
    let sent = Command::new("kill").args([signal, &child.id().to_string()]).status();
    assert!(sent.unwrap().success());
}

/// `map` of a log that comes as slowly as a test wants.
fn slow_map(folder: &Path, more: &[&str]) -> Child {
    let arguments = [&["map", "-", "--out", "out", "--matcher-only", "--save-every", "0", "-q"], more].concat();
    let mut command = lrfslam(folder, &arguments);
    command.stdin(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

#[test]
fn results_are_not_replaced_unless_that_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("a.log"), log_of(40)).unwrap();
    fs::write(folder.join("b.log"), log_of(50)).unwrap();
    assert_eq!(run(folder, &["map", "a.log", "--out", "out", "-q"]).0, 0);
    let before = files(&folder.join("out"));
    let into_out = [
        &["map", "b.log", "--matcher-only"][..],
        &["localize", "b.log", "--map", "out"],
        &["map", "b.log", "--continue", "out"],
        &["run", "--lrf", "hokuyo", "--port", "none"],
        &["attach", "--lrf", "hokuyo", "--port", "none"],
        &["demo"],
    ];
    for arguments in into_out.into_iter().filter(|words| cfg!(feature = "demo") || words[0] != "demo") {
        let (code, _, stderr) = run(folder, &[arguments, &["--out", "out"]].concat());
        assert!(code == 2 && stderr.contains("out: holds map.lrfslam already"), "{arguments:?}: {code} {stderr}");
        assert!(files(&folder.join("out")) == before, "{arguments:?}");
    }
    let (code, _, stderr) = run(folder, &["map", "b.log", "--matcher-only", "--out", "out", "--overwrite", "-q"]);
    assert_eq!((code, stderr.as_str()), (0, ""));
    assert_eq!(poses(&folder.join("out")), 50);
    assert!(!folder.join("out/steps.csv").exists(), "nothing of the former set is left");
    assert_eq!(names(folder), ["a.log", "b.log", "out"]);
}

#[test]
fn without_a_name_each_run_has_a_new_folder() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("hall.log"), log_of(5)).unwrap();
    for _ in 0..3 {
        let (code, stdout, _) = run(folder.path(), &["map", "hall.log", "--matcher-only"]);
        assert!(code == 0 && stdout.contains("results in hall-map-2"), "{stdout}");
    }
    let maps = names(folder.path()).iter().filter(|name| name.starts_with("hall-map-2")).count();
    assert_eq!(maps, 3);
}

#[test]
fn ctrl_c_writes_what_was_mapped_and_says_partial() {
    let folder = tempfile::tempdir().unwrap();
    let mut child = slow_map(folder.path(), &[]);
    let mut log = child.stdin.take().unwrap();
    log.write_all(log_of(60).as_bytes()).unwrap();
    let out = folder.path().join("out");
    wait_until("a first save", || out.join("run.json").exists());
    assert_eq!((report(&out)["ending"].as_str(), report(&out)["partial"].as_bool()), (Some("running"), Some(true)));
    // The pipe stays open and silent.
    std::thread::sleep(Duration::from_millis(500));
    interrupt(&child);
    let done = child.wait_with_output().unwrap();
    let stderr = String::from_utf8(done.stderr).unwrap();
    assert_eq!(done.status.code(), Some(130), "{stderr}");
    assert!(stderr.contains("partial results are in out"), "{stderr}");
    let report = report(&out);
    assert_eq!((report["ending"].as_str(), report["partial"].as_bool()), (Some("interrupted"), Some(true)));
    assert_eq!(poses(&out), 60, "all that came");
    assert!(SavedMap::read(&out).is_ok());
    drop(log);
}

/// What hours have measured is not lost.
#[test]
fn ctrl_c_writes_the_stretches_measured_by_then() {
    let folder = tempfile::tempdir().unwrap();
    let truth: String = (0..60).map(|second| format!("{second}.0 0 0 0 0 0 0 1\n")).collect();
    fs::write(folder.path().join("true.tum"), truth).unwrap();
    let arguments = ["experiment", "endurance", "-", "--truth", "true.tum", "--stretch", "20", "--out", "out"];
    let mut command = lrfslam(folder.path(), &arguments);
    let mut child = command.stdin(Stdio::piped()).stderr(Stdio::piped()).stdout(Stdio::null()).spawn().unwrap();
    let mut log = child.stdin.take().unwrap();
    log.write_all(log_of(50).as_bytes()).unwrap();
    std::thread::sleep(Duration::from_millis(2000));
    interrupt(&child);
    let done = child.wait_with_output().unwrap();
    let stderr = String::from_utf8(done.stderr).unwrap();
    assert!(
        done.status.code() == Some(130) && stderr.contains("the results are of a part"),
        "{:?} {stderr}",
        done.status
    );
    let table = fs::read_to_string(folder.path().join("out/endurance.csv")).unwrap();
    assert_eq!(table.lines().count(), 1 + 3, "{table}");
    drop(log);
}

/// The first scans are looked at before the first is mapped; a pipe may say nothing at all.
#[test]
fn ctrl_c_is_noticed_however_little_has_come() {
    let folder = tempfile::tempdir().unwrap();
    for (scans, words) in [(0, "no scan came: no results were written"), (5, "stopped after 5 scans")] {
        let mut child = slow_map(folder.path(), &[]);
        let mut log = child.stdin.take().unwrap();
        log.write_all(log_of(scans).as_bytes()).unwrap();
        std::thread::sleep(Duration::from_millis(700));
        interrupt(&child);
        let done = child.wait_with_output().unwrap();
        let stderr = String::from_utf8(done.stderr).unwrap();
        assert!(done.status.code() == Some(130) && stderr.contains(words), "{scans}: {:?} {stderr}", done.status);
        assert_eq!(folder.path().join("out").exists(), scans > 0);
        drop(log);
    }
}

/// How a program is ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum End {
    Kill,
    Interrupt,
    Terminate,
}

/// The old map, or one of both logs: whole at ten moments of every end, with the right exit code.
#[test]
fn a_map_that_is_gone_on_with_is_whole_at_any_moment() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let line = |i: u32| corner(i, 0.1 * f64::from(i));
    fs::write(folder.join("first.log"), (0..60).map(line).collect::<String>()).unwrap();
    let again = |i: u32| corner(1000 + i, 0.1 * f64::from(i % 60));
    fs::write(folder.join("second.log"), (0..400).map(again).collect::<String>()).unwrap();
    assert_eq!(run(folder, &["map", "first.log", "--out", "old", "-q"]).0, 0);
    let go_on = "map second.log --continue out --start 0,0,0 --trust-start --out out --overwrite --save-every 0 -q";
    let words: Vec<&str> = go_on.split(' ').collect();
    let mut lengths = Vec::new();
    for (end, moment) in
        [End::Kill, End::Interrupt, End::Terminate].iter().flat_map(|end| (0..10).map(move |m| (*end, m)))
    {
        let _ = fs::remove_dir_all(folder.join("out"));
        fs::create_dir(folder.join("out")).unwrap();
        files(&folder.join("old"))
            .iter()
            .for_each(|(name, bytes)| fs::write(folder.join("out").join(name), bytes).unwrap());
        let mut child = lrfslam(folder, &words).stderr(Stdio::piped()).spawn().unwrap();
        std::thread::sleep(Duration::from_millis(30 + 90 * moment));
        match end {
            End::Kill => child.kill().unwrap(),
            End::Interrupt => interrupt(&child),
            End::Terminate => send(&child, "-TERM"),
        }
        let done = child.wait_with_output().unwrap();
        let (out, what) = (folder.join("out"), format!("{end:?} at moment {moment}"));
        let (report, count) = (report(&out), poses(&out));
        let before = if report["continues"].is_null() { 0 } else { 60 };
        assert_eq!(
            report["cost"]["scans"].as_u64(),
            Some(count as u64 - before),
            "{what}: one set, with the first visit"
        );
        assert!(SavedMap::read(&out).is_ok(), "{what}");
        let code = done.status.code();
        let stderr = String::from_utf8(done.stderr).unwrap();
        assert!(matches!(code, None | Some(0 | 130)), "{what}: {stderr}");
        assert!(code != Some(130) || stderr.contains("results"), "{what}: {stderr}");
        assert!(end == End::Kill || !folder.join("out.lrfslam-new").exists(), "{what}");
        lengths.push(count);
    }
    assert!(lengths.contains(&60) && lengths.iter().any(|length| *length > 60), "{lengths:?}");
}

/// A scan from `x` m along a hall with a corner ahead, so that the place is determined.
fn corner(second: u32, x: f64) -> String {
    let range = |beam: u32| {
        let bearing = f64::from(beam).to_radians() - std::f64::consts::FRAC_PI_2;
        let (ahead, aside) = ((12.0 - x) / bearing.cos().max(1e-3), 3.0 / bearing.sin().abs().max(1e-3));
        format!("{:.2}", f64::min(ahead, aside))
    };
    let ranges: Vec<String> = (0..180).map(range).collect();
    format!("FLASER 180 {} {x} 0 0 {x} 0 0 {second}.000000 host {second}.000000\n", ranges.join(" "))
}

/// At ten moments: what is in the folder is a whole set, of this run or of the one before.
#[test]
fn a_killed_run_leaves_a_whole_set() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("old.log"), log_of(7)).unwrap();
    assert_eq!(run(folder, &["map", "old.log", "--out", "out", "-q"]).0, 0);
    let mut newer = 0;
    for moment in 0..10 {
        let mut child = slow_map(folder, &["--overwrite"]);
        let mut log = child.stdin.take().unwrap();
        log.write_all(log_of(33 + 5 * moment).as_bytes()).unwrap();
        std::thread::sleep(Duration::from_millis(40 + 37 * u64::from(moment)));
        child.kill().unwrap();
        child.wait().unwrap();
        let out = folder.join("out");
        let count = poses(&out);
        assert_eq!(report(&out)["cost"]["scans"], count, "one set: the report and the path are of the same moment");
        assert!(SavedMap::read(&out).is_ok() && out.join("map.pgm").exists());
        newer += u32::from(count != 7);
        assert!(!folder.join("out.part").exists(), "nothing has begun to grow");
    }
    assert!(newer > 0, "no run has saved anything");
}

fn disk_of(blocks: u32, folder: &Path, command: &str) -> (Option<i32>, String) {
    // An ignored signal makes the write fail instead of ending the program; blocks are of 512 bytes.
    let line = format!("trap '' XFSZ; ulimit -f {blocks}; exec {} {command}", env!("CARGO_BIN_EXE_lrfslam"));
    let done = Command::new("sh").current_dir(folder).args(["-c", &line]).output().unwrap();
    (done.status.code(), String::from_utf8(done.stderr).unwrap())
}

#[test]
fn localize_and_cloud_keep_the_last_set_when_they_are_killed_or_have_no_room() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("a.log"), log_of(60)).unwrap();
    fs::write(folder.join("tilt.txt"), (0..60).map(|i| format!("{i} 0.1\n")).collect::<String>()).unwrap();
    assert_eq!(run(folder, &["map", "a.log", "--out", "map", "-q"]).0, 0);
    let commands = [
        "localize a.log --map map --start end -q",
        "cloud a.log --trajectory map/trajectory.tum --tilt tilt.txt --gap 2 --json",
    ];
    for (command, last) in commands.into_iter().zip(["run.json", "cloud.json"]) {
        let _ = fs::remove_dir_all(folder.join("out"));
        let line = format!("{command} --out out --overwrite");
        let words: Vec<&str> = line.split(' ').collect();
        let first = run(folder, &words);
        assert!(first.0 == 0 || first.0 == 3, "{command}: {first:?}");
        let before = files(&folder.join("out"));
        let same_names = || names(&folder.join("out")).into_iter().eq(before.iter().map(|(name, _)| name.clone()));
        for moment in 0..10 {
            let mut child = lrfslam(folder, &words).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
            std::thread::sleep(Duration::from_millis(3 + 9 * moment));
            let _ = child.kill();
            child.wait().unwrap();
            assert!(
                same_names() && folder.join("out").join(last).exists(),
                "{command}: {:?}",
                names(&folder.join("out"))
            );
            assert!(!folder.join("out.part").exists());
        }
        let full = disk_of(0, folder, &line);
        assert!(full.0 == Some(1) && full.1.contains("cannot be written"), "{command}: {full:?}");
        assert!(same_names() && !folder.join("out.lrfslam-new").exists(), "{command}");
    }
}

/// A folder whose neighbours cannot be written could not be replaced when the work is done.
#[test]
fn a_place_that_cannot_be_replaced_is_refused_at_the_start() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("a.log"), log_of(5)).unwrap();
    for (place, words) in [("/proc", "a disk is mounted there"), (".", "expected a folder of its own")] {
        let (code, _, stderr) = run(folder.path(), &["map", "a.log", "--out", place, "--overwrite", "-q"]);
        assert!(code == 2 && stderr.contains(words), "{place}: {code} {stderr}");
    }
    std::os::unix::fs::symlink("real", folder.path().join("link")).unwrap();
    fs::create_dir(folder.path().join("real")).unwrap();
    assert_eq!(run(folder.path(), &["map", "a.log", "--matcher-only", "--out", "link", "-q"]).0, 0);
    assert!(folder.path().join("link").is_symlink() && folder.path().join("real/run.json").exists());
}

/// The first blocks of a file can be written, and then no more, as on a disk that gets full.
#[test]
fn a_full_disk_leaves_what_was_there() {
    const COMMANDS: [&str; 3] = [
        "map a.log --matcher-only",
        "localize a.log --map out",
        "map a.log --continue out --start 0,0,0 --trust-start",
    ];
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("a.log"), log_of(60)).unwrap();
    assert_eq!(run(folder, &["map", "a.log", "--out", "out", "-q"]).0, 0);
    let before = files(&folder.join("out"));
    for (blocks, command) in
        [0, 1, 2, 4, 8, 12, 16, 20].into_iter().flat_map(|blocks| COMMANDS.map(|command| (blocks, command)))
    {
        let (code, stderr) = disk_of(blocks, folder, &format!("{command} --out out --overwrite -q"));
        // The robot need not find itself in so plain a room.
        if matches!(code, Some(0 | 3)) {
            assert!(command.starts_with("localize") || blocks > 8, "{blocks} {command}");
            let again = ["map", "a.log", "--out", "out", "--overwrite", "-q"];
            assert_eq!(run(folder, &again).0, 0);
            continue;
        }
        assert!(code == Some(1) && stderr.contains("cannot be written"), "{blocks}: {stderr}");
        let same = |(name, bytes): &(String, Vec<u8>)| {
            name == "run.json" || name == "steps.csv" || fs::read(folder.join("out").join(name)).unwrap() == *bytes
        };
        assert!(before.iter().all(same) && names(&folder.join("out")).len() == before.len(), "{blocks} {command}");
        assert_eq!(names(folder), ["a.log", "out"], "{blocks}: nothing is left beside it");
    }
}
