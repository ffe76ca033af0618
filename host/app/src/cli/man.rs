//! `lrfslam man`: the help of all commands as manual pages.

use std::path::PathBuf;

use anyhow::Context as _;
use clap::{Args, Command};
use clap_mangen::Man;

use super::{Failure, command, print};
use lrfslam_host::output::save_file;

/// Print the manual pages, one after the other: `lrfslam man | man -l -`.
#[derive(Debug, Args)]
pub(super) struct ManArgs {
    /// Folder to write them to instead, a file each: lrfslam.1, lrfslam-map.1 …; made if it is not there.
    #[arg(long, value_name = "MANDIR")]
    out: Option<PathBuf>,
}

pub(super) fn run(args: &ManArgs) -> Result<(), Failure> {
    let mut whole = command().disable_help_subcommand(true);
    whole.build();
    let mut pages = Vec::new();
    add_pages(&whole, &mut pages).map_err(Failure::work)?;
    let Some(folder) = &args.out else { return pages.iter().try_for_each(|(_, page)| print(page)) };
    let made = std::fs::create_dir_all(folder).with_context(|| format!("{}: cannot be made", folder.display()));
    made.map_err(Failure::Start)?;
    for (name, page) in &pages {
        save_file(&folder.join(name), page.as_bytes()).map_err(Failure::Work)?;
    }
    Ok(())
}

/// The page of a command, then those of the commands below it: names of files, and text.
fn add_pages(of: &Command, pages: &mut Vec<(String, String)>) -> std::io::Result<()> {
    let page = Man::new(of.clone());
    let mut text = Vec::new();
    page.render(&mut text)?;
    pages.push((page.get_filename(), String::from_utf8_lossy(&text).into_owned()));
    of.get_subcommands().filter(|below| !below.is_hide_set()).try_for_each(|below| add_pages(below, pages))
}
