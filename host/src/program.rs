//! This program: what results say that they were made by.

use serde::Serialize;

/// The program that ran.
#[derive(Debug, Clone, Serialize)]
pub struct Program {
    /// Its name.
    pub name: &'static str,
    /// Its version.
    pub version: &'static str,
    /// The commit it was built from, shortened; none if it was built outside the repository.
    pub commit: Option<&'static str>,
}

impl Program {
    /// This one.
    pub const THIS: Self =
        Self { name: "lrfslam", version: env!("CARGO_PKG_VERSION"), commit: option_env!("LRFSLAM_COMMIT") };

    /// Version and commit in a line, as `--version` says them.
    pub const DESCRIBED: &str = env!("LRFSLAM_VERSION");
}
