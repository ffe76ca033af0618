//! What a robot has told, written before the robot is told that it was heard: a host that is stopped and started goes on where it was.
//!
//! # Format
//! 8 bytes `LRFROB` and two digits, the version of the robot link; then [`Packet::Reliable`] after the other in the link's frames,
//! CRC included. A file may end anywhere. What is damaged ends at the next whole frame; one flipped bit is mended; the rest is skipped, and that is told. The
//! file never gets shorter: what is damaged stays in it, and what is new comes behind it.

use std::fmt;
use std::fs::{File, OpenOptions};
use std::io::{self, Write as _};
use std::path::Path;

use anyhow::{Context as _, ensure};
use lrfslam_robot::wire::frame::{DELIMITER, FrameDecoder, MAX_FRAME, encode};
use lrfslam_robot::wire::session::{Packet, Progress, VERSION};

use super::client::Told;
use crate::output::{GrowingFile, Hole, cannot_write};
use crate::plural::count;

/// Its name in the folder of results.
pub const JOURNAL: &str = "robot.journal";

/// Damage up to here is searched for a flipped bit, bytes: two frames that have become one.
const MENDED_MAX: usize = 2 * MAX_FRAME;
/// In no more than so many places: a search takes a tenth of a second.
const MENDINGS_MAX: u32 = 100;

/// A journal that is written to.
#[derive(Debug)]
pub struct Journal {
    file: GrowingFile,
}

/// What of a journal could not be read.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Skipped {
    /// Damaged places that were skipped, and their bytes.
    pub places: u32,
    /// See `places`.
    pub bytes: usize,
    /// Messages that are missing between those that are there: damaged, or never written for want of room.
    pub messages: u32,
    /// Flipped bits that were mended: their messages are there.
    pub mended: u32,
}

impl fmt::Display for Skipped {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { places, bytes, messages, mended } = *self;
        let [places, messages] =
            [(places, "damaged place"), (messages, "message")].map(|(n, what)| count(n.into(), what));
        write!(
            out,
            "{places} skipped ({bytes} bytes), {messages} missing, {} mended",
            count(mended.into(), "flipped bit")
        )
    }
}

fn magic() -> String {
    format!("LRFROB{VERSION:02}")
}

impl Journal {
    /// An empty one in place of any other; its folder is made if it is not there.
    ///
    /// # Errors
    /// If it cannot be made.
    pub fn create(path: &Path) -> anyhow::Result<Self> {
        let made = path.parent().map_or(Ok(()), std::fs::create_dir_all);
        let file = made.and_then(|()| File::create(path)).with_context(|| cannot_write(path))?;
        let mut file = GrowingFile::new(path, file);
        // Nothing waits yet: it is taken.
        let _ = file.write(magic().as_bytes());
        Ok(Self { file })
    }

    /// Goes on with the one at `path`; gives all that it holds to `take`, in order, and tells what is damaged in it.
    ///
    /// # Errors
    /// If it cannot be read or opened for writing, is no journal, or one of another version of the link.
    pub fn resume(path: &Path, take: impl FnMut(Told<'_>)) -> anyhow::Result<(Self, Skipped)> {
        let bytes = std::fs::read(path).with_context(|| format!("{}: cannot be read", path.display()))?;
        let magic = magic();
        let found = String::from_utf8_lossy(bytes.get(..magic.len()).unwrap_or_default());
        let expected = format!("{}: expected a robot's journal that begins with {magic}", path.display());
        ensure!(found == magic, "{expected}, found {found:?}");
        let skipped = read(bytes.get(magic.len()..).unwrap_or_default(), take);
        let mut file = OpenOptions::new().append(true).open(path).with_context(|| cannot_write(path))?;
        if bytes.len() > magic.len() && bytes.last() != Some(&DELIMITER) {
            // The frame that was cut ends here.
            file.write_all(&[DELIMITER]).with_context(|| cannot_write(path))?;
        }
        Ok((Self { file: GrowingFile::new(path, file) }, skipped))
    }

    /// Adds a message; it is with the system, and survives the end of this program, when this returns. On a disk without room it waits in
    /// memory; when there is no more of that it is left out, and a [hole](Self::holes).
    ///
    /// # Errors
    /// If it is longer than any.
    pub fn add(&mut self, told: &Told<'_>) -> io::Result<()> {
        let packet = Packet::Reliable { epoch: told.at.epoch, sequence: told.at.next, message: told.bytes };
        let (mut payload, mut memory) = ([0; MAX_FRAME], [0; MAX_FRAME]);
        let too_long = || io::Error::new(io::ErrorKind::InvalidData, "a message longer than any frame");
        let payload = postcard::to_slice(&packet, &mut payload).map_err(|_| too_long())?;
        // What is left out is counted where it happens.
        let _ = self.file.write(encode(payload, &mut memory).ok_or_else(too_long)?);
        Ok(())
    }

    /// What found no room so far.
    pub fn holes(&self) -> Vec<Hole> {
        self.file.holes()
    }

    /// What there is to tell of its disk.
    pub fn news(&mut self) -> Option<String> {
        self.file.news()
    }

    /// Puts all on disk.
    ///
    /// # Errors
    /// If there is no room for it.
    pub fn finish(&mut self) -> io::Result<()> {
        self.file.finish()
    }
}

/// Gives every message to `take`, each once and in order.
fn read(bytes: &[u8], mut take: impl FnMut(Told<'_>)) -> Skipped {
    let mut skipped = Skipped::default();
    let mut next: Option<Progress> = None;
    let mut give = |frame: &Frame, skipped: &mut Skipped| {
        let at = frame.at;
        let known = next.filter(|next| next.epoch == at.epoch);
        let ahead = known.map_or(0, |known| at.next.wrapping_sub(known.next) as i32);
        if ahead < 0 {
            return;
        }
        skipped.messages = skipped.messages.saturating_add(ahead.unsigned_abs());
        next = Some(Progress { epoch: at.epoch, next: at.next.wrapping_add(1) });
        take(Told { at, bytes: &frame.message });
    };
    // The damage under way begins here.
    let (mut begin, mut at) = (0, 0);
    for raw in bytes.split_inclusive(|byte| *byte == DELIMITER) {
        // Of the last one, the end may be all that is missing.
        let frame = decoded(raw).or_else(|| decoded(&[raw, &[DELIMITER]].concat()));
        let is_idle = *raw == [DELIMITER] && begin == at;
        let damaged = bytes.get(begin..at).unwrap_or_default();
        at += raw.len();
        if frame.is_some() || is_idle {
            skip(damaged, &mut skipped, &mut give);
            begin = at;
        }
        frame.iter().for_each(|frame| give(frame, &mut skipped));
    }
    skip(bytes.get(begin..).unwrap_or_default(), &mut skipped, &mut give);
    skipped
}

/// Mends what is damaged, or counts it; there may be nothing.
fn skip(damaged: &[u8], skipped: &mut Skipped, give: &mut impl FnMut(&Frame, &mut Skipped)) {
    if damaged.is_empty() {
        return;
    }
    let is_short = damaged.len() <= MENDED_MAX && damaged.last() == Some(&DELIMITER) && skipped.mended < MENDINGS_MAX;
    match is_short.then(|| mended(damaged)).flatten() {
        Some(frames) => {
            skipped.mended += 1;
            frames.iter().for_each(|frame| give(frame, skipped));
        }
        None => {
            skipped.places += 1;
            skipped.bytes += damaged.len();
        }
    }
}

/// A message, and which it is.
struct Frame {
    at: Progress,
    message: Vec<u8>,
}

/// What a frame says, delimiter included; `None` if it is damaged.
fn decoded(raw: &[u8]) -> Option<Frame> {
    let mut memory = [0; MAX_FRAME];
    let mut decoder = FrameDecoder::new(&mut memory);
    match postcard::from_bytes(decoder.take(raw).1?) {
        Ok(Packet::Reliable { epoch, sequence, message }) => {
            Some(Frame { at: Progress { epoch, next: sequence }, message: message.to_vec() })
        }
        _ => None,
    }
}

/// The frames that these bytes are but for one flipped bit.
fn mended(damaged: &[u8]) -> Option<Vec<Frame>> {
    let mut bytes = damaged.to_vec();
    (0..8 * bytes.len()).find_map(|bit| {
        *bytes.get_mut(bit / 8)? ^= 1 << (bit % 8);
        let whole: Option<Vec<_>> = bytes.split_inclusive(|byte| *byte == DELIMITER).map(decoded).collect();
        *bytes.get_mut(bit / 8)? ^= 1 << (bit % 8);
        whole
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn messages(path: &Path) -> Vec<(u32, u32, Vec<u8>)> {
        let mut found = Vec::new();
        let _ = Journal::resume(path, |told| found.push((told.at.epoch, told.at.next, told.bytes.to_vec()))).unwrap();
        found
    }

    #[test]
    fn what_was_added_is_there_whatever_happens_to_the_end() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(JOURNAL);
        let mut journal = Journal::create(&path).unwrap();
        let wanted: Vec<_> = (0..20_u32).map(|number| (7, number, vec![number as u8; 40])).collect();
        for (epoch, next, bytes) in &wanted {
            journal.add(&Told { at: Progress { epoch: *epoch, next: *next }, bytes }).unwrap();
        }
        assert_eq!(messages(&path), wanted);
        let whole = std::fs::read(&path).unwrap();
        for cut in [1, 40, 52] {
            std::fs::write(&path, &whole[..whole.len() - cut]).unwrap();
            let kept = messages(&path);
            assert!(
                kept.len() < 20 + usize::from(cut == 1) && wanted.starts_with(&kept),
                "{} of 20 with {cut} bytes cut",
                kept.len()
            );
            // What is added now is found behind it, and the file was not cut.
            let (mut journal, _) = Journal::resume(&path, |_| {}).unwrap();
            journal.add(&Told { at: Progress { epoch: 7, next: 99 }, bytes: &[1] }).unwrap();
            assert_eq!(messages(&path).last(), Some(&(7, 99, vec![1])));
            assert_eq!(messages(&path).len(), kept.len() + 1);
            assert!(std::fs::read(&path).unwrap().starts_with(&whole[..whole.len() - cut]));
        }
    }

    #[test]
    fn a_flipped_bit_loses_nothing_wherever_it_is_and_more_damage_only_what_it_hits() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(JOURNAL);
        let mut journal = Journal::create(&path).unwrap();
        let wanted: Vec<_> = (0..6_u32).map(|number| (7, number, vec![number as u8 ^ 0x5a; 20])).collect();
        for (epoch, next, bytes) in &wanted {
            journal.add(&Told { at: Progress { epoch: *epoch, next: *next }, bytes }).unwrap();
        }
        let whole = std::fs::read(&path).unwrap();
        let damaged = |bits: &[usize]| {
            let mut bytes = whole.clone();
            bits.iter().for_each(|bit| bytes[bit / 8] ^= 1 << (bit % 8));
            std::fs::write(&path, &bytes).unwrap();
            let mut found = Vec::new();
            let (_, skipped) =
                Journal::resume(&path, |told| found.push((7, told.at.next, told.bytes.to_vec()))).unwrap();
            assert_eq!(std::fs::read(&path).unwrap()[..bytes.len()], bytes, "it stays as it is");
            (found, skipped)
        };
        for bit in 64..8 * (whole.len() - 1) {
            let (found, skipped) = damaged(&[bit]);
            assert_eq!((found.len(), skipped.mended, skipped.messages), (6, 1, 0), "bit {bit}");
            assert!(found == wanted, "bit {bit}");
        }
        for bit in (64..8 * (whole.len() - 40)).step_by(7) {
            let (found, skipped) = damaged(&[bit, bit + 9]);
            let lost = 6 - found.len();
            assert!(
                (1..=3).contains(&lost) && found.iter().all(|message| wanted.contains(message)),
                "bit {bit}: {lost}"
            );
            assert!(skipped.places == 1 && skipped.bytes > 20, "{skipped}");
            // Of the first ones nobody knows that they were there.
            assert!(skipped.messages as usize == lost || found[0].1 > 0, "bit {bit}: {skipped}");
        }
    }

    #[test]
    fn other_files_are_refused_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        std::fs::write(&path, "LRFROB01 and more").unwrap();
        let error = Journal::resume(&path, |_| {}).unwrap_err().to_string();
        assert!(error.contains("a.txt: expected a robot's journal") && error.contains("LRFROB01"), "{error}");
        assert!(Journal::resume(&folder.path().join("none"), |_| {}).is_err());
    }
}
