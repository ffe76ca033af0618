//! `lrfslam experiment`: the sweeps of chapter 5 on the example log, and wrong input.

use std::fs;
use std::path::{Path, PathBuf};

use crate::common::run;

fn example(name: &str) -> String {
    let path: PathBuf = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples").join(name);
    path.to_str().unwrap().to_owned()
}

/// Runs an experiment on the example log; the folder's results and its table.
fn experiment(folder: &Path, name: &str, more: &[&str]) -> (serde_json::Value, String) {
    let (log, truth) = (example("floor.log.gz"), example("floor.tum.gz"));
    let arguments = ["experiment", name, &log, "--truth", &truth, "--poses", "40", "--seeds", "2", "--gap", "2"];
    let out = ["--out", name, "--overwrite"];
    let (code, stdout, stderr) = run(folder, &[&arguments[..], &out, more].concat());
    assert_eq!((code, stderr.as_str()), (0, ""));
    let report = fs::read(folder.join(name).join("report.json")).unwrap();
    (serde_json::from_slice(&report).unwrap(), stdout)
}

fn median_forward_m(report: &serde_json::Value, label: &str, method: &str) -> f64 {
    let summaries = report["summaries"].as_array().unwrap();
    let line = summaries.iter().find(|line| line["label"] == label && line["method"] == method).unwrap();
    line["forward_m"]["median"].as_f64().unwrap()
}

#[test]
fn more_generations_are_more_precise_and_newton_steps_need_few() {
    let folder = tempfile::tempdir().unwrap();
    let (report, table) = experiment(folder.path(), "de-generations", &[]);
    let median = |label, method| median_forward_m(&report, label, method);
    assert!(median("G 15", "thesis") > 1.5 * median("G 50", "thesis"), "{table}");
    assert!(median("G 15", "ours") < median("G 30", "thesis"), "{table}");
    assert!(table.contains("| more generations make the estimate more precise |"));

    let out = folder.path().join("de-generations");
    let csv = fs::read_to_string(out.join("errors.csv")).unwrap();
    let pairs = report["pairs"].as_u64().unwrap() as usize;
    assert_eq!(csv.lines().count(), 1 + pairs * 4 * 2 * 2, "cases, methods, seeds");
    assert!(fs::read_to_string(out.join("errors.svg")).unwrap().starts_with("<svg"));
    assert_eq!(
        table.replace("\nresults in de-generations\n", ""),
        fs::read_to_string(out.join("findings.md")).unwrap()
    );
}

#[test]
#[ignore = "heavy: run by .ci/run"]
fn noise_makes_the_estimate_worse_and_the_model_wider() {
    let folder = tempfile::tempdir().unwrap();
    let (report, table) = experiment(folder.path(), "lrf-noise", &[]);
    let ours = |label| median_forward_m(&report, label, "ours");
    assert!(ours("80 mm") > 2.0 * ours("15 mm"), "{table}");
    let model = |noise: &str| -> f64 {
        experiment(folder.path(), "motion-model", &["--noise", noise]);
        let bytes = fs::read(folder.path().join("motion-model/motion-model.json")).unwrap();
        let model: serde_json::Value = serde_json::from_slice(&bytes).unwrap();
        model["forward_m"]["all"]["robust_std"].as_f64().unwrap()
    };
    let (quiet, loud) = (model("0"), model("60"));
    assert!(quiet > 0.0005 && quiet < 0.02 && loud > 1.5 * quiet, "{quiet} {loud}");
}

#[test]
fn same_input_same_bytes_and_wrong_input_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let csv = || {
        experiment(folder.path(), "de-population", &[]);
        fs::read(folder.path().join("de-population/errors.csv")).unwrap()
    };
    assert!(csv() == csv());

    fs::write(folder.path().join("short.tum"), "0 0 0 0\n").unwrap();
    let log = example("floor.log.gz");
    let (code, _, stderr) = run(folder.path(), &["experiment", "lrf-noise", &log, "--truth", "short.tum"]);
    assert_eq!(code, 2);
    assert!(stderr.contains("scans and the trajectory 0 poses: expected a pose for every scan"), "{stderr}");
    let truth = example("floor.tum.gz");
    let picky = ["experiment", "lrf-noise", &log, "--truth", &truth, "--overlap", "1.1"];
    assert!(
        run(folder.path(), &picky)
            .2
            .contains("no pair of scans overlaps enough: expected a share of points of at least 110 %")
    );
}

#[test]
#[ignore = "heavy: run by .ci/run"]
fn the_loop_of_the_example_floor_closes_with_each_number_of_levels() {
    let folder = tempfile::tempdir().unwrap();
    let (log, truth) = (example("floor.log.gz"), example("floor.tum.gz"));
    let arguments = ["experiment", "loop", &log, "--truth", &truth, "--seeds", "1", "--levels", "0,2", "--out", "loop"];
    let (code, stdout, stderr) = run(folder.path(), &arguments);
    assert_eq!((code, stderr.as_str()), (0, ""));
    assert!(stdout.contains("| 0 | 1 of 1 |") && stdout.contains("| 2 | 1 of 1 |"), "{stdout}");
    let csv = fs::read_to_string(folder.path().join("loop/loop.csv")).unwrap();
    assert_eq!(csv.lines().count(), 3);
    let strict = [&arguments[..7], &["--levels", "0", "--closed", "0.0001"]].concat();
    assert!(run(folder.path(), &strict).1.contains("| 0 | 0 of 1 |"));
}
