//! Folders beside a folder of results: what they are called, what may be removed of them, and how two change places.

use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

use anyhow::{Context as _, ensure};

use super::folder::RECORDING;

/// A set under way, or the last one on its way out, as it is called beside its place.
pub(super) const NEW: &str = "lrfslam-new";
/// The last set for a moment, where two folders cannot change places in one step.
pub(super) const OLD: &str = "lrfslam-old";

/// Files that grow while a run goes on, and go from set to set.
pub(super) const GROWING: [&str; 2] = [RECORDING, "robot.journal"];

/// All names that commands give to results: these may be replaced, nothing else.
const RESULTS: &str = "carried.csv carried.md cloud.json cloud.pcd cloud.ply cloud.png cost.csv cost.svg distribution.svg endurance.csv endurance.md \
    endurance.svg envelope.csv envelope.md envelope.svg errors.csv errors.md errors.svg findings.md landmarks.csv \
    landmarks.png laser.rec localization.csv localization.png loop.csv loop.md map.lrfslam map.pgm map.png map.yaml \
    motion-model.json online.tum path.png report.json robot-map.pgm robot-map.yaml robot.journal robot.tum run.json \
    steps.csv trajectory.tum truth.tum";

/// True for a name that commands give to a result.
pub(super) fn is_result(name: &str) -> bool {
    RESULTS.split_whitespace().any(|result| result == name)
}

/// `DIR` and "part" → `DIR.part`, beside it.
pub(super) fn sibling(place: &Path, ending: &str) -> PathBuf {
    let mut name = place.as_os_str().to_owned();
    name.push(".");
    name.push(ending);
    name.into()
}

/// DIR.part, DIR.part-2, …: the first that is not there.
pub(super) fn free_sibling(place: &Path, ending: &str) -> PathBuf {
    let numbered = (2..).map(|number| sibling(place, &format!("{ending}-{number}")));
    [sibling(place, ending)].into_iter().chain(numbered).find(|path| !path.exists()).unwrap_or_default()
}

/// DIR.part, DIR.part-2, …, as far as they are there.
pub(super) fn parts(place: &Path) -> impl Iterator<Item = PathBuf> {
    let (parent, stem) = (place.parent().unwrap_or(Path::new("")), sibling(place, "part"));
    let stem = stem.file_name().unwrap_or_default().to_os_string();
    let listed = if parent.as_os_str().is_empty() { Path::new(".") } else { parent };
    let is_part = move |name: &OsString| {
        let rest = name.as_encoded_bytes().strip_prefix(stem.as_encoded_bytes());
        rest.is_some_and(|rest| rest.is_empty() || rest[0] == b'-' && rest[1..].iter().all(u8::is_ascii_digit))
    };
    let names = fs::read_dir(listed).into_iter().flatten().filter_map(|entry| Some(entry.ok()?.file_name()));
    let mut found: Vec<_> = names.filter(is_part).map(|name| parent.join(name)).collect();
    found.sort();
    found.into_iter()
}

/// A kill between two names of the last set: it gets its own back.
pub(super) fn put_back(place: &Path) -> io::Result<()> {
    let place: PathBuf = place.components().collect();
    let aside = sibling(&place, OLD);
    if !place.exists() && aside.exists() { fs::rename(aside, place) } else { Ok(()) }
}

/// Names beside `place` can be made, and it can get another one; `named` is how the user calls it.
pub(super) fn ensure_replaceable(place: &Path, named: &Path) -> anyhow::Result<()> {
    #[cfg(target_os = "linux")]
    {
        use rustix::fs::{AtFlags, CWD, StatxAttributes, StatxFlags, statx};
        let about = statx(CWD, place, AtFlags::empty(), StatxFlags::empty());
        let is_mount = about.is_ok_and(|about| about.stx_attributes.contains(StatxAttributes::MOUNT_ROOT));
        ensure!(!is_mount, "{}: a disk is mounted there: name a folder in it by --out", named.display());
    }
    let stage = sibling(place, NEW);
    fs::create_dir(&stage).and_then(|()| fs::remove_dir(&stage)).with_context(|| {
        let parent = place.parent().unwrap_or(place).display();
        format!("{}: cannot be used as output folder: {parent} cannot be written", named.display())
    })
}

pub(super) fn names_in(folder: &Path) -> io::Result<Vec<String>> {
    let name = |entry: io::Result<fs::DirEntry>| Ok(entry?.file_name().to_string_lossy().into_owned());
    let mut names = fs::read_dir(folder)?.map(name).collect::<io::Result<Vec<_>>>()?;
    names.sort();
    Ok(names)
}

/// As [`retire`], but a recording or journal that has no other name goes to DIR.part: on a disk without links a kill may leave it here.
pub(super) fn clear(old: &Path, place: &Path) -> io::Result<()> {
    for (name, file) in GROWING.map(|name| (name, old.join(name))) {
        if fs::metadata(&file).is_ok_and(|about| has_one_name(&about)) {
            let part = free_sibling(place, "part");
            fs::create_dir(&part)?;
            fs::rename(file, part.join(name))?;
        }
    }
    retire(old, place)
}

#[cfg(unix)]
fn has_one_name(about: &fs::Metadata) -> bool {
    std::os::unix::fs::MetadataExt::nlink(about) == 1
}

#[cfg(not(unix))]
fn has_one_name(_: &fs::Metadata) -> bool {
    true
}

/// Removes the folder `old`, if it is there, with its results. Anything else that somebody has put into it goes to `place`.
pub(super) fn retire(old: &Path, place: &Path) -> io::Result<()> {
    let names = match names_in(old) {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(()),
        names => names?,
    };
    for name in names {
        let from = old.join(&name);
        if is_result(name.strip_suffix(".part").unwrap_or(&name)) {
            fs::remove_file(from)?;
        } else {
            fs::rename(from, place.join(name))?;
        }
    }
    fs::remove_dir(old)
}

/// What was made and renamed in `folder` is on disk when this returns, where the system can do that.
pub(super) fn sync_folder(folder: &Path) {
    if let Ok(folder) = File::open(folder) {
        let _ = folder.sync_all();
    }
}

/// The two folders get one another's names, in one step where the file system can do that.
pub(super) fn change_places(new: &Path, old: &Path) -> io::Result<()> {
    #[cfg(target_os = "linux")]
    {
        use rustix::fs::{CWD, RenameFlags, renameat_with};
        if renameat_with(CWD, new, CWD, old, RenameFlags::EXCHANGE).is_ok() {
            return Ok(());
        }
    }
    let aside = sibling(old, OLD);
    fs::rename(old, &aside)?;
    if let Err(error) = fs::rename(new, old) {
        fs::rename(aside, old)?;
        return Err(error);
    }
    fs::rename(aside, new)
}
