//! Where results go: arguments that all commands with a folder share.

use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::Args;

use super::Failure;
use super::laser::say;
use lrfslam_host::output::ResultFolder;
#[cfg(feature = "experiments")]
use lrfslam_host::output::write_file;

/// How often a long run saves what it has.
#[derive(Debug, Clone, Copy, Args)]
pub struct SaveArgs {
    /// A run saves what it has so far at least this far apart, s: what a power cut or a kill leaves.
    #[arg(long = "save-every", value_name = "S", default_value_t = 60)]
    every_s: u32,
}

impl SaveArgs {
    /// From save to save.
    pub fn every(self) -> Duration {
        Duration::from_secs(u64::from(self.every_s))
    }
}

/// Replaces the results by these texts, each with the name of its file.
///
/// # Errors
/// If they cannot be written.
#[cfg(feature = "experiments")]
pub(super) fn save_texts(folder: &mut ResultFolder, files: &[(&str, String)]) -> Result<(), Failure> {
    let write =
        |stage: &Path| Ok(files.iter().try_for_each(|(name, text)| write_file(&stage.join(name), text.as_bytes()))?);
    folder.save(write).map_err(Failure::Work)
}

/// Where results go.
#[derive(Debug, Args)]
pub struct OutArgs {
    /// Folder for the results; made if it is not there [default: a new one here, named after the input and the time].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Replace the results that DIR holds, once there are new ones. Nothing else is replaced.
    #[arg(long, requires = "out")]
    overwrite: bool,
}

impl OutArgs {
    /// The folder, ready to be written to; a new one begins with `stem`.
    ///
    /// # Errors
    /// If it cannot be used, or holds something that is not to be replaced.
    pub fn folder(&self, stem: &str) -> Result<ResultFolder, Failure> {
        let folder = ResultFolder::choose(self.out.as_deref(), stem, self.overwrite).map_err(Failure::Start)?;
        for file in folder.left_behind() {
            say(&format!("{}: left by a run that was stopped before it had saved anything", file.display()));
        }
        Ok(folder)
    }

    /// As the user named it.
    pub(super) fn named(&self) -> Option<&Path> {
        self.out.as_deref()
    }

    /// Whether older results may go.
    pub(super) fn overwrites(&self) -> bool {
        self.overwrite
    }
}
