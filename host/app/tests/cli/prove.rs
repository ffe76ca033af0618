//! `lrfslam prove`: a row is measured, kept, and shown; what the README says of a row is what was measured.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::Value;

use crate::common::run;

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// `lrfslam prove` in the folder of the repository: exit code, stdout, stderr.
fn prove(out: &Path, more: &[&str]) -> (i32, String, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lrfslam"));
    command.current_dir(repository()).env_remove("LRFSLAM_DATA").args(["prove", "--out"]).arg(out).args(more);
    let Output { status, stdout, stderr } = command.output().unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    (status.code().unwrap(), text(stdout), text(stderr))
}

#[test]
fn a_row_is_measured_once_and_others_say_why_they_are_not() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("figures");
    let (code, stdout, stderr) = prove(&out, &["--quick", "--only", "floor-0", "--seeds", "1"]);
    assert_eq!((code, stderr.as_str()), (0, "floor-0: seed 1\n"));
    assert!(stdout.contains("measured.md"), "{stdout}");

    let json = fs::read_to_string(out.join("measured.json")).unwrap();
    let results: Value = serde_json::from_str(&json).unwrap();
    let row = &results["rows"]["floor-0"];
    let rmse = row["seeds"]["1"]["figures"]["RMSE, m"].as_f64().unwrap();
    assert!((0.002..0.0048).contains(&rmse), "{rmse}: tests/cli/accuracy.rs has the bound");
    assert!(row["commands"][0].as_str().unwrap().starts_with("lrfslam map examples/floor.log.gz "), "{row}");

    let page = fs::read_to_string(out.join("measured.md")).unwrap();
    let line = |id: &str| page.lines().find(|line| line.starts_with(&format!("| `{id}` |"))).unwrap();
    assert!(line("floor-0").contains(&format!("| matching alone | 1 | {rmse:.3} |")), "{page}");
    assert!(line("floor").contains("*not measured yet*"), "{page}");
    assert!(line("intel").contains("*not measured: logs/intel.log.gz is not there (--data)*"), "{page}");
    assert!(page.contains("1 of ") && page.contains("Cartographer: Hess et al. 2016"), "{page}");

    // What is there is not measured again, and the page not changed by that.
    let (code, _, stderr) = prove(&out, &["--quick", "--only", "floor-0,intel", "--seeds", "1"]);
    assert_eq!((code, stderr.as_str()), (0, ""), "Intel is no row of seconds");
    assert_eq!(fs::read_to_string(out.join("measured.md")).unwrap(), page);
    let (code, _, stderr) = prove(&out, &["--only", "intel"]);
    assert_eq!((code, stderr.as_str()), (0, "intel: skipped: logs/intel.log.gz is not there (--data)\n"));
    assert_eq!(fs::read_to_string(out.join("measured.json")).unwrap(), json);
}

#[test]
fn wrong_rows_and_files_are_named_before_anything_is_measured() {
    let folder = tempfile::tempdir().unwrap();
    let (code, _, stderr) = prove(folder.path(), &["--only", "flor"]);
    assert_eq!(code, 2);
    assert!(stderr.contains("--only flor: there is no such row"), "{stderr}");
    fs::write(folder.path().join("measured.json"), "[]").unwrap();
    let (code, _, stderr) = prove(folder.path(), &["--quick"]);
    assert_eq!(code, 2);
    assert!(stderr.contains("is not what lrfslam prove writes"), "{stderr}");
    let (code, list, _) = run(folder.path(), &["prove", "--list"]);
    assert_eq!(code, 0);
    assert!(list.lines().any(|line| line.starts_with("floor ")) && list.lines().count() > 50, "{list}");
}

/// A line of the README ends with `<!-- prove:ID -->`; each number in its cell before that stands in the row of that id.
#[test]
fn what_the_readme_promises_is_in_the_rows_it_names() {
    let text = |name: &str| fs::read_to_string(repository().join(name)).unwrap();
    let (readme, measured) = (text("README.md"), text("docs/measured.md"));
    let mut checked = 0;
    for line in readme.lines() {
        let Some((line, id)) = line.split_once("<!-- prove:") else { continue };
        let id = id.split("-->").next().unwrap_or_default().trim();
        let row = measured.lines().find(|row| row.starts_with(&format!("| `{id}` |")));
        let row = row.unwrap_or_else(|| panic!("docs/measured.md has no row {id}"));
        let promised = line.trim_end_matches([' ', '|']).rsplit('|').next().unwrap();
        let numbers: Vec<&str> =
            promised.split(|c: char| !c.is_ascii_digit() && c != '.').filter(|n| n.len() > 1).collect();
        assert!(!numbers.is_empty(), "{line}");
        for number in numbers {
            assert!(row.split(['|', ' ', '(', ')']).any(|word| word == number), "README: {number}, measured: {row}");
            checked += 1;
        }
    }
    assert!(checked > 2, "{checked}");
}
