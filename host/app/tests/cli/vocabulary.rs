//! One vocabulary: a flag means the same in every command, and every command keeps to the exit codes.

use std::collections::BTreeMap;
use std::fs;

use clap::Command;
use lrfslam_app::cli;

use crate::common::{flaser, run};

/// Every command with its words after `lrfslam`, those that only group others too.
fn commands() -> Vec<(Vec<String>, Command)> {
    fn below(words: &[String], of: &Command, all: &mut Vec<(Vec<String>, Command)>) {
        for command in of.get_subcommands().filter(|command| command.get_name() != "help") {
            let words = [words, &[command.get_name().to_owned()]].concat();
            below(&words, command, all);
            all.push((words, command.clone()));
        }
    }
    let mut all = Vec::new();
    below(&[], &cli::command(), &mut all);
    all
}

#[test]
fn every_command_has_help() {
    let folder = tempfile::tempdir().unwrap();
    let commands = commands();
    assert!(commands.len() > 14, "{}", commands.len());
    for (words, _) in commands {
        if ["experiment", "prove"].contains(&words[0].as_str()) && !cfg!(feature = "experiments") {
            continue;
        }
        let arguments: Vec<&str> = words.iter().map(String::as_str).chain(["--help"]).collect();
        let (code, help, stderr) = run(folder.path(), &arguments);
        assert_eq!((code, stderr.as_str()), (0, ""), "{words:?}");
        assert!(help.contains(&format!("Usage: lrfslam {}", words.join(" "))), "{help}");
    }
}

#[test]
fn flags_of_one_name_have_one_help() {
    // Of other flags, those that take the same: `--out DIR` is a folder, `--out FILE` is none.
    const ANYWHERE: [&str; 5] = ["truth", "lrf", "seed", "json", "quiet"];
    let mut known = BTreeMap::new();
    for (words, command) in commands() {
        for flag in command.get_arguments().filter(|flag| flag.get_id() != "help") {
            let Some(name) = flag.get_long() else { continue };
            let takes = flag.get_value_names().map(|names| format!("{names:?}"));
            let takes = takes.filter(|_| !ANYWHERE.contains(&name));
            let help = flag.get_help().map(ToString::to_string).unwrap_or_default();
            assert!(!help.is_empty() && !help.ends_with('.'), "{words:?} --{name}: {help:?}");
            let (first, said) = known.entry((name.to_owned(), takes)).or_insert((words.clone(), help.clone()));
            assert_eq!(said, &help, "--{name} of {first:?} and of {words:?}");
        }
    }
}

#[test]
fn commands_with_results_have_the_same_flags() {
    let flags = |wanted: &str| {
        let (_, command) = commands().into_iter().find(|(words, _)| words.join(" ") == wanted).unwrap();
        command.get_arguments().filter_map(|flag| flag.get_long().map(str::to_owned)).collect::<Vec<_>>()
    };
    for command in ["map", "run", "replay", "attach", "localize", "cloud", "demo"] {
        let flags = flags(command);
        for flag in ["out", "overwrite", "config", "set", "seed", "json", "quiet"] {
            assert!(flags.iter().any(|there| there == flag), "{command} has no --{flag}");
        }
    }
    assert!(flags("eval").contains(&"truth".to_owned()) && flags("eval").contains(&"json".to_owned()));
}

/// A robot that drives through a hall.
fn hall(folder: &std::path::Path) {
    let log: String = (0..30).map(|i| flaser(i, 180)).collect();
    fs::write(folder.join("hall.log"), log).unwrap();
}

#[test]
fn json_is_what_the_report_holds_and_quiet_is_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    hall(folder);
    for (name, arguments) in [
        ("made", &["map", "hall.log", "--matcher-only"][..]),
        ("found", &["localize", "hall.log", "--map", "made", "--start", "0,0,0"]),
    ] {
        let to = |flag| [arguments, &["--out", name, "--overwrite", flag]].concat();
        let (code, json, stderr) = run(folder, &to("--json"));
        assert_eq!((code, stderr.as_str()), (0, ""), "{json}");
        assert_eq!(json, fs::read_to_string(folder.join(name).join("run.json")).unwrap());
        assert_eq!(run(folder, &to("-q")), (0, String::new(), String::new()));
        let (code, _, stderr) = run(folder, &[&to("-q")[..], &["--json"]].concat());
        assert!(code == 2 && stderr.contains("cannot be used with"), "{stderr}");
    }
}

#[test]
fn exit_codes_are_those_of_the_help() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    hall(folder);
    let help = run(folder, &["--help"]).1;
    let told = |code: &str| help.lines().any(|line| line.trim_start().starts_with(&format!("{code} ")));
    assert!(["0", "1", "2", "3", "130"].iter().all(|code| told(code)), "{help}");
    assert_eq!(run(folder, &["map", "hall.log", "--matcher-only", "-q", "--out", "made"]).0, 0);
    // Wrong from the start, each command in its own way.
    for arguments in [
        &["map", "none.log"][..],
        &["localize", "none.log", "--map", "made"],
        &["localize", "hall.log", "--map", "none"],
        &["eval", "none.tum", "--truth", "made/trajectory.tum"],
        &["cloud", "none.log", "--trajectory", "made/trajectory.tum", "--tilt", "none.txt"],
        &["replay", "none.rec"],
        &["calibrate", "none.log", "--truth", "made/trajectory.tum"],
        &["config", "--config", "none.toml"],
        &["run", "--lrf", "ld06", "--port", "x", "--config", "none.toml"],
        &["attach", "--lrf", "hokuyo", "--port", "x", "--config", "none.toml"],
        &["demo", "--world", "none.toml"],
        &["experiment", "loop", "none.log", "--truth", "made/trajectory.tum"],
        &["completions", "none"],
    ] {
        let (code, stdout, stderr) = run(folder, arguments);
        assert_eq!((code, stdout.as_str()), (2, ""), "{arguments:?}: {stderr}");
        assert!(stderr.contains("none") || stderr.contains("this build has no"), "{arguments:?}: {stderr}");
    }
    // On the way: that nothing of the reference lies within the log is known once it is mapped.
    fs::write(folder.join("far.txt"), "9000 9001 1 0 0 0 0 0\n").unwrap();
    let (code, stdout, stderr) = run(folder, &["calibrate", "hall.log", "--relations", "far.txt"]);
    assert_eq!((code, stdout.as_str()), (1, ""), "{stderr}");
    let no_folder = ["man", "--out", "hall.log"];
    assert_eq!(run(folder, &no_folder).0, 2, "a file is no folder");
}

#[test]
fn a_shell_is_told_of_every_command() {
    let folder = tempfile::tempdir().unwrap();
    for shell in ["bash", "zsh", "fish"] {
        let (code, script, stderr) = run(folder.path(), &["completions", shell]);
        assert_eq!((code, stderr.as_str()), (0, ""));
        for (words, _) in commands() {
            assert!(script.contains(words.last().unwrap()), "{shell}: {words:?}");
        }
    }
    let bash = run(folder.path(), &["completions", "bash"]).1;
    for (words, _) in commands().into_iter().filter(|(words, _)| words.len() == 1) {
        assert!(bash.contains(&format!("lrfslam,{})", words[0])), "{words:?}");
    }
}

#[test]
fn manual_pages_name_what_the_commands_take() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    assert_eq!(run(folder, &["man", "--out", "pages"]), (0, String::new(), String::new()));
    let page = |name: &str| fs::read_to_string(folder.join("pages").join(name)).unwrap();
    assert!(page("lrfslam-map.1").contains(r"\-\-continue"), "{}", page("lrfslam-map.1"));
    assert!(page("lrfslam-lrf-scan.1").contains(r"\-\-table") && page("lrfslam.1").contains("130"));
    let (code, all, stderr) = run(folder, &["man"]);
    assert_eq!((code, stderr.as_str()), (0, ""));
    assert!(all.contains(&page("lrfslam.1")) && all.contains(&page("lrfslam-map.1")));
    assert_eq!(fs::read_dir(folder.join("pages")).unwrap().count(), 1 + commands().len());
}

#[test]
fn version_names_the_commit_it_was_built_from() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    hall(folder);
    run(folder, &["map", "hall.log", "--matcher-only", "--out", "made"]);
    let report: serde_json::Value = serde_json::from_slice(&fs::read(folder.join("made/run.json")).unwrap()).unwrap();
    let program = &report["program"];
    assert_eq!(program["version"], env!("CARGO_PKG_VERSION"));
    let head = std::process::Command::new("git").args(["rev-parse", "HEAD"]).output();
    let head = head.ok().filter(|said| said.status.success()).map(|said| String::from_utf8(said.stdout).unwrap());
    let wanted = match (head, program["commit"].as_str()) {
        (Some(head), Some(commit)) => {
            assert!(commit.len() >= 7 && head.starts_with(commit), "{head} {commit}");
            format!("lrfslam {} ({commit})\n", env!("CARGO_PKG_VERSION"))
        }
        // Built from a package, or without git.
        (_, None) => format!("lrfslam {}\n", env!("CARGO_PKG_VERSION")),
        (None, Some(commit)) => panic!("{commit}, and there is no repository"),
    };
    assert_eq!(run(folder, &["--version"]).1, wanted);
}
