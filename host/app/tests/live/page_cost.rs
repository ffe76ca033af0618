//! What watching costs.
//!
//! `cargo test --release -p lrfslam --all-features --test live what_watching_costs -- --ignored --nocapture`. Runs without a page, with one
//! that nobody looks at, with two viewers, and with one who reads nothing, take turns; `LRFSLAM_ROUNDS` says how often. Viewers are light:
//! a browser's own work is not SLAM's. What is compared is the processor's time, which other programs on the computer change least.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::Stdio;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use crate::common::lrfslam;
use crate::laser::Laser;
use crate::page::{LATER, TOKEN, Watched, floor};
use crate::viewer::{Viewer, sulker};

/// What `/proc` counts in, s.
const TICK_S: f64 = 0.01;
/// The most that two viewers, or any that do not read, may cost SLAM.
const SHARE_MAX: f64 = 0.03;

/// Times of a run, s: of the processor in all, of the page's threads, and of the clock while scans were mapped.
#[derive(Debug, Clone, Copy)]
struct Times {
    all: f64,
    page: f64,
    wall: f64,
}

/// State and processor time, s, of a process or thread.
fn stat(file: &Path) -> Option<(char, f64)> {
    let text = fs::read_to_string(file).ok()?;
    let words: Vec<&str> = text.rsplit_once(") ")?.1.split(' ').collect();
    let ticks: f64 = words[11].parse::<f64>().ok()? + words[12].parse::<f64>().ok()?;
    Some((words[0].chars().next()?, ticks * TICK_S))
}

/// Processor time of the threads of page and drawing, s.
fn of_page(process: &Path) -> f64 {
    let tasks = fs::read_dir(process.join("task")).into_iter().flatten().flatten();
    let is_page = |task: &Path| {
        fs::read_to_string(task.join("comm")).is_ok_and(|name| ["monitor", "live page"].contains(&name.trim()))
    };
    tasks.filter(|task| is_page(&task.path())).filter_map(|task| stat(&task.path().join("stat"))).map(|(_, s)| s).sum()
}

/// Waits for the end of a process, and tells what it took.
fn follow(pid: u32, out: &Path) -> Times {
    let process = Path::new("/proc").join(pid.to_string());
    let mut page = 0.0_f64;
    let begun = Instant::now();
    loop {
        page = page.max(of_page(&process));
        let (state, all) = stat(&process.join("stat")).expect("nobody has waited for it");
        // A zombie's times are whole.
        if state == 'Z' {
            let report: serde_json::Value = serde_json::from_slice(&fs::read(out.join("run.json")).unwrap()).unwrap();
            return Times { all, page, wall: report["cost"]["wall_s"].as_f64().unwrap() };
        }
        assert!(begun.elapsed() < LATER, "the run does not end");
        std::thread::sleep(Duration::from_millis(20));
    }
}

fn run(folder: &Path, scans: u32, kind: &str) -> Times {
    let out = folder.join("watched");
    if kind == "no page" {
        let (log, scans) = (floor(), scans.to_string());
        let args = ["map", log.to_str().unwrap(), "--out", "watched", "--overwrite", "--scans", &scans];
        let mut child = lrfslam(folder, &args).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        let times = follow(child.id(), &out);
        assert_eq!(child.wait().unwrap().code(), Some(0));
        return times;
    }
    let mut run = Watched::start(folder, "0", scans, &[]);
    let viewers: Vec<Viewer> = (0..if kind == "two viewers" { 2 } else { 0 }).map(|_| Viewer::new(&run.host)).collect();
    let sulking = (kind == "one who reads nothing").then(|| sulker(&run.host));
    let times = follow(run.child.id(), &out);
    assert_eq!(run.child.wait().unwrap().code(), Some(0));
    drop(sulking);
    for viewer in viewers {
        let (states, bytes) = viewer.end();
        assert!(states > 5 && bytes > 10_000, "a viewer saw {states} states");
    }
    times
}

fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

fn least(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(f64::INFINITY, f64::min)
}

#[test]
#[ignore = "a measurement: wants a quiet computer"]
fn what_watching_costs() {
    let number = |name: &str, usual: u32| std::env::var(name).ok().and_then(|text| text.parse().ok()).unwrap_or(usual);
    let (rounds, scans) = (number("LRFSLAM_ROUNDS", 9), number("LRFSLAM_SCANS", 806));
    let folder = tempfile::tempdir().unwrap();
    let kinds = ["no page", "a page, nobody looks", "two viewers", "one who reads nothing"];
    let mut times: BTreeMap<&str, Vec<Times>> = BTreeMap::new();
    for round in 0..rounds as usize {
        // None is always the first of its round.
        for k in 0..kinds.len() {
            let kind = kinds[(round + k) % kinds.len()];
            times.entry(kind).or_default().push(run(folder.path(), scans, kind));
        }
    }
    let plain = times["no page"].clone();
    let slam = |times: &Times| times.all - times.page;
    let noise = median(plain.iter().map(slam)) / least(plain.iter().map(slam)) - 1.0;
    println!("Runs without a page differ by {:.1} % among each other.", 100.0 * noise);
    println!(
        "| {rounds} rounds of {scans} scans | SLAM's processor time, least | median | against no page, least | median of the rounds | the page's own threads | clock, median of the rounds |"
    );
    println!("| --- | --- | --- | --- | --- | --- | --- |");
    let mut dear = Vec::new();
    for kind in kinds {
        let of = &times[kind];
        let best = least(of.iter().map(slam)) / least(plain.iter().map(slam)) - 1.0;
        let share = median(of.iter().zip(&plain).map(|(this, plain)| slam(this) / slam(plain) - 1.0));
        let wall = median(of.iter().zip(&plain).map(|(this, plain)| this.wall / plain.wall - 1.0));
        let page = median(of.iter().map(|times| times.page));
        println!(
            "| {kind} | {:.2} s | {:.2} s | {:+.1} % | {:+.1} % | {page:.2} s | {:+.1} % |",
            least(of.iter().map(slam)),
            median(of.iter().map(slam)),
            100.0 * best,
            100.0 * share,
            100.0 * wall
        );
        // The least of several is nearer to what the work takes than the median is.
        if best > SHARE_MAX {
            dear.push(kind);
        }
    }
    assert!(dear.is_empty(), "{dear:?}");
}

#[test]
#[ignore = "a measurement: wants a quiet computer"]
fn who_reads_nothing_for_a_minute_changes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let laser = Laser::hokuyo(folder.path());
    let args = ["run", "--lrf", "hokuyo", "--port", &laser.port(), "--out", "watched", "--monitor=0"];
    let mut run = Watched::run(folder.path(), &args);
    let viewer = Viewer::new(&run.host);
    std::thread::sleep(Duration::from_secs(8));
    let begun = Instant::now();
    let states = |viewer: &Viewer| viewer.states.load(Ordering::Relaxed);
    let seconds = |count: u32| {
        let begun = states(&viewer);
        std::thread::sleep(Duration::from_secs(count.into()));
        (states(&viewer) - begun) as f64 / f64::from(count)
    };
    let before = seconds(4);
    let sulking: Vec<_> = (0..4).map(|_| sulker(&run.host)).collect();
    let least = (0..12).map(|_| seconds(5)).fold(f64::INFINITY, f64::min);
    drop(sulking);
    let minutes = begun.elapsed().as_secs_f64() / 60.0;
    assert_eq!(run.status("POST /robots/0/stop", &format!("Authorization: Bearer {TOKEN}\r\n")), "204");
    assert_eq!(run.child.wait().unwrap().code(), Some(0));
    println!("{before:.1} states a second before, at least {least:.1} while four read nothing for a minute");
    assert!(least > 0.5 * before, "{before} {least}");
    let report = fs::read(folder.path().join("watched/run.json")).unwrap();
    let report: serde_json::Value = serde_json::from_slice(&report).unwrap();
    let scans = report["cost"]["scans"].as_u64().unwrap();
    println!("{scans} scans in {minutes:.1} minutes, {} B at most", report["cost"]["peak_memory_bytes"]);
    // Ten a second, but for those of its start.
    assert!(scans as f64 > 570.0 * minutes, "{report}");
    assert!(report["cost"]["peak_memory_bytes"].as_u64() < Some(150_000_000), "{report}");
}
