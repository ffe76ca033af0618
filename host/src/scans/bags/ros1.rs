//! Bags of ROS 1, version 2.0: records, of which chunks hold connections and messages.
//!
//! ```text
//! record = length (u32), header: fields `name=value`, each with its length (u32) before it; length (u32), data
//! ```
//! The index at the end is not needed. Source: ROS wiki, Bags/Format/2.0.

use std::collections::{HashMap, VecDeque};
use std::io::{self, Read as _, Seek as _, SeekFrom};
use std::sync::Arc;

use super::container::{Bytes, Container, Next, damaged};
use crate::scans::mcap::{Channel, Fields, Message};
use crate::scans::unpack::unpack;

const MESSAGE: u8 = 2;
const CHUNK: u8 = 5;
const CONNECTION: u8 = 7;
/// Length of the first line.
const MAGIC: u64 = 13;
/// Longer records are not believed.
const LONGEST: u64 = 1 << 28;

/// See the [module](self).
pub(super) struct Ros1Bag {
    input: Box<dyn Bytes>,
    at: u64,
    size: u64,
    connections: HashMap<u32, Arc<Channel>>,
    ready: VecDeque<Next>,
    /// It has ended; cut or not.
    end: Option<bool>,
}

impl Ros1Bag {
    pub fn new(mut input: Box<dyn Bytes>) -> io::Result<Self> {
        let size = input.seek(SeekFrom::End(0))?;
        Ok(Self { input, at: MAGIC, size, connections: HashMap::new(), ready: VecDeque::new(), end: None })
    }

    fn read(&mut self, length: u64) -> Option<Vec<u8>> {
        if length > LONGEST || length > self.size.saturating_sub(self.at) {
            return None;
        }
        self.input.seek(SeekFrom::Start(self.at)).ok()?;
        let mut bytes = vec![0; length as usize];
        self.input.read_exact(&mut bytes).ok()?;
        self.at += length;
        Some(bytes)
    }

    /// A header or data, behind its length.
    fn read_counted(&mut self) -> Option<Vec<u8>> {
        let length = self.read(4)?;
        self.read(Fields(&length).u32()?.into())
    }

    fn read_record(&mut self) {
        let begin = self.at;
        if begin == self.size {
            self.end = Some(false);
            return;
        }
        let record = self.read_counted().zip(self.read_counted());
        match record {
            None => self.end = Some(true),
            Some((header, data)) => {
                let whole = if value(&header, b"op") == Some(&[CHUNK]) {
                    self.take_chunk(&header, &data)
                } else {
                    self.take_record(&header, &data)
                };
                if whole.is_none() {
                    self.ready.push_back(damaged(begin, "a whole record"));
                }
            }
        }
    }

    fn take_chunk(&mut self, header: &[u8], data: &[u8]) -> Option<()> {
        let codec = String::from_utf8_lossy(value(header, b"compression")?).into_owned();
        let size = Fields(value(header, b"size")?).u32()?;
        let records = unpack(&codec, data, u64::from(size).min(LONGEST))?;
        let mut fields = Fields(&records);
        while !fields.0.is_empty() {
            let header = fields.u32()?;
            let header = fields.bytes(header.into())?;
            let data = fields.u32()?;
            let data = fields.bytes(data.into())?;
            self.take_record(header, data)?;
        }
        Some(())
    }

    fn take_record(&mut self, header: &[u8], data: &[u8]) -> Option<()> {
        let [kind] = value(header, b"op")? else { return None };
        match *kind {
            CONNECTION => {
                let number = Fields(value(header, b"conn")?).u32()?;
                let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
                let (topic, schema) = (text(value(header, b"topic")?), text(value(data, b"type")?));
                let channel = Channel { topic, encoding: "ros1".to_owned(), schema };
                self.connections.entry(number).or_insert_with(|| Arc::new(channel));
            }
            MESSAGE => {
                let channel = self.connections.get(&Fields(value(header, b"conn")?).u32()?)?.clone();
                let mut time = Fields(value(header, b"time")?);
                let time_ns = u64::from(time.u32()?) * 1_000_000_000 + u64::from(time.u32()?);
                let message = Message { channel, sequence: 0, time_ns, data: data.to_vec(), is_suspect: false };
                self.ready.push_back(Next::Message(message));
            }
            _ => {}
        }
        Some(())
    }
}

impl Container for Ros1Bag {
    fn next(&mut self) -> Next {
        loop {
            match (self.ready.pop_front(), self.end) {
                (Some(ready), _) => return ready,
                (None, Some(is_cut)) => return Next::End { is_cut },
                (None, None) => self.read_record(),
            }
        }
    }

    fn position(&self) -> u64 {
        self.at
    }
}

/// The value of a field of a header.
fn value<'a>(header: &'a [u8], name: &[u8]) -> Option<&'a [u8]> {
    let mut fields = Fields(header);
    loop {
        let length = fields.u32()?;
        let field = fields.bytes(length.into())?;
        let (known, value) = field.split_at(field.iter().position(|byte| *byte == b'=')?);
        if known == name {
            return value.get(1..);
        }
    }
}
