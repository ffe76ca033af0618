//! Frames: a payload and its CRC-32 in COBS, ended by 0x00.
//!
//! COBS leaves no 0x00 inside, so a receiver that has lost its place finds it again at the next one. CRC-32 is that of
//! Ethernet (IEEE 802.3), little-endian behind the payload, computed before COBS.
//!
//! Sources: Cheshire & Baker, *Consistent overhead byte stuffing*, IEEE/ACM ToN 1999; IEEE 802.3 §3.2.9.

use cobs::CobsEncoder;
use crc::{CRC_32_ISO_HDLC, Crc};

/// Longest packet, bytes.
pub const MAX_PACKET: usize = 1024;
/// What a link with a key adds to a packet, bytes: the kind of the payload, a number and a tag.
pub const SEAL_BYTES: usize = 1 + 4 + 16;
/// Longest payload, bytes.
pub const MAX_PAYLOAD: usize = MAX_PACKET + SEAL_BYTES;
/// Longest frame with CRC, COBS and delimiter, bytes: the memory to lend for one.
pub const MAX_FRAME: usize = MAX_PAYLOAD + CRC_BYTES + (MAX_PAYLOAD + CRC_BYTES) / 254 + 2;
const CRC_BYTES: usize = 4;
/// Ends every frame and is nowhere inside of one.
pub const DELIMITER: u8 = 0;

pub(crate) const CRC32: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);

/// Writes the frame of `payload` to the front of `memory`; `None` if either is too long or too short for it.
pub fn encode<'m>(payload: &[u8], memory: &'m mut [u8]) -> Option<&'m [u8]> {
    if payload.len() > MAX_PAYLOAD {
        return None;
    }
    let length = {
        let mut encoder = CobsEncoder::new(memory);
        encoder.push(payload).ok()?;
        encoder.push(&CRC32.checksum(payload).to_le_bytes()).ok()?;
        encoder.finalize()
    };
    *memory.get_mut(length)? = DELIMITER;
    memory.get(..=length)
}

/// What came of the bytes so far.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct FrameCounters {
    /// Frames whose CRC was right.
    pub good: u32,
    /// Frames that were damaged, or longer than any of ours.
    pub damaged: u32,
}

/// Finds frames in a stream of bytes, however it is cut.
#[derive(Debug)]
pub struct FrameDecoder<'m> {
    memory: &'m mut [u8],
    length: usize,
    /// The frame under way is too long: nothing of it counts, its end included.
    is_oversize: bool,
    counters: FrameCounters,
}

impl<'m> FrameDecoder<'m> {
    /// * `memory` — holds one frame: [`MAX_FRAME`]; longer ones are skipped
    pub fn new(memory: &'m mut [u8]) -> Self {
        Self { memory, length: 0, is_oversize: false, counters: FrameCounters::default() }
    }

    /// What came of the bytes so far.
    pub fn counters(&self) -> FrameCounters {
        self.counters
    }

    /// Forgets a frame under way: the link was cut.
    pub fn forget(&mut self) {
        self.length = 0;
        self.is_oversize = false;
    }

    /// Takes bytes up to the end of a frame; returns how many, and the payload if that frame was right.
    #[must_use]
    pub fn take(&mut self, bytes: &[u8]) -> (usize, Option<&[u8]>) {
        let end = bytes.iter().position(|byte| *byte == DELIMITER);
        let part = bytes.get(..end.unwrap_or(bytes.len())).unwrap_or_default();
        match self.memory.get_mut(self.length..self.length + part.len()) {
            Some(room) => room.copy_from_slice(part),
            None => self.is_oversize = true,
        }
        if self.is_oversize {
            self.length = 0;
        } else {
            self.length += part.len();
        }
        match end {
            Some(end) => (end + 1, self.finish()),
            None => (bytes.len(), None),
        }
    }

    fn finish(&mut self) -> Option<&[u8]> {
        let (length, is_oversize) = (self.length, self.is_oversize);
        self.forget();
        // Delimiters in a row are an idle line.
        if length == 0 && !is_oversize {
            return None;
        }
        let payload = self.memory.get_mut(..length).and_then(checked);
        match payload {
            Some(_) => self.counters.good = self.counters.good.saturating_add(1),
            None => self.counters.damaged = self.counters.damaged.saturating_add(1),
        }
        payload
    }
}

/// The payload of a frame without its delimiter, decoded in place; `None` if it is not one.
fn checked(frame: &mut [u8]) -> Option<&[u8]> {
    let length = cobs::decode_in_place(frame).ok()?;
    let (payload, crc) = frame.get(..length)?.split_last_chunk::<CRC_BYTES>()?;
    (CRC32.checksum(payload) == u32::from_le_bytes(*crc)).then_some(payload)
}
