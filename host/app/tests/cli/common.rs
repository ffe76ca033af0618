//! What the tests of the program share: the program itself, and the real logs where they are.
#![allow(dead_code, reason = "not every binary uses all of it")]

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::{Arc, Mutex, OnceLock};

/// The built program, in `folder`, with `args`.
pub fn lrfslam(folder: &Path, args: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lrfslam"));
    command.current_dir(folder).args(args);
    command
}

/// Runs it: exit code, stdout, stderr. A panic fails the test.
pub fn run(folder: &Path, args: &[&str]) -> (i32, String, String) {
    let Output { status, stdout, stderr } = lrfslam(folder, args).output().expect("the program starts");
    let stderr = String::from_utf8(stderr).expect("messages are text");
    assert!(!stderr.contains("panicked"), "{stderr}");
    (status.code().expect("not killed"), String::from_utf8(stdout).expect("output is text"), stderr)
}

/// A file of the real data, from the folder LRFSLAM_DATA, else from beside the repository; says so if it is missing.
pub fn real_data(name: &str) -> Option<PathBuf> {
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    let folder = std::env::var_os("LRFSLAM_DATA").map_or_else(beside, PathBuf::from);
    let file = folder.join(name);
    if !file.exists() {
        println!("skipped: {name} is not there (set LRFSLAM_DATA to the folder of the real logs)");
        return None;
    }
    Some(file)
}

/// The results of `lrfslam map` with a real log, all as it is without being asked; mapped once for all tests that look at it.
pub fn mapped(name: &str) -> Option<PathBuf> {
    static MAPPED: Mutex<BTreeMap<String, Arc<OnceLock<PathBuf>>>> = Mutex::new(BTreeMap::new());
    let log = real_data(name)?;
    let place = MAPPED.lock().unwrap().entry(name.to_owned()).or_default().clone();
    let results = place.get_or_init(|| {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR"));
        let out = folder.join(name.replace('/', "-"));
        let words = ["map", log.to_str().unwrap(), "--overwrite", "--quiet", "--out", out.to_str().unwrap()];
        assert_eq!(run(folder, &words), (0, String::new(), String::new()));
        out
    });
    Some(results.clone())
}

/// A FLASER line of `count` beams at time `i` s, the robot driving forward, walls 3 m around.
pub fn flaser(i: u32, count: usize) -> String {
    let ranges = vec!["3.00"; count].join(" ");
    let x = f64::from(i) * 0.1;
    format!("FLASER {count} {ranges} {x} 0 0 {x} 0 0 {i}.000000 host {i}.000000\n")
}

/// Positions by their times, as they stand in a TUM file.
pub fn read_positions(file: &Path) -> Vec<(String, f64, f64)> {
    let text = std::fs::read_to_string(file).unwrap();
    let pose = |line: &str| {
        let words: Vec<&str> = line.split(' ').collect();
        (words[0].to_owned(), words[1].parse().unwrap(), words[2].parse().unwrap())
    };
    text.lines().map(pose).collect()
}
