//! Localisation in a saved map, from the command line: a simulated floor, its second half in the map of all of it, and wrong maps.

use std::fs;
use std::io::{Read as _, Write as _};
use std::path::Path;

use crate::common::{read_positions, run};

/// A position as near as this is right: the same distance that the stated certainty is about. The map's own path is off by up to 0.15 m.
const RIGHT_M: f64 = 0.25;

/// The lines of the example's scans.
fn floor() -> Vec<String> {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/floor.log.gz");
    let mut text = String::new();
    flate2::read::GzDecoder::new(fs::File::open(file).unwrap()).read_to_string(&mut text).unwrap();
    text.lines().filter(|line| line.starts_with("ROBOTLASER1")).map(str::to_owned).collect()
}

/// The same scan in a building that is a mirror image.
fn mirrored(line: &str) -> String {
    let mut words: Vec<&str> = line.split(' ').collect();
    let count: usize = words[8].parse().unwrap();
    words[9..9 + count].reverse();
    words.join(" ")
}

/// The same scan with people about the robot, others in every scan: a third of the view is theirs, 0.6 to 1.6 m away.
fn crowded(number: usize, line: &str) -> String {
    let mut words: Vec<String> = line.split(' ').map(str::to_owned).collect();
    let count: usize = words[8].parse().unwrap();
    for person in 0..7 {
        let chance = (number * 7 + person).wrapping_mul(2_654_435_761) >> 8;
        let (start, range_m) = (chance % (count - 9), 0.6 + 0.1 * (chance / 1000 % 11) as f64);
        for word in &mut words[9 + start..9 + start + 9] {
            if word.parse::<f64>().unwrap() > range_m {
                *word = format!("{range_m:.2}");
            }
        }
    }
    words.join(" ")
}

fn write_log(folder: &Path, name: &str, lines: &[String]) {
    let mut file = fs::File::create(folder.join(name)).unwrap();
    lines.iter().for_each(|line| writeln!(file, "{line}").unwrap());
}

fn report(folder: &Path) -> serde_json::Value {
    serde_json::from_slice(&fs::read(folder.join("run.json")).unwrap()).unwrap()
}

fn farthest_apart(path: &Path, truth: &Path) -> f64 {
    *distances(path, truth).last().unwrap()
}

/// Distances of the poses of `path` from those of `truth`, m, the smallest first.
fn distances(path: &Path, truth: &Path) -> Vec<f64> {
    let truth = read_positions(truth);
    let distance = |(stamp, x, y): (String, f64, f64)| {
        let (_, true_x, true_y) = truth.iter().find(|(of, ..)| *of == stamp).expect("a pose for every scan");
        (x - true_x).hypot(y - true_y)
    };
    let mut apart: Vec<f64> = read_positions(path).into_iter().map(distance).collect();
    apart.sort_by(f64::total_cmp);
    apart
}

#[test]
fn a_robot_finds_itself_and_only_in_the_right_map() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let lines = floor();
    write_log(folder, "all.log", &lines);
    write_log(folder, "later.log", &lines[300..]);
    write_log(folder, "other.log", &lines.iter().map(|line| mirrored(line)).collect::<Vec<_>>());
    for log in ["all", "other"] {
        let done = run(folder, &["map", &format!("{log}.log"), "--matcher-only", "-q", "--out", log]);
        assert_eq!(done, (0, String::new(), String::new()));
    }
    let map_before = fs::read(folder.join("all/map.lrfslam")).unwrap();

    // A start that is far from all of the map is no start.
    let far = ["localize", "later.log", "--map", "all", "--start", "50,50,0", "--out", "far"];
    let (code, stdout, stderr) = run(folder, &far);
    assert_eq!(code, 3, "{stdout}{stderr}");
    assert!(stdout.contains("from the told start is nowhere in the map"), "{stdout}");
    assert_eq!(fs::read_to_string(folder.join("far/trajectory.tum")).unwrap(), "", "a path that nothing confirms");

    let (code, stdout, stderr) = run(folder, &["localize", "later.log", "--map", "all", "--out", "found"]);
    assert_eq!((code, stderr.as_str()), (0, ""));
    assert!(stdout.contains("; found after ") && stdout.ends_with("results in found\n"), "{stdout}");
    let found = report(&folder.join("found"));
    assert_eq!((&found["localisation"]["found"], &found["localisation"]["lost"]), (&1.into(), &0.into()));
    let apart = farthest_apart(&folder.join("found/trajectory.tum"), &folder.join("all/trajectory.tum"));
    assert!(apart < RIGHT_M, "{apart} m");
    assert!(fs::read(folder.join("found/localization.png")).unwrap().starts_with(b"\x89PNG"));
    let table = fs::read_to_string(folder.join("found/localization.csv")).unwrap();
    assert_eq!(table.lines().count(), 1 + lines.len() - 300);
    assert!(table.lines().nth(1).unwrap().contains(",searching,"), "nothing is known at the first scan");

    let start = ["localize", "all.log", "--map", "all", "--start", "0,0,0", "--out", "known", "-q"];
    assert_eq!(run(folder, &start), (0, String::new(), String::new()));
    assert_eq!(report(&folder.join("known"))["localisation"]["tracked_scans"], lines.len());
    // Over maps of three seeds and five seeds of localisation: mean 0.014 to 0.015 m, 99 % within 0.13 m, the worst pose 0.17 to 0.30 m.
    let apart = distances(&folder.join("known/trajectory.tum"), &folder.join("all/trajectory.tum"));
    let (mean, worst) = (apart.iter().sum::<f64>() / apart.len() as f64, apart[apart.len() - 1]);
    assert!(mean < 0.02 && apart[apart.len() * 99 / 100] < 0.15 && worst < 0.35, "{mean} m, at most {worst} m");

    let (code, stdout, _) = run(folder, &["localize", "later.log", "--map", "other", "--out", "nowhere"]);
    assert_eq!(code, 3);
    assert!(stdout.contains("the robot has not found itself in the map"), "{stdout}");
    assert_eq!(fs::read(folder.join("nowhere/trajectory.tum")).unwrap(), b"");
    assert_eq!(fs::read(folder.join("all/map.lrfslam")).unwrap(), map_before, "the map is not changed");
}

/// People hide walls. That says nothing about the place; and whoever is elsewhere is still found out, among people too.
#[test]
fn a_crowd_does_not_make_the_robot_lost_nor_a_wrong_place_right() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let lines = floor();
    let crowd: Vec<String> = lines.iter().enumerate().map(|(number, line)| crowded(number, line)).collect();
    write_log(folder, "all.log", &lines);
    write_log(folder, "crowd.log", &crowd);
    write_log(folder, "later.log", &crowd[300..]);
    assert_eq!(run(folder, &["map", "all.log", "-q", "--out", "all"]).0, 0);
    let there = ["localize", "crowd.log", "--map", "all", "--start", "0,0,0", "--out", "there", "-q"];
    assert_eq!(run(folder, &there), (0, String::new(), String::new()));
    let found = &report(&folder.join("there"))["localisation"];
    assert_eq!((&found["tracked_scans"], &found["lost"]), (&lines.len().into(), &0.into()));
    let apart = distances(&folder.join("there/trajectory.tum"), &folder.join("all/trajectory.tum"));
    assert!(apart[apart.len() * 99 / 100] < RIGHT_M, "{apart:?}");
    // The drive is gone on with where it begins, and nowhere else.
    let go_on =
        |start: &str| run(folder, &["map", "crowd.log", "--continue", "all", "--start", start, "-q", "--out", "more"]);
    assert_eq!(go_on("2,0,90").0, 3);
    assert_eq!(go_on("0,0,0").0, 0);
    // Told the start of the whole drive, a later part of it is somewhere else.
    let wrong = ["localize", "later.log", "--map", "all", "--start", "0,0,0", "--out", "wrong", "-q"];
    run(folder, &wrong);
    assert_ne!(report(&folder.join("wrong"))["localisation"]["lost"], 0);
}

#[test]
fn without_a_whole_map_there_is_one_clear_message() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_log(folder, "a.log", &floor()[..40]);
    assert_eq!(run(folder, &["map", "a.log", "--levels", "1", "-q", "--out", "a"]).0, 0);
    let message = |arguments: &[&str]| {
        let (code, _, stderr) = run(folder, &[&["localize", "a.log", "--map", "a"], arguments].concat());
        assert_eq!(code, 2, "{stderr}");
        stderr
    };
    assert!(message(&["--start", "1,2"]).contains("expected \"end\", or x, y in metres"));
    assert!(message(&["--set", "localize.nothing=1"]).contains("unknown field `nothing`"));
    let file = folder.join("a/map.lrfslam");
    let bytes = fs::read(&file).unwrap();
    fs::write(&file, &bytes[..bytes.len() / 2]).unwrap();
    assert!(message(&[]).contains("map.lrfslam: expected"), "{}", message(&[]));
    let mut damaged = bytes.clone();
    damaged[bytes.len() / 2] ^= 1;
    fs::write(&file, &damaged).unwrap();
    assert!(message(&[]).contains("damaged: the checksum is"));
    fs::remove_file(&file).unwrap();
    assert!(message(&[]).contains("not there; expected a folder that `lrfslam map`"));
}

#[test]
fn a_map_is_gone_on_with_where_the_robot_is() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let lines = floor();
    write_log(folder, "all.log", &lines);
    write_log(folder, "first.log", &lines[..400]);
    write_log(folder, "second.log", &lines[400..]);
    for log in ["all", "first"] {
        assert_eq!(run(folder, &["map", &format!("{log}.log"), "-q", "--out", log]).0, 0);
    }
    let go_on = ["map", "second.log", "--continue", "first", "-q", "--out", "both"];
    assert_eq!(run(folder, &go_on), (0, String::new(), String::new()));
    assert_eq!(report(&folder.join("both"))["continues"], "first");
    let (both, all) = (folder.join("both/trajectory.tum"), folder.join("all/trajectory.tum"));
    assert_eq!(read_positions(&both).len(), lines.len(), "the first drive's path is in it");
    let apart = farthest_apart(&both, &all);
    assert!(apart < RIGHT_M, "{apart} m");

    // The whole log again, from its start: the robot is where it said, and what it maps is the same building.
    let again = ["map", "all.log", "--continue", "both", "--start", "0,0,0", "-q", "--out", "again"];
    assert_eq!(run(folder, &again), (0, String::new(), String::new()));
    let path = read_positions(&folder.join("again/trajectory.tum"));
    assert_eq!(path.len(), lines.len(), "the same times: of each the later pose is kept");
    let (_, x, y) = &path[lines.len() - 1];
    let (_, end_x, end_y) = read_positions(&all).pop().unwrap();
    assert!((x - end_x).hypot(y - end_y) < RIGHT_M, "{x} {y} and {end_x} {end_y}");

    let (code, _, stderr) = run(folder, &["map", "second.log", "--continue", "first", "--levels", "1", "--out", "x"]);
    assert_eq!(code, 2);
    assert!(stderr.contains("expected hierarchy.levels = 2"), "{stderr}");
    let (code, _, stderr) = run(folder, &["map", "second.log", "--continue", "nowhere", "--out", "x"]);
    assert!(code == 2 && stderr.contains("map.lrfslam: not there"), "{stderr}");
}

/// Two buildings drawn over each other are worth nothing: a log that does not fit is refused before anything is written.
#[test]
fn a_map_is_not_gone_on_with_where_the_log_does_not_fit() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let lines = floor();
    write_log(folder, "first.log", &lines[..400]);
    write_log(folder, "second.log", &lines[400..]);
    write_log(folder, "other.log", &lines[..300].iter().map(|line| mirrored(line)).collect::<Vec<_>>());
    assert_eq!(run(folder, &["map", "first.log", "-q", "--out", "first"]).0, 0);
    let before = fs::read(folder.join("first/map.lrfslam")).unwrap();
    let go_on = |log: &str, more: &[&str]| {
        let out = ["--out", "first", "--overwrite"];
        let (code, _, stderr) = run(folder, &[&["map", log, "--continue", "first"], more, &out].concat());
        assert!(fs::read(folder.join("first/map.lrfslam")).unwrap() == before || code == 0, "{stderr}");
        (code, stderr)
    };
    let (code, stderr) = go_on("other.log", &[]);
    assert!(
        code == 3 && stderr.contains("does not fit the map in first") && stderr.contains("Nothing was written"),
        "{stderr}"
    );
    let (code, stderr) = go_on("second.log", &["--start", "0,0,90"]);
    assert!(code == 3 && stderr.contains("does not fit the map in first at 0.00,0.00,90.0"), "{stderr}");
    let (code, stderr) = go_on("first.log", &["--start", "1,0,0"]);
    let fits_at: Vec<f64> = stderr
        .split_once("it fits at ")
        .map(|(_, at)| at.split([',', ':']).take(2).map(|word| word.parse().unwrap()).collect())
        .unwrap_or_default();
    let is_right = matches!(fits_at[..], [x, y] if x.hypot(y) < RIGHT_M);
    assert!(code == 3 && is_right, "a metre off along a wall is noticed: {stderr}");
    // The start of the first drive, found without being told; afterwards the map holds both, in place of the first one's.
    let (code, stderr) = go_on("first.log", &[]);
    assert_eq!(code, 0, "{stderr}");
    assert!(stderr.contains("the drive begins at "), "{stderr}");
    let start = read_positions(&folder.join("first/trajectory.tum"))[0].clone();
    assert!(start.1.hypot(start.2) < RIGHT_M, "{start:?}");
}
