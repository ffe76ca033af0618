//! Bad input of every kind: one clear message, exit code 2 (wrong from the start) or 1 (on the way), never a panic;
//! what was earned before a fault is written and said to be partial.

use std::fs;
use std::io::Write;
use std::path::Path;
use std::process::Stdio;

use crate::common::{flaser, lrfslam, run};
use flate2::{Compression, write::GzEncoder};

fn folder() -> tempfile::TempDir {
    tempfile::tempdir().expect("a temporary folder")
}

fn log_of(scans: u32) -> String {
    (0..scans).map(|i| flaser(i, 180)).collect()
}

/// Runs `map` on a log of `content`; returns exit code and the single line on stderr.
fn map(folder: &Path, content: &[u8], more: &[&str]) -> (i32, String) {
    fs::write(folder.join("a.log"), content).unwrap();
    let args = [&["map", "a.log", "--out", "out", "--overwrite"], more].concat();
    let (code, _, stderr) = run(folder, &args);
    (code, stderr)
}

fn assert_one_line(message: &str) {
    assert_eq!(message.trim_end().lines().count(), 1, "{message}");
    assert!(message.starts_with("lrfslam: "), "{message}");
}

fn poses(folder: &Path) -> usize {
    fs::read_to_string(folder.join("out/trajectory.tum")).unwrap().lines().count()
}

fn report(folder: &Path) -> serde_json::Value {
    serde_json::from_slice(&fs::read(folder.join("out/run.json")).unwrap()).unwrap()
}

#[test]
fn missing_file() {
    let folder = folder();
    let (code, _, message) = run(folder.path(), &["map", "nowhere.log"]);
    assert_eq!(code, 2);
    assert_one_line(&message);
    assert!(message.contains("nowhere.log: cannot be opened"), "{message}");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0, "nothing is left behind");
    let (code, _, message) = run(folder.path(), &["map", "."]);
    assert!(code == 2 && message.contains("folder"), "{message}");
}

#[test]
fn not_a_log() {
    let folder = folder();
    for content in [b"Dear diary,\ntoday\n".as_slice(), &[0, 159, 146, 150].repeat(1000), &[b'x'; 3 << 20]] {
        let (code, message) = map(folder.path(), content, &[]);
        assert_eq!(code, 2);
        assert_one_line(&message);
        assert!(message.contains("a.log: not a log"), "{message}");
    }
    assert!(!folder.path().join("out").exists());
}

#[test]
fn empty_log() {
    let folder = folder();
    for (content, expected) in
        [("", "the log is empty"), ("# only this\n", "empty"), ("PARAM a b\n", "no scan in its 1 lines")]
    {
        let (code, message) = map(folder.path(), content.as_bytes(), &[]);
        assert_eq!(code, 2);
        assert_one_line(&message);
        assert!(message.contains(expected), "{message}");
    }
}

#[test]
fn truncated_gzip_keeps_what_was_read() {
    let folder = folder();
    let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(log_of(400).as_bytes()).unwrap();
    let mut packed = encoder.finish().unwrap();
    packed.truncate(packed.len() * 3 / 4);
    let (code, message) = map(folder.path(), &packed, &[]);
    assert_eq!(code, 1);
    assert_one_line(&message);
    let read = poses(folder.path());
    assert!(read > 32, "{read}");
    assert!(message.contains(&format!("stopped after {read} scans; partial results are in out")), "{message}");
    assert!(message.contains("cut off"), "{message}");
    let report = report(folder.path());
    assert_eq!((report["partial"].as_bool(), report["log"]["scans"].as_u64()), (Some(true), Some(read as u64)));
    assert!(report["fault"].as_str().unwrap().contains("a.log"), "{report}");
    for file in ["map.pgm", "map.yaml", "map.png"] {
        assert!(folder.path().join("out").join(file).exists(), "{file}");
    }
}

#[test]
fn damaged_gzip_keeps_what_was_read() {
    let folder = folder();
    let mut encoder = GzEncoder::new(Vec::new(), Compression::none());
    encoder.write_all(log_of(400).as_bytes()).unwrap();
    let mut packed = encoder.finish().unwrap();
    let middle = packed.len() - 6;
    packed[middle] ^= 0xff; // the checksum
    let (code, message) = map(folder.path(), &packed, &[]);
    assert_eq!(code, 1);
    assert_one_line(&message);
    assert_eq!(poses(folder.path()), 400);
    let (code, message) = map(folder.path(), &[0x1f, 0x8b, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10], &[]);
    assert_eq!(code, 2, "{message}");
}

#[test]
fn nan_and_negative_ranges_are_invalid_beams() {
    let folder = folder();
    let log = log_of(3).replacen("3.00 3.00 3.00 3.00", "nan -1.00 0 inf", 1);
    let (code, message) = map(folder.path(), log.as_bytes(), &[]);
    assert_eq!((code, message.as_str()), (0, ""));
    let beams = &report(folder.path())["beams"];
    assert_eq!((beams["invalid"].as_u64(), beams["misses"].as_u64()), (Some(3), Some(1)));
}

#[test]
fn damaged_lines_are_left_out_and_named() {
    let folder = folder();
    let scan = |i: u32| flaser(i, 180);
    let damaged = [
        scan(5).replacen("3.00", "3,00", 1),
        scan(6).replacen("3.00 ", "", 1),
        scan(7).replace("7.000000", "nan"),
        flaser(8, 90),
    ];
    fs::write(folder.path().join("a.log"), log_of(5) + &damaged.concat() + &scan(9) + &flaser(10, 181)).unwrap();
    let (code, stdout, message) = run(folder.path(), &["map", "a.log", "--out", "out"]);
    assert_eq!((code, message.as_str()), (0, ""));
    assert!(stdout.contains("note: WARNING: 4 of 11 lines with scans (36.4 %) are damaged"), "{stdout}");
    assert!(stdout.contains("line 6: field range 1 of 180: expected a number (m), found \"3,00\""), "{stdout}");
    assert!(stdout.contains("line 9: field number of beams: expected 180"), "{stdout}");
    assert_eq!(poses(folder.path()), 7);
    let report = report(folder.path());
    assert_eq!((report["partial"].as_bool(), report["log"]["damaged_lines"].as_u64()), (Some(false), Some(4)));
    let second = &report["log"]["damaged"][1];
    assert_eq!((second["line"].as_u64(), second["found"].as_str()), (Some(7), Some("\"host\"")), "{second}");
    let (code, message) = map(folder.path(), damaged[..3].concat().as_bytes(), &[]);
    assert_eq!(code, 2);
    assert_one_line(&message);
    assert!(message.contains("a.log: no scan can be read: 3 damaged lines, the first: line 1: field"), "{message}");
}

#[test]
fn log_comes_from_standard_input() {
    let folder = folder();
    let text = log_of(40);
    let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(text.as_bytes()).unwrap();
    let packed = encoder.finish().unwrap();
    let (code, message) = map(folder.path(), &packed, &[]);
    assert_eq!((code, message.as_str()), (0, ""));
    let from_file = report(folder.path());
    let mut child = lrfslam(folder.path(), &["map", "-", "--out", "stdin-map"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    child.stdin.take().unwrap().write_all(&packed).unwrap();
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success() && output.stdout.ends_with(b"results in stdin-map\n"), "{output:?}");
    let written = |folder: &Path, name: &str| fs::read(folder.join(name)).unwrap();
    let (piped, out) = (folder.path().join("stdin-map"), folder.path().join("out"));
    for name in ["trajectory.tum", "map.pgm", "map.lrfslam"] {
        assert_eq!(written(&piped, name), written(&out, name), "{name}");
    }
    let from_pipe: serde_json::Value = serde_json::from_slice(&written(&piped, "run.json")).unwrap();
    assert_eq!((from_pipe["input"]["name"].as_str(), from_file["input"]["name"].as_str()), (Some("-"), Some("a.log")));
    assert_eq!(from_pipe["input"]["bytes"].as_u64(), Some(packed.len() as u64));
    for key in ["sha256", "bytes", "format"] {
        assert_eq!(from_pipe["input"][key], from_file["input"][key], "{key}");
    }
    let nothing = lrfslam(folder.path(), &["map", "-"]).stdin(Stdio::null()).output().unwrap();
    let message = String::from_utf8(nothing.stderr).unwrap();
    assert_eq!((nothing.status.code(), message.as_str()), (Some(2), "lrfslam: -: the log is empty\n"));
}

#[test]
fn trajectory_is_sorted_by_time_with_each_time_once() {
    let folder = folder();
    let log = [0, 1, 3, 2, 4, 4].map(|i| flaser(i, 180)).concat();
    let (code, _) = map(folder.path(), log.as_bytes(), &[]);
    assert_eq!(code, 0);
    let text = fs::read_to_string(folder.path().join("out/trajectory.tum")).unwrap();
    let times: Vec<&str> = text.lines().map(|line| line.split(' ').next().unwrap()).collect();
    assert_eq!(times, ["0.000000", "1.000000", "2.000000", "3.000000", "4.000000"]);
    let counts = &report(folder.path())["log"];
    assert_eq!((counts["backward_times"].as_u64(), counts["repeated_times"].as_u64()), (Some(1), Some(1)));
    let (code, stdout, stderr) = run(folder.path(), &["eval", "out/trajectory.tum", "--stretches", "a.log"]);
    assert!(code == 2 && stderr.contains("5 scans"), "{stdout}{stderr}");
}

#[test]
fn cut_last_line_is_no_fault() {
    let folder = folder();
    let log = log_of(5);
    let (code, message) = map(folder.path(), &log.as_bytes()[..log.len() - 100], &[]);
    assert_eq!((code, message.as_str()), (0, ""));
    let report = report(folder.path());
    assert_eq!((report["log"]["cut_last_line"].as_bool(), report["partial"].as_bool()), (Some(true), Some(false)));
    assert_eq!(poses(folder.path()), 4);
}

#[test]
fn unwritable_output_folder_is_found_before_the_work() {
    let folder = folder();
    fs::write(folder.path().join("file"), "").unwrap();
    fs::write(folder.path().join("a.log"), log_of(3)).unwrap();
    for out in ["file", "file/below"] {
        let (code, stdout, message) = run(folder.path(), &["map", "a.log", "--out", out]);
        assert_eq!((code, stdout.as_str()), (2, ""));
        assert_one_line(&message);
        assert!(message.contains(&format!("{out}: cannot be used as output folder")), "{message}");
    }
}

#[test]
fn wrong_configurations() {
    let folder = folder();
    let config = |text: &str| {
        fs::write(folder.path().join("c.toml"), text).unwrap();
        let (code, message) = map(folder.path(), log_of(3).as_bytes(), &["--config", "c.toml"]);
        assert_eq!(code, 2, "{message}");
        assert!(!folder.path().join("out").exists());
        message
    };
    let message = config("[map]\nceil_size_m = 0.1\n");
    assert!(message.contains("c.toml") && message.contains("line 2") && message.contains("unknown field"), "{message}");
    assert!(config("[map]\ncell_size_m = 100.0\n").contains("map.cell_size_m is 100.0, expected 0.005 to 1.0"));
    assert!(config("[map]\ncell_size_m = \"x\"\n").contains("line 2"));
    assert!(config("not toml").contains("line 1"));
    let set = |argument: &str| run(folder.path(), &["config", "--set", argument]);
    assert_eq!(set("map.cell_size_m=7").0, 2);
    assert_eq!(set("map.nothing=7").0, 2);
    assert_eq!(set("map.cell_size_m=0.1").0, 0);
    let (code, _, message) = run(folder.path(), &["config", "--config", "none.toml"]);
    assert!(code == 2 && message.contains("none.toml: cannot be read"), "{message}");
}

#[test]
fn wrong_usage() {
    let folder = folder();
    for args in [&["nonsense"][..], &["map"], &[], &["map", "a", "--seed", "x"], &["eval", "t.tum"]] {
        assert_eq!(run(folder.path(), args).0, 2, "{args:?}");
    }
    assert_eq!(run(folder.path(), &["--help"]).0, 0);
    assert_eq!(run(folder.path(), &["--version"]).0, 0);
}

#[test]
fn eval_of_wrong_files() {
    let folder = folder();
    let write = |name: &str, text: &str| fs::write(folder.path().join(name), text).unwrap();
    write("t.tum", "1.0 0 0 0 0 0 0 1\n2.0 1 0 0 0 0 0 1\n");
    write("bad.tum", "1.0 0 0 0 0 0 0 1\n2.0 1 0 zero 0 0 0 1\n");
    write("r.txt", "1.0 2.0 1 0 0 0 0 0\n");
    write("late.txt", "100.0 200.0 1 0 0 0 0 0\n");
    write("empty.txt", "");
    let eval = |trajectory: &str, relations: &str| run(folder.path(), &["eval", trajectory, "--relations", relations]);
    assert_eq!(eval("t.tum", "r.txt").0, 0);
    for (trajectory, relations, expected) in [
        ("none.tum", "r.txt", "none.tum: cannot be read"),
        ("bad.tum", "r.txt", "bad.tum: line 2: field z"),
        ("t.tum", "empty.txt", "empty.txt: no line of numbers"),
        ("t.tum", "late.txt", "no pose of the trajectory (2 poses, 1.000 to 2.000 s)"),
    ] {
        let (code, _, message) = eval(trajectory, relations);
        assert!(code == 2 && message.contains(expected), "{message}");
        assert_one_line(&message);
    }
}

#[test]
fn reader_that_goes_away_is_no_fault() {
    let folder = folder();
    let mut child = lrfslam(folder.path(), &["config"]).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert_eq!((output.status.code(), output.stderr.len()), (Some(0), 0));
}

#[test]
fn full_disk_on_stdout_is_a_fault() {
    let Ok(full) = fs::File::options().write(true).open("/dev/full") else {
        println!("skipped: no /dev/full on this system");
        return;
    };
    let folder = folder();
    let output = lrfslam(folder.path(), &["config"]).stdout(full).output().unwrap();
    assert_eq!(output.status.code(), Some(1));
}
