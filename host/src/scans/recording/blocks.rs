//! The blocks of a recording: records up to the check that vouches for them. **Where a damaged recording is read on.**
//!
//! A block whose check does not fit has damage somewhere: one flipped bit is mended; else the block is left out, and the next one is looked for
//! whose own check fits. Lengths are believed only within a block that was checked.

use std::io::{ErrorKind, Read};

use super::mend::mend;
use super::{CRC32, GOES_ON, HEAD, MAX_PAYLOAD};

/// A block is written when 64 KiB wait; the first holds all that came until a laser was found, 4 MiB at most. One longer than this has lost its check.
const LONGEST: usize = 8 << 20;
/// A check: a head, and the sum.
const CHECK: usize = HEAD + 4;
/// A check's kind and the length of its payload, as they stand in it, with what lies between left open.
const CHECK_KIND: u8 = b'#';
const CHECK_LENGTH: [u8; 4] = [4, 0, 0, 0];
/// The record with which a program goes on in a recording that another has begun.
const GOES_ON_RECORD: usize = HEAD + GOES_ON.len();

/// What was found wrong.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Damage {
    /// Places that could not be mended, and how many bytes were left out there.
    pub(super) places: u32,
    pub(super) bytes: u64,
    /// The first begins here, or within the block that begins here.
    pub(super) first_at: u64,
    /// Single bits that were flipped back.
    pub(super) mended: u32,
}

/// What there is at a place, if lengths are believed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Found {
    /// A check, behind so many bytes.
    Check(usize),
    /// The recording was closed here.
    Closed,
    /// The file ends after so many bytes of whole records; behind them there is nothing, or a part of one.
    End { whole: usize, is_torn: bool },
    /// After so many bytes there is no record, or no check for too long.
    Nonsense(usize),
}

/// See the [module](self).
pub(super) struct Blocks<R> {
    input: R,
    /// Read, and not handed out.
    window: Vec<u8>,
    /// Where the window begins in the file.
    at: u64,
    is_at_end: bool,
    has_checks: bool,
    is_over: bool,
    /// What no check vouches for is not handed out.
    pub(super) skips_unchecked: bool,
    pub(super) is_closed: bool,
    pub(super) damage: Damage,
}

impl<R: Read> Blocks<R> {
    /// * `at` — bytes of the file that were read from `input` already
    pub(super) fn new(input: R, at: u64) -> Self {
        let (window, damage) = (Vec::new(), Damage::default());
        Self {
            input,
            window,
            at,
            is_at_end: false,
            has_checks: false,
            is_over: false,
            skips_unchecked: false,
            is_closed: false,
            damage,
        }
    }

    /// Whole records, one behind the other; `None` at the end.
    pub(super) fn next_block(&mut self) -> Option<Vec<u8>> {
        while !self.is_over {
            let found = self.look(0);
            let block = match found {
                Found::Closed => self.close(),
                Found::Check(length) => self.checked(length).or_else(|| self.recover()),
                Found::End { whole: 0, is_torn: false } => {
                    (self.is_over, self.is_closed) = (true, self.is_closed || !self.has_checks);
                    None
                }
                // Old recordings have no checks at all; else it is the last block of one that was cut.
                _ if self.has_candidate() => self.recover(),
                Found::End { whole, is_torn } => {
                    (self.is_over, self.is_closed) = (true, !self.has_checks && !is_torn);
                    Some(self.hand_out(whole, 0)).filter(|_| !self.skips_unchecked)
                }
                Found::Nonsense(0) => self.recover(),
                Found::Nonsense(whole) => Some(self.hand_out(whole, 0)),
            };
            if block.as_ref().is_some_and(|block| !block.is_empty()) {
                return block;
            }
        }
        None
    }

    /// The end was written; a run that goes on may have written more behind it.
    fn close(&mut self) -> Option<Vec<u8>> {
        self.hand_out(HEAD, 0);
        self.is_over = !self.fill(1);
        self.is_closed = self.is_over;
        None
    }

    /// The first bytes of the window; so many behind them are taken, too.
    fn hand_out(&mut self, length: usize, behind: usize) -> Vec<u8> {
        self.at += (length + behind) as u64;
        let mut block: Vec<u8> = self.window.drain(..length + behind).collect();
        block.truncate(length);
        block
    }

    /// Reads until the window has so many bytes; false if the file ends before. A disk that cannot be read ends it, too.
    fn fill(&mut self, length: usize) -> bool {
        let mut buffer = [0; 1 << 14];
        while self.window.len() < length && !self.is_at_end {
            match self.input.read(&mut buffer) {
                Ok(0) => self.is_at_end = true,
                Ok(count) => self.window.extend_from_slice(buffer.get(..count).unwrap_or(&buffer)),
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(_) => self.is_at_end = true,
            }
        }
        self.window.len() >= length
    }

    /// Follows the records from `begin` on.
    fn look(&mut self, begin: usize) -> Found {
        let mut at = begin;
        loop {
            if !self.fill(at + HEAD) {
                return Found::End { whole: at - begin, is_torn: self.window.len() > at };
            }
            let Some((kind, length)) = self.head(at) else { return Found::Nonsense(at - begin) };
            let is_nonsense = length > MAX_PAYLOAD || at - begin > LONGEST;
            if is_nonsense {
                return Found::Nonsense(at - begin);
            }
            if !self.fill(at + HEAD + length) {
                return Found::End { whole: at - begin, is_torn: true };
            }
            match (kind, length) {
                (CHECK_KIND, 4) => return Found::Check(at - begin),
                (b'e', 0) if at == begin => return Found::Closed,
                _ => at += HEAD + length,
            }
        }
    }

    /// Kind of the record at this place, and the length of its payload.
    fn head(&self, at: usize) -> Option<(u8, usize)> {
        let head: &[u8; HEAD] = self.window.get(at..)?.first_chunk()?;
        Some((head[0], u32::from_le_bytes(*head.last_chunk()?) as usize))
    }

    /// What the block differs by from the check behind it, as sums do; 0 if it fits.
    fn difference(&self, begin: usize, length: usize) -> Option<u32> {
        let (block, check) = self.window.get(begin..)?.split_at_checked(length)?;
        let sum = check.get(HEAD..)?.first_chunk()?;
        Some(CRC32.checksum(block) ^ u32::from_le_bytes(*sum))
    }

    fn fits(&self, begin: usize, length: usize) -> bool {
        self.difference(begin, length) == Some(0)
    }

    /// The block of this length, if its check fits.
    fn checked(&mut self, length: usize) -> Option<Vec<u8>> {
        self.fits(0, length).then(|| {
            self.has_checks = true;
            self.hand_out(length, CHECK)
        })
    }

    /// Where the next check may be, from `from` on; a bit of it may be flipped.
    fn candidate(&self, from: usize) -> Option<usize> {
        let length = u32::from_le_bytes(CHECK_LENGTH);
        let is_near = |bytes: &[u8]| {
            let (Some(kind), Some(found)) = (bytes.first(), bytes.get(HEAD - 4..).and_then(<[u8]>::first_chunk)) else {
                return false;
            };
            (kind ^ CHECK_KIND).count_ones() + (u32::from_le_bytes(*found) ^ length).count_ones() <= 1
        };
        self.window.get(from..)?.windows(CHECK).position(is_near).map(|at| from + at)
    }

    fn has_candidate(&mut self) -> bool {
        self.fill(LONGEST);
        self.candidate(0).is_some() || self.goes_on_at(0).is_some()
    }

    /// Where a program that went on has begun, from `from` on.
    fn goes_on_at(&self, from: usize) -> Option<usize> {
        let places = self.window.get(from..)?.windows(GOES_ON_RECORD);
        places.into_iter().position(|bytes| bytes.starts_with(b"n") && bytes.ends_with(GOES_ON)).map(|at| from + at)
    }

    /// Something in the block at the front of the window is wrong: mends it, or leaves it out.
    fn recover(&mut self) -> Option<Vec<u8>> {
        self.fill(LONGEST);
        let (goes_on, mut from, mut last) = (self.goes_on_at(1), 0, None);
        while let Some(check) = self.candidate(from).filter(|check| goes_on.is_none_or(|at| *check < at)) {
            let difference = self.difference(0, check);
            let block = self.window.get_mut(..check).unwrap_or_default();
            if difference.is_some_and(|difference| difference == 0 || mend(block, difference)) {
                self.damage.mended += 1;
                self.has_checks = true;
                return Some(self.hand_out(check, CHECK));
            }
            if self.is_good(check + CHECK) {
                self.leave_out(check + CHECK);
                return None;
            }
            (from, last) = (check + 1, Some(check + CHECK));
        }
        match (goes_on, last) {
            // What is before it was not checked when its program was killed.
            (Some(at), _) => drop(self.hand_out(0, at)),
            (None, Some(behind)) => self.leave_out(behind),
            (None, None) if self.is_at_end => self.leave_out(self.window.len()),
            // The next check may stand across the end of the window.
            (None, None) => self.leave_out(self.window.len().saturating_sub(GOES_ON_RECORD).max(1)),
        }
        None
    }

    /// Here begins a block whose check fits, or the recording is closed.
    fn is_good(&mut self, begin: usize) -> bool {
        match self.look(begin) {
            Found::Check(length) => self.fits(begin, length),
            Found::Closed => true,
            Found::End { whole, is_torn } => whole == 0 && !is_torn,
            Found::Nonsense(_) => false,
        }
    }

    fn leave_out(&mut self, bytes: usize) {
        if self.damage.places == 0 {
            self.damage.first_at = self.at;
        }
        self.damage.places += 1;
        self.damage.bytes += bytes as u64;
        self.has_checks = true;
        self.hand_out(0, bytes);
    }
}
