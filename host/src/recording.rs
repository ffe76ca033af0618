//! Recordings of a laser's bytes: everything its driver was given and gave, with times, so that it replays exactly.
//!
//! # Format, version 1
//! All numbers little-endian. The file begins with the 8 bytes `LRFREC01`, a `u32` length, and that many bytes of TOML:
//! the [`RecordingHeader`]. Then records until the end of the file:
//!
//! | bytes | what |
//! | --- | --- |
//! | 1 | kind: `<` received, `>` sent, `b` rate set (payload `u32`, bit/s), `c` connected, `d` disconnected, `t` timeout, `s` stop |
//! | 8 | `i64`: time on the host's clock, µs since 1970 |
//! | 4 | `u32`: length of the payload |
//! | … | payload |
//!
//! A file may end anywhere: a record that is cut is left out. New kinds may come; a reader skips those it does not know.

use std::fs::File;
use std::io::{self, BufReader, BufWriter, Read, Write};
use std::path::Path;

use anyhow::{Context as _, bail};
use lrfslam_core::lrf::driver::Input;
use lrfslam_core::time::Instant;
use serde::{Deserialize, Serialize};

use crate::driver::LrfOptions;

const MAGIC: &[u8; 8] = b"LRFREC01";
/// Longer payloads are not written, and not believed.
const MAX_PAYLOAD: usize = 1 << 20;

/// What a replay must know before the first byte.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RecordingHeader {
    /// Program and version that wrote it.
    pub program: String,
    /// Port, for people.
    pub port: String,
    /// The driver and its options.
    pub lrf: LrfOptions,
}

/// One record.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Entry {
    /// The port is open.
    Connected,
    /// The port is gone.
    Disconnected,
    /// Bytes received.
    Received(Vec<u8>),
    /// The driver's deadline came.
    Timeout,
    /// The driver was asked to stop.
    Stop,
    /// Bytes sent.
    Sent(Vec<u8>),
    /// A rate set, bit/s.
    Baud(u32),
}

impl Entry {
    /// The driver's input that this records; `None` for what it gave.
    pub fn input(&self) -> Option<Input<'_>> {
        match self {
            Entry::Connected => Some(Input::Connected),
            Entry::Disconnected => Some(Input::Disconnected),
            Entry::Received(bytes) => Some(Input::Bytes(bytes)),
            Entry::Timeout => Some(Input::Timeout),
            Entry::Stop => Some(Input::Stop),
            Entry::Sent(_) | Entry::Baud(_) => None,
        }
    }

    fn parse(kind: u8, payload: Vec<u8>) -> Option<Self> {
        match kind {
            b'c' => Some(Entry::Connected),
            b'd' => Some(Entry::Disconnected),
            b'<' => Some(Entry::Received(payload)),
            b't' => Some(Entry::Timeout),
            b's' => Some(Entry::Stop),
            b'>' => Some(Entry::Sent(payload)),
            b'b' => payload.try_into().ok().map(|rate| Entry::Baud(u32::from_le_bytes(rate))),
            _ => None,
        }
    }
}

/// Writes a recording.
#[derive(Debug)]
pub struct Recorder {
    out: BufWriter<File>,
    unsaved_since: Option<Instant>,
}

impl Recorder {
    /// Begins a recording in a new file, or over an old one.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn create(path: &Path, header: &RecordingHeader) -> anyhow::Result<Self> {
        let named = || format!("{}: cannot be written", path.display());
        let text = toml::to_string(header).with_context(named)?;
        let mut out = BufWriter::new(File::create(path).with_context(named)?);
        let begun = out.write_all(MAGIC).and_then(|()| out.write_all(&(text.len() as u32).to_le_bytes()));
        begun.and_then(|()| out.write_all(text.as_bytes())).and_then(|()| out.flush()).with_context(named)?;
        Ok(Self { out, unsaved_since: None })
    }

    /// An input that the driver is given.
    ///
    /// # Errors
    /// If the file cannot be written.
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
    /// If the file cannot be written.
    pub fn sent(&mut self, now: Instant, bytes: &[u8]) -> io::Result<()> {
        self.record(b'>', now, bytes)
    }

    /// A rate that the driver sets.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn baud(&mut self, now: Instant, baud: u32) -> io::Result<()> {
        self.record(b'b', now, &baud.to_le_bytes())
    }

    /// To the file at least every second, so that little is lost however the program ends.
    fn record(&mut self, kind: u8, now: Instant, payload: &[u8]) -> io::Result<()> {
        let mut head = [kind; 13];
        head[1..9].copy_from_slice(&now.micros.to_le_bytes());
        head[9..].copy_from_slice(&(payload.len() as u32).to_le_bytes());
        self.out.write_all(&head)?;
        self.out.write_all(payload)?;
        let since = *self.unsaved_since.get_or_insert(now);
        if now.since(since).micros > 1_000_000 {
            self.unsaved_since = None;
            self.out.flush()?;
        }
        Ok(())
    }

    /// Puts everything into the file.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn finish(mut self) -> io::Result<()> {
        self.out.flush()
    }
}

/// Reads a recording, record by record, up to its end or cut.
#[derive(Debug)]
pub struct RecordingReader<R = BufReader<File>> {
    input: R,
    header: RecordingHeader,
}

impl RecordingReader {
    /// Opens a recording.
    ///
    /// # Errors
    /// If the file cannot be read, or is none.
    pub fn open(path: &Path) -> anyhow::Result<Self> {
        let named = || path.display().to_string();
        let file = File::open(path).with_context(named)?;
        Self::new(BufReader::new(file)).with_context(named)
    }
}

impl<R: Read> RecordingReader<R> {
    /// Reads the header.
    ///
    /// # Errors
    /// If it is none, or of a version not known.
    pub fn new(mut input: R) -> anyhow::Result<Self> {
        let mut magic = [0; 8];
        let read = input.read_exact(&mut magic);
        if read.is_err() || magic[..6] != MAGIC[..6] {
            bail!("not a recording of a laser range finder (it does not begin with LRFREC)");
        }
        if magic != *MAGIC {
            bail!("a recording of version {}, which this program does not know", String::from_utf8_lossy(&magic[6..]));
        }
        let text = read_block(&mut input).context("cut within its header")?;
        let text = String::from_utf8(text).context("damaged header")?;
        let header = toml::from_str(&text).context("damaged header")?;
        Ok(Self { input, header })
    }

    /// What the recording is of.
    pub fn header(&self) -> &RecordingHeader {
        &self.header
    }

    fn next_known(&mut self) -> Option<(Instant, Entry)> {
        loop {
            let mut head = [0; 9];
            self.input.read_exact(&mut head).ok()?;
            let [kind, time @ ..] = head;
            let payload = read_block(&mut self.input)?;
            if let Some(entry) = Entry::parse(kind, payload) {
                return Some((Instant::from_micros(i64::from_le_bytes(time)), entry));
            }
        }
    }
}

/// A length and so many bytes; `None` if cut, or impossibly long.
fn read_block(input: &mut impl Read) -> Option<Vec<u8>> {
    let mut length = [0; 4];
    input.read_exact(&mut length).ok()?;
    let length = u32::from_le_bytes(length) as usize;
    if length > MAX_PAYLOAD {
        return None;
    }
    let mut payload = vec![0; length];
    input.read_exact(&mut payload).ok()?;
    Some(payload)
}

impl<R: Read> Iterator for RecordingReader<R> {
    type Item = (Instant, Entry);
    fn next(&mut self) -> Option<Self::Item> {
        self.next_known()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::driver::LrfFamily;

    fn header() -> RecordingHeader {
        RecordingHeader { program: "test".into(), port: "none".into(), lrf: LrfOptions::new(LrfFamily::Hokuyo) }
    }

    fn recording() -> Vec<u8> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.lrfrec");
        let mut recorder = Recorder::create(&path, &header()).unwrap();
        let at = Instant::from_micros;
        recorder.input(at(1), Input::Connected).unwrap();
        recorder.sent(at(2), b"QT\n").unwrap();
        recorder.baud(at(2), 19_200).unwrap();
        recorder.input(at(3), Input::Bytes(b"QT\n00P\n\n")).unwrap();
        recorder.input(at(4), Input::Timeout).unwrap();
        recorder.finish().unwrap();
        std::fs::read(path).unwrap()
    }

    #[test]
    fn what_is_written_is_read_back() {
        let bytes = recording();
        let reader = RecordingReader::new(&bytes[..]).unwrap();
        assert_eq!(*reader.header(), header());
        let entries: Vec<(i64, Entry)> = reader.map(|(at, entry)| (at.micros, entry)).collect();
        let expected = [
            (1, Entry::Connected),
            (2, Entry::Sent(b"QT\n".to_vec())),
            (2, Entry::Baud(19_200)),
            (3, Entry::Received(b"QT\n00P\n\n".to_vec())),
            (4, Entry::Timeout),
        ];
        assert_eq!(entries, expected);
    }

    #[test]
    fn cut_anywhere_it_reads_up_to_the_cut() {
        let bytes = recording();
        let mut last = 0;
        for cut in 0..bytes.len() {
            let Ok(reader) = RecordingReader::new(&bytes[..cut]) else { continue };
            let count = reader.count();
            assert!(count == last || count == last + 1);
            last = count;
        }
        assert_eq!(last, 4, "all but the last, which is cut by a byte");
    }

    #[test]
    fn other_files_are_refused_in_words() {
        for (bytes, words) in [
            (&b"CARMEN log"[..], "does not begin with LRFREC"),
            (b"LRFREC99....", "version 99"),
            (b"LRFREC01\x10\0\0\0abc", "cut"),
        ] {
            let error = format!("{:#}", RecordingReader::new(bytes).unwrap_err());
            assert!(error.contains(words), "{error}");
        }
    }
}
