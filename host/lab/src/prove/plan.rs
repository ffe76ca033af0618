//! The rows: what is measured, by which commands, and what others reached.

use std::collections::{BTreeMap, BTreeSet};

use serde::{Deserialize, Serialize};

/// All rows, in the order of the page.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Plan {
    /// What is told of a row, by name.
    pub metric: BTreeMap<String, Metric>,
    /// Logs and maps that rows share, by name.
    pub prepare: BTreeMap<String, Preparation>,
    /// Tables of the page.
    pub group: Vec<Group>,
}

/// What is told of each row of a table.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Metric {
    /// What it measures, and how finely: its own noise.
    pub about: String,
    /// Figures; none where the last command's own words are shown.
    #[serde(default)]
    pub column: Vec<Column>,
    /// These words are Markdown.
    #[serde(default)]
    pub markdown: bool,
}

/// A figure.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Column {
    /// With its unit.
    pub title: String,
    /// Where it is found.
    pub from: Source,
    /// JSON pointer into that.
    #[serde(default)]
    pub at: String,
    /// What it is multiplied by.
    #[serde(default = "one")]
    pub scale: f64,
    /// Decimals that are shown.
    pub digits: usize,
    /// Not the figure is shown, but how many seeds have it no larger than this.
    pub at_most: Option<f64>,
}

fn one() -> f64 {
    1.0
}

/// Where a figure is found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Source {
    /// What the command of this number printed as JSON, counted from 0.
    Output(usize),
    /// Elsewhere.
    Run(RunFigure),
}

/// A figure of a run of `lrfslam map`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RunFigure {
    /// In its `run.json`.
    Run,
    /// Time driven over CPU time of the first command.
    Speed,
    /// CPU time of the first command for each scan, ms.
    CpuMs,
}

/// Commands that make what rows share; done once, with the seed 1.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Preparation {
    /// One after the other.
    pub commands: Vec<String>,
}

/// A table of rows with the same metric.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Group {
    /// Heading.
    pub title: String,
    /// What one must know to read it.
    #[serde(default)]
    pub words: String,
    /// Name of the metric.
    pub metric: String,
    /// What others reached.
    #[serde(default)]
    pub other: Vec<Other>,
    /// Its rows.
    pub row: Vec<Row>,
}

/// What another program reached, or an earlier publication says.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Other {
    /// Who, and with what.
    pub who: String,
    /// A figure for each column that was published, empty where none was; the last ones may be left out.
    pub figures: Vec<String>,
    /// Where it is said.
    pub source: String,
}

/// One measurement.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Row {
    /// Name, for `--only`.
    pub id: String,
    /// What is measured.
    pub what: String,
    /// Seeds 1 to this.
    #[serde(default = "five")]
    pub seeds: u64,
    /// Takes seconds: part of `--quick`.
    #[serde(default)]
    pub quick: bool,
    /// What has to be there.
    #[serde(default)]
    pub prepare: Vec<String>,
    /// One after the other, for every seed.
    pub commands: Vec<String>,
    /// The run.json of the mapping, in `$W`.
    #[serde(default)]
    pub run: String,
}

fn five() -> u64 {
    5
}

impl Row {
    /// Whether another seed would give other figures.
    pub fn takes_seed(&self) -> bool {
        self.commands.iter().any(|command| command.contains("$S"))
    }
}

/// Rows that cannot be meant.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PlanError {
    /// Not TOML, or a key that is none.
    #[error("rows.toml: {0}")]
    Form(#[from] toml::de::Error),
    /// Names that nothing has, or two have.
    #[error("rows.toml: {0}")]
    Name(String),
}

impl Plan {
    /// That of this program.
    ///
    /// # Errors
    /// Never, as the tests show.
    pub fn built_in() -> Result<Self, PlanError> {
        Self::parse(include_str!("rows.toml"))
    }

    /// Reads rows.
    ///
    /// # Errors
    /// If the text is of another form, or names do not fit.
    pub fn parse(text: &str) -> Result<Self, PlanError> {
        let plan: Self = toml::from_str(text)?;
        let mut ids = BTreeSet::new();
        for (group, row) in plan.rows() {
            if !ids.insert(&row.id) {
                return Err(PlanError::Name(format!("two rows are called {}", row.id)));
            }
            if !plan.metric.contains_key(&group.metric) {
                return Err(PlanError::Name(format!("there is no metric {}", group.metric)));
            }
            if let Some(name) = row.prepare.iter().find(|name| !plan.prepare.contains_key(*name)) {
                return Err(PlanError::Name(format!("{}: there is no preparation {name}", row.id)));
            }
        }
        for group in &plan.group {
            let columns = plan.columns(group).len();
            if let Some(other) = group.other.iter().find(|other| other.figures.len() > columns) {
                return Err(PlanError::Name(format!("{}: more figures than columns", other.who)));
            }
        }
        Ok(plan)
    }

    /// Every row with its table.
    pub fn rows(&self) -> impl Iterator<Item = (&Group, &Row)> {
        self.group.iter().flat_map(|group| group.row.iter().map(move |row| (group, row)))
    }

    /// The figures of a table.
    pub fn columns(&self, group: &Group) -> &[Column] {
        self.metric.get(&group.metric).map_or(&[], |metric| &metric.column)
    }

    /// Everything that is run for `row`, in order.
    pub fn commands<'a>(&'a self, row: &'a Row) -> Vec<&'a str> {
        let shared = row.prepare.iter().filter_map(|name| self.prepare.get(name)).flat_map(|shared| &shared.commands);
        shared.chain(&row.commands).map(String::as_str).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SMALL: &str = r#"
        [metric.path]
        about = "RMSE."
        column = [{ title = "RMSE, m", from = 1, at = "/absolute_m/rmse", digits = 3 }, { title = "speed", from = "speed", digits = 0 }]
        [prepare.log]
        commands = ["make $W/log"]
        [[group]]
        title = "A"
        metric = "path"
        other = [{ who = "them", figures = ["1.0"], source = "a paper" }]
        [[group.row]]
        id = "a"
        what = "this"
        prepare = ["log"]
        commands = ["map $W/log --seed $S", "eval"]
    "#;

    #[test]
    fn rows_come_with_their_table_and_what_they_need() {
        let plan = Plan::parse(SMALL).unwrap();
        let (group, row) = plan.rows().next().unwrap();
        assert_eq!((group.title.as_str(), row.id.as_str(), row.seeds), ("A", "a", 5));
        assert_eq!(plan.commands(row), ["make $W/log", "map $W/log --seed $S", "eval"]);
        let [rmse, speed] = plan.columns(group) else { panic!("{group:?}") };
        assert_eq!((rmse.from, rmse.scale), (Source::Output(1), 1.0));
        assert_eq!(speed.from, Source::Run(RunFigure::Speed));
    }

    #[test]
    fn names_that_do_not_fit_are_told() {
        let told = |from: &str, to: &str| Plan::parse(&SMALL.replace(from, to)).unwrap_err().to_string();
        assert_eq!(told("metric = \"path\"", "metric = \"way\""), "rows.toml: there is no metric way");
        assert_eq!(told("prepare = [\"log\"]", "prepare = [\"map\"]"), "rows.toml: a: there is no preparation map");
        assert_eq!(told("[\"1.0\"]", "[\"1\", \"2\", \"3\"]"), "rows.toml: them: more figures than columns");
        assert!(told("what =", "why =").contains("why"));
        let twice = SMALL.to_owned() + "[[group.row]]\nid = \"a\"\nwhat = \"\"\ncommands = []\n";
        assert_eq!(Plan::parse(&twice).unwrap_err().to_string(), "rows.toml: two rows are called a");
    }

    #[test]
    fn the_rows_of_this_program_are_whole() {
        let plan = Plan::built_in().unwrap();
        assert!(plan.rows().count() > 50);
        for (group, row) in plan.rows() {
            assert!(!row.commands.is_empty() && row.seeds > 0, "{}", row.id);
            let needs_run = plan.columns(group).iter().any(|column| matches!(column.from, Source::Run(_)));
            assert!(!needs_run || row.run.ends_with("run.json"), "{}: no run.json", row.id);
            for column in plan.columns(group) {
                assert!(!matches!(column.from, Source::Output(n) if n >= row.commands.len()), "{}: {column:?}", row.id);
            }
            // A row without $S would give the same figure for every seed.
            assert!(row.seeds == 1 || row.takes_seed(), "{}: which seed?", row.id);
        }
        let quick: Vec<&str> = plan.rows().filter(|(_, row)| row.quick).map(|(_, row)| row.id.as_str()).collect();
        assert_eq!(quick, ["floor", "floor-1", "floor-0"]);
    }
}
