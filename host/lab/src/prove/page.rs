//! The page: a table for each group of rows, what others reached under it, and the commands.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use super::plan::{Column, Group, Metric, Other, Plan, Row};
use super::results::{Measured, Origin, Results};

/// The page as Markdown. `notes` say why rows have no figures, by id; `origin` is what writes it.
pub fn page(plan: &Plan, results: &Results, notes: &BTreeMap<String, String>, origin: &Origin) -> String {
    let page = Page { plan, results, notes };
    let mut text = page.head(origin);
    plan.group.iter().for_each(|group| page.push_group(&mut text, group));
    text
}

struct Page<'a> {
    plan: &'a Plan,
    results: &'a Results,
    notes: &'a BTreeMap<String, String>,
}

impl Page<'_> {
    fn head(&self, origin: &Origin) -> String {
        let rows = self.plan.rows().count();
        let done = self.plan.rows().filter(|(_, row)| self.results.row(&row.id).is_some()).count();
        let mut text = format!(
            "# What was measured\n\n\
             `lrfslam prove` wrote this page, and `measured.json` beside it with the figures of every seed. {done} of {rows} rows are measured.\n\n\
             Each row is the commands under its table. `$D` is the folder of the real data, `$W` a working folder, `$S` the seed; they are run in a clone of \
             the repository. A cell has the mean over the seeds and, in brackets, the least and the largest. Laser only and default settings where \
             the commands say nothing else. Times are of the machine named, with whatever else it did; they alone differ from run to run.\n\n\
             | measured by | on | day | rows |\n| --- | --- | --- | --- |\n"
        );
        let mut origins: BTreeMap<(String, &str, &str), usize> = BTreeMap::new();
        for measured in self.plan.rows().filter_map(|(_, row)| self.results.row(&row.id)) {
            let by = &measured.origin;
            *origins.entry((build(by), &by.machine, &by.date)).or_default() += 1;
        }
        for ((build, machine, date), rows) in &origins {
            let _ = writeln!(text, "| {build} | {machine} | {date} | {rows} |");
        }
        if origins.is_empty() {
            let _ = writeln!(text, "| {} | {} | {} | 0 |", build(origin), origin.machine, origin.date);
        }
        text
    }

    fn push_group(&self, text: &mut String, group: &Group) {
        let metric = &self.plan.metric[&group.metric];
        let _ = write!(text, "\n## {}\n\n", group.title);
        for words in [&group.words, &metric.about].into_iter().filter(|words| !words.is_empty()) {
            let _ = write!(text, "{}\n\n", words.trim());
        }
        if metric.column.is_empty() {
            group.row.iter().for_each(|row| self.push_words(text, metric, row));
            return;
        }
        let titles: String = metric.column.iter().map(|column| format!(" {} |", column.title)).collect();
        let _ = writeln!(
            text,
            "| row | what | seeds |{titles}\n| --- | --- | --- |{}",
            " --- |".repeat(metric.column.len())
        );
        group.row.iter().for_each(|row| self.push_row(text, &metric.column, row));
        group.other.iter().for_each(|other| push_other(text, &metric.column, other));
        text.push('\n');
        self.push_commands(text, group);
    }

    fn push_row(&self, text: &mut String, columns: &[Column], row: &Row) {
        let _ = write!(text, "| `{}` | {} |", row.id, row.what);
        let Some(measured) = self.results.row(&row.id) else {
            let _ = writeln!(text, " | *{}* |{}", self.note(row), " |".repeat(columns.len().saturating_sub(1)));
            return;
        };
        let note = self.notes.get(&row.id).map_or_else(String::new, |note| format!(" ({note})"));
        let _ = write!(text, " {}{note} |", seeds(measured));
        columns.iter().for_each(|column| {
            let _ = write!(text, " {} |", cell(column, &measured.values(column)));
        });
        text.push('\n');
    }

    /// A row whose result is what a command says.
    fn push_words(&self, text: &mut String, metric: &Metric, row: &Row) {
        let _ = write!(text, "### `{}`: {}\n\n```sh\n", row.id, row.what);
        self.plan.commands(row).iter().for_each(|command| {
            let _ = writeln!(text, "{command}");
        });
        text.push_str("```\n\n");
        let Some(measured) = self.results.row(&row.id) else {
            let _ = write!(text, "*{}*\n\n", self.note(row));
            return;
        };
        for (seed, outcome) in &measured.seeds {
            if measured.seeds.len() > 1 {
                let _ = write!(text, "Seed {seed}:\n\n");
            }
            let (said, fence) = (outcome.text.trim_end(), if metric.markdown { "" } else { "```" });
            let _ = write!(text, "{fence}\n{said}\n{fence}\n\n");
        }
        while text.ends_with("\n\n") {
            text.pop();
        }
    }

    fn note(&self, row: &Row) -> String {
        self.notes.get(&row.id).map_or_else(|| "not measured yet".to_owned(), |note| format!("not measured: {note}"))
    }

    /// What the rows share first, then row by row.
    fn push_commands(&self, text: &mut String, group: &Group) {
        let mut shared: Vec<&str> = Vec::new();
        for name in group.row.iter().flat_map(|row| &row.prepare) {
            let commands = self.plan.prepare[name].commands.iter().map(String::as_str);
            let new: Vec<&str> = commands.filter(|command| !shared.contains(command)).collect();
            shared.extend(new);
        }
        text.push_str("```sh\n");
        for command in shared {
            let _ = writeln!(text, "{command}");
        }
        for row in &group.row {
            let _ = writeln!(text, "# {}\n{}", row.id, row.commands.join("\n"));
        }
        text.push_str("```\n");
    }
}

/// Such as `lrfslam 0.1.0 (16e103e)`.
fn build(origin: &Origin) -> String {
    let commit = if origin.commit.is_empty() { String::new() } else { format!(" ({})", origin.commit) };
    format!("lrfslam {}{commit}", origin.version)
}

fn push_other(text: &mut String, columns: &[Column], Other { who, figures, source }: &Other) {
    let _ = write!(text, "| | *{who}: {source}* | |");
    for at in 0..columns.len() {
        let _ = write!(text, " {} |", figures.get(at).map_or("", String::as_str));
    }
    text.push('\n');
}

/// `1`, `1 to 5`, or those that there are.
fn seeds(measured: &Measured) -> String {
    let all: Vec<u64> = measured.seeds.keys().copied().collect();
    match (all.first(), all.last()) {
        (Some(first), Some(last)) if first == last => first.to_string(),
        (Some(first), Some(last)) if last - first == all.len() as u64 - 1 => format!("{first} to {last}"),
        _ => all.iter().map(u64::to_string).collect::<Vec<_>>().join(", "),
    }
}

/// Mean, least and largest of a column, or of how many seeds it is true.
fn cell(column: &Column, values: &[f64]) -> String {
    if values.is_empty() {
        return String::new();
    }
    if let Some(most) = column.at_most {
        return format!("{} of {}", values.iter().filter(|&&value| value <= most).count(), values.len());
    }
    let shown = |value: f64| format!("{value:.*}", column.digits);
    let mean = shown(values.iter().sum::<f64>() / values.len() as f64);
    let least = shown(values.iter().copied().fold(f64::INFINITY, f64::min));
    let largest = shown(values.iter().copied().fold(f64::NEG_INFINITY, f64::max));
    if least == largest { mean } else { format!("{mean} ({least} to {largest})") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prove::{Outcome, Plan};

    const ROWS: &str = r#"
        [metric.path]
        about = "Its own noise is 1 mm."
        column = [
            { title = "RMSE, m", from = 1, at = "/rmse", digits = 3 },
            { title = "closed", from = 1, at = "/revisit", digits = 0, at_most = 0.5 },
        ]
        [metric.words]
        about = ""
        [prepare.log]
        commands = ["sim --out $W/log"]
        [[group]]
        title = "Floor"
        metric = "path"
        other = [{ who = "Karto", figures = ["0.096"], source = "run here" }]
        row = [
            { id = "a", what = "all of it", prepare = ["log"], commands = ["map $W/log", "eval --seed $S"] },
            { id = "b", what = "no log", prepare = ["log"], commands = ["map $D/b.log --seed $S"] },
            { id = "c", what = "later", commands = ["map --seed $S"] },
        ]
        [[group]]
        title = "Speed"
        metric = "words"
        row = [{ id = "d", what = "a benchmark", seeds = 1, commands = ["bench"] }]
    "#;

    fn origin() -> Origin {
        let [commit, config, row] = ["abc", "c", "r"].map(str::to_owned);
        Origin {
            version: "1.0".into(),
            commit,
            config,
            row,
            machine: "a computer, 2 cores".into(),
            date: "2026-11-22".into(),
        }
    }

    fn results() -> Results {
        let mut results = Results::default();
        let outcome = |rmse: f64, revisit: f64| {
            let figures =
                [("RMSE, m", rmse), ("closed", revisit)].map(|(title, value)| (title.to_owned(), Some(value)));
            Outcome { figures: figures.into(), text: String::new() }
        };
        results.make_room("a", &origin(), false);
        for (seed, rmse, revisit) in [(1, 0.04, 0.2), (2, 0.046, 0.6), (3, 0.043, 0.5)] {
            results.add("a", seed, outcome(rmse, revisit));
        }
        results.make_room("d", &origin(), false);
        results.add("d", 1, Outcome { text: "2.4 ms\n".into(), ..Outcome::default() });
        results
    }

    #[test]
    fn page_has_figures_others_notes_and_commands() {
        let plan = Plan::parse(ROWS).unwrap();
        let notes = BTreeMap::from([("b".to_owned(), "b.log is not there (--data)".to_owned())]);
        let text = page(&plan, &results(), &notes, &origin());
        let (head, tables) = text.split_once("\n## ").unwrap();
        assert!(head.contains("2 of 4 rows are measured."), "{head}");
        assert!(head.ends_with("| lrfslam 1.0 (abc) | a computer, 2 cores | 2026-11-22 | 2 |\n"), "{head}");
        assert_eq!(
            tables,
            "Floor\n\nIts own noise is 1 mm.\n\n\
             | row | what | seeds | RMSE, m | closed |\n| --- | --- | --- | --- | --- |\n\
             | `a` | all of it | 1 to 3 | 0.043 (0.040 to 0.046) | 2 of 3 |\n\
             | `b` | no log | | *not measured: b.log is not there (--data)* | |\n\
             | `c` | later | | *not measured yet* | |\n\
             | | *Karto: run here* | | 0.096 |  |\n\n\
             ```sh\nsim --out $W/log\n# a\nmap $W/log\neval --seed $S\n# b\nmap $D/b.log --seed $S\n# c\nmap --seed $S\n```\n\n\
             ## Speed\n\n### `d`: a benchmark\n\n```sh\nbench\n```\n\n```\n2.4 ms\n```\n"
        );
    }

    #[test]
    fn cells_say_mean_and_span_and_seeds_what_there_is() {
        let column = |at_most| Column { at_most, ..Plan::parse(ROWS).unwrap().metric["path"].column[0].clone() };
        assert_eq!(cell(&column(None), &[0.04]), "0.040");
        assert_eq!(cell(&column(None), &[0.0401, 0.0399]), "0.040");
        assert_eq!(cell(&column(None), &[-0.5, 0.1]), "-0.200 (-0.500 to 0.100)");
        assert_eq!((cell(&column(Some(0.1)), &[0.1, 0.2]), cell(&column(None), &[])), ("1 of 2".into(), String::new()));
        let mut measured = results().row("a").unwrap().clone();
        measured.seeds.remove(&2);
        assert_eq!(seeds(&measured), "1, 3");
        measured.seeds.remove(&1);
        assert_eq!(seeds(&measured), "3");
    }
}
