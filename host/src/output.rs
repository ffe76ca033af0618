//! Files that are either whole or not there: written beside their place under another name, then renamed.

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

/// A file under way. Dropped without [`finish`](Self::finish), it is left under its temporary name, results in it.
#[derive(Debug)]
pub struct PendingFile {
    out: BufWriter<File>,
    temporary: PathBuf,
    target: PathBuf,
}

impl PendingFile {
    /// Starts the file that shall become `target`, as `target` with `.part` behind it.
    ///
    /// # Errors
    /// If it cannot be created.
    pub fn create(target: &Path) -> io::Result<Self> {
        let mut name = target.as_os_str().to_owned();
        name.push(".part");
        let temporary = PathBuf::from(name);
        let out = BufWriter::new(File::create(&temporary)?);
        Ok(Self { out, temporary, target: target.to_owned() })
    }

    /// Writes out what is left and gives the file its name, replacing a former one.
    ///
    /// # Errors
    /// If writing or renaming fails.
    pub fn finish(mut self) -> io::Result<()> {
        self.out.flush()?;
        fs::rename(&self.temporary, &self.target)
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

/// Writes `bytes` as the file `target`.
///
/// # Errors
/// If creating, writing or renaming fails.
pub fn write_file(target: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut file = PendingFile::create(target)?;
    file.write_all(bytes)?;
    file.finish()
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
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }
}
