//! Every published figure, repeated: what is promised is what these commands give.
//!
//! `rows.toml` ([`Plan`]) → [`Shell`] (each row's commands, seed after seed) → [`Results`] (`measured.json`, after every seed) → [`page()`] (`measured.md`).
//!
//! A row is commands that anyone can type, of this program and of those beside it: nothing of the library is called from here. What
//! is measured stays when a run is stopped, and is left alone by the next one as long as program, configuration and row are the same.

mod page;
mod plan;
mod results;
mod shell;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::Context as _;

pub use page::page;
pub use plan::{Column, Group, Metric, Other, Plan, PlanError, Preparation, Row, Source};
pub use results::{Measured, Origin, Outcome, Results};
pub use shell::{Fault, Shell};

use lrfslam_host::output::save_file;

/// Seeds of a row with `--quick`.
const QUICK_SEEDS: u64 = 2;

/// What to measure.
#[derive(Debug, Clone, Default)]
pub struct Choice {
    /// Only these rows; all if empty.
    pub only: Vec<String>,
    /// Seeds 1 to this, instead of as many as the row says.
    pub seeds: Option<u64>,
    /// Only rows of seconds, with few seeds.
    pub is_quick: bool,
    /// Rows that another version measured are left as they are.
    pub keeps_older: bool,
}

impl Choice {
    /// How many seeds `row` is to have; none if it is not chosen, one if they would all be the same.
    fn seeds(&self, row: &Row) -> u64 {
        let is_named = self.only.is_empty() || self.only.contains(&row.id);
        if !is_named || (self.is_quick && !row.quick) {
            return 0;
        }
        let seeds = if self.is_quick { row.seeds.min(QUICK_SEEDS) } else { row.seeds };
        if row.takes_seed() { self.seeds.unwrap_or(seeds) } else { 1 }
    }
}

/// A measurement under way: what there is is on disk after every seed.
#[derive(Debug)]
pub struct Proof<'a> {
    plan: &'a Plan,
    shell: Shell,
    origin: Origin,
    folder: &'a Path,
    results: Results,
    /// Why rows have no figures, by id.
    notes: BTreeMap<String, String>,
}

impl<'a> Proof<'a> {
    /// Goes on with the results in `folder`, which is made if it is not there.
    ///
    /// * `config` — the program's default configuration, as text: figures of another one are not the same figures
    ///
    /// # Errors
    /// If the folder cannot be made, or its `measured.json` is none.
    pub fn new(plan: &'a Plan, data: Option<PathBuf>, folder: &'a Path, config: &str) -> anyhow::Result<Self> {
        std::fs::create_dir_all(folder).with_context(|| format!("{}: cannot be made", folder.display()))?;
        let results = Results::read(&folder.join("measured.json"))?;
        let shell = Shell::new(data)?;
        let missing = |row: &Row| Some((row.id.clone(), shell.missing(&plan.commands(row))?));
        let notes = plan.rows().filter_map(|(_, row)| missing(row)).collect();
        Ok(Self { plan, shell, origin: Origin::here(config), folder, results, notes })
    }

    /// Measures what `choice` names and is not there yet; `tell` hears what is done. Returns the rows that failed.
    ///
    /// # Errors
    /// If the results cannot be written.
    pub fn run(&mut self, choice: &Choice, tell: &dyn Fn(&str)) -> anyhow::Result<Vec<String>> {
        let mut failed = Vec::new();
        for (group, row) in self.plan.rows().filter(|(_, row)| choice.seeds(row) > 0) {
            if let Some(note) = self.notes.get(&row.id) {
                tell(&format!("{}: skipped: {note}", row.id));
            } else if !self.measure(group, row, choice, tell)? {
                failed.push(row.id.clone());
            }
        }
        self.save()?;
        Ok(failed)
    }

    /// Whether the row did not fail.
    fn measure(&mut self, group: &Group, row: &Row, choice: &Choice, tell: &dyn Fn(&str)) -> anyhow::Result<bool> {
        let origin = self.origin.of_row(self.plan, group, row);
        self.results.make_room(&row.id, &origin, choice.keeps_older);
        for seed in 1..=choice.seeds(row) {
            if self.results.has(&row.id, seed) {
                continue;
            }
            tell(&format!("{}: seed {seed}", row.id));
            match self.shell.measure(self.plan, group, row, seed) {
                Ok(outcome) => self.results.add(&row.id, seed, outcome),
                Err(Fault::Missing(note)) => {
                    tell(&format!("{}: skipped: {note}", row.id));
                    self.notes.insert(row.id.clone(), note);
                    return Ok(true);
                }
                Err(Fault::Failed(why)) => {
                    tell(&format!("{}: failed: {why}", row.id));
                    self.notes.insert(row.id.clone(), format!("seed {seed} failed: {why}"));
                    return Ok(false);
                }
            }
            self.save()?;
        }
        Ok(true)
    }

    fn save(&self) -> anyhow::Result<()> {
        let text = page(self.plan, &self.results, &self.notes, &self.origin);
        for (name, bytes) in [("measured.json", self.results.to_json(self.plan)?), ("measured.md", text)] {
            save_file(&self.folder.join(name), bytes.as_bytes())?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn choice_says_how_many_seeds_a_row_gets() {
        let plan = Plan::built_in().unwrap();
        let row = |id: &str| plan.rows().find(|(_, row)| row.id == id).unwrap().1.clone();
        let (floor, intel, sweep) = (row("floor-1"), row("intel"), row("lrf-noise-loop"));
        let of = |choice: &Choice| [choice.seeds(&floor), choice.seeds(&intel), choice.seeds(&sweep)];
        assert_eq!(of(&Choice::default()), [5, 5, 1]);
        assert_eq!(of(&Choice { seeds: Some(7), ..Choice::default() }), [7, 7, 1], "a sweep has seeds of its own");
        assert_eq!(of(&Choice { is_quick: true, ..Choice::default() }), [2, 0, 0]);
        assert_eq!(of(&Choice { is_quick: true, seeds: Some(1), ..Choice::default() }), [1, 0, 0]);
        assert_eq!(of(&Choice { only: vec!["intel".to_owned()], ..Choice::default() }), [0, 5, 0]);
    }
}
