//! The bytes of a laser, taken out of a file again: the stream that `laser.rec` is.

use std::io::{self, Read, Seek};

use super::reader::McapReader;

/// The channel with a laser's bytes: a `laser.rec`, block by block.
pub const RAW_TOPIC: &str = "/laser/bytes";
/// How its messages are written: see [`recording`](crate::scans::recording).
pub const RAW_ENCODING: &str = "lrfrec";
/// Stands for blocks that are lost: no record, and a check that does not fit it. The recording's reader counts a damaged place.
const NO_RECORD: [u8; 16] = [0xff; 16];
const NO_CHECK: [u8; 17] = [b'#', 0, 0, 0, 0, 0, 0, 0, 0, 4, 0, 0, 0, 0x5a, 0xa5, 0x5a, 0xa5];

/// The bytes of a laser, as the stream that `laser.rec` is.
pub struct RawBytes<R> {
    reader: McapReader<R>,
    next: u32,
    block: Vec<u8>,
    taken: usize,
}

impl<R: Read + Seek> RawBytes<R> {
    /// * returns `None` if the file has no bytes of a laser
    ///
    /// # Errors
    /// If it is not an MCAP file.
    pub fn new(input: R) -> io::Result<Option<Self>> {
        let mut reader = McapReader::new(input)?;
        reader.look_ahead();
        let has_bytes = reader.channels().any(|channel| channel.topic == RAW_TOPIC && channel.encoding == RAW_ENCODING);
        Ok(has_bytes.then_some(Self { reader, next: 0, block: Vec::new(), taken: 0 }))
    }
}

impl<R: Read + Seek> Read for RawBytes<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        while self.taken == self.block.len() {
            let Some(message) = self.reader.next_message() else { return Ok(0) };
            if message.channel.topic != RAW_TOPIC {
                continue;
            }
            (self.block, self.taken) = (message.data, 0);
            // Of a block whose chunk is damaged, its own check judges.
            if message.sequence != self.next {
                self.block.splice(0..0, NO_RECORD.into_iter().chain(NO_CHECK));
            }
            self.next = message.sequence.wrapping_add(1);
        }
        let count = self.block.get(self.taken..).unwrap_or_default().read(buffer)?;
        self.taken += count;
        Ok(count)
    }
}
