//! `lrfslam key`: a key for a robot's port; and the key that a command is given.

use std::path::PathBuf;

use anyhow::{Context as _, anyhow};
use clap::Args;
use lrfslam_host::robot::{entropy, new_key_file, read_key_file};
use lrfslam_robot::wire::key::Key;
use lrfslam_robot::wire::lock::Lock;

use super::Failure;

/// The key, if the user has one for all runs.
const KEY: &str = "LRFSLAM_KEY";

/// Make a key for a robot's port: whoever has it commands the robot, and nobody else does.
///
/// The file holds 64 hexadecimal digits, and only you can read it. Copy it to the robot, for `robot-sim --key-file`, and give it to
/// `attach --key-file`.
#[derive(Debug, Args)]
pub(super) struct KeyArgs {
    /// File to make; one that is there already stays as it is.
    file: PathBuf,
}

pub(super) fn run(args: &KeyArgs) -> Result<(), Failure> {
    new_key_file(&args.file)
        .with_context(|| format!("{}: no key was made", args.file.display()))
        .map_err(Failure::Start)
}

/// The key of a robot.
#[derive(Debug, Args)]
pub(super) struct RobotKeyArgs {
    /// Key of the robot, as `lrfslam key` makes it; otherwise the environment's LRFSLAM_KEY, if there is one.
    #[arg(long, value_name = "FILE")]
    key_file: Option<PathBuf>,
}

impl RobotKeyArgs {
    /// The host's end of a link with a key, if there is one.
    ///
    /// # Errors
    /// If there is to be a key, and none can be had.
    pub(super) fn lock(&self) -> Result<Option<Lock>, Failure> {
        let Some(key) = self.key().map_err(Failure::Start)? else { return Ok(None) };
        Ok(Some(Lock::of_host(key, entropy().map_err(Failure::start)?)))
    }

    fn key(&self) -> anyhow::Result<Option<Key>> {
        if let Some(path) = &self.key_file {
            return read_key_file(path).map(Some).with_context(|| path.display().to_string());
        }
        let digits = std::env::var(KEY).ok().filter(|digits| !digits.is_empty());
        let no_key = || anyhow!("{KEY}: this is no key: 64 hexadecimal digits, as `lrfslam key` makes them");
        digits.map(|digits| Key::from_hex(digits.trim()).ok_or_else(no_key)).transpose()
    }
}
