//! A run's folder of results: its files take the place of the last ones all at once, or not at all.
//!
//! They are written into a folder beside it, put on disk, and the two folders change places in one step of the file system. Killed
//! at any moment, a run leaves either the whole old set or the whole new one.
//!
//! * `DIR.lrfslam-new`, seen for a moment, is a set under way or the last one on its way out. The next run in DIR removes it; so nobody
//!   else's folder is called like that. On a file system that cannot change two names at once, `DIR.lrfslam-old` is the last one.
//! * `DIR.part` holds the files that grow while a run goes on (a recording, a journal), as long as DIR still holds older results. It is
//!   left if the run is killed before it has saved anything; nobody removes it but the user.

use std::fs::{self, File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime};

use anyhow::{Context as _, bail, ensure};

use super::aside::Aside;
use super::beside::{
    GROWING, NEW, OLD, change_places, clear, ensure_replaceable, free_sibling, is_result, names_in, parts, put_back,
    retire, sibling, sync_folder,
};

/// Name of a laser's recording among the results.
pub const RECORDING: &str = "laser.rec";

/// A run's folder of results: its files take the place of the last ones all at once, or not at all.
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
    /// The save before the last one failed, and the last one.
    has_failed: [bool; 2],
}

/// At most one part of so many of a run's time goes into saving what it has on the way.
const SAVING_SHARE: u32 = 20;

/// Names for a new folder: `stem`, and the time now (UTC), such as `intel-map-20261122T023105Z`, then numbered.
fn folder_names(stem: &str) -> impl Iterator<Item = PathBuf> {
    let now = humantime::format_rfc3339_seconds(SystemTime::now()).to_string();
    let name = format!("{stem}-{}", now.replace(['-', ':'], ""));
    let first = PathBuf::from(&name);
    std::iter::once(first).chain((2..).map(move |number| PathBuf::from(format!("{name}-{number}"))))
}

/// Makes a folder that nobody else has made.
fn make_new(mut names: impl Iterator<Item = PathBuf>) -> anyhow::Result<PathBuf> {
    let made = names.find_map(|name| match fs::create_dir(&name) {
        Ok(()) => Some(Ok(name)),
        Err(error) if error.kind() == io::ErrorKind::AlreadyExists => None,
        Err(error) => Some(Err(error).with_context(|| format!("{}: cannot be used as output folder", name.display()))),
    });
    made.unwrap_or_else(|| bail!("no name is left for a new folder"))
}

/// `file` as one would call it here.
pub fn shown(file: &Path) -> PathBuf {
    let here = std::env::current_dir().unwrap_or_default();
    file.strip_prefix(here).unwrap_or(file).to_owned()
}

impl ResultFolder {
    /// The folder that the user named, or else a new one called `stem` and the time.
    ///
    /// # Errors
    /// As [`claim`](Self::claim).
    pub fn choose(out: Option<&Path>, stem: &str, overwrite: bool) -> anyhow::Result<Self> {
        match out {
            Some(out) => Self::claim(out, overwrite),
            None => {
                let mut folder = Self::open(&make_new(folder_names(stem))?)?;
                folder.is_ours = true;
                Ok(folder)
            }
        }
    }

    /// Makes the folder `place`, or takes an empty one, or with `overwrite` one of older results; these stay until something is saved.
    ///
    /// # Errors
    /// If it cannot be made or written, holds results and `overwrite` is not set, holds anything else, or another run writes there.
    pub fn claim(place: &Path, overwrite: bool) -> anyhow::Result<Self> {
        let unusable = || format!("{}: cannot be used as output folder", place.display());
        put_back(place).with_context(unusable)?;
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
            if let Some(foreign) = names.iter().find(|name| !is_result(name)) {
                bail!(
                    "{}: holds {foreign}, which is no result of lrfslam: not replaced; name another folder by --out",
                    place.display()
                );
            }
            folder.home = free_sibling(&folder.place, "part");
        }
        folder.is_ours = is_new || !names.is_empty();
        Ok(folder)
    }

    /// The folder of an earlier run that goes on with its growing file `name`, wherever [that is](Self::last_grown).
    ///
    /// # Errors
    /// If it is not there, cannot be used, or another run writes there.
    pub fn go_on(place: &Path, name: &str) -> anyhow::Result<Self> {
        put_back(place).with_context(|| format!("{}: cannot be used as output folder", place.display()))?;
        let mut folder = Self::open(place)?;
        if let Some(home) = Self::last_grown(&folder.place, name).as_deref().and_then(Path::parent) {
            folder.home = home.to_owned();
        }
        Ok(folder)
    }

    /// The growing file `name` that was written last: among the results in `place`, or in DIR.part by a run that was killed.
    pub fn last_grown(place: &Path, name: &str) -> Option<PathBuf> {
        let files = std::iter::once(place.join(name)).chain(parts(place).map(|part| part.join(name)));
        let written = |file: PathBuf| Some((fs::metadata(&file).ok()?.modified().ok()?, file));
        files.filter_map(written).max().map(|(_, file)| file)
    }

    /// Recordings and journals in DIR.part: of runs that were killed before they had saved anything.
    pub fn left_behind(&self) -> Vec<PathBuf> {
        let files = parts(&self.place).flat_map(|part| GROWING.map(|name| part.join(name)));
        files.filter(|file| file.exists()).map(|file| shown(&file)).collect()
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
        [NEW, OLD].iter().try_for_each(|ending| clear(&sibling(&whole, ending), &whole)).with_context(unusable)?;
        ensure_replaceable(&whole, place)?;
        let last_save = (Instant::now(), Duration::ZERO);
        Ok(Self {
            named: place.to_owned(),
            place: whole.clone(),
            home: whole,
            lock,
            is_ours: false,
            kept: None,
            last_save,
            has_failed: [false; 2],
        })
    }

    /// Where the results are, or will be, as the user named it.
    pub fn named(&self) -> &Path {
        &self.named
    }

    /// Where the results are, or will be, from the root.
    pub fn place(&self) -> &Path {
        &self.place
    }

    /// Where the growing file `name` is until the next [`save`](Self::save); who has it open then goes on writing to it. Its folder
    /// may have to be made.
    pub fn growing(&self, name: &str) -> PathBuf {
        debug_assert!(GROWING.contains(&name), "{name} is not among the growing files");
        self.home.join(name)
    }

    /// Where this run puts aside what its results will be made of: beside the folder, on the same disk.
    pub fn aside(&self) -> Aside {
        Aside::in_folder(self.place.parent().unwrap_or(&self.place))
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
    ///
    /// # Panics
    /// In a build with checks, if `write` gives a file another name than those of results: the next set could not replace it.
    pub fn save<T>(&mut self, write: impl FnOnce(&Path) -> anyhow::Result<T>) -> anyhow::Result<T> {
        let started = Instant::now();
        let stage = sibling(&self.place, NEW);
        let unusable = format!("{}: results cannot be put there", self.named.display());
        let made = clear(&stage, &self.place).and_then(|()| fs::create_dir(&stage)).with_context(|| unusable.clone());
        let done = made.and_then(|()| write(&stage));
        debug_assert!(
            names_in(&stage).unwrap_or_default().iter().all(|name| is_result(name)),
            "the next set could not replace a file"
        );
        let done = done.and_then(|written| self.publish(&stage).with_context(|| unusable).map(|()| written));
        if done.is_err() {
            let _ = clear(&stage, &self.place);
        }
        self.last_save = (Instant::now(), started.elapsed());
        self.has_failed = [self.has_failed[1], done.is_err()];
        done
    }

    /// What there is to tell of a [`save`](Self::save) on the way: the first failure, and that it works again.
    pub fn news<T>(&self, saved: &anyhow::Result<T>) -> Option<String> {
        match saved {
            Err(error) => (!self.has_failed[0]).then(|| format!("{error:#}; going on, and trying again in a while")),
            Ok(_) => self.has_failed[0].then(|| format!("{}: results are saved again", self.named.display())),
        }
    }

    /// `stage` becomes the folder; what was in it goes.
    fn publish(&mut self, stage: &Path) -> io::Result<()> {
        let unlinked = self.link_growing(stage);
        fs::set_permissions(stage, fs::metadata(&self.place)?.permissions())?;
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
        let home = std::mem::replace(&mut self.home, self.place.clone());
        // The new set is there: what cannot be cleared away now is so by the next save, or the next run.
        let _ = retire(stage, &self.place);
        if home != self.place {
            let _ = retire(&home, &self.place);
        }
        Ok(())
    }

    /// Gives the growing files a second name in `stage`; returns those that cannot have one.
    fn link_growing(&self, stage: &Path) -> Vec<(PathBuf, &'static str)> {
        let mut unlinked = Vec::new();
        for name in GROWING {
            let (mut from, to) = (self.home.join(name), stage.join(name));
            let kept = self.kept.as_ref().filter(|kept| kept.ends_with(name) && !from.exists());
            from = kept.cloned().unwrap_or(from);
            if from.exists() && fs::hard_link(&from, &to).is_err() {
                unlinked.push((from, name));
            }
        }
        unlinked
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

#[cfg(test)]
mod tests;
