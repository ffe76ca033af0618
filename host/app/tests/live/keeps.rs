//! What a live command has earned is kept, at whatever moment it ends.

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use crate::attach::Bench;
use crate::common::{lrfslam, run};
use crate::demo::WORLD;
use crate::laser::Laser;

/// How a command is ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum End {
    Kill,
    CtrlC,
}

fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).into_iter().flatten();
    entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
}

/// Scans of the set in `folder`, which is whole; -1 of the old one.
fn scans(folder: &Path, what: &str) -> i64 {
    let text = fs::read_to_string(folder.join("run.json")).unwrap_or_else(|error| panic!("{what}: {error}"));
    if text == "old" {
        return -1;
    }
    let report: serde_json::Value = serde_json::from_str(&text).unwrap();
    let poses = fs::read_to_string(folder.join("trajectory.tum")).unwrap().lines().count();
    assert_eq!(report["cost"]["scans"], poses, "{what}: the report and the path are of the same moment");
    assert!(folder.join("map.lrfslam").exists(), "{what}");
    poses as i64
}

/// The same command, which ctrl-C ends before it listens for it, too: what the shell runs in the background, tests as well, ignores it.
fn interruptible(command: &Command) -> Command {
    let mut by_env = Command::new("env");
    by_env.arg("--default-signal=INT").arg(command.get_program()).args(command.get_args());
    by_env.envs(command.get_envs().filter_map(|(name, value)| Some((name, value?))));
    by_env.current_dir(command.get_current_dir().unwrap_or(Path::new(".")));
    by_env
}

/// Starts the command over an old set, ends it after `moment_ms`, and looks at what is there; scans that were saved, or -1.
fn end_at(folder: &Path, arguments: &[&str], (end, moment_ms): (End, u64), codes: &[i32]) -> i64 {
    for name in ["out", "out.part"] {
        let _ = fs::remove_dir_all(folder.join(name));
    }
    fs::create_dir(folder.join("out")).unwrap();
    fs::write(folder.join("out/run.json"), "old").unwrap();
    let arguments = [arguments, &["--out", "out", "--overwrite", "-q"]].concat();
    let what = format!("{arguments:?} {end:?} after {moment_ms} ms");
    let mut child =
        interruptible(&lrfslam(folder, &arguments)).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    std::thread::sleep(Duration::from_millis(moment_ms));
    match end {
        End::Kill => child.kill().unwrap(),
        End::CtrlC => {
            let sent = Command::new("kill").args(["-INT", &child.id().to_string()]).status();
            assert!(sent.unwrap().success());
        }
    }
    let done = child.wait_with_output().unwrap();
    let stderr = String::from_utf8(done.stderr).unwrap();
    let count = scans(&folder.join("out"), &what);
    let part = names(&folder.join("out.part"));
    if end == End::CtrlC {
        // Ctrl-C ends a program that has only just begun by itself.
        let Some(code) = done.status.code() else { return count };
        assert!(codes.contains(&code) || (count < 0 && code == 130), "{what}: {code} {stderr}");
        assert!(stderr.lines().count() == usize::from(code != 0), "{what}: one line says why: {stderr}");
        assert!(code != 130 || stderr.contains("results"), "{what}: {stderr}");
        assert!(!folder.join("out.lrfslam-new").exists(), "{what}");
        assert!(count < 0 || !folder.join("out.part").exists(), "{what}: {part:?}");
    }
    if folder.join("out.part").exists() {
        assert!(part.iter().all(|name| name == "laser.rec" || name == "robot.journal"), "{what}: {part:?}");
        assert!(!part.is_empty(), "{what}: an empty folder is left");
    }
    count
}

/// Ten moments; at one of them at least something was saved.
fn ten_moments(folder: &Path, arguments: &[&str], end: End, every_ms: u64, codes: &[i32]) {
    let saved = (0..10).map(|moment| end_at(folder, arguments, (end, 150 + every_ms * moment), codes));
    let saved: Vec<i64> = saved.collect();
    assert!(
        saved.iter().any(|count| *count > 0) || arguments[0] == "demo" && end == End::Kill,
        "{arguments:?} {saved:?}"
    );
}

fn live_run(end: End) {
    let folder = tempfile::tempdir().unwrap();
    let laser = Laser::hokuyo(folder.path());
    let arguments = ["run", "--lrf", "hokuyo", "--port", &laser.port(), "--save-every", "1"];
    ten_moments(folder.path(), &arguments, end, 250, &[0]);
    let place = ["out", "out.part"].map(|name| folder.path().join(name).join("laser.rec"));
    let recording = place.iter().find(|file| file.exists()).expect("a recording").display().to_string();
    let (code, stdout, stderr) = run(folder.path(), &["replay", &recording, "--fast", "--out", "again"]);
    assert!(code == i32::from(end == End::Kill) && stdout.contains("results in again"), "{stderr}");
}

fn replayed(end: End) {
    let folder = tempfile::tempdir().unwrap();
    let laser = Laser::hokuyo(folder.path());
    let made = ["run", "--lrf", "hokuyo", "--port", &laser.port(), "--out", "made", "--seconds", "6", "-q"];
    assert_eq!(run(folder.path(), &made).0, 0);
    ten_moments(folder.path(), &["replay", "made/laser.rec", "--save-every", "1"], end, 250, &[130]);
}

fn attached(end: End) {
    let folder = tempfile::tempdir().unwrap();
    let bench = Bench::new(folder.path(), false, 0.0);
    let arguments = ["attach", "--lrf", "hokuyo", "--port", &bench.port, "--save-every", "1"];
    ten_moments(folder.path(), &arguments, end, 350, &[0]);
    let more = ["--out", "out", "--resume", "--seconds", "6", "-q"];
    let (code, _, stderr) = run(folder.path(), &[&arguments[..], &more].concat());
    assert_eq!((code, stderr.as_str()), (0, ""));
    let report: serde_json::Value =
        serde_json::from_slice(&fs::read(folder.path().join("out/run.json")).unwrap()).unwrap();
    assert_eq!(report["robot"]["missing_scans"], 0);
}

fn shown(end: End) {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("room.toml"), WORLD).unwrap();
    ten_moments(folder.path(), &["demo", "--world", "room.toml"], end, 400, &[130]);
}

#[test]
#[ignore = "heavy: run by .ci/run"]
fn what_a_live_command_has_earned_is_kept_at_any_moment() {
    std::thread::scope(|scope| {
        for end in [End::Kill, End::CtrlC] {
            for command in [live_run, replayed, attached, shown] {
                scope.spawn(move || command(end));
            }
        }
    });
}
