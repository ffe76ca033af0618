//! `lrfslam completions`: what a shell needs to complete our commands and flags.

use clap::Args;
use clap_complete::{Shell, generate};

use super::{Failure, command, print};

/// Print a script that lets the shell complete commands and flags.
///
/// For bash: `lrfslam completions bash > ~/.local/share/bash-completion/completions/lrfslam`.
#[derive(Debug, Args)]
pub(super) struct CompletionsArgs {
    /// The shell.
    shell: Shell,
}

pub(super) fn run(args: &CompletionsArgs) -> Result<(), Failure> {
    let mut script = Vec::new();
    generate(args.shell, &mut command(), "lrfslam", &mut script);
    print(&String::from_utf8_lossy(&script))
}
