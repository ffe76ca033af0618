//! Results in Python: the snippets of docs/guide/python.md run as printed, and readers that are not ours read what we write.
//!
//! Takes the Python of LRFSLAM_PYTHON, else python3; says so where it lacks a package.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use crate::cloud::{ply_points, write_drive};
use crate::common::{flaser, read_positions, run};
use crate::map_server::ServedMap;

/// A Python that has `packages`, else a word on what is missing.
fn python(packages: &str) -> Option<String> {
    let python = std::env::var("LRFSLAM_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let import = Command::new(&python).args(["-c", &format!("import {packages}")]).output();
    if import.is_ok_and(|import| import.status.success()) {
        return Some(python);
    }
    println!("skipped: {python} does not have {packages} (set LRFSLAM_PYTHON to one that has)");
    None
}

/// Runs Python in `folder`: what it prints. Figures are drawn, and not shown.
fn run_python(python: &str, folder: &Path, arguments: &[&str]) -> String {
    let mut command = Command::new(python);
    let done = command.args(arguments).current_dir(folder).env("MPLBACKEND", "Agg").output();
    let Output { status, stdout, stderr } = done.expect("it starts");
    assert!(status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&stderr));
    String::from_utf8(stdout).expect("text")
}

/// A folder with a map, a cloud and landmarks, called as the page calls them.
fn results() -> tempfile::TempDir {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    let log: String = (0..30).map(|i| flaser(i, 180)).collect();
    fs::write(folder.join("hall.log"), log).unwrap();
    write_drive(folder);
    for arguments in [
        &["map", "hall.log", "--particles", "5", "--out", "visit", "-q"][..],
        &["cloud", "room.log", "--trajectory", "path.txt", "--tilt", "tilt.txt", "--out", "cloud", "-q"],
        &["landmarks", "ekf", "--data", "sim", "--out", "posts", "-q"],
    ] {
        assert_eq!(run(folder, arguments), (0, String::new(), String::new()), "{arguments:?}");
    }
    temporary
}

#[test]
fn snippets_of_the_page_run_as_printed() {
    let Some(python) = python("numpy, matplotlib") else { return };
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/guide/python.md");
    let page = fs::read_to_string(page).unwrap();
    let snippets: Vec<&str> =
        page.split("```python\n").skip(1).map(|rest| rest.split("```").next().unwrap_or_default()).collect();
    assert!(snippets.len() >= 7, "{} snippets", snippets.len());
    let folder = results();
    let said: Vec<String> =
        snippets.iter().map(|snippet| run_python(&python, folder.path(), &["-c", snippet])).collect();
    let poses = read_positions(&folder.path().join("visit/trajectory.tum")).len();
    assert!(said[0].starts_with(&format!("{poses} poses in ")), "{}", said[0]);
    let points = ply_points(&folder.path().join("cloud/cloud.ply")).len();
    let counted = said.iter().filter(|said| said.starts_with(&format!("{points} points"))).count();
    assert_eq!(counted, 2, "of PLY and PCD: {said:?}");
    assert!(said.iter().any(|said| said.starts_with("30 scans, ")), "{said:?}");
}

#[test]
fn other_readers_find_what_was_written() {
    let Some(python) = python("evo, plyfile, pypcd4, yaml, PIL") else { return };
    let folder = results();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/cli/edges.py");
    let said = run_python(&python, folder.path(), &[script.to_str().unwrap(), "visit", "cloud"]);
    let path = read_positions(&folder.path().join("visit/trajectory.tum"));
    let length: f64 = path.windows(2).map(|pair| (pair[1].1 - pair[0].1).hypot(pair[1].2 - pair[0].2)).sum();
    let map = ServedMap::load(&folder.path().join("visit/map.yaml"));
    let [free, _, occupied] = map.counts();
    let points = ply_points(&folder.path().join("cloud/cloud.ply"));
    let bound = |of: fn(f64, f64) -> f64, from: f64| {
        [0, 1, 2].map(|axis| format!("{:.3}", points.iter().map(|point| point[axis]).fold(from, of))).join(" ")
    };
    let [x, y] = map.origin_m;
    let expected = [
        format!("path {} {length:.3}", path.len()),
        format!("map {} {} {occupied} {free} {:.3} {x:?} {y:?} 0.0", map.width, map.height, map.resolution_m),
        format!("cloud {} {} {}", points.len(), bound(f64::min, f64::INFINITY), bound(f64::max, f64::NEG_INFINITY)),
    ];
    let said: Vec<&str> = said.lines().collect();
    assert_eq!(said, expected);
}
