//! Recorded data that lies outside the repository.

use std::path::PathBuf;

/// A file of the data folder: that of `LRFSLAM_DATA`, else `../shared/data` beside the workspace. `None`, said on standard
/// error, if it is not there: the test then has nothing to check.
pub fn file(name: &str) -> Option<Vec<u8>> {
    let beside = || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../shared/data");
    let path = std::env::var_os("LRFSLAM_DATA").map_or_else(beside, PathBuf::from).join(name);
    let read = std::fs::read(&path);
    if read.is_err() {
        eprintln!("skipped: {} is not there (set LRFSLAM_DATA)", path.display());
    }
    read.ok()
}
