//! What was measured, by whom, and from what: `measured.json`.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::Context as _;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use sha2::{Digest as _, Sha256};

use super::plan::{Column, Group, Plan, Row};
use lrfslam_host::program::Program;

/// What one seed gave.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Outcome {
    /// By title of the column; none where the command did not tell.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub figures: BTreeMap<String, Option<f64>>,
    /// The last command's own words, where these are the result.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub text: String,
}

/// What measured, and what was measured: figures of another origin are not the same figures.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Origin {
    /// Of the program.
    pub version: String,
    /// It was built from; empty if nobody knows.
    pub commit: String,
    /// Digest of the default configuration.
    pub config: String,
    /// Digest of the row's commands and metric.
    pub row: String,
    /// Processor and cores.
    pub machine: String,
    /// Day.
    pub date: String,
}

impl Origin {
    /// This program, on this machine, today; no row yet.
    ///
    /// * `config` — its default configuration, as text
    pub fn here(config: &str) -> Self {
        let Program { version, commit, .. } = Program::THIS;
        let today = humantime::format_rfc3339_seconds(std::time::SystemTime::now()).to_string();
        Self {
            version: version.to_owned(),
            commit: commit.unwrap_or_default().to_owned(),
            config: digest(config),
            row: String::new(),
            machine: machine(),
            date: today.chars().take(10).collect(),
        }
    }

    /// The same, for `row`.
    pub fn of_row(&self, plan: &Plan, group: &Group, row: &Row) -> Self {
        Self { row: digest(&format!("{:?} {:?}", plan.commands(row), plan.columns(group))), ..self.clone() }
    }

    /// Whether what `other` measured can stand for what this one would: of the same row and defaults, and unless `keeps_older` of the same build.
    fn stands_for(&self, other: &Self, keeps_older: bool) -> bool {
        let is_same_build = (&self.version, &self.commit) == (&other.version, &other.commit);
        (&self.config, &self.row) == (&other.config, &other.row) && (keeps_older || is_same_build)
    }
}

fn digest(text: &str) -> String {
    Sha256::digest(text).iter().take(6).map(|byte| format!("{byte:02x}")).collect()
}

/// Such as `Intel(R) Xeon(R) Processor, 2 cores`.
fn machine() -> String {
    let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = info.lines().find_map(|line| line.strip_prefix("model name")?.split_once(':'));
    let name = name.map_or(std::env::consts::ARCH, |(_, name)| name.trim());
    format!("{name}, {cores} {}", if cores == 1 { "core" } else { "cores" })
}

/// A row's figures.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Measured {
    /// Where they are from.
    pub origin: Origin,
    /// By seed.
    pub seeds: BTreeMap<u64, Outcome>,
}

impl Measured {
    /// Values of a column, seed by seed.
    pub fn values(&self, column: &Column) -> Vec<f64> {
        self.seeds.values().filter_map(|outcome| outcome.figures.get(&column.title).copied().flatten()).collect()
    }
}

/// What is known of all rows, by id.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
pub struct Results {
    rows: BTreeMap<String, Measured>,
}

impl Results {
    /// What `file` holds; nothing if it is not there.
    ///
    /// # Errors
    /// If it cannot be read, or is of another form.
    pub fn read(file: &Path) -> anyhow::Result<Self> {
        let text = match std::fs::read_to_string(file) {
            Ok(text) => text,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Self::default()),
            Err(error) => return Err(error).with_context(|| format!("{}: cannot be read", file.display())),
        };
        serde_json::from_str(&text).with_context(|| format!("{}: is not what lrfslam prove writes", file.display()))
    }

    /// A row's figures, if there are any.
    pub fn row(&self, id: &str) -> Option<&Measured> {
        self.rows.get(id).filter(|row| !row.seeds.is_empty())
    }

    /// Whether there is something for this seed.
    pub fn has(&self, id: &str, seed: u64) -> bool {
        self.rows.get(id).is_some_and(|row| row.seeds.contains_key(&seed))
    }

    /// Forgets what cannot stand beside figures of `origin`.
    pub fn make_room(&mut self, id: &str, origin: &Origin, keeps_older: bool) {
        if !self.rows.get(id).is_some_and(|row| row.origin.stands_for(origin, keeps_older)) {
            self.rows.insert(id.to_owned(), Measured { origin: origin.clone(), seeds: BTreeMap::new() });
        }
    }

    /// Remembers what one seed gave.
    pub fn add(&mut self, id: &str, seed: u64, outcome: Outcome) {
        self.rows.entry(id.to_owned()).and_modify(|row| {
            row.seeds.insert(seed, outcome);
        });
    }

    /// With what was measured beside it: commands, and what others reached.
    ///
    /// # Errors
    /// Never, but for a number that JSON does not have.
    pub fn to_json(&self, plan: &Plan) -> anyhow::Result<String> {
        let row = |(group, row): (&Group, &Row)| -> Option<(String, Value)> {
            let Measured { origin, seeds } = self.row(&row.id)?;
            let of = json!({ "what": row.what, "table": group.title, "commands": plan.commands(row), "origin": origin, "seeds": seeds, "others": group.other });
            Some((row.id.clone(), of))
        };
        let rows: serde_json::Map<String, Value> = plan.rows().filter_map(row).collect();
        Ok(serde_json::to_string_pretty(&json!({ "program": "lrfslam prove", "rows": rows }))? + "\n")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn origin(commit: &str, row: &str) -> Origin {
        Origin { commit: commit.into(), row: row.into(), ..Origin::here("") }
    }

    #[test]
    fn figures_stay_while_program_configuration_and_row_are_the_same() {
        let (mut results, first) = (Results::default(), origin("a", "r"));
        results.make_room("x", &first, false);
        results.add("x", 1, Outcome::default());
        results.make_room("x", &Origin { date: "later".into(), ..first.clone() }, false);
        assert!(results.has("x", 1) && !results.has("x", 2));
        results.make_room("x", &origin("b", "r"), true);
        assert!(results.has("x", 1), "an older one, kept");
        assert_eq!(results.row("x").unwrap().origin.commit, "a", "and said to be one");
        results.make_room("x", &origin("b", "r"), false);
        assert!(!results.has("x", 1), "another build");
        results.add("x", 1, Outcome::default());
        results.make_room("x", &origin("b", "other commands"), true);
        assert!(!results.has("x", 1), "another row");
    }

    #[test]
    fn what_is_written_is_read_again() {
        let plan = Plan::built_in().unwrap();
        let (group, row) = plan.rows().next().unwrap();
        let mut results = Results::default();
        results.make_room(&row.id, &Origin::here("").of_row(&plan, group, row), false);
        let figures = BTreeMap::from([("RMSE, m".to_owned(), Some(0.123457)), ("none".to_owned(), None)]);
        results.add(&row.id, 3, Outcome { figures, text: "words".into() });
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("measured.json");
        assert_eq!(Results::read(&file).unwrap(), Results::default(), "nothing yet");
        std::fs::write(&file, results.to_json(&plan).unwrap()).unwrap();
        assert_eq!(Results::read(&file).unwrap(), results);
        std::fs::write(&file, "{}").unwrap();
        assert!(Results::read(&file).unwrap_err().to_string().contains("is not what lrfslam prove writes"));
    }
}
