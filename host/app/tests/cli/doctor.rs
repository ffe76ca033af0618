//! `lrfslam doctor` as its user sees it; what it finds in which log is tested with the library.

use std::fs;
use std::io::Write as _;
use std::path::Path;
use std::process::Stdio;

use crate::common::{flaser, lrfslam, real_data, run};

/// Kinds of what is wrong or unusual, with how bad it is.
fn findings(log: &str) -> (i32, Vec<String>) {
    let folder = tempfile::tempdir().unwrap();
    let (code, json, _) = run(folder.path(), &["doctor", log, "--json"]);
    let report: serde_json::Value = serde_json::from_str(&json).unwrap_or_else(|error| panic!("{error}: {json}"));
    let told = report["findings"].as_array().unwrap().iter().filter(|finding| finding["severity"] != "note");
    (code, told.map(|finding| finding["kind"].as_str().unwrap().to_owned()).collect())
}

#[test]
fn a_clean_log_is_well() {
    let log = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/floor.log.gz");
    let folder = tempfile::tempdir().unwrap();
    let (code, stdout, stderr) = run(folder.path(), &["doctor", log.to_str().unwrap()]);
    assert_eq!((code, stderr.as_str()), (0, ""), "{stdout}");
    assert!(stdout.ends_with("\n806 scans: nothing is wrong\n"), "{stdout}");
    assert!(stdout.contains("181 beams a scan over 180°") && stdout.contains("4.0 a second"), "{stdout}");
    assert_eq!(run(folder.path(), &["doctor", log.to_str().unwrap(), "-q"]), (0, String::new(), String::new()));
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0, "nothing is written");
}

#[test]
fn what_is_wrong_is_said_with_code_3() {
    let folder = tempfile::tempdir().unwrap();
    // The robot is said to drive, the scans stay the same: a circle about it.
    let log: String = (0..40).map(|i| flaser(i, 180)).collect();
    fs::write(folder.path().join("stuck.log"), &log).unwrap();
    let (code, stdout, stderr) = run(folder.path(), &["doctor", "stuck.log"]);
    assert_eq!((code, stderr.as_str()), (3, "lrfslam: wrong: no-return-as-wall, frozen-scans\n"), "{stdout}");
    assert!(stdout.contains("WRONG    frozen-scans: 39 scans with the same bits"), "{stdout}");
    assert!(stdout.contains("at     lines 2 to 40 (1.00 to 39.00 s)"), "{stdout}");
    let mut child = lrfslam(folder.path(), &["doctor", "-", "-q"]).stdin(Stdio::piped()).spawn().unwrap();
    child.stdin.take().unwrap().write_all(log.as_bytes()).unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(3), "from standard input");
    assert_eq!(run(folder.path(), &["doctor", "none.log"]).0, 2);
    assert_eq!(run(folder.path(), &["doctor"]).0, 2);
}

/// What is true of them and no more.
#[test]
fn real_logs_are_not_cried_wolf_over() {
    let expected: [(&str, &[&str]); 5] = [
        ("intel.log.gz", &["times-backward", "times-repeated", "bursts"]),
        ("aces.clf.gz", &["gaps", "unsteady-rate", "too-fast"]),
        ("loop5.log.gz", &["too-fast"]),
        ("urg04lx-exp2.dat.gz", &["mostly-invalid", "dead-sector", "too-fast", "smeared", "odometry-late"]),
        ("fr-clinic.clf.gz", &["gaps", "too-fast", "lost"]),
    ];
    for (name, may) in expected {
        let Some(log) = real_data(&format!("logs/{name}")) else { return };
        let (code, found) = findings(log.to_str().unwrap());
        assert_eq!(code, 0, "{name}: {found:?}");
        assert!(found.iter().all(|kind| may.contains(&kind.as_str())), "{name}: {found:?}");
        assert!(!found.is_empty() || name == "loop5.log.gz", "{name}");
    }
}

#[test]
fn real_logs_with_faults_show_them() {
    for (name, kinds) in [
        ("ydlidar-x4/ydlidar-x4-1.dat.gz", &["mostly-invalid", "odometry-frozen"][..]),
        ("keyframes/edmonton.log.gz", &["too-fast"]),
    ] {
        let Some(log) = real_data(&format!("logs/{name}")) else { return };
        let (code, found) = findings(log.to_str().unwrap());
        assert_eq!(code, 3, "{name}: {found:?}");
        assert!(kinds.iter().all(|kind| found.iter().any(|found| found == kind)), "{name}: {found:?}");
    }
}
