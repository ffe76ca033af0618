//! What is recorded, and which topic of a bag is read.

use std::path::{Path, PathBuf};

use anyhow::ensure;
use clap::Args;

use super::Failure;
use super::shared::RECORD;
use crate::config::RunConfig;
use lrfslam_host::runs::bag::RunBag;
use lrfslam_host::scans::log::LogOptions;

/// What a run does, as a file to look at.
#[derive(Debug, Args)]
pub(super) struct RecordArgs {
    #[arg(long, value_name = "FILE", help = RECORD)]
    record: Option<PathBuf>,
}

impl RecordArgs {
    /// * `input` — what is read, which is not to be written
    pub(super) fn bag(&self, input: Option<&Path>) -> Result<Option<RunBag>, Failure> {
        let bag = || {
            let Some(path) = &self.record else { return Ok(None) };
            let is_input = input.is_some_and(|input| {
                input.canonicalize().is_ok_and(|input| path.canonicalize().is_ok_and(|path| path == input))
            });
            ensure!(!is_input, "{}: is what is read: record to another file", path.display());
            RunBag::at(path).map(Some)
        };
        bag().map_err(Failure::Start)
    }
}

/// Which scans of a bag.
#[derive(Debug, Args)]
pub(super) struct TopicArgs {
    /// Of a bag: the topic with the scans, such as /scan [default: the only one that has any].
    #[arg(long, value_name = "TOPIC", value_parser = for_ever)]
    topic: Option<&'static str>,
}

impl TopicArgs {
    /// How a log is read.
    pub(super) fn log_options(&self, config: &RunConfig) -> LogOptions {
        LogOptions { topic: self.topic, ..config.log_options() }
    }
}

/// There is one for as long as the program runs.
fn for_ever(topic: &str) -> Result<&'static str, std::convert::Infallible> {
    Ok(topic.to_owned().leak())
}
