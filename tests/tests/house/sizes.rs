//! Files that one can read at a sitting. The length of functions is clippy's: `too_many_lines` in `clippy.toml`.

use super::{files, root};

const LINES_MAX: usize = 400;

#[test]
fn no_file_is_longer_than_can_be_read_at_a_sitting() {
    let lines = |file: &std::path::PathBuf| std::fs::read_to_string(root().join(file)).unwrap().lines().count();
    let sources = files(&root(), "rs");
    assert!(sources.len() > 300, "found {} files only", sources.len());
    let long: Vec<_> = sources.iter().map(|file| (file, lines(file))).filter(|(_, lines)| *lines > LINES_MAX).collect();
    assert!(long.is_empty(), "over {LINES_MAX} lines: {long:?}");
}
