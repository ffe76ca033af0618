//! Writes a recording: from the moment that a laser is found, up to a size.

use std::fs::{self, OpenOptions};
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use lrfslam_core::time::Instant;
use lrfslam_lrf::driver::Input;

use super::sink::Sink;
use super::{CRC32, GOES_ON, HEAD, MAGIC, RecordingHeader, RecordingReader};
use crate::output::{GrowingFile, Hole};
use crate::scans::family::LrfFamily;
use crate::scans::mcap::{RAW_TOPIC, SharedMcap};

/// Where to record to, and how much.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RecordPlan {
    /// The file.
    pub path: PathBuf,
    /// The file does not get larger than this, bytes.
    pub max_bytes: u64,
    /// A file that is there already may go.
    pub overwrite: bool,
    /// Goes on in the recording of a run that was killed, of the same laser; nothing of it goes.
    pub goes_on: bool,
    /// The file is MCAP, and others write to it too.
    pub bag: Option<SharedMcap>,
}

impl RecordPlan {
    /// * `path` — a file that is not there yet; up to 2000 MB, which is four hours of the fastest laser here (a UTM-30LX, 140 kB/s)
    pub fn new(path: impl Into<PathBuf>) -> Self {
        Self { path: path.into(), max_bytes: 2_000_000_000, overwrite: false, goes_on: false, bag: None }
    }
}

/// What became of a recording.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordingReport {
    /// The file, as it was called when it began.
    pub path: PathBuf,
    /// Its size.
    pub bytes: u64,
    /// Why it ends before the run did.
    pub fault: Option<String>,
    /// When the disk had no room for it.
    pub holes: Vec<Hole>,
}

/// To the file at least this often, µs, so that little is lost however the program ends.
const SAVE_EVERY_US: i64 = 1_000_000;
/// The same into MCAP: what a kill takes is less than a second then, whatever comes together.
const SAVE_BAG_EVERY_US: i64 = 500_000;
/// To the file when so many bytes wait.
const BLOCK: usize = 1 << 16;
/// Kept of a port where no laser is found.
const SWAMPED: usize = 4 << 20;
/// The records that close a recording: a check of the last block, and the end.
const CLOSING: u64 = 2 * HEAD as u64 + 4;

#[derive(Debug)]
enum State {
    /// No laser was found yet: records wait, and there is no file.
    Waiting,
    Writing(Sink),
    Ended(Option<String>),
}

/// Writes a recording.
///
/// The file is made when a laser is found; what was before goes into it too. An older one is replaced when the first scan has come, so
/// that it is not lost for nothing: until then the new one is called FILE.part. It stays open: it may be moved, or get another name.
#[derive(Debug)]
pub struct Recorder {
    plan: RecordPlan,
    header: RecordingHeader,
    state: State,
    /// What the file is called as long as an older one is there.
    aside: Option<PathBuf>,
    /// Records that are not in the file yet.
    block: Vec<u8>,
    block_since: Option<Instant>,
    /// Of the last record.
    now: Instant,
    /// In the file.
    bytes: u64,
    /// The first record that the disk had no room for, since the last one that it had.
    missing_since: Option<Instant>,
    holes: Vec<Hole>,
}

impl Recorder {
    /// A recording that has not begun.
    ///
    /// # Errors
    /// If the file is there already and must not be overwritten, or cannot be made.
    pub fn new(plan: &RecordPlan, header: RecordingHeader) -> anyhow::Result<Self> {
        let name = plan.path.display();
        let is_there = plan.path.exists();
        anyhow::ensure!(
            plan.overwrite || plan.goes_on || !is_there,
            "{name}: is there already (--overwrite replaces it)"
        );
        anyhow::ensure!(!plan.path.is_dir(), "{name}: cannot be written: it is a folder");
        let is_other = fs::symlink_metadata(&plan.path).is_ok() && !plan.path.is_file();
        anyhow::ensure!(!is_other, "{name}: cannot be written: it is no regular file");
        tempfile::tempfile_in(folder_there(&plan.path)).with_context(|| format!("{name}: cannot be written"))?;
        let (plan, now) = (plan.clone(), Instant::default());
        Ok(Self {
            plan,
            header,
            state: State::Waiting,
            aside: None,
            block: Vec::new(),
            block_since: None,
            now,
            bytes: 0,
            missing_since: None,
            holes: Vec::new(),
        })
    }

    /// A laser of `family` was found: the recording begins with what waits.
    ///
    /// # Errors
    /// If the file cannot be made, or is there already; there is no recording then.
    pub fn begin(&mut self, family: LrfFamily) -> io::Result<()> {
        if !matches!(self.state, State::Waiting) {
            return Ok(());
        }
        self.header.lrf.family = family;
        match self.create() {
            Ok(file) => self.state = State::Writing(file),
            Err(error) => return self.end_with(error),
        }
        self.save()
    }

    fn create(&mut self) -> io::Result<Sink> {
        if self.plan.goes_on {
            return self.go_on();
        }
        let text = toml::to_string(&self.header).map_err(io::Error::other)?;
        let head = [&MAGIC[..], &(text.len() as u32).to_le_bytes(), text.as_bytes()].concat();
        self.plan.path.parent().map_or(Ok(()), fs::create_dir_all)?;
        let is_there = self.plan.overwrite && self.plan.path.exists();
        self.aside = is_there.then(|| with_part(&self.plan.path));
        let path = self.aside.as_ref().unwrap_or(&self.plan.path);
        let mut options = OpenOptions::new();
        options.write(true).create(true).truncate(true).create_new(!self.plan.overwrite);
        let file = GrowingFile::new(path, options.open(path)?);
        let mut sink = match &self.plan.bag {
            Some(bag) => {
                let channel = bag.channel(RAW_TOPIC).ok_or(ErrorKind::Unsupported)?;
                bag.begin(file, self.plan.max_bytes);
                Sink::Bag(bag.clone(), channel)
            }
            None => Sink::File(file),
        };
        // Nothing waits yet: it is taken.
        let _ = sink.write(self.now, &head);
        self.bytes = sink.bytes().unwrap_or(head.len() as u64);
        Ok(sink)
    }

    /// Behind what is there, whatever that ends with.
    fn go_on(&mut self) -> io::Result<Sink> {
        if self.plan.bag.is_some() {
            return Err(io::Error::other(
                "nothing goes on in an MCAP file: --resume needs a recording such as laser.rec",
            ));
        }
        let known = RecordingReader::open(&self.plan.path).map_err(|error| io::Error::other(format!("{error:#}")))?;
        if known.header().lrf != self.header.lrf {
            return Err(io::Error::other("it is of another laser, or of one that was asked for something else"));
        }
        let file = OpenOptions::new().append(true).open(&self.plan.path)?;
        self.bytes = file.metadata()?.len();
        let mut file = GrowingFile::new(&self.plan.path, file);
        let mut block = Vec::new();
        push(&mut block, b'n', self.now, GOES_ON);
        seal(&mut block, self.now);
        let _ = file.write(&block);
        self.bytes += block.len() as u64;
        Ok(Sink::File(file))
    }

    /// A scan has come: what was recorded takes the place of an older file.
    ///
    /// # Errors
    /// If it cannot; there is no more recording then.
    pub fn scan_came(&mut self) -> io::Result<()> {
        match self.aside.take() {
            Some(aside) if matches!(self.state, State::Writing(_)) => {
                let replaced = fs::rename(&aside, &self.plan.path);
                replaced.or_else(|error| {
                    self.aside = Some(aside);
                    self.end_with(error)
                })
            }
            aside => {
                self.aside = aside;
                Ok(())
            }
        }
    }

    /// Forgets what waits: no laser was found with it.
    pub fn forget(&mut self) {
        if matches!(self.state, State::Waiting) {
            self.block.clear();
            self.block_since = None;
        }
    }

    /// True if more waits than is worth keeping.
    pub fn is_swamped(&self) -> bool {
        matches!(self.state, State::Waiting) && self.block.len() > SWAMPED
    }

    /// An input that the driver is given.
    ///
    /// # Errors
    /// If it is as large as it may get: said once, and nothing is written any more.
    pub fn input(&mut self, now: Instant, input: Input<'_>) -> io::Result<()> {
        match input {
            Input::Connected => self.record(b'c', now, b""),
            Input::Disconnected => self.record(b'd', now, b""),
            Input::Bytes(bytes) => self.record(b'<', now, bytes),
            Input::Timeout => self.record(b't', now, b""),
            Input::Stop => self.record(b's', now, b""),
        }
    }

    /// Bytes that the driver sends.
    ///
    /// # Errors
    /// As [`input`](Self::input).
    pub fn sent(&mut self, now: Instant, bytes: &[u8]) -> io::Result<()> {
        self.record(b'>', now, bytes)
    }

    /// A rate that the driver sets.
    ///
    /// # Errors
    /// As [`input`](Self::input).
    pub fn baud(&mut self, now: Instant, baud: u32) -> io::Result<()> {
        self.record(b'b', now, &baud.to_le_bytes())
    }

    fn record(&mut self, kind: u8, now: Instant, payload: &[u8]) -> io::Result<()> {
        if let State::Ended(_) = self.state {
            return Ok(());
        }
        self.now = now;
        let after = self.bytes + self.block.len() as u64 + HEAD as u64 + payload.len() as u64;
        if matches!(self.state, State::Writing(_)) && after + CLOSING > self.plan.max_bytes {
            self.close()?;
            let text = format!("full at {} MB (--record-max)", self.plan.max_bytes / 1_000_000);
            return self.end_with(io::Error::new(ErrorKind::FileTooLarge, text));
        }
        push(&mut self.block, kind, now, payload);
        let since = *self.block_since.get_or_insert(now);
        let wait_us = if self.plan.bag.is_some() { SAVE_BAG_EVERY_US } else { SAVE_EVERY_US };
        let is_due = now.since(since).micros > wait_us || self.block.len() > BLOCK;
        if is_due { self.save() } else { Ok(()) }
    }

    /// Puts what waits into the file at once, and its check behind it; what the disk has no room for, and memory neither, is missing.
    fn save(&mut self) -> io::Result<()> {
        let State::Writing(sink) = &mut self.state else { return Ok(()) };
        let Some(since) = self.block_since.take() else { return Ok(()) };
        let mut block = Vec::new();
        if let Some(from) = self.missing_since {
            let times = [from.micros.to_le_bytes(), since.micros.to_le_bytes()].concat();
            push(&mut block, b'm', since, &times);
        }
        block.append(&mut self.block);
        seal(&mut block, self.now);
        match sink.write(self.now, &block) {
            Ok(()) => {
                self.bytes = sink.bytes().unwrap_or(self.bytes + block.len() as u64);
                self.missing_since = None;
            }
            Err(_) => self.missing_since = self.missing_since.or(Some(since)),
        }
        self.holes = sink.holes();
        Ok(())
    }

    /// What there is to tell of the disk.
    pub fn news(&mut self) -> Option<String> {
        match &mut self.state {
            State::Writing(sink) => sink.news(),
            State::Waiting | State::Ended(_) => None,
        }
    }

    /// The last check, and the end.
    fn close(&mut self) -> io::Result<()> {
        self.save()?;
        let State::Writing(sink) = &mut self.state else { return Ok(()) };
        push(&mut self.block, b'e', self.now, b"");
        if sink.write(self.now, &self.block).is_ok() {
            self.bytes = sink.bytes().unwrap_or(self.bytes + self.block.len() as u64);
        }
        let written = sink.finish();
        self.holes = sink.holes();
        written.or_else(|error| self.end_with(error))
    }

    /// There is no more recording, for this reason.
    fn end_with(&mut self, error: io::Error) -> io::Result<()> {
        self.state = State::Ended(Some(error.to_string()));
        self.block = Vec::new();
        Err(error)
    }

    /// Puts everything into the file, and says in it that this is all.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn finish(&mut self) -> io::Result<()> {
        let closed = self.close();
        if let State::Writing(_) = self.state {
            self.state = State::Ended(self.aside.as_ref().map(|_| "no scan came: the older file stays".to_owned()));
        }
        self.aside.take().map_or(Ok(()), fs::remove_file)?;
        closed
    }

    /// What became of it; `None` if no laser was found.
    pub fn report(&self) -> Option<RecordingReport> {
        let fault = match &self.state {
            State::Waiting => return None,
            State::Writing(_) => None,
            State::Ended(fault) => fault.clone(),
        };
        Some(RecordingReport { path: self.plan.path.clone(), bytes: self.bytes, fault, holes: self.holes.clone() })
    }
}

/// The folder of `path`, or as much of it as is there: the rest is made with the file.
fn folder_there(path: &Path) -> &Path {
    let whole = path.ancestors().skip(1).find(|folder| folder.exists());
    whole.unwrap_or(Path::new("."))
}

/// `FILE` → `FILE.part`.
fn with_part(path: &Path) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(".part");
    name.into()
}

fn push(block: &mut Vec<u8>, kind: u8, now: Instant, payload: &[u8]) {
    block.push(kind);
    block.extend_from_slice(&now.micros.to_le_bytes());
    block.extend_from_slice(&(payload.len() as u32).to_le_bytes());
    block.extend_from_slice(payload);
}

/// The check of a block, behind it.
fn seal(block: &mut Vec<u8>, now: Instant) {
    let check = CRC32.checksum(block);
    push(block, b'#', now, &check.to_le_bytes());
}

#[cfg(test)]
mod tests;
