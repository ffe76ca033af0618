//! A run's folder of results: its files take the place of the last ones all at once, or not at all.
//!
//! They are written into a folder beside it, put on disk, and the two folders change places in one step of the file system. Killed
//! at any moment, a run leaves either the whole old set or the whole new one.
//!
//! * `DIR.new`, seen for a moment, is a set under way or the last one on its way out. The next run in DIR removes it.
//! * `DIR.part` holds the files that grow while a run goes on (a recording, a journal), as long as DIR still holds older results. It is
//!   left if the run is killed before it has saved anything; nobody removes it but the user.

use std::ffi::OsStr;
use std::fs::{self, File, TryLockError};
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime};

use anyhow::{Context as _, bail, ensure};

/// Name of a laser's recording among the results.
pub const RECORDING: &str = "laser.rec";

/// Files that grow while a run goes on, and go from set to set.
const GROWING: [&str; 2] = [RECORDING, "robot.journal"];

/// All names that commands give to results: these may be replaced, nothing else.
const RESULTS: [&str; 29] = [
    "cloud.json",
    "cloud.pcd",
    "cloud.ply",
    "cloud.png",
    "distribution.svg",
    "errors.csv",
    "errors.md",
    "errors.svg",
    "findings.md",
    "laser.rec",
    "localization.csv",
    "localization.png",
    "loop.csv",
    "loop.md",
    "map.lrfslam",
    "map.pgm",
    "map.png",
    "map.yaml",
    "motion-model.json",
    "path.png",
    "report.json",
    "robot-map.pgm",
    "robot-map.yaml",
    "robot.journal",
    "robot.tum",
    "run.json",
    "steps.csv",
    "trajectory.tum",
    "truth.tum",
];

/// See the [module](self).
#[derive(Debug)]
pub struct ResultFolder {
    /// As the user named it.
    named: PathBuf,
    place: PathBuf,
    /// Where the growing files are: in place, or in DIR.part.
    home: PathBuf,
    /// Held so that no other run writes here; none where the system has no locks on folders.
    lock: Option<File>,
    is_ours: bool,
    /// A growing file of the last set that stays.
    kept: Option<PathBuf>,
    /// When something was last saved, or the run began, and how long that took.
    last_save: (Instant, Duration),
}

/// At most one part of so many of a run's time goes into saving what it has on the way.
const SAVING_SHARE: u32 = 20;

/// A name for a new folder: `stem`, and the time now (UTC), such as `intel-map-20261122T023105Z`.
pub fn folder_name(stem: &str) -> PathBuf {
    let now = humantime::format_rfc3339_seconds(SystemTime::now()).to_string();
    let name = format!("{stem}-{}", now.replace(['-', ':'], ""));
    let free = |name: &PathBuf| !name.exists();
    let numbered = (2..).map(|number| PathBuf::from(format!("{name}-{number}")));
    [PathBuf::from(&name)].into_iter().chain(numbered).find(free).unwrap_or_default()
}

impl ResultFolder {
    /// The folder that the user named, or else a new one called `stem` and the time.
    ///
    /// # Errors
    /// As [`claim`](Self::claim).
    pub fn choose(out: Option<&Path>, stem: &str, overwrite: bool) -> anyhow::Result<Self> {
        Self::claim(&out.map_or_else(|| folder_name(stem), Path::to_owned), overwrite)
    }

    /// Makes the folder `place`, or takes an empty one, or with `overwrite` one of older results; these stay until something is saved.
    ///
    /// # Errors
    /// If it cannot be made or written, holds results and `overwrite` is not set, holds anything else, or another run writes there.
    pub fn claim(place: &Path, overwrite: bool) -> anyhow::Result<Self> {
        let unusable = || format!("{}: cannot be used as output folder", place.display());
        let is_new = !place.exists();
        fs::create_dir_all(place).with_context(unusable)?;
        let mut folder = Self::open(place)?;
        let names = names_in(&folder.place).with_context(unusable)?;
        if !names.is_empty() {
            ensure!(
                overwrite,
                "{}: holds {} already; name another folder by --out, or replace what is there by --overwrite",
                place.display(),
                names[0]
            );
            if let Some(foreign) = names.iter().find(|name| !RESULTS.contains(&name.as_str())) {
                bail!(
                    "{}: holds {foreign}, which is no result of lrfslam: not replaced; name another folder by --out",
                    place.display()
                );
            }
            folder.home = free_sibling(&folder.place, "part");
            fs::create_dir(&folder.home).with_context(unusable)?;
        }
        folder.is_ours = is_new || !names.is_empty();
        Ok(folder)
    }

    /// The folder of an earlier run that goes on.
    ///
    /// # Errors
    /// If it is not there, or another run writes there.
    pub fn go_on(place: &Path) -> anyhow::Result<Self> {
        Self::open(place)
    }

    fn open(place: &Path) -> anyhow::Result<Self> {
        let unusable = || format!("{}: cannot be used as output folder", place.display());
        let whole = fs::canonicalize(place).with_context(unusable)?;
        let here = std::env::current_dir().unwrap_or_default();
        ensure!(!here.starts_with(&whole), "{}: expected a folder of its own for the results", place.display());
        let lock = File::open(&whole).ok();
        if let Some(Err(TryLockError::WouldBlock)) = lock.as_ref().map(File::try_lock) {
            bail!("{}: another lrfslam is writing there", place.display());
        }
        // What a killed run left on its way out.
        retire(&sibling(&whole, "new"), &whole).with_context(unusable)?;
        let last_save = (Instant::now(), Duration::ZERO);
        Ok(Self {
            named: place.to_owned(),
            place: whole.clone(),
            home: whole,
            lock,
            is_ours: false,
            kept: None,
            last_save,
        })
    }

    /// Where the results are, or will be, as the user named it.
    pub fn named(&self) -> &Path {
        &self.named
    }

    /// Where the growing file `name` is until the next [`save`](Self::save); who has it open then goes on writing to it.
    pub fn growing(&self, name: &str) -> PathBuf {
        debug_assert!(GROWING.contains(&name), "{name} is not among the growing files");
        self.home.join(name)
    }

    /// The growing file `file` stays if it is among the last results here: the new ones are made of it.
    pub fn keep(&mut self, file: &Path) {
        self.kept = fs::canonicalize(file).ok().filter(|file| file.parent() == Some(&self.place));
    }

    /// True if the run has gone on for `every` since the last [`save`](Self::save), and for so long that saving hardly costs.
    pub fn is_due(&self, every: Duration) -> bool {
        let (at, took) = self.last_save;
        at.elapsed() >= every.max(took * SAVING_SHARE)
    }

    /// Replaces the set of results by what `write` writes into the folder it is given; growing files stay.
    ///
    /// # Errors
    /// That of `write`, or if the folder cannot be replaced. The last set is still there then.
    pub fn save<T>(&mut self, write: impl FnOnce(&Path) -> anyhow::Result<T>) -> anyhow::Result<T> {
        let started = Instant::now();
        let stage = sibling(&self.place, "new");
        let unusable = format!("{}: results cannot be put there", self.named.display());
        fs::create_dir(&stage).with_context(|| unusable.clone())?;
        let done = write(&stage).and_then(|written| self.publish(&stage).with_context(|| unusable).map(|()| written));
        if done.is_err() {
            let _ = fs::remove_dir_all(&stage);
        }
        self.last_save = (Instant::now(), started.elapsed());
        done
    }

    /// `stage` becomes the folder; what was in it goes.
    fn publish(&mut self, stage: &Path) -> io::Result<()> {
        let mut unlinked = Vec::new();
        for name in GROWING {
            let (mut from, to) = (self.home.join(name), stage.join(name));
            let kept = self.kept.as_ref().filter(|kept| kept.ends_with(name) && !from.exists());
            from = kept.cloned().unwrap_or(from);
            if from.exists() && fs::hard_link(&from, &to).is_err() {
                unlinked.push((from, name));
            }
        }
        sync_folder(stage);
        let lock = File::open(stage).ok();
        lock.iter().for_each(|lock| drop(lock.try_lock()));
        change_places(stage, &self.place)?;
        (self.lock, self.is_ours) = (lock, false);
        sync_folder(self.place.parent().unwrap_or(Path::new(".")));
        // On a disk without links they follow a moment later.
        for (from, name) in unlinked {
            let from = if from.starts_with(&self.place) { stage.join(name) } else { from };
            fs::rename(from, self.place.join(name))?;
        }
        retire(stage, &self.place)?;
        if self.home != self.place {
            retire(&self.home, &self.place)?;
            self.home.clone_from(&self.place);
        }
        Ok(())
    }
}

impl Drop for ResultFolder {
    /// A folder made for a run that has left nothing goes again.
    fn drop(&mut self) {
        if self.is_ours {
            let _ = fs::remove_dir(&self.home);
        }
    }
}

/// `DIR` and "new" → `DIR.new`, beside it.
fn sibling(place: &Path, ending: &str) -> PathBuf {
    let mut name = place.as_os_str().to_owned();
    name.push(".");
    name.push(ending);
    name.into()
}

/// DIR.part, DIR.part-2, …: the first that is not there.
fn free_sibling(place: &Path, ending: &str) -> PathBuf {
    let numbered = (2..).map(|number| sibling(place, &format!("{ending}-{number}")));
    [sibling(place, ending)].into_iter().chain(numbered).find(|path| !path.exists()).unwrap_or_default()
}

fn names_in(folder: &Path) -> io::Result<Vec<String>> {
    let name = |entry: io::Result<fs::DirEntry>| Ok(entry?.file_name().to_string_lossy().into_owned());
    let mut names = fs::read_dir(folder)?.map(name).collect::<io::Result<Vec<_>>>()?;
    names.sort();
    Ok(names)
}

/// Removes the folder `old`, if it is there, with its results. Anything else that somebody has put into it goes to `place`.
fn retire(old: &Path, place: &Path) -> io::Result<()> {
    let names = match names_in(old) {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(()),
        names => names?,
    };
    for name in names {
        let from = old.join(&name);
        if RESULTS.contains(&name.as_str()) || OsStr::new(&name).as_encoded_bytes().ends_with(b".part") {
            fs::remove_file(from)?;
        } else {
            fs::rename(from, place.join(name))?;
        }
    }
    fs::remove_dir(old)
}

/// What was made and renamed in `folder` is on disk when this returns, where the system can do that.
fn sync_folder(folder: &Path) {
    if let Ok(folder) = File::open(folder) {
        let _ = folder.sync_all();
    }
}

/// The two folders get one another's names, in one step where the file system can do that.
fn change_places(new: &Path, old: &Path) -> io::Result<()> {
    #[cfg(target_os = "linux")]
    {
        use rustix::fs::{CWD, RenameFlags, renameat_with};
        if renameat_with(CWD, new, CWD, old, RenameFlags::EXCHANGE).is_ok() {
            return Ok(());
        }
    }
    let aside = free_sibling(old, "old");
    fs::rename(old, &aside)?;
    fs::rename(new, old)?;
    fs::rename(aside, new)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::write_file;
    use std::io::Write as _;

    fn save(folder: &mut ResultFolder, files: &[(&str, &str)]) -> anyhow::Result<()> {
        folder.save(|stage| {
            Ok(files.iter().try_for_each(|(name, text)| write_file(&stage.join(name), text.as_bytes()))?)
        })
    }

    fn read(folder: &Path, name: &str) -> String {
        fs::read_to_string(folder.join(name)).unwrap_or_default()
    }

    #[test]
    fn a_set_is_replaced_whole_and_only_if_that_was_said() {
        let parent = tempfile::tempdir().unwrap();
        let place = parent.path().join("a/map");
        let mut first = ResultFolder::claim(&place, false).unwrap();
        save(&mut first, &[("map.pgm", "one"), ("steps.csv", "one")]).unwrap();
        drop(first);
        let refused = ResultFolder::claim(&place, false).unwrap_err().to_string();
        assert!(refused.contains("holds map.pgm already") && refused.contains("--overwrite"), "{refused}");
        let mut second = ResultFolder::claim(&place, true).unwrap();
        assert!(second.save(|stage| Ok(write_file(&stage.join("no/such"), b"")?)).is_err());
        assert_eq!(read(&place, "steps.csv"), "one", "what could not be written has replaced nothing");
        save(&mut second, &[("map.pgm", "two")]).unwrap();
        drop(second);
        assert_eq!(names_in(&place).unwrap(), ["map.pgm"]);
        assert_eq!(read(&place, "map.pgm"), "two");
        assert_eq!(names_in(&parent.path().join("a")).unwrap(), ["map"], "nothing is left beside it");
    }

    #[test]
    fn a_run_without_results_leaves_what_was_there() {
        let parent = tempfile::tempdir().unwrap();
        let place = parent.path().join("map");
        drop(ResultFolder::claim(&place, false).unwrap());
        assert!(!place.exists(), "a folder made for nothing is not left");
        fs::create_dir(&place).unwrap();
        drop(ResultFolder::claim(&place, false).unwrap());
        assert!(place.exists(), "one that the user has made is");
        fs::write(place.join("map.pgm"), "old").unwrap();
        drop(ResultFolder::claim(&place, true).unwrap());
        assert_eq!(
            (names_in(&place).unwrap(), names_in(parent.path()).unwrap()),
            (vec!["map.pgm".into()], vec!["map".into()])
        );
    }

    #[test]
    fn nothing_foreign_is_replaced() {
        let parent = tempfile::tempdir().unwrap();
        let place = parent.path().join("map");
        fs::create_dir(&place).unwrap();
        fs::write(place.join("thesis.tex"), "years").unwrap();
        let refused = ResultFolder::claim(&place, true).unwrap_err().to_string();
        assert!(refused.contains("holds thesis.tex, which is no result"), "{refused}");
        fs::remove_file(place.join("thesis.tex")).unwrap();
        let mut folder = ResultFolder::claim(&place, false).unwrap();
        save(&mut folder, &[("map.pgm", "one")]).unwrap();
        fs::write(place.join("notes.txt"), "put there while it runs").unwrap();
        save(&mut folder, &[("map.pgm", "two")]).unwrap();
        assert_eq!(
            (read(&place, "notes.txt").as_str(), read(&place, "map.pgm").as_str()),
            ("put there while it runs", "two")
        );
    }

    #[test]
    fn growing_files_go_from_set_to_set() {
        let parent = tempfile::tempdir().unwrap();
        let place = parent.path().join("map");
        fs::create_dir(&place).unwrap();
        fs::write(place.join("laser.rec"), "old").unwrap();
        let mut folder = ResultFolder::claim(&place, true).unwrap();
        let mut recording = File::create(folder.growing("laser.rec")).unwrap();
        recording.write_all(b"new").unwrap();
        assert_eq!(read(&place, "laser.rec"), "old", "until something is saved");
        for round in ["one", "two"] {
            save(&mut folder, &[("map.pgm", round)]).unwrap();
            recording.write_all(b"er").unwrap();
        }
        assert_eq!((read(&place, "laser.rec").as_str(), read(&place, "map.pgm").as_str()), ("newerer", "two"));
        assert_eq!(names_in(parent.path()).unwrap(), ["map"]);
    }

    #[test]
    fn a_killed_run_s_leavings_are_cleared_and_its_recording_is_not() {
        let parent = tempfile::tempdir().unwrap();
        let place = parent.path().join("map");
        for (folder, file) in
            [("map", "map.pgm"), ("map.new", "map.pgm"), ("map.new", "notes.txt"), ("map.part", "laser.rec")]
        {
            fs::create_dir_all(parent.path().join(folder)).unwrap();
            fs::write(parent.path().join(folder).join(file), folder).unwrap();
        }
        fs::remove_file(place.join("map.pgm")).unwrap();
        let mut folder = ResultFolder::claim(&place, false).unwrap_err().to_string();
        assert!(folder.contains("notes.txt"), "{folder}");
        folder.clear();
        assert_eq!(names_in(parent.path()).unwrap(), ["map", "map.part"]);
        assert_eq!(read(&parent.path().join("map.part"), "laser.rec"), "map.part");
    }

    #[test]
    fn two_runs_do_not_share_a_folder() {
        let parent = tempfile::tempdir().unwrap();
        let place = parent.path().join("map");
        let mut first = ResultFolder::claim(&place, false).unwrap();
        let refused = || ResultFolder::claim(&place, true).unwrap_err().to_string();
        assert!(refused().contains("another lrfslam is writing there"), "{}", refused());
        save(&mut first, &[("map.pgm", "one")]).unwrap();
        assert!(refused().contains("another lrfslam is writing there"), "{}", refused());
        drop(first);
        assert!(ResultFolder::claim(&place, true).is_ok());
    }

    #[test]
    fn new_folders_are_named_by_the_time() {
        let name = folder_name("hall-map").display().to_string();
        assert!(
            name.starts_with("hall-map-2") && name.ends_with('Z') && name.len() == "hall-map-20261122T023105Z".len(),
            "{name}"
        );
    }
}
