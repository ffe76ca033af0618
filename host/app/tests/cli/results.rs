//! What the commands leave behind when all goes well.

use std::fs;

use crate::common::{flaser, run};

#[test]
fn map_writes_all_its_results() {
    let folder = tempfile::tempdir().unwrap();
    let log: String = (0..40).map(|i| flaser(i, 180)).collect();
    fs::write(folder.path().join("hall.log"), log).unwrap();
    let (code, stdout, stderr) =
        run(folder.path(), &["map", "hall.log", "--out", "hall", "--odometry", "--set", "map.cell_size_m=0.1"]);
    assert_eq!((code, stderr.as_str()), (0, ""));
    assert!(stdout.starts_with("40 scans in ") && stdout.ends_with("results in hall\n"), "{stdout}");

    let out = folder.path().join("hall");
    let mut names: Vec<_> = fs::read_dir(&out).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    names.sort();
    assert_eq!(names, ["map.lrfslam", "map.pgm", "map.png", "map.yaml", "run.json", "steps.csv", "trajectory.tum"]);
    assert_eq!(fs::read_to_string(out.join("trajectory.tum")).unwrap().lines().count(), 40);
    assert!(fs::read_to_string(out.join("map.yaml")).unwrap().contains("resolution: 0.100000"));
    assert!(fs::read(out.join("map.pgm")).unwrap().starts_with(b"P5\n"));

    let report: serde_json::Value = serde_json::from_slice(&fs::read(out.join("run.json")).unwrap()).unwrap();
    assert_eq!(report["config"]["map"]["cell_size_m"], 0.1);
    assert_eq!((&report["seed"], &report["odometry"], &report["partial"]), (&1.into(), &true.into(), &false.into()));
    assert_eq!((&report["log"]["scans"], &report["input"]["name"]), (&40.into(), &"hall.log".into()));
    assert_eq!(report["input"]["sha256"].as_str().unwrap().len(), 64);
}

/// A robot that drives through a hall, its laser first ahead of it.
fn drive_log(folder: &std::path::Path) {
    let log: String = (0..60).map(|i| flaser(i, 180)).collect();
    fs::write(folder.join("hall.log"), log).unwrap();
}

#[test]
fn threads_change_nothing_and_particles_do() {
    let folder = tempfile::tempdir().unwrap();
    drive_log(folder.path());
    let results = |flags: &[&str]| {
        let arguments = [&["map", "hall.log", "--out", "out", "--overwrite", "-q"], flags].concat();
        assert_eq!(run(folder.path(), &arguments), (0, String::new(), String::new()));
        let out = folder.path().join("out");
        (fs::read(out.join("trajectory.tum")).unwrap(), fs::read(out.join("map.pgm")).unwrap())
    };
    // As many as are asked for, whether or not they are at different places.
    let spread = ["--set", "motion.forward_m=0.01", "--set", "particles.particles_min=100"];
    let on = |threads| results(&[&["--particles", "30", "--threads", threads], &spread[..]].concat());
    let one = on("1");
    assert_eq!(one, on("2"));
    assert_eq!(one, on("7"));
    assert_ne!(one.0, results(&[&["--particles", "31"], &spread[..]].concat()).0);
}

#[test]
fn matching_alone_takes_no_steps_of_the_filter() {
    let folder = tempfile::tempdir().unwrap();
    drive_log(folder.path());
    run(folder.path(), &["map", "hall.log", "--out", "out", "--matcher-only"]);
    let out = folder.path().join("out");
    assert!(!out.join("steps.csv").exists());
    let report: serde_json::Value = serde_json::from_slice(&fs::read(out.join("run.json")).unwrap()).unwrap();
    assert!(report["particles"].is_null());
    assert_eq!(report["config"]["hierarchy"]["levels"], 0);
}

#[test]
fn memory_too_small_for_the_map_is_said() {
    let folder = tempfile::tempdir().unwrap();
    drive_log(folder.path());
    let full = ["--set", "memory.map_tiles=256", "--set", "particle_map.square_size_m=0.01"];
    for (more, is_full) in [(&[][..], false), (&full, true)] {
        let map = ["map", "hall.log", "--out", "out", "--overwrite", "--particles", "30", "--levels", "1"];
        let (code, stdout, stderr) = run(folder.path(), &[&map, more].concat());
        assert_eq!((code, stderr.as_str()), (0, ""));
        let note = stdout.lines().find(|line| line.starts_with("note: memory.map_tiles is too small: "));
        assert_eq!(note.is_some_and(|note| !note.ends_with(" 0 squares left out")), is_full, "{stdout}");
    }
}

#[test]
fn calibration_is_a_configuration() {
    let folder = tempfile::tempdir().unwrap();
    drive_log(folder.path());
    run(folder.path(), &["map", "hall.log", "--out", "out", "-q"]);
    let arguments = ["calibrate", "hall.log", "--truth", "out/trajectory.tum", "--out", "motion.toml"];
    assert_eq!(run(folder.path(), &arguments), (0, String::new(), String::new()));
    let text = fs::read_to_string(folder.path().join("motion.toml")).unwrap();
    assert!(text.contains("[motion]\nforward_m = 0.00"), "{text}");
    let (code, _, stderr) = run(folder.path(), &["map", "hall.log", "--config", "motion.toml"]);
    assert_eq!((code, stderr.as_str()), (0, ""));
    let (code, _, stderr) = run(folder.path(), &["calibrate", "hall.log"]);
    assert!(code == 2 && stderr.contains("--relations"), "{code} {stderr}");
}

#[test]
fn quiet_says_nothing() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("a.log"), flaser(0, 180)).unwrap();
    assert_eq!(run(folder.path(), &["map", "a.log", "--quiet"]), (0, String::new(), String::new()));
}

#[test]
fn same_seed_gives_the_same_files() {
    let folder = tempfile::tempdir().unwrap();
    let log: String = (0..40).map(|i| flaser(i, 180)).collect();
    fs::write(folder.path().join("a.log"), log).unwrap();
    for out in ["one", "two"] {
        assert_eq!(run(folder.path(), &["map", "a.log", "--out", out, "--seed", "9"]).0, 0);
    }
    for file in ["trajectory.tum", "map.pgm", "map.yaml", "map.png"] {
        let read = |out: &str| fs::read(folder.path().join(out).join(file)).unwrap();
        assert!(read("one") == read("two"), "{file} differs");
    }
}

#[test]
fn printed_configuration_can_be_used() {
    let folder = tempfile::tempdir().unwrap();
    let (_, printed, _) = run(folder.path(), &["config", "--set", "log.range_max_m=25"]);
    assert!(printed.contains("range_max_m = 25.0"), "{printed}");
    fs::write(folder.path().join("c.toml"), &printed).unwrap();
    assert_eq!(run(folder.path(), &["config", "--config", "c.toml"]).1, printed);
}

#[test]
fn eval_prints_a_table_or_json() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("t.tum"), "1.0 0 0 0 0 0 0 1\n2.0 1.5 0 0 0 0 0 1\n").unwrap();
    fs::write(folder.path().join("r.txt"), "1.0 2.0 1 0 0 0 0 0\n1.0 9.0 1 0 0 0 0 0\n").unwrap();
    let (_, table, _) = run(folder.path(), &["eval", "t.tum", "--relations", "r.txt"]);
    assert!(table.contains("translation, m            0.5000    0.0000"), "{table}");
    assert!(table.contains("1 of 2 relations judged\n1 without a pose within 0.05 s"), "{table}");
    let (_, json, _) = run(folder.path(), &["eval", "t.tum", "--relations", "r.txt", "--json"]);
    let report: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!((&report["translation_m"]["mean"], &report["unmatched"]), (&0.5.into(), &1.into()));
    let (_, json, _) = run(folder.path(), &["eval", "t.tum", "--truth", "t.tum", "--json", "--stretch", "1"]);
    let report: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!((&report["absolute_m"]["max"], &report["relative"]["stretch_m"]), (&0.0.into(), &1.0.into()));
}
