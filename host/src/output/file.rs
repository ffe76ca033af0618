//! Files that are either whole or not there: written beside their place under another name, put on disk, then renamed.

use std::fs::{self, File};
use std::io::{self, BufWriter, ErrorKind, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use serde::Serialize;

/// A file under way. Dropped without [`finish`](Self::finish), it is gone, and what was there before is still there.
#[derive(Debug)]
pub struct PendingFile {
    out: BufWriter<File>,
    temporary: PathBuf,
    target: PathBuf,
    is_finished: bool,
}

impl PendingFile {
    /// Starts the file that shall become `target`, as `target` with `.part` behind it; a link is followed.
    ///
    /// # Errors
    /// If it cannot be created, or `target` is there and no regular file: a device, a pipe, a folder, a link that leads nowhere.
    pub fn create(target: &Path) -> io::Result<Self> {
        let target = match fs::metadata(target) {
            Ok(found) if !found.is_file() => {
                return Err(io::Error::new(ErrorKind::InvalidInput, "it is there already, and no regular file"));
            }
            Ok(_) => fs::canonicalize(target)?,
            Err(_) if fs::symlink_metadata(target).is_ok() => {
                return Err(io::Error::new(ErrorKind::InvalidInput, "it is a link that leads nowhere"));
            }
            Err(_) => target.to_owned(),
        };
        let mut name = target.as_os_str().to_owned();
        name.push(".part");
        let temporary = PathBuf::from(name);
        let out = BufWriter::new(File::create(&temporary)?);
        Ok(Self { out, temporary, target, is_finished: false })
    }

    /// Writes out what is left and gives the file its name, replacing a former one. It is on disk then.
    ///
    /// # Errors
    /// If writing or renaming fails.
    pub fn finish(mut self) -> io::Result<()> {
        self.out.flush()?;
        self.out.get_ref().sync_all()?;
        fs::rename(&self.temporary, &self.target)?;
        self.is_finished = true;
        Ok(())
    }
}

impl Drop for PendingFile {
    fn drop(&mut self) {
        if !self.is_finished {
            // Nobody is left to be told.
            let _ = fs::remove_file(&self.temporary);
        }
    }
}

impl Write for PendingFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.out.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.out.flush()
    }
}

impl Seek for PendingFile {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.out.seek(to)
    }
}

/// Writes `bytes` as the file `target`.
///
/// # Errors
/// If creating, writing or renaming fails.
pub fn write_file(target: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut file = PendingFile::create(target)?;
    file.write_all(bytes)?;
    file.finish()
}

/// Writes a file by `write`, whole or not at all.
///
/// # Errors
/// As [`write_file`]; the error names the file.
pub fn save_by(target: &Path, write: impl FnOnce(&mut PendingFile) -> io::Result<()>) -> anyhow::Result<()> {
    let written = PendingFile::create(target).and_then(|mut file| {
        write(&mut file)?;
        file.finish()
    });
    written.with_context(|| cannot_write(target))
}

/// Writes `bytes` as the file `target`.
///
/// # Errors
/// As [`write_file`]; the error names the file.
pub fn save_file(target: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    save_by(target, |file| file.write_all(bytes))
}

/// Writes `report` as the file `target`, in JSON for people.
///
/// # Errors
/// As [`save_file`], or if the report is none in JSON.
pub fn save_json(target: &Path, report: &impl Serialize) -> anyhow::Result<()> {
    save_file(target, (serde_json::to_string_pretty(report)? + "\n").as_bytes())
}

/// What an error says of a file.
pub fn cannot_write(file: &Path) -> String {
    format!("{}: cannot be written", file.display())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn file_appears_under_its_name_only_when_finished() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("a.txt");
        let mut file = PendingFile::create(&target).unwrap();
        file.write_all(b"abc").unwrap();
        assert!(!target.exists());
        file.finish().unwrap();
        assert_eq!(fs::read(&target).unwrap(), b"abc");
        write_file(&target, b"new").unwrap();
        assert_eq!(fs::read(&target).unwrap(), b"new");
        drop(PendingFile::create(&target).unwrap());
        assert_eq!(fs::read(&target).unwrap(), b"new", "one that was not finished changes nothing");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn only_regular_files_are_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let error = write_file(folder.path(), b"abc").unwrap_err();
        assert!(error.to_string().contains("no regular file"), "{error}");
        let (target, link) = (folder.path().join("a.txt"), folder.path().join("link"));
        write_file(&target, b"old").unwrap();
        std::os::unix::fs::symlink(&target, &link).unwrap();
        write_file(&link, b"new").unwrap();
        assert_eq!(fs::read(&target).unwrap(), b"new", "a link is followed, not replaced");
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
        fs::remove_file(&target).unwrap();
        assert!(write_file(&link, b"new").unwrap_err().to_string().contains("leads nowhere"));
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
        let device = write_file(Path::new("/dev/null"), b"new").unwrap_err();
        assert!(device.to_string().contains("no regular file"), "{device}");
    }
}
