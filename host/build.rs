//! Tells the program which commit it is built from, where that is known: a package from a registry has none.

use std::path::Path;
use std::process::Command;

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    let version = env!("CARGO_PKG_VERSION");
    // Of this repository, not of one that a copy of the package happens to lie in.
    let commit = Path::new("../.git").exists().then(|| git(&["rev-parse", "--short", "HEAD"])).flatten();
    let Some(commit) = commit.filter(|commit| !commit.is_empty()) else {
        println!("cargo::rustc-env=LRFSLAM_VERSION={version}");
        return;
    };
    println!("cargo::rustc-env=LRFSLAM_VERSION={version} ({commit})");
    println!("cargo::rustc-env=LRFSLAM_COMMIT={commit}");
    // HEAD names a branch, the branch a commit; where the branch is packed, the log of HEAD grows with every commit.
    let branch = git(&["rev-parse", "--symbolic-full-name", "HEAD"]);
    for name in ["HEAD", "logs/HEAD"].into_iter().chain(branch.as_deref()) {
        // A worktree has some of these itself and shares others. One that is not there would count as changed always.
        let file = git(&["rev-parse", "--git-path", name]).filter(|file| Path::new(file).exists());
        file.into_iter().for_each(|file| println!("cargo::rerun-if-changed={file}"));
    }
}

/// What git says, in one line; `None` if there is none, or it does not know.
fn git(arguments: &[&str]) -> Option<String> {
    let said = Command::new("git").args(arguments).output().ok().filter(|said| said.status.success())?;
    Some(String::from_utf8(said.stdout).ok()?.trim().to_owned())
}
