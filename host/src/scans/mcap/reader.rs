//! Goes from record to record of a file, and over damage to the next chunk.

use std::collections::{HashMap, VecDeque};
use std::io::{self, Read, Seek, SeekFrom};
use std::sync::Arc;

use super::fields::Fields;
use super::writer::CRC32;
use super::{CHANNEL, CHUNK, DATA_END, FOOTER, HEAD, MAGIC, MESSAGE, MESSAGE_INDEX, SCHEMA};
use crate::scans::unpack::unpack;

/// Longer records are not believed.
const LONGEST: u64 = 1 << 28;
/// From the begin of a chunk's content to its records, without the name of the codec.
const CHUNK_HEAD: u64 = 40;

/// Where messages come from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Channel {
    /// Its name.
    pub topic: String,
    /// How its messages are written: `cdr`, `json`, …
    pub encoding: String,
    /// What they are, such as `sensor_msgs/msg/LaserScan`; empty without a schema.
    pub schema: String,
}

/// A message.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Message {
    /// Where it comes from.
    pub channel: Arc<Channel>,
    /// Its number in the channel, if the writer counts.
    pub sequence: u32,
    /// When it was written down, ns since 1970.
    pub time_ns: u64,
    /// Its bytes.
    pub data: Vec<u8>,
    /// The check of its chunk does not fit.
    pub is_suspect: bool,
}

/// Reads the messages of a file, over damage to the next chunk. It ends at a disk that cannot be read, too.
pub struct McapReader<R> {
    input: R,
    size: u64,
    at: u64,
    schemas: HashMap<u16, String>,
    channels: HashMap<u16, Arc<Channel>>,
    messages: VecDeque<Message>,
    damage: Vec<u64>,
    is_closed: bool,
    is_over: bool,
}

impl<R: Read + Seek> McapReader<R> {
    /// # Errors
    /// If it cannot be read, or does not begin as such a file does.
    pub fn new(mut input: R) -> io::Result<Self> {
        let size = input.seek(SeekFrom::End(0))?;
        input.seek(SeekFrom::Start(0))?;
        let mut magic = [0; 8];
        input.read_exact(&mut magic)?;
        if magic != *MAGIC {
            return Err(io::Error::other("it does not begin as an MCAP file does"));
        }
        Ok(Self {
            input,
            size,
            at: MAGIC.len() as u64,
            schemas: HashMap::new(),
            channels: HashMap::new(),
            messages: VecDeque::new(),
            damage: Vec::new(),
            is_closed: false,
            is_over: false,
        })
    }

    /// Channels met so far.
    pub fn channels(&self) -> impl Iterator<Item = &Arc<Channel>> {
        self.channels.values()
    }

    /// Reads up to the first message; what channels a file of ours has is known then.
    pub fn look_ahead(&mut self) {
        while self.messages.is_empty() && !self.is_over {
            self.read_record();
        }
    }

    /// Bytes of the file that were read.
    pub fn position(&self) -> u64 {
        self.at
    }

    /// The end of the data was written; else the file was cut, or its program killed.
    pub fn is_closed(&self) -> bool {
        self.is_closed
    }

    /// Where damage was met since the last call: bytes from the begin.
    pub fn take_damage(&mut self) -> Vec<u64> {
        std::mem::take(&mut self.damage)
    }

    /// The next message, in the order of the file.
    pub fn next_message(&mut self) -> Option<Message> {
        self.look_ahead();
        self.messages.pop_front()
    }

    fn read_record(&mut self) {
        let Some((kind, length)) = self.read_head(self.at) else {
            self.is_over = true;
            return;
        };
        let is_known = (1..=DATA_END).contains(&kind) || kind >= 0x80;
        if !is_known || length > self.size - self.at - HEAD as u64 || length > LONGEST || !self.is_sound(kind, length) {
            return self.resynchronize();
        }
        let begin = self.at + HEAD as u64;
        self.at = begin + length;
        match kind {
            DATA_END | FOOTER => (self.is_closed, self.is_over) = (true, true),
            SCHEMA | CHANNEL | MESSAGE | CHUNK => match self.read_at(begin, length as usize) {
                Some(content) if kind == CHUNK => self.take_chunk(begin, &content),
                Some(content) => {
                    let is_damaged = self.take_record(kind, &content, false).is_none();
                    self.note(is_damaged, begin);
                }
                None => self.is_over = true,
            },
            _ => {}
        }
    }

    /// Of the records that a file is full of, other lengths agree with this one: a flipped bit does not skip what is behind.
    fn is_sound(&mut self, kind: u8, length: u64) -> bool {
        let left = self.size - self.at;
        match kind {
            DATA_END => length == 4,
            FOOTER => length == 20,
            CHUNK => self.read_at(self.at, left.min(64) as usize).is_some_and(|bytes| is_chunk(&bytes, left)),
            MESSAGE_INDEX => {
                let entries = self.read_at(self.at + HEAD as u64, length.min(6) as usize);
                let entries = entries.and_then(|bytes| Fields(bytes.get(2..)?).u32());
                entries.is_some_and(|entries| u64::from(entries) + 6 == length)
            }
            _ => true,
        }
    }

    fn note(&mut self, is_damaged: bool, at: u64) {
        if is_damaged {
            self.damage.push(at);
        }
    }

    fn read_at(&mut self, at: u64, length: usize) -> Option<Vec<u8>> {
        self.input.seek(SeekFrom::Start(at)).ok()?;
        let mut content = vec![0; length];
        self.input.read_exact(&mut content).ok()?;
        Some(content)
    }

    fn read_head(&mut self, at: u64) -> Option<(u8, u64)> {
        if self.size < at + HEAD as u64 {
            return None;
        }
        let head = self.read_at(at, HEAD)?;
        let mut fields = Fields(&head);
        Some((fields.u8()?, fields.u64()?))
    }

    fn take_chunk(&mut self, at: u64, content: &[u8]) {
        let Some((records, is_suspect)) = chunk(content) else { return self.note(true, at) };
        let mut fields = Fields(&records);
        let mut is_damaged = is_suspect;
        while !fields.0.is_empty() {
            let record = fields.u8().zip(fields.u64()).and_then(|(kind, length)| Some((kind, fields.bytes(length)?)));
            let Some((kind, content)) = record else {
                is_damaged = true;
                break;
            };
            is_damaged |= self.take_record(kind, content, is_suspect).is_none();
        }
        self.note(is_damaged, at);
    }

    /// `None` if it is damaged.
    fn take_record(&mut self, kind: u8, content: &[u8], is_suspect: bool) -> Option<()> {
        let mut fields = Fields(content);
        match kind {
            SCHEMA => {
                let (number, name) = (fields.u16()?, fields.text()?);
                self.schemas.insert(number, name);
            }
            CHANNEL => {
                let (number, schema) = (fields.u16()?, fields.u16()?);
                let (topic, encoding) = (fields.text()?, fields.text()?);
                let schema = self.schemas.get(&schema).cloned().unwrap_or_default();
                let channel = Channel { topic, encoding, schema };
                if self.channels.get(&number).is_none_or(|known| **known != channel) {
                    self.channels.insert(number, Arc::new(channel));
                }
            }
            MESSAGE => {
                let (number, sequence, time_ns, _) = (fields.u16()?, fields.u32()?, fields.u64()?, fields.u64()?);
                let channel = self.channels.get(&number)?.clone();
                self.messages.push_back(Message { channel, sequence, time_ns, data: fields.0.to_vec(), is_suspect });
            }
            _ => {}
        }
        Some(())
    }

    /// Looks for the next chunk: its head says the same length twice, and a codec.
    fn resynchronize(&mut self) {
        const WINDOW: u64 = 1 << 20;
        const OVERLAP: u64 = HEAD as u64 + CHUNK_HEAD + 8;
        let (lost, mut from) = (self.at, self.at + 1);
        while from + OVERLAP <= self.size {
            let length = WINDOW.min(self.size - from);
            let Some(window) = self.read_at(from, length as usize) else { break };
            let left = self.size - from;
            if let Some(place) = (0..window.len())
                .find(|place| window.get(*place..).is_some_and(|bytes| is_chunk(bytes, left - *place as u64)))
            {
                self.at = from + place as u64;
                return self.damage.push(lost);
            }
            from += (length - OVERLAP).max(1);
        }
        self.is_over = true;
    }
}

/// A chunk begins here.
fn is_chunk(bytes: &[u8], left: u64) -> bool {
    let look = || {
        let mut fields = Fields(bytes);
        let (kind, length) = (fields.u8().filter(|kind| *kind == CHUNK)?, fields.u64()?);
        fields.bytes(28)?;
        let codec = fields.u32().filter(|length| *length <= 4)?;
        fields.bytes(codec.into())?;
        let records = fields.u64()?;
        let fits = records.checked_add(CHUNK_HEAD + u64::from(codec)) == Some(length) && length <= left - HEAD as u64;
        (kind == CHUNK && fits).then_some(())
    };
    left >= HEAD as u64 && look().is_some()
}

/// The records of a chunk, and whether its check does not fit.
fn chunk(content: &[u8]) -> Option<(Vec<u8>, bool)> {
    let mut fields = Fields(content);
    fields.bytes(16)?;
    let (size, sum, codec, length) = (fields.u64()?, fields.u32()?, fields.text()?, fields.u64()?);
    let packed = fields.bytes(length)?;
    let records = unpack(&codec, packed, size.min(LONGEST))?;
    let is_suspect = sum != 0 && CRC32.checksum(&records) != sum;
    // Of packed records that are damaged, nothing can be believed.
    (!is_suspect || codec.is_empty()).then_some((records, is_suspect))
}
