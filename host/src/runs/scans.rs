//! Scans, one after the other, wherever they come from: a log, a recording of a laser, or a laser now. **Where scans are opened.**
//!
//! Its content tells what a file is. A folder stands for the recording in it, `-` for a log from the standard input.

use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};

use anyhow::anyhow;
use lrfslam_core::scan::Echo;

use crate::input::text::ByteCount;
use crate::output::RECORDING;
use crate::results::report::{Input, LaserCounts, RecordingCounts, Source};
use crate::scans::live::{Fetch, LiveLaser, NOTICED_AFTER, Say, ScanSource, ScanStream, SourceReport};
use crate::scans::log::{LogError, LogOptions, LogReader, LogScan};
use crate::scans::recording::RecordingReader;

/// Iterator over scans; see the [module](self). An error is the last thing handed out.
pub struct Scans {
    name: String,
    stop: &'static AtomicBool,
    origin: Origin,
}

enum Origin {
    Log { reader: Box<LogReader>, is_piped: bool, is_over: bool },
    Laser { stream: Box<ScanStream>, file: Option<PathBuf>, report: Option<SourceReport>, range_max_m: Option<f32> },
}

/// A log from the standard input.
pub fn is_stdin(path: &Path) -> bool {
    path.as_os_str() == "-"
}

/// All scans of the log or recording at `path`.
///
/// # Errors
/// If it cannot be read to its end.
pub fn read_scans(path: &Path, options: LogOptions) -> anyhow::Result<Vec<LogScan>> {
    static NEVER: AtomicBool = AtomicBool::new(false);
    Scans::open(path, options, &NEVER, Box::new(|_| {}))?.collect()
}

impl Scans {
    /// The scans of a log or recording, as fast as they are taken.
    ///
    /// * `stop` — ends it early
    ///
    /// # Errors
    /// If there is none, or no scan of a log can be read.
    pub fn open(path: &Path, options: LogOptions, stop: &'static AtomicBool, mut say: Say) -> anyhow::Result<Self> {
        let (is_piped, file) = (is_stdin(path), path.display().to_string());
        if path.is_dir() && path.join(RECORDING).is_file() && !options.tf.is_any() {
            return Ok(Self::replay(path, true, stop, say)?.within(options.range_max_m));
        }
        let reader = if is_piped {
            LogReader::from_reader("-", Piped::new(io::stdin(), stop), options)
        } else {
            LogReader::open(path, options)
        };
        match reader {
            Err(LogError::Recording { .. }) if options.tf.is_any() => Err(LogError::NoFrames { file }.into()),
            Err(LogError::Recording { .. }) if !is_piped => {
                Ok(Self::replay(path, true, stop, say)?.within(options.range_max_m))
            }
            Err(error) => Err(error.into()),
            Ok(reader) => {
                reader.frames_found().iter().for_each(|found| say(found));
                let origin = Origin::Log { reader: Box::new(reader), is_piped, is_over: false };
                Ok(Self { name: file, stop, origin })
            }
        }
    }

    /// Those of a recording, or of the one in a folder; if not `fast`, they come when they came.
    ///
    /// # Errors
    /// If it is none.
    pub fn replay(path: &Path, fast: bool, stop: &'static AtomicBool, say: Say) -> anyhow::Result<Self> {
        let path = if path.is_dir() { path.join(RECORDING) } else { path.to_owned() };
        RecordingReader::open(&path)?;
        let source = ScanSource::Recording { path: path.clone(), fast };
        let stream = ScanStream::new(source, stop, say);
        Ok(Self::of(path.display().to_string(), stream, stop, Some(path)))
    }

    /// Those of a laser, from now on.
    pub fn live(laser: LiveLaser, stop: &'static AtomicBool, say: Say) -> Self {
        let name = laser.address.to_string();
        Self::of(name, ScanStream::new(ScanSource::Live(laser), stop, say), stop, None)
    }

    /// Those that others tell of a laser, from now on; `name` says where they come from.
    pub fn told(name: String, fetch: Fetch, stop: &'static AtomicBool, say: Say) -> Self {
        Self::of(name, ScanStream::of(fetch, stop, say), stop, None)
    }

    fn of(name: String, stream: ScanStream, stop: &'static AtomicBool, file: Option<PathBuf>) -> Self {
        let origin = Origin::Laser { stream: Box::new(stream), file, report: None, range_max_m: None };
        Self { name, stop, origin }
    }

    /// The same. A log's reader has been told already.
    ///
    /// * `given_m` — what a laser measures from here on are misses, m; `None`: as it says
    pub fn within(mut self, given_m: Option<f32>) -> Self {
        if let Origin::Laser { range_max_m, .. } = &mut self.origin {
            *range_max_m = given_m;
        }
        self
    }

    /// They were read by lines; otherwise by a laser's driver.
    pub fn is_log(&self) -> bool {
        matches!(self.origin, Origin::Log { .. })
    }

    /// They are taken now, and have no end of their own.
    pub fn is_live(&self) -> bool {
        matches!(self.origin, Origin::Laser { file: None, .. })
    }

    /// The recording that they are read from.
    pub fn recording(&self) -> Option<&Path> {
        match &self.origin {
            Origin::Laser { file, .. } => file.as_deref(),
            Origin::Log { .. } => None,
        }
    }

    /// Size of a log, 0 if it is not known, and how many bytes of it were read, to watch; nothing for a laser.
    pub fn progress(&self) -> Option<(u64, ByteCount)> {
        match &self.origin {
            Origin::Log { reader, .. } => Some((reader.size_bytes(), reader.bytes_read())),
            Origin::Laser { .. } => None,
        }
    }

    /// All scans that there were have been handed out; never those of a laser.
    pub fn is_at_end(&self) -> bool {
        match &self.origin {
            Origin::Log { is_over, .. } => *is_over,
            Origin::Laser { report, .. } => report.as_ref().is_some_and(|report| report.input.is_some()),
        }
    }

    /// Nothing more is wanted: a laser is stopped.
    pub fn end(&mut self) {
        // Its faults are told by the scan that does not come.
        let _ = self.stop_laser();
    }

    fn stop_laser(&mut self) -> anyhow::Result<()> {
        let Origin::Laser { stream, report, .. } = &mut self.origin else { return Ok(()) };
        let Some(ended) = stream.end() else { return Ok(()) };
        let ended = report.insert(ended?);
        ended.input_fault().map_or(Ok(()), |fault| Err(anyhow!("{}: {fault}", self.name)))
    }

    /// What they were, so far; of a log, the rest is read too if nothing more is wanted.
    pub fn source(&mut self, is_over: bool) -> Source {
        let name = self.name.clone();
        match &mut self.origin {
            Origin::Log { reader, .. } => {
                let sha256 = is_over.then(|| reader.sha256());
                let input = Input { name, sha256, bytes: reader.bytes_read().get(), format: reader.format() };
                Source::Log { input, log: reader.counts(), range_max_m: reader.range_max_m() }
            }
            Origin::Laser { report, .. } => {
                let SourceReport { counters, overrun, recording, .. } = report.clone().unwrap_or_default();
                let lrfslam_lrf::driver::Counters { damaged, restarts, incomplete, .. } = counters;
                let laser = LaserCounts { damaged, restarts, incomplete, overrun, too_fast: 0 };
                Source::Laser { port: name, laser, recording: recording.as_ref().map(RecordingCounts::from) }
            }
        }
    }
}

impl Iterator for Scans {
    type Item = anyhow::Result<LogScan>;

    fn next(&mut self) -> Option<Self::Item> {
        match &mut self.origin {
            Origin::Log { reader, is_piped, is_over } => {
                let is_stopped = || self.stop.load(Ordering::Relaxed);
                // What came through a pipe before it was stopped is used.
                if *is_over || is_stopped() && !*is_piped {
                    return None;
                }
                let next = reader.next();
                *is_over = next.is_none();
                let next = next.filter(|next| next.is_ok() || !(*is_piped && is_stopped()));
                next.map(|next| next.map_err(anyhow::Error::new))
            }
            Origin::Laser { stream, range_max_m, .. } => match stream.next() {
                Some(scan) => Some(Ok(match *range_max_m {
                    Some(range_max_m) => limited(scan, range_max_m),
                    None => scan,
                })),
                None => self.stop_laser().err().map(Err),
            },
        }
    }
}

/// The same scan; ranges from `range_max_m` (m) on are misses.
fn limited(mut scan: LogScan, range_max_m: f32) -> LogScan {
    for beam in &mut scan.beams {
        if matches!(beam.echo, Echo::Hit(range_m) if range_m >= range_max_m) {
            beam.echo = Echo::Miss;
        }
    }
    scan.range_max_m = scan.range_max_m.min(range_max_m);
    scan
}

/// The standard input, read by a thread of its own: who waits for it notices that the user wants an end.
struct Piped {
    blocks: Receiver<io::Result<Vec<u8>>>,
    block: Vec<u8>,
    taken: usize,
    stop: &'static AtomicBool,
}

impl Piped {
    fn new(mut input: impl Read + Send + 'static, stop: &'static AtomicBool) -> Self {
        let (sender, blocks) = sync_channel(0);
        // It is left behind where it waits when the program ends.
        std::thread::spawn(move || {
            loop {
                let mut block = vec![0; 1 << 16];
                let read = input.read(&mut block);
                let is_last = !matches!(read, Ok(1..));
                let read = read.map(|length| {
                    block.truncate(length);
                    block
                });
                if sender.send(read).is_err() || is_last {
                    break;
                }
            }
        });
        Self { blocks, block: Vec::new(), taken: 0, stop }
    }

    fn next_block(&self) -> io::Result<Vec<u8>> {
        loop {
            if self.stop.load(Ordering::Relaxed) {
                return Err(io::Error::other("stopped"));
            }
            match self.blocks.recv_timeout(NOTICED_AFTER) {
                Ok(block) => return block,
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return Ok(Vec::new()),
            }
        }
    }
}

impl Read for Piped {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.taken == self.block.len() {
            (self.block, self.taken) = (self.next_block()?, 0);
        }
        let count = (&self.block[self.taken..]).read(buffer)?;
        self.taken += count;
        Ok(count)
    }
}
