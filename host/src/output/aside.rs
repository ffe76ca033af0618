//! What is wanted again only when results are written lies on disk meanwhile: the path of a robot that drives for days.

use std::borrow::Cow;
use std::fs::File;
use std::io::{self, Read as _, Seek as _, SeekFrom, Write as _};
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Where bytes are put aside: a file without a name, which is gone with the run, however that ends.
///
/// The default has no file, and they stay in memory; so they do if the disk takes no more.
#[derive(Debug, Clone, Default)]
pub struct Aside(Option<Shared>);

type Shared = Arc<Mutex<Nameless>>;

#[derive(Debug)]
pub(crate) struct Nameless {
    file: File,
    end: u64,
    /// The first one of reading.
    fault: Option<String>,
}

/// Bytes that may have been put aside.
#[derive(Debug, Clone)]
pub(crate) enum Kept {
    Here(Box<[u8]>),
    Aside { file: Shared, at: u64, count: u32 },
}

impl Aside {
    /// On the disk of `folder`; in memory if no file can be made there.
    pub fn in_folder(folder: &Path) -> Self {
        tempfile::tempfile_in(folder).map_or_else(|_| Self::default(), Self::in_file)
    }

    fn in_file(file: File) -> Self {
        Self(Some(Arc::new(Mutex::new(Nameless { file, end: 0, fault: None }))))
    }

    pub(crate) fn put(&self, bytes: Box<[u8]>) -> Kept {
        let Some(file) = &self.0 else { return Kept::Here(bytes) };
        match (lock(file).append(&bytes), u32::try_from(bytes.len())) {
            (Ok(at), Ok(count)) => Kept::Aside { file: file.clone(), at, count },
            _ => Kept::Here(bytes),
        }
    }

    /// So many lie on disk.
    pub fn bytes(&self) -> u64 {
        self.0.as_ref().map_or(0, |file| lock(file).end)
    }

    /// The first fault of the disk when something was to be read back, in words: that is missing in what was made of it.
    pub fn fault(&self) -> Option<String> {
        self.0.as_ref().and_then(|file| lock(file).fault.clone())
    }
}

/// A file whose holder has panicked is as good as before.
fn lock(file: &Shared) -> MutexGuard<'_, Nameless> {
    file.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Nameless {
    /// Where they begin. What a full disk has taken of them is written over by the next ones.
    fn append(&mut self, bytes: &[u8]) -> io::Result<u64> {
        self.file.seek(SeekFrom::Start(self.end))?;
        self.file.write_all(bytes)?;
        let at = self.end;
        self.end += bytes.len() as u64;
        Ok(at)
    }

    fn read(&mut self, at: u64, count: u32) -> io::Result<Vec<u8>> {
        let mut bytes = vec![0; count as usize];
        self.file.seek(SeekFrom::Start(at))?;
        self.file.read_exact(&mut bytes)?;
        Ok(bytes)
    }
}

impl Kept {
    /// All of them; none if the disk fails, which [`Aside::fault`] tells.
    pub(crate) fn read(&self) -> Cow<'_, [u8]> {
        match self {
            Self::Here(bytes) => Cow::Borrowed(bytes),
            Self::Aside { file, at, count } => {
                let mut file = lock(file);
                Cow::Owned(file.read(*at, *count).unwrap_or_else(|error| {
                    file.fault.get_or_insert_with(|| {
                        format!(
                            "a part of the path or of its steps is missing: the disk does not give it back: {error}"
                        )
                    });
                    Vec::new()
                }))
            }
        }
    }

    /// Puts them aside, if they are not yet.
    pub(crate) fn put_aside(&mut self, aside: &Aside) {
        if let Self::Here(bytes) = self {
            *self = aside.put(std::mem::take(bytes));
        }
    }
}

impl Default for Kept {
    fn default() -> Self {
        Self::Here(Box::default())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bytes(number: u8) -> Box<[u8]> {
        vec![number; 100 + usize::from(number)].into()
    }

    #[test]
    fn what_was_put_aside_comes_back_in_any_order_and_leaves_no_file() {
        let folder = tempfile::tempdir().unwrap();
        let aside = Aside::in_folder(folder.path());
        let mut kept: Vec<Kept> = (0..50).map(|number| aside.put(bytes(number))).collect();
        assert!(kept.iter().all(|kept| matches!(kept, Kept::Aside { .. })));
        kept.iter_mut().for_each(|kept| kept.put_aside(&aside));
        for number in [7, 49, 0, 7] {
            assert_eq!(kept[usize::from(number)].read(), bytes(number).as_ref());
        }
        assert_eq!(folder.path().read_dir().unwrap().count(), 0);
        assert_eq!((aside.fault(), aside.bytes()), (None, (100..150).sum()));
    }

    #[test]
    fn without_a_disk_all_stays_in_memory() {
        let full = File::options().read(true).write(true).open("/dev/full").unwrap();
        let missing = Aside::in_folder(Path::new("/no such folder"));
        for aside in [Aside::default(), missing, Aside::in_file(full)] {
            let kept = aside.put(bytes(9));
            assert!(matches!(&kept, Kept::Here(_)) && *kept.read() == *bytes(9) && aside.fault().is_none());
        }
    }

    #[test]
    fn a_disk_that_does_not_give_back_is_told_and_costs_no_more_than_that() {
        let file = tempfile::tempfile().unwrap();
        let aside = Aside::in_file(file.try_clone().unwrap());
        let kept = [1, 2].map(|number| aside.put(bytes(number)));
        file.set_len(150).unwrap();
        assert!(*kept[0].read() == *bytes(1) && kept[1].read().is_empty());
        assert!(aside.fault().unwrap().contains("the disk does not give it back"));
    }
}
