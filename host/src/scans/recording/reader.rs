//! Reads a recording, and says how much of what was written it is.

use std::fmt;
use std::fs::File;
use std::io::{BufReader, Read, Seek as _, SeekFrom};
use std::path::Path;

use anyhow::{Context as _, bail};
use lrfslam_core::time::Instant;

use super::blocks::{Blocks, Damage};
use super::{Entry, HEAD, MAGIC, MAX_PAYLOAD, RecordingHeader};
use crate::plural::count;
use crate::scans::mcap::{RawBytes, is_mcap};

/// How a recording ended, and what of it is not what was written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RecordingEnd {
    /// It was closed; else it stops, as after a program that was killed, or a copy that was cut.
    pub is_closed: bool,
    /// Places where it is damaged …
    pub damaged_places: u32,
    /// … so many bytes that were left out there …
    pub damaged_bytes: u64,
    /// … and where the first begins; 0 without damage.
    pub damaged_at: u64,
    /// Flipped bits that were mended: all is there.
    pub mended_bits: u32,
    /// Times at which the disk had no room …
    pub holes: u32,
    /// … µs in all.
    pub missing_us: i64,
}

impl RecordingEnd {
    /// All is there that was written.
    pub const WHOLE: Self = Self {
        is_closed: true,
        damaged_places: 0,
        damaged_bytes: 0,
        damaged_at: 0,
        mended_bits: 0,
        holes: 0,
        missing_us: 0,
    };

    /// All that the laser said is there, if need be mended.
    pub fn is_whole(&self) -> bool {
        self.is_closed && self.damaged_places == 0 && self.holes == 0
    }
}

impl fmt::Display for RecordingEnd {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut said = Vec::new();
        if self.damaged_places > 0 {
            let Self { damaged_places, damaged_bytes, damaged_at, .. } = self;
            let places = count(u64::from(*damaged_places), "place");
            said.push(format!(
                "is damaged in {places}, the first at byte {damaged_at}: {damaged_bytes} bytes left out"
            ));
        }
        if self.mended_bits > 0 {
            said.push(format!("had {}, which was mended", count(u64::from(self.mended_bits), "flipped bit")));
        }
        if self.holes > 0 {
            let missing_s = self.missing_us as f64 * 1e-6;
            said.push(format!("lacks {missing_s:.1} s for which the disk had no room"));
        }
        if !self.is_closed {
            said.push("ends in the middle (was the program killed, or the file cut?)".to_owned());
        }
        if said.is_empty() {
            said.push("is whole".to_owned());
        }
        write!(out, "the recording {}", said.join(", "))
    }
}

/// Reads a recording, record by record, over damage to its end.
pub struct RecordingReader<R = Box<dyn Read + Send>> {
    header: RecordingHeader,
    blocks: Blocks<R>,
    /// Records that are whole, and how many bytes of them were read.
    block: (Vec<u8>, usize),
    holes: (u32, i64),
    end: Option<RecordingEnd>,
}

impl<R> fmt::Debug for RecordingReader<R> {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.debug_struct("RecordingReader")
            .field("header", &self.header)
            .field("end", &self.end)
            .finish_non_exhaustive()
    }
}

impl RecordingReader {
    /// Opens a recording: a file of its own, or a channel of an MCAP file.
    ///
    /// # Errors
    /// If the file cannot be read, or is none.
    pub fn open(path: &Path) -> anyhow::Result<Self> {
        let named = || path.display().to_string();
        let mut file = BufReader::new(File::open(path).with_context(named)?);
        let mut magic = Vec::new();
        (&mut file).take(8).read_to_end(&mut magic).with_context(named)?;
        file.seek(SeekFrom::Start(0)).with_context(named)?;
        if !is_mcap(&magic) {
            return Self::new(Box::new(file)).with_context(named);
        }
        let bytes = RawBytes::new(file).with_context(named)?;
        let bytes = bytes.context("an MCAP file without the bytes of a laser: `lrfslam map` reads its scans");
        Self::new(Box::new(bytes.with_context(named)?)).with_context(named)
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
        let blocks = Blocks::new(input, (MAGIC.len() + 4 + length) as u64);
        Ok(Self { header, blocks, block: (Vec::new(), 0), holes: (0, 0), end: None })
    }

    /// What the recording is of.
    pub fn header(&self) -> &RecordingHeader {
        &self.header
    }

    /// Records that no check vouches for, at the end of a recording that was cut, are not read.
    pub fn skip_unchecked(&mut self) {
        self.blocks.skips_unchecked = true;
    }

    /// How it ended, once it has been read to its end.
    pub fn end(&self) -> Option<RecordingEnd> {
        self.end
    }

    fn next_known(&mut self) -> Option<(Instant, Entry)> {
        loop {
            let (block, at) = &mut self.block;
            let Some((kind, time, payload)) = record(block.get(*at..)?) else {
                self.block = (self.blocks.next_block()?, 0);
                continue;
            };
            let (payload, time) = (payload.to_vec(), Instant::from_micros(time));
            *at += HEAD + payload.len();
            let Some(entry) = Entry::parse(kind, payload) else { continue };
            if let Entry::Missing([from, to]) = entry {
                self.holes.0 += 1;
                self.holes.1 = self.holes.1.saturating_add(to.saturating_sub(from).max(0));
            }
            return Some((time, entry));
        }
    }

    fn ended(&self) -> RecordingEnd {
        let Damage { places, bytes, first_at, mended } = self.blocks.damage;
        RecordingEnd {
            is_closed: self.blocks.is_closed,
            damaged_places: places,
            damaged_bytes: bytes,
            damaged_at: first_at,
            mended_bits: mended,
            holes: self.holes.0,
            missing_us: self.holes.1,
        }
    }
}

/// Kind, time and payload of the first record, if it is whole.
fn record(bytes: &[u8]) -> Option<(u8, i64, &[u8])> {
    let (kind, rest) = bytes.split_first()?;
    let (time, rest) = rest.split_first_chunk()?;
    let (length, rest) = rest.split_first_chunk()?;
    let payload = rest.get(..u32::from_le_bytes(*length) as usize)?;
    Some((*kind, i64::from_le_bytes(*time), payload))
}

impl<R: Read> Iterator for RecordingReader<R> {
    type Item = (Instant, Entry);

    fn next(&mut self) -> Option<Self::Item> {
        if self.end.is_some() {
            return None;
        }
        let next = self.next_known();
        if next.is_none() {
            self.end = Some(self.ended());
        }
        next
    }
}
