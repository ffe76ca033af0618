//! Where a recording goes: a file of its own, or a channel of an MCAP file.

use std::io;

use lrfslam_core::time::Instant;

use crate::output::{GrowingFile, Hole, NoRoom};
use crate::scans::mcap::SharedMcap;

/// See the [module](self).
#[derive(Debug)]
pub(super) enum Sink {
    File(GrowingFile),
    /// A channel of it: others write to it too, and close it.
    Bag(SharedMcap, usize),
}

impl Sink {
    /// Takes whole blocks, as of `now`.
    pub fn write(&mut self, now: Instant, bytes: &[u8]) -> Result<(), NoRoom> {
        match self {
            Self::File(file) => file.write(bytes),
            Self::Bag(bag, channel) => {
                bag.write(*channel, now.micros.max(0) as u64 * 1000, bytes);
                bag.flush();
                Ok(())
            }
        }
    }

    pub fn news(&mut self) -> Option<String> {
        match self {
            Self::File(file) => file.news(),
            Self::Bag(bag, _) => bag.news(),
        }
    }

    pub fn holes(&self) -> Vec<Hole> {
        match self {
            Self::File(file) => file.holes(),
            Self::Bag(bag, _) => bag.holes(),
        }
    }

    /// Bytes of the file, if more than what was written is in it.
    pub fn bytes(&self) -> Option<u64> {
        match self {
            Self::File(_) => None,
            Self::Bag(bag, _) => Some(bag.bytes()),
        }
    }

    pub fn finish(&mut self) -> io::Result<()> {
        match self {
            Self::File(file) => file.finish(),
            Self::Bag(..) => Ok(()),
        }
    }
}
