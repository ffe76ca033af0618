//! Files that grow while a run goes on: neither a disk that is full nor one that is slow ends the run.
//!
//! What the disk does not take waits in memory, up to [`HELD_MAX`], and is written when there is room. Beyond that it is not kept: a
//! [`Hole`], which is told. What was written is put on disk by a thread of its own, every [`SYNC_EVERY`]: a power cut takes no more.

use std::fmt;
use std::fs::File;
use std::io::{self, ErrorKind, Write as _};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use serde::Serialize;

use super::beside::sync_folder;
use super::folder::shown;

/// Bytes that wait for a disk without room: a quarter of an hour of most lasers and robots.
pub const HELD_MAX: usize = 16 << 20;
/// From putting what was written on disk to doing it again.
pub const SYNC_EVERY: Duration = Duration::from_secs(3);
/// A disk that refused is asked again after so long.
const RETRY: Duration = Duration::from_millis(500);
/// More holes are told as one.
const HOLES_MAX: usize = 100;

/// What is missing in a file that grows.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Hole {
    /// From when, s since 1970 on this computer's clock …
    pub from_s: f64,
    /// … to when.
    pub to_s: f64,
    /// How much, bytes.
    pub bytes: u64,
}

impl fmt::Display for Hole {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let at = |seconds: f64| {
            let time = UNIX_EPOCH + Duration::from_secs_f64(seconds.clamp(0.0, 2e11));
            humantime::format_rfc3339_seconds(time)
        };
        write!(out, "{} to {} ({} bytes)", at(self.from_s), at(self.to_s), self.bytes)
    }
}

/// There is no room in memory either; nothing of it was kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NoRoom;

/// A file that grows while a run goes on, and survives a full disk and a kill.
#[derive(Debug)]
pub struct GrowingFile {
    name: PathBuf,
    file: Arc<File>,
    /// Accepted, and not in the file yet.
    waiting: Vec<u8>,
    held_max: usize,
    /// Since when the disk refuses, and when it was asked last.
    refused: Option<[Instant; 2]>,
    hole: Option<Hole>,
    holes: Vec<Hole>,
    news: Option<String>,
    syncing: Syncing,
}

impl GrowingFile {
    /// Goes on at the end of `file`, which is called `name`. Its name is on disk when this returns.
    pub fn new(name: &Path, file: File) -> Self {
        if let Some(folder) = name.parent() {
            sync_folder(folder);
        }
        let file = Arc::new(file);
        let syncing = Syncing::of(&file);
        Self {
            name: shown(name),
            file,
            waiting: Vec::new(),
            held_max: HELD_MAX,
            refused: None,
            hole: None,
            holes: Vec::new(),
            news: None,
            syncing,
        }
    }

    /// Takes all of `bytes`: they are with the system, or wait for the disk.
    ///
    /// # Errors
    /// [`NoRoom`] if too much waits already: they are left out then, and counted in a [`Hole`].
    pub fn write(&mut self, bytes: &[u8]) -> Result<(), NoRoom> {
        self.flush_if_due();
        if self.waiting.len() + bytes.len() > self.held_max && !self.waiting.is_empty() {
            self.leave_out(bytes.len());
            return Err(NoRoom);
        }
        self.close_hole();
        self.waiting.extend_from_slice(bytes);
        if self.refused.is_none() {
            self.flush();
        }
        Ok(())
    }

    fn flush_if_due(&mut self) {
        if self.refused.is_some_and(|[_, asked]| asked.elapsed() >= RETRY) {
            self.flush();
        }
    }

    /// Writes what waits, as far as the disk takes it.
    fn flush(&mut self) {
        let mut written = 0;
        let refusal = loop {
            match (&*self.file).write(&self.waiting[written..]) {
                Ok(0) if written < self.waiting.len() => break Some(ErrorKind::WriteZero.into()),
                Ok(count) => written += count,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => break Some(error),
            }
            if written == self.waiting.len() {
                break None;
            }
        };
        self.waiting.drain(..written);
        self.syncing.is_dirty.store(true, Ordering::Relaxed);
        let now = Instant::now();
        match (refusal, self.refused) {
            (Some(error), None) => {
                self.refused = Some([now; 2]);
                let name = self.name.display();
                self.news = Some(format!("{name}: cannot be written: {error}; going on, what comes waits in memory"));
            }
            (Some(_), Some([since, _])) => self.refused = Some([since, now]),
            (None, Some(_)) => {
                self.refused = None;
                self.waiting.shrink_to(1 << 16);
                self.news = Some(format!("{}: is written again{}", self.name.display(), self.missing()));
            }
            (None, None) => {}
        }
    }

    fn leave_out(&mut self, bytes: usize) {
        let now_s = now_s();
        let hole = self.hole.get_or_insert_with(|| {
            let (name, held) = (self.name.display(), self.held_max >> 20);
            self.news = Some(format!("{name}: still cannot be written, and {held} MB wait: from now on it has a hole"));
            Hole { from_s: now_s, to_s: now_s, bytes: 0 }
        });
        hole.to_s = now_s;
        hole.bytes += bytes as u64;
    }

    fn close_hole(&mut self) {
        let Some(hole) = self.hole.take() else { return };
        let is_full = self.holes.len() == HOLES_MAX;
        match self.holes.last_mut().filter(|_| is_full) {
            Some(last) => (last.to_s, last.bytes) = (hole.to_s, last.bytes + hole.bytes),
            None => self.holes.push(hole),
        }
    }

    fn missing(&self) -> String {
        let last = self.hole.or(self.holes.last().copied());
        last.map_or("; nothing is missing".to_owned(), |hole| format!("; missing in it is {hole}"))
    }

    /// What is missing so far, in order.
    pub fn holes(&self) -> Vec<Hole> {
        self.holes.iter().copied().chain(self.hole).collect()
    }

    /// What there is to tell: that the disk refuses, that there is a hole, that it works again. Each once.
    pub fn news(&mut self) -> Option<String> {
        self.news.take()
    }

    /// Writes what waits, and puts all on disk.
    ///
    /// # Errors
    /// If it cannot be written: what waited is missing then.
    pub fn finish(&mut self) -> io::Result<()> {
        self.flush();
        self.close_hole();
        if !self.waiting.is_empty() {
            let bytes = std::mem::take(&mut self.waiting).len();
            self.leave_out(bytes);
            self.close_hole();
            self.news = None;
            return Err(io::Error::other(format!("{bytes} bytes at its end found no room on the disk")));
        }
        self.file.sync_all()
    }
}

fn now_s() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs_f64()
}

/// A thread that puts what was written on disk; it ends with this.
#[derive(Debug)]
struct Syncing {
    is_dirty: Arc<AtomicBool>,
    _end: Sender<()>,
}

impl Syncing {
    fn of(file: &Arc<File>) -> Self {
        let (end, ended) = channel();
        let (is_dirty, file) = (Arc::new(AtomicBool::new(true)), Arc::downgrade(file));
        let flag = is_dirty.clone();
        std::thread::spawn(move || {
            while ended.recv_timeout(SYNC_EVERY) == Err(RecvTimeoutError::Timeout) {
                let Some(file) = file.upgrade() else { return };
                if flag.swap(false, Ordering::Relaxed) {
                    // A disk that fails says so when it is written to.
                    let _ = file.sync_data();
                }
            }
        });
        Self { is_dirty, _end: end }
    }
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;
    use rustix::fs::{OFlags, fcntl_setfl};
    use std::io::Read as _;

    /// A pipe takes 64 KiB, and more when somebody reads: a disk that gets full, and has room again.
    #[test]
    fn what_the_disk_refuses_waits_and_what_memory_has_no_room_for_is_a_hole() {
        let (mut reader, writer) = io::pipe().unwrap();
        fcntl_setfl(&writer, OFlags::NONBLOCK).unwrap();
        let writer = File::from(std::os::fd::OwnedFd::from(writer));
        let mut file = GrowingFile { held_max: 100_000, ..GrowingFile::new(Path::new("a.rec"), writer) };
        let block = |number: u8| vec![number; 10_000];
        let taken: Vec<u8> = (0..30).filter(|number| file.write(&block(*number)).is_ok()).collect();
        assert_eq!(taken, (0..16).collect::<Vec<u8>>(), "65536 bytes of pipe, 100000 of memory");
        assert!(file.news().unwrap().contains("from now on it has a hole"));
        assert_eq!(file.holes().iter().map(|hole| hole.bytes).collect::<Vec<_>>(), [140_000]);
        let mut read = vec![0; 60_000];
        reader.read_exact(&mut read).unwrap();
        std::thread::sleep(RETRY);
        file.write(&block(30)).unwrap();
        let mut more = vec![0; 60_000];
        reader.read_exact(&mut more).unwrap();
        read.append(&mut more);
        std::thread::sleep(RETRY);
        file.write(&block(31)).unwrap();
        assert!(file.news().unwrap().contains("is written again; missing in it is "));
        assert!(file.holes().len() == 1 && file.holes()[0].from_s <= file.holes()[0].to_s);
        let _ = file.finish();
        drop(file);
        reader.read_to_end(&mut read).unwrap();
        let wanted: Vec<u8> = (0..16).chain(30..32).flat_map(block).collect();
        assert!(read == wanted, "{} bytes of {}", read.len(), wanted.len());
    }

    #[test]
    fn what_never_found_room_is_told_at_the_end() {
        let full = File::options().write(true).open("/dev/full").unwrap();
        let mut file = GrowingFile::new(Path::new("a.rec"), full);
        file.write(b"abc").unwrap();
        let news = file.news().unwrap();
        assert!(news.contains("a.rec: cannot be written") && news.contains("going on"), "{news}");
        assert!(file.finish().unwrap_err().to_string().contains("3 bytes at its end found no room"));
        assert_eq!(file.holes().len(), 1);
    }
}
