//! What a robot has told, on disk before the robot is told that it was heard: a host that is stopped and started goes on where it was.
//!
//! # Format
//! 8 bytes `LRFROB` and two digits, the version of the robot link; then [`Packet::Reliable`] after the other in the link's frames,
//! CRC included. A file may end anywhere: a frame that is cut or damaged, and all behind it, is left out.

use std::fs::{File, OpenOptions};
use std::io::{self, Write as _};
use std::path::Path;

use anyhow::{Context as _, ensure};
use lrfslam_robot::wire::frame::{FrameDecoder, MAX_FRAME, encode};
use lrfslam_robot::wire::session::{Packet, Progress, VERSION};

use super::client::Told;
use crate::output::cannot_write;

/// Its name in the folder of results.
pub const JOURNAL: &str = "robot.journal";

/// A journal that is written to.
#[derive(Debug)]
pub struct Journal {
    file: File,
}

fn magic() -> String {
    format!("LRFROB{VERSION:02}")
}

impl Journal {
    /// An empty one in place of any other; its folder is made if it is not there.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn create(path: &Path) -> anyhow::Result<Self> {
        let made = path.parent().map_or(Ok(()), std::fs::create_dir_all);
        let mut file = made.and_then(|()| File::create(path)).with_context(|| cannot_write(path))?;
        file.write_all(magic().as_bytes()).with_context(|| cannot_write(path))?;
        Ok(Self { file })
    }

    /// Goes on with the one at `path`; gives all that it holds to `take`, in order. What is damaged at its end is cut off.
    ///
    /// # Errors
    /// If it cannot be read or written, is no journal, or one of another version of the link.
    pub fn resume(path: &Path, mut take: impl FnMut(Told<'_>)) -> anyhow::Result<Self> {
        let bytes = std::fs::read(path).with_context(|| format!("{}: cannot be read", path.display()))?;
        let magic = magic();
        let found = String::from_utf8_lossy(bytes.get(..magic.len()).unwrap_or_default());
        let expected = format!("{}: expected a robot's journal that begins with {magic}", path.display());
        ensure!(found == magic, "{expected}, found {found:?}");
        let mut good = magic.len();
        let mut memory = [0; MAX_FRAME];
        let mut decoder = FrameDecoder::new(&mut memory);
        while let Some(rest) = bytes.get(good..).filter(|rest| !rest.is_empty()) {
            let (taken, payload) = decoder.take(rest);
            let Some(Ok(Packet::Reliable { epoch, sequence, message })) = payload.map(postcard::from_bytes) else {
                break;
            };
            take(Told { at: Progress { epoch, next: sequence }, bytes: message });
            good += taken;
        }
        let file = OpenOptions::new().append(true).open(path).with_context(|| cannot_write(path))?;
        file.set_len(good as u64).with_context(|| cannot_write(path))?;
        Ok(Self { file })
    }

    /// Adds a message; it is with the system, and survives the end of this program, when this returns.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn add(&mut self, told: &Told<'_>) -> io::Result<()> {
        let packet = Packet::Reliable { epoch: told.at.epoch, sequence: told.at.next, message: told.bytes };
        let (mut payload, mut memory) = ([0; MAX_FRAME], [0; MAX_FRAME]);
        let too_long = || io::Error::new(io::ErrorKind::InvalidData, "a message longer than any frame");
        let payload = postcard::to_slice(&packet, &mut payload).map_err(|_| too_long())?;
        self.file.write_all(encode(payload, &mut memory).ok_or_else(too_long)?)
    }
}
#[cfg(test)]
mod tests {
    use super::*;

    fn messages(path: &Path) -> Vec<(u32, u32, Vec<u8>)> {
        let mut found = Vec::new();
        Journal::resume(path, |told| found.push((told.at.epoch, told.at.next, told.bytes.to_vec()))).unwrap();
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
            assert!(kept.len() < 20 && wanted.starts_with(&kept), "{} of 20 with {cut} bytes cut", kept.len());
            // The end was repaired: what is added now is found behind it.
            let mut journal = Journal::resume(&path, |_| {}).unwrap();
            journal.add(&Told { at: Progress { epoch: 7, next: 99 }, bytes: &[1] }).unwrap();
            assert_eq!(messages(&path).last(), Some(&(7, 99, vec![1])));
            assert_eq!(messages(&path).len(), kept.len() + 1);
        }
        let mut damaged = whole.clone();
        damaged[whole.len() / 2] ^= 0x10;
        std::fs::write(&path, damaged).unwrap();
        assert!(wanted.starts_with(&messages(&path)) && messages(&path).len() > 5);
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
