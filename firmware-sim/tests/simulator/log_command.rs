//! `lrf-sim log`: the example log comes out again, and faults are told in one line.

use std::io::Read;
use std::path::Path;
use std::process::{Command, Output};

use flate2::read::GzDecoder;

fn lrf_sim(folder: &Path, arguments: &str) -> Output {
    Command::new(env!("CARGO_BIN_EXE_lrf-sim")).current_dir(folder).args(arguments.split(' ')).output().unwrap()
}

fn lines(file: &Path) -> Vec<String> {
    let mut text = String::new();
    GzDecoder::new(std::fs::File::open(file).unwrap()).read_to_string(&mut text).unwrap();
    text.lines().map(str::to_owned).collect()
}

/// Sines of the last bit may differ between systems, and with them the last digit of a few ranges.
#[test]
fn example_log_comes_out_again() {
    let folder = tempfile::tempdir().unwrap();
    let arguments = "log --world floor --lrf lms291 --resolution 1 --rate 4 --out floor.log.gz --truth floor.tum.gz";
    assert!(lrf_sim(folder.path(), arguments).status.success());
    for name in ["floor.log.gz", "floor.tum.gz"] {
        let kept = lines(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples").join(name));
        let made = lines(&folder.path().join(name));
        let different = kept.iter().zip(&made).filter(|(kept, made)| kept != made).count();
        assert_eq!(kept.len(), made.len());
        assert!(different * 100 <= kept.len(), "{name}: {different} of {} lines differ", kept.len());
    }
}

#[test]
fn faults_are_told_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("w.toml"), "[[wall]]\nfrom = [0, 0]\nto = [0, 0]\n").unwrap();
    let fault = |arguments: &str| {
        let output = lrf_sim(folder.path(), arguments);
        let text = String::from_utf8(output.stderr).unwrap();
        assert!(!output.status.success() && text.lines().count() == 1, "{text}");
        text
    };
    assert_eq!(
        fault("log --world w.toml --out a.log"),
        "lrf-sim: w.toml:1: wall: to: expected another place than `from`\n"
    );
    assert!(fault("log --world nowhere.toml --out a.log").starts_with("lrf-sim: nowhere.toml: cannot be read"));
    assert!(fault("log --world room --out a.log").contains("say how many seconds"));
    assert!(fault("log --world room --seconds 2 --out none/a.log").contains("none/a.log: cannot be made"));
    assert!(fault("log --world room --seconds 2 --resolution 0 --out a.log").contains("--resolution: expected"));
}
