//! Recordings of a laser's bytes: everything its driver was given and gave, with times, so that it replays exactly.
//!
//! # Format, version 1
//! All numbers little-endian. The file begins with the 8 bytes `LRFREC01`, a `u32` length, and that many bytes of TOML:
//! the [`RecordingHeader`]. Then records until the end of the file:
//!
//! | bytes | what |
//! | --- | --- |
//! | 1 | kind: `<` received, `>` sent, `b` rate set (payload `u32`, bit/s), `c` connected, `d` disconnected, `t` timeout, `s` stop, `n` goes on, `m` missing, `#` check, `e` end |
//! | 8 | `i64`: time on the host's clock, µs since 1970 |
//! | 4 | `u32`: length of the payload |
//! | … | payload |
//!
//! A check's payload is a `u32`: CRC-32 (ISO-HDLC) of the records since the one before, or since the header. An end says that
//! the recording was closed, and not cut; older recordings have neither. A file may end anywhere: a record that is cut is left
//! out. New kinds may come; a reader skips those it does not know.
//!
//! What goes on is a new program, with a driver that knows nothing yet, that goes on in the file of one that was killed; its payload is `LRFREC goes on`. What is
//! behind the last check before it does not count: nobody has vouched for it. What is missing found no room on the disk: two `i64`, from when to when,
//! µs since 1970.
//!
//! # Damage
//! A block, the records up to a check, whose sum is wrong by one flipped bit is mended. Any other is left out, and the next whole one is found by its
//! own check. What was found is told at the end ([`RecordingEnd`]).

mod blocks;
mod mend;
mod reader;
mod recorder;
mod sink;

use crc::{CRC_32_ISO_HDLC, Crc};
use lrfslam_lrf::driver::Input;
use serde::{Deserialize, Serialize};

use crate::scans::family::LrfOptions;

pub use reader::{RecordingEnd, RecordingReader};
pub use recorder::{RecordPlan, Recorder, RecordingReport};

const MAGIC: &[u8; 8] = b"LRFREC01";
/// What a program says that goes on.
const GOES_ON: &[u8; 14] = b"LRFREC goes on";
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
    /// Another program has gone on from here, with a driver that knew nothing yet.
    GoesOn,
    /// What came between two times, µs since 1970, is not here.
    Missing([i64; 2]),
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
            Entry::Sent(_) | Entry::Baud(_) | Entry::GoesOn | Entry::Missing(_) => None,
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
            b'n' => Some(Entry::GoesOn),
            b'm' => missing(&payload).map(Entry::Missing),
            b'b' => payload.try_into().ok().map(|rate| Entry::Baud(u32::from_le_bytes(rate))),
            _ => None,
        }
    }
}

/// From when to when.
fn missing(payload: &[u8]) -> Option<[i64; 2]> {
    let (from, rest) = payload.split_first_chunk()?;
    Some([i64::from_le_bytes(*from), i64::from_le_bytes(*rest.first_chunk()?)])
}

#[cfg(test)]
mod tests;
