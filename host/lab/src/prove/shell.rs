//! Rows' commands, run by the shell as anyone would type them.
//!
//! They know `$D`, the folder of the real data; `$W`, a working folder that goes when all is done; `$S`, the seed. `lrfslam` is this
//! program, `lrf-sim` the one beside it. `examples/…` and `cargo` are those of a clone, in whose folder this is run.

use std::collections::{BTreeMap, BTreeSet};
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use anyhow::{Context as _, ensure};
use serde_json::Value;
use tempfile::TempDir;

use super::plan::{Column, Group, Plan, Row, RunFigure, Source};
use super::results::Outcome;

/// Ticks of `/proc` in a second, on every Linux.
const TICKS_PER_S: f64 = 100.0;
/// Figures are kept to six decimals: what is written so is read as it was.
const DECIMALS: f64 = 1e6;
/// How a script says that what it needs is not there.
const NOT_HERE: i32 = 77;

/// Why a row has no figure.
#[derive(Debug)]
pub enum Fault {
    /// What it needs is not there.
    Missing(String),
    /// A command did not end well, or did not tell what it should.
    Failed(String),
}

/// Runs rows.
#[derive(Debug)]
pub struct Shell {
    data: Option<PathBuf>,
    work: TempDir,
    path: OsString,
    prepared: BTreeSet<String>,
}

/// What a command left.
struct Said {
    stdout: String,
    cpu_s: f64,
}

impl Shell {
    /// With a new working folder.
    ///
    /// * `data` — folder of the real data
    ///
    /// # Errors
    /// If there can be none, the data's folder is not there, or this program is not called `lrfslam`, as the rows call it.
    pub fn new(data: Option<PathBuf>) -> anyhow::Result<Self> {
        let program = std::env::current_exe().context("this program does not know where it is")?;
        ensure!(
            program.file_stem().is_some_and(|name| name == "lrfslam"),
            "{}: the rows call lrfslam",
            program.display()
        );
        let of_data =
            |data: PathBuf| data.canonicalize().with_context(|| format!("{}: cannot be read", data.display()));
        let data = data.map(of_data).transpose()?;
        let others = std::env::var_os("PATH").unwrap_or_default();
        let folders = program.parent().map(Path::to_owned).into_iter().chain(std::env::split_paths(&others));
        let path = std::env::join_paths(folders).context("PATH cannot be made")?;
        let work = tempfile::tempdir().context("there can be no working folder")?;
        Ok(Self { data, work, path, prepared: BTreeSet::new() })
    }

    /// What `commands` need and is not there, in words.
    pub fn missing(&self, commands: &[&str]) -> Option<String> {
        let words = commands.iter().flat_map(|command| command.split_whitespace());
        words.filter_map(|word| self.missing_word(word)).next()
    }

    fn missing_word(&self, word: &str) -> Option<String> {
        let is_missing = match word {
            "cargo" => !self.has_program("cargo") || !Path::new("Cargo.toml").exists(),
            "lrf-sim" => !self.has_program("lrf-sim"),
            _ if word.starts_with("examples/") || word.starts_with("firmware-sim/") => !Path::new(word).exists(),
            _ => {
                let name = word.strip_prefix("$D/")?;
                let is_there = self.data.as_ref().is_some_and(|data| data.join(name).exists());
                return (!is_there).then(|| format!("{name} is not there (--data)"));
            }
        };
        is_missing.then(|| format!("{word} is not there"))
    }

    fn has_program(&self, name: &str) -> bool {
        std::env::split_paths(&self.path).any(|folder| folder.join(name).is_file())
    }

    /// Runs `row` with `seed`, and first what it needs.
    ///
    /// # Errors
    /// See [`Fault`].
    pub fn measure(&mut self, plan: &Plan, group: &Group, row: &Row, seed: u64) -> Result<Outcome, Fault> {
        for name in &row.prepare {
            if self.prepared.contains(name) {
                continue;
            }
            for command in plan.prepare.get(name).into_iter().flat_map(|shared| &shared.commands) {
                self.run(command, 1)?;
            }
            self.prepared.insert(name.clone());
        }
        let said: Vec<Said> = row.commands.iter().map(|command| self.run(command, seed)).collect::<Result<_, _>>()?;
        let columns = plan.columns(group);
        if columns.is_empty() {
            let text = said.into_iter().next_back().map(|said| said.stdout).unwrap_or_default();
            return Ok(Outcome { figures: BTreeMap::new(), text });
        }
        let run = self.work.path().join(row.run.replace("$S", &seed.to_string()));
        let figures = figures(columns, &said, &std::fs::read_to_string(run).unwrap_or_default());
        if figures.values().all(Option::is_none) {
            return Err(Fault::Failed("no figure was told".to_owned()));
        }
        Ok(Outcome { figures, text: String::new() })
    }

    fn run(&self, command: &str, seed: u64) -> Result<Said, Fault> {
        let failed = |why: String| Fault::Failed(format!("`{command}`: {why}"));
        let before_s = children_cpu_s();
        let mut shell = Command::new("sh");
        shell.args(["-c", command]).stdin(Stdio::null()).env("PATH", &self.path);
        shell.env("W", self.work.path()).env("S", seed.to_string());
        if let Some(data) = &self.data {
            shell.env("D", data).env("LRFSLAM_DATA", data);
        }
        let Output { status, stdout, stderr } = shell.output().map_err(|error| failed(error.to_string()))?;
        if status.code() == Some(NOT_HERE) {
            return Err(Fault::Missing("its toolchain is not there".to_owned()));
        }
        if !status.success() {
            let words = String::from_utf8_lossy(&stderr);
            return Err(failed(words.lines().next_back().unwrap_or("it said nothing").to_owned()));
        }
        let stdout = self.without_places(&String::from_utf8_lossy(&stdout));
        Ok(Said { stdout, cpu_s: children_cpu_s() - before_s })
    }

    /// `text` with the folders written as rows write them: what is published says nothing of a machine's places.
    fn without_places(&self, text: &str) -> String {
        let folders = [(self.data.as_deref(), "$D"), (Some(self.work.path()), "$W")];
        let named = folders.into_iter().filter_map(|(folder, name)| Some((folder?.to_str()?, name)));
        named.fold(text.to_owned(), |text, (folder, name)| text.replace(folder, name))
    }
}

/// CPU time of all commands that have ended, s; 0 where there is no `/proc` that tells.
fn children_cpu_s() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    // After the name in brackets, which may hold anything, the state is field 3; 16 and 17 are the children's time.
    let fields = stat.rsplit_once(')').map_or("", |(_, fields)| fields).split_whitespace();
    fields.skip(13).take(2).filter_map(|field| field.parse::<f64>().ok()).sum::<f64>() / TICKS_PER_S
}

/// By title; `run` is the text of a run.json.
fn figures(columns: &[Column], said: &[Said], run: &str) -> BTreeMap<String, Option<f64>> {
    let told: Vec<Value> = said.iter().map(|said| serde_json::from_str(&said.stdout).unwrap_or_default()).collect();
    let run: Value = serde_json::from_str(run).unwrap_or_default();
    let cpu_s = said.first().map_or(0.0, |said| said.cpu_s);
    let value = |column: &Column| {
        let value = match column.from {
            Source::Output(number) => told.get(number)?.pointer(&column.at)?.as_f64()?,
            Source::Run(RunFigure::Run) => run.pointer(&column.at)?.as_f64()?,
            Source::Run(RunFigure::Speed) => run.pointer("/cost/driven_s")?.as_f64()? / cpu_s,
            Source::Run(RunFigure::CpuMs) => 1e3 * cpu_s / run.pointer("/cost/scans")?.as_f64()?,
        };
        Some((value * column.scale * DECIMALS).round() / DECIMALS).filter(|value| value.is_finite())
    };
    columns.iter().map(|column| (column.title.clone(), value(column))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn column(title: &str, from: Source, at: &str, scale: f64) -> Column {
        Column { title: title.into(), from, at: at.into(), scale, digits: 1, at_most: None }
    }

    #[test]
    fn figures_are_read_from_what_commands_print_and_leave() {
        let said = |stdout: &str, cpu_s| Said { stdout: stdout.into(), cpu_s };
        let said = [said("words", 2.0), said(r#"{"error": {"mean": 0.25}, "axes": [{"within": [0.5]}]}"#, 0.0)];
        let run = r#"{"cost": {"driven_s": 60.0, "scans": 100, "peak_memory_bytes": 5000000}}"#;
        let columns = [
            column("cm", Source::Output(1), "/error/mean", 100.0),
            column("share", Source::Output(1), "/axes/0/within/0", 1.0),
            column("words", Source::Output(0), "/error/mean", 1.0),
            column("MB", Source::Run(RunFigure::Run), "/cost/peak_memory_bytes", 1e-6),
            column("speed", Source::Run(RunFigure::Speed), "", 1.0),
            column("ms", Source::Run(RunFigure::CpuMs), "", 1.0),
        ];
        let of = |run: &str| figures(&columns, &said, run).into_values().collect::<Vec<_>>();
        // In order of their titles: MB, cm, ms, share, speed, words.
        assert_eq!(of(run), [Some(5.0), Some(25.0), Some(20.0), Some(0.5), Some(30.0), None]);
        assert_eq!(of(""), [None, Some(25.0), None, Some(0.5), None, None]);
    }

    #[test]
    fn what_is_not_there_is_named() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("a.log"), "").unwrap();
        let work = tempfile::tempdir().unwrap();
        let mut shell =
            Shell { data: Some(folder.path().to_owned()), work, path: OsString::new(), prepared: BTreeSet::new() };
        assert_eq!(shell.missing(&["lrfslam map $D/a.log"]), None);
        let told = |shell: &Shell, command: &str| shell.missing(&["true", command]).unwrap();
        assert_eq!(told(&shell, "lrfslam map $D/b.log"), "b.log is not there (--data)");
        assert_eq!(told(&shell, "lrf-sim log --out $W/x"), "lrf-sim is not there");
        assert_eq!(told(&shell, "lrfslam map examples/none.log.gz"), "examples/none.log.gz is not there");
        shell.data = None;
        assert_eq!(told(&shell, "lrfslam map $D/a.log"), "a.log is not there (--data)");
    }

    #[test]
    fn a_command_that_fails_says_why_and_one_without_a_toolchain_is_skipped() {
        let path = std::env::var_os("PATH").unwrap();
        let shell = Shell { data: None, work: tempfile::tempdir().unwrap(), path, prepared: BTreeSet::new() };
        assert_eq!(shell.run("echo $S in $W/x; test -d $W", 7).ok().unwrap().stdout, "7 in $W/x\n");
        let Err(Fault::Failed(why)) = shell.run("echo no; echo first >&2; echo last >&2; exit 1", 1) else { panic!() };
        assert!(why.ends_with("exit 1`: last"), "{why}");
        assert!(matches!(shell.run("exit 77", 1), Err(Fault::Missing(_))));
    }

    #[test]
    fn time_of_children_is_counted() {
        if !Path::new("/proc/self/stat").exists() {
            return;
        }
        let path = std::env::var_os("PATH").unwrap();
        let shell = Shell { data: None, work: tempfile::tempdir().unwrap(), path, prepared: BTreeSet::new() };
        let said = shell.run("i=0; while [ $i -lt 300000 ]; do i=$((i+1)); done", 1).ok().unwrap();
        assert!(said.cpu_s > 0.02 && said.cpu_s < 60.0, "{}", said.cpu_s);
    }
}
