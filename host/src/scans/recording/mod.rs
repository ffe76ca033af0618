//! Recordings of a laser's bytes: everything its driver was given and gave, with times, so that it replays exactly.
//!
//! # Format, version 1
//! All numbers little-endian. The file begins with the 8 bytes `LRFREC01`, a `u32` length, and that many bytes of TOML:
//! the [`RecordingHeader`]. Then records until the end of the file:
//!
//! | bytes | what |
//! | --- | --- |
//! | 1 | kind: `<` received, `>` sent, `b` rate set (payload `u32`, bit/s), `c` connected, `d` disconnected, `t` timeout, `s` stop, `#` check, `e` end |
//! | 8 | `i64`: time on the host's clock, µs since 1970 |
//! | 4 | `u32`: length of the payload |
//! | … | payload |
//!
//! A check's payload is a `u32`: CRC-32 (ISO-HDLC) of the records since the one before, or since the header. An end says that
//! the recording was closed, and not cut; older recordings have neither. A file may end anywhere: a record that is cut is left
//! out. New kinds may come; a reader skips those it does not know.

mod recorder;

use std::fmt;
use std::fs::File;
use std::io::{BufReader, ErrorKind, Read};
use std::path::Path;

use anyhow::{Context as _, bail};
use crc::{CRC_32_ISO_HDLC, Crc, Digest};
use lrfslam_core::time::Instant;
use lrfslam_lrf::driver::Input;
use serde::{Deserialize, Serialize};

use crate::scans::family::LrfOptions;

pub use recorder::{RecordPlan, Recorder, RecordingReport};

const MAGIC: &[u8; 8] = b"LRFREC01";
/// Longer payloads are not written, and not believed.
const MAX_PAYLOAD: usize = 1 << 16;
/// A record without its payload, bytes.
const HEAD: usize = 13;
static CRC32: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);

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

/// How a recording ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RecordingEnd {
    /// It was closed.
    Whole,
    /// It stops, as after a program that was killed.
    Cut,
    /// It is not what was written.
    Damaged {
        /// The record, or the first of several, that is wrong begins here.
        at_byte: u64,
    },
}

impl fmt::Display for RecordingEnd {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Whole => out.write_str("the recording is whole"),
            Self::Cut => out.write_str("the recording ends in the middle (was the program killed?)"),
            Self::Damaged { at_byte } => {
                write!(out, "the recording is damaged from byte {at_byte} on; what comes behind it was not read")
            }
        }
    }
}

/// Reads a recording, record by record, up to its end, cut or damage.
pub struct RecordingReader<R = BufReader<File>> {
    input: R,
    header: RecordingHeader,
    /// Bytes read.
    at: u64,
    /// The records since the last check begin here, and their sum.
    checked: u64,
    sum: Digest<'static, u32>,
    has_checks: bool,
    end: Option<RecordingEnd>,
}

impl<R> fmt::Debug for RecordingReader<R> {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.debug_struct("RecordingReader").field("header", &self.header).field("at", &self.at).finish_non_exhaustive()
    }
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
        let mut length = [0; 4];
        input.read_exact(&mut length).context("cut within its header")?;
        let length = u32::from_le_bytes(length) as usize;
        anyhow::ensure!(length <= MAX_PAYLOAD, "damaged header");
        let mut text = vec![0; length];
        input.read_exact(&mut text).context("cut within its header")?;
        let text = String::from_utf8(text).context("damaged header")?;
        let header = toml::from_str(&text).context("damaged header")?;
        let at = (MAGIC.len() + 4 + length) as u64;
        Ok(Self { input, header, at, checked: at, sum: CRC32.digest(), has_checks: false, end: None })
    }

    /// What the recording is of.
    pub fn header(&self) -> &RecordingHeader {
        &self.header
    }

    /// How it ended, once it has been read to its end.
    pub fn end(&self) -> Option<RecordingEnd> {
        self.end
    }

    fn next_known(&mut self) -> Result<(Instant, Entry), RecordingEnd> {
        loop {
            let (begin, (kind, time, payload)) = (self.at, self.next_record()?);
            match kind {
                b'#' => self.check(&payload)?,
                // A recording is closed with a check: something between them is damage.
                b'e' if begin == self.checked => return Err(RecordingEnd::Whole),
                b'e' => return Err(RecordingEnd::Damaged { at_byte: self.checked }),
                kind => {
                    if let Some(entry) = Entry::parse(kind, payload) {
                        return Ok((Instant::from_micros(time), entry));
                    }
                }
            }
        }
    }

    /// Kind, time, payload.
    fn next_record(&mut self) -> Result<(u8, i64, Vec<u8>), RecordingEnd> {
        let damaged = RecordingEnd::Damaged { at_byte: self.at };
        let mut head = [0; HEAD];
        match self.fill(&mut head)? {
            0 if !self.has_checks => return Err(RecordingEnd::Whole),
            HEAD => {}
            _ => return Err(RecordingEnd::Cut),
        }
        let [kind, t0, t1, t2, t3, t4, t5, t6, t7, length @ ..] = head;
        let length = u32::from_le_bytes(length) as usize;
        if length > MAX_PAYLOAD {
            return Err(damaged);
        }
        let mut payload = vec![0; length];
        if self.fill(&mut payload)? < length {
            return Err(RecordingEnd::Cut);
        }
        if kind != b'#' {
            self.sum.update(&head);
            self.sum.update(&payload);
        }
        Ok((kind, i64::from_le_bytes([t0, t1, t2, t3, t4, t5, t6, t7]), payload))
    }

    fn check(&mut self, payload: &[u8]) -> Result<(), RecordingEnd> {
        let sum = std::mem::replace(&mut self.sum, CRC32.digest()).finalize();
        if payload != sum.to_le_bytes() {
            return Err(RecordingEnd::Damaged { at_byte: self.checked });
        }
        (self.checked, self.has_checks) = (self.at, true);
        Ok(())
    }

    /// Reads as much as there is; a disk that cannot be read is damage.
    fn fill(&mut self, buffer: &mut [u8]) -> Result<usize, RecordingEnd> {
        let mut filled = 0;
        while filled < buffer.len() {
            match self.input.read(&mut buffer[filled..]) {
                Ok(0) => break,
                Ok(count) => filled += count,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(_) => return Err(RecordingEnd::Damaged { at_byte: self.at }),
            }
        }
        self.at += filled as u64;
        Ok(filled)
    }
}

impl<R: Read> Iterator for RecordingReader<R> {
    type Item = (Instant, Entry);
    fn next(&mut self) -> Option<Self::Item> {
        if self.end.is_some() {
            return None;
        }
        self.next_known().map_err(|end| self.end = Some(end)).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scans::family::LrfFamily;

    fn header() -> RecordingHeader {
        RecordingHeader { program: "test".into(), port: "none".into(), lrf: LrfOptions::new(LrfFamily::Hokuyo) }
    }

    /// Two blocks: what waited for a laser to be found, and what came then.
    fn recording() -> Vec<u8> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.lrfrec");
        let mut recorder = Recorder::new(&RecordPlan::new(&path), header()).unwrap();
        let at = Instant::from_micros;
        recorder.input(at(1), Input::Connected).unwrap();
        recorder.sent(at(2), b"QT\n").unwrap();
        recorder.baud(at(2), 19_200).unwrap();
        assert!(!path.exists(), "no laser was found yet");
        recorder.begin(LrfFamily::Hokuyo).unwrap();
        recorder.input(at(3), Input::Bytes(b"QT\n00P\n\n")).unwrap();
        recorder.input(at(4), Input::Timeout).unwrap();
        recorder.finish().unwrap();
        let bytes = std::fs::read(&path).unwrap();
        assert_eq!(recorder.report(), Some(RecordingReport { path, bytes: bytes.len() as u64, fault: None }));
        bytes
    }

    /// How many records there are, and how it ends.
    fn read(bytes: &[u8]) -> Option<(usize, RecordingEnd)> {
        let mut reader = RecordingReader::new(bytes).ok()?;
        let count = reader.by_ref().count();
        Some((count, reader.end().expect("read to its end")))
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
    fn cut_anywhere_it_reads_up_to_the_cut_and_says_so() {
        let bytes = recording();
        let mut last = 0;
        for cut in 0..bytes.len() {
            let Some((count, end)) = read(&bytes[..cut]) else { continue };
            assert!(count == last || count == last + 1);
            last = count;
            // Before its first check it looks like an old one, which has none.
            assert!(end == RecordingEnd::Cut || count < 4 && end == RecordingEnd::Whole, "{cut}: {end}");
        }
        assert_eq!((last, read(&bytes)), (5, Some((5, RecordingEnd::Whole))));
    }

    #[test]
    fn damage_anywhere_is_found_unless_it_changes_nothing() {
        let bytes = recording();
        let entries = |bytes: &[u8]| RecordingReader::new(bytes).unwrap().collect::<Vec<_>>();
        let begin = 12 + u32::from_le_bytes(bytes[8..12].try_into().unwrap()) as usize;
        for at in begin..bytes.len() {
            let mut damaged = bytes.clone();
            damaged[at] ^= 1;
            let (_, end) = read(&damaged).expect("its header is whole");
            assert!(end != RecordingEnd::Whole || entries(&damaged) == entries(&bytes), "byte {at}");
        }
    }

    #[test]
    fn recordings_without_checks_are_read_as_ever() {
        let bytes = recording();
        let begin = 12 + u32::from_le_bytes(bytes[8..12].try_into().unwrap()) as usize;
        let old = [&bytes[..begin], b"c\x01\0\0\0\0\0\0\0\0\0\0\0", b"t\x02\0\0\0\0\0\0\0\0\0\0\0"].concat();
        assert_eq!(read(&old), Some((2, RecordingEnd::Whole)));
        assert_eq!(read(&old[..old.len() - 1]), Some((1, RecordingEnd::Cut)));
        let too_long = [&old[..], b"<\x03\0\0\0\0\0\0\0\xFF\xFF\xFF\x7F"].concat();
        assert_eq!(read(&too_long), Some((2, RecordingEnd::Damaged { at_byte: old.len() as u64 })));
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
