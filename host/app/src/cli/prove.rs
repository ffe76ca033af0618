//! `lrfslam prove`: every published figure, repeated.

use std::fmt::Write as _;
use std::path::PathBuf;

use anyhow::Context as _;
use clap::Args;
use serde::Serialize;

use super::laser::say;
use super::shared::{JsonArgs, SEEDS};
use super::{Failure, print};
use crate::config::RunConfig;
use lrfslam_lab::prove::{Choice, Plan, Proof};

/// Repeat every published figure and write them down: measured.md and measured.json.
///
/// Run it in a clone of the repository; of its programs, `lrf-sim` is to be beside this one. Rows whose log is not there are skipped, and said to be. All of it takes hours. What was measured is kept: stopped, the same command goes on, as long as it is the
/// same build.
#[derive(Debug, Args)]
pub(super) struct ProveArgs {
    /// Folder of the real data [default: that named by LRFSLAM_DATA].
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    /// Folder of measured.md and measured.json.
    #[arg(long, value_name = "FOLDER", default_value = "docs")]
    out: PathBuf,
    /// Only these rows; --list names them.
    #[arg(long, value_name = "ID,…", value_delimiter = ',')]
    only: Vec<String>,
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..1000), help = SEEDS)]
    seeds: Option<u64>,
    /// Only rows of seconds, with two seeds.
    #[arg(long)]
    quick: bool,
    /// Leave rows as they are that an earlier build measured by the same commands and default settings.
    #[arg(long)]
    keep_older: bool,
    /// Name the rows, and measure nothing.
    #[arg(long)]
    list: bool,
    #[command(flatten)]
    json: JsonArgs,
}

pub(super) fn run(args: &ProveArgs) -> Result<(), Failure> {
    let plan = Plan::built_in().map_err(Failure::start)?;
    if args.list {
        let rows: Vec<Listed<'_>> =
            plan.rows().map(|(group, row)| Listed::new(&group.title, &row.id, &row.what)).collect();
        return print(&args.json.choose(&rows, || list(&plan))?);
    }
    if let Some(id) = args.only.iter().find(|id| plan.rows().all(|(_, row)| row.id != **id)) {
        return Err(Failure::start(anyhow::anyhow!("--only {id}: there is no such row; --list names them")));
    }
    let choice =
        Choice { only: args.only.clone(), seeds: args.seeds, is_quick: args.quick, keeps_older: args.keep_older };
    let named = std::env::var_os("LRFSLAM_DATA").filter(|name| !name.is_empty());
    let data = args.data.clone().or(named.map(PathBuf::from));
    let config = RunConfig::default().to_commented_toml();
    let mut proof = Proof::new(&plan, data, &args.out, &config).map_err(Failure::Start)?;
    let failed = proof.run(&choice, &say).map_err(Failure::Work)?;
    if !failed.is_empty() {
        return Err(Failure::Work(anyhow::anyhow!(
            "{} failed; {} says why",
            failed.join(", "),
            args.out.join("measured.md").display()
        )));
    }
    let measured = args.out.join("measured.json");
    let figures = std::fs::read_to_string(&measured).map_err(anyhow::Error::new);
    let figures = figures.and_then(|text| serde_json::from_str::<serde_json::Value>(&text).map_err(anyhow::Error::new));
    let figures = figures.with_context(|| measured.display().to_string()).map_err(Failure::Work)?;
    print(&args.json.choose(&figures, || format!("figures in {}\n", args.out.join("measured.md").display()))?)
}

/// A row, as JSON.
#[derive(Debug, Serialize)]
struct Listed<'a> {
    group: &'a str,
    id: &'a str,
    what: &'a str,
}

impl<'a> Listed<'a> {
    fn new(group: &'a str, id: &'a str, what: &'a str) -> Self {
        Self { group, id, what }
    }
}

fn list(plan: &Plan) -> String {
    let mut text = String::new();
    for (group, row) in plan.rows() {
        let _ = writeln!(text, "{:<24} {}: {}", row.id, group.title, row.what);
    }
    text
}
