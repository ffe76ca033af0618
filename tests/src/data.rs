//! Recorded data that lies outside the repository.

use std::path::PathBuf;

/// Where a file of the data folder is: of that of `LRFSLAM_DATA`, else of `../shared/data` beside the workspace. `None`, said on standard
/// output, if it is not there: the test then has nothing to check.
pub fn path(name: &str) -> Option<PathBuf> {
    let beside = || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../shared/data");
    let path = std::env::var_os("LRFSLAM_DATA").map_or_else(beside, PathBuf::from).join(name);
    if !path.exists() {
        println!("skipped: {name} is not there (set LRFSLAM_DATA to the folder of the real data)");
        return None;
    }
    Some(path)
}

/// What is in it.
pub fn file(name: &str) -> Option<Vec<u8>> {
    path(name).map(|path| std::fs::read(path).expect("the file can be read"))
}
