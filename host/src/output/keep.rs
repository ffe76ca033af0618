//! The latest runs stay, older ones go: what a robot that maps from every power-on has room for.

use std::fs::{self, File, TryLockError};
use std::io;
use std::path::Path;

use super::beside::{NEW, OLD, is_result, names_in, sibling};

/// Removes the oldest folders `STEM-TIME` in `place`, as runs [make](super::ResultFolder::choose) them, until `keep` are left.
///
/// Empty ones, of runs that were killed before they had found a laser, go and count nothing. A folder stays that holds anything but results,
/// or that another run writes to. Returns the names of the runs that were removed.
///
/// # Errors
/// If `place` cannot be read, or a folder cannot be removed.
pub fn keep_latest(place: &Path, stem: &str, keep: usize) -> io::Result<Vec<String>> {
    let mut runs = Vec::new();
    for name in names_in(place)? {
        let folder = place.join(&name);
        let Some(begun) = begun(&name, stem).filter(|_| folder.is_dir() && !folder.is_symlink()) else { continue };
        if is_in_use(&folder) || !holds_results_alone(&folder)? {
            continue;
        }
        match names_in(&folder)?.is_empty() {
            true => fs::remove_dir(folder)?,
            false => runs.push((begun, name)),
        }
    }
    runs.sort();
    runs.truncate(runs.len().saturating_sub(keep));
    for (_, name) in &runs {
        remove(&place.join(name))?;
    }
    Ok(runs.into_iter().map(|(_, name)| name).collect())
}

/// `STEM-20261122T023105Z-2` → when that run began, and which it is of those that began then.
fn begun(name: &str, stem: &str) -> Option<(String, u32)> {
    let rest = name.strip_prefix(stem)?.strip_prefix('-')?;
    let (time, number) = rest.split_once('-').map_or(Some((rest, 1)), |(time, n)| Some((time, n.parse().ok()?)))?;
    let shape: String = time.chars().map(|letter| if letter.is_ascii_digit() { '0' } else { letter }).collect();
    (shape == "00000000T000000Z").then(|| (time.to_owned(), number))
}

/// A run holds a lock on its folder.
fn is_in_use(folder: &Path) -> bool {
    let lock = File::open(folder);
    matches!(lock.map(|lock| lock.try_lock()), Ok(Err(TryLockError::WouldBlock)))
}

fn holds_results_alone(folder: &Path) -> io::Result<bool> {
    Ok(names_in(folder)?.iter().all(|name| is_result(name.strip_suffix(".part").unwrap_or(name))))
}

/// The folder, and what a kill left beside it.
fn remove(run: &Path) -> io::Result<()> {
    for folder in [sibling(run, NEW), sibling(run, OLD), run.to_owned()] {
        if folder.is_dir() && holds_results_alone(&folder)? {
            fs::remove_dir_all(folder)?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(place: &Path, name: &str, file: &str) {
        fs::create_dir(place.join(name)).unwrap();
        fs::write(place.join(name).join(file), "x").unwrap();
    }

    #[test]
    fn the_latest_runs_stay_and_what_is_none_too() {
        let temporary = tempfile::tempdir().unwrap();
        let place = temporary.path();
        for second in 0..5 {
            run(place, &format!("run-20260101T00000{second}Z"), "laser.rec");
        }
        run(place, "run-20260101T000000Z-2", "run.json");
        run(place, "run-20260101T000000Z-10", "run.json");
        run(place, "run-20260101T000000Z.lrfslam-new", "laser.rec");
        run(place, "run-20250101T000000Z", "thesis.tex");
        run(place, "run-of-the-mill", "run.json");
        run(place, "other-20250101T000000Z", "run.json");
        fs::create_dir(place.join("run-20260102T000000Z")).unwrap();
        let used = place.join("run-20240101T000000Z");
        run(place, "run-20240101T000000Z", "laser.rec");
        let lock = File::open(&used).unwrap();
        lock.try_lock().unwrap();

        let numbered = ["run-20260101T000000Z", "run-20260101T000000Z-2", "run-20260101T000000Z-10"];
        let removed = keep_latest(place, "run", 3).unwrap();
        assert_eq!(removed, [&numbered[..], &["run-20260101T000001Z"]].concat());
        let left = names_in(place).unwrap();
        let expected = [
            "other-20250101T000000Z",
            "run-20240101T000000Z",
            "run-20250101T000000Z",
            "run-20260101T000002Z",
            "run-20260101T000003Z",
            "run-20260101T000004Z",
            "run-of-the-mill",
        ];
        assert_eq!(left, expected);
        assert!(keep_latest(place, "run", 3).unwrap().is_empty());
        drop(lock);
        assert_eq!(keep_latest(place, "run", 3).unwrap(), ["run-20240101T000000Z"]);
    }
}
