//! Bags of ROS 2 in SQLite: the tables `topics` and `messages`, read page by page.
//!
//! ```text
//! topics   = id, name, type, serialization_format, …
//! messages = id, topic_id, timestamp (ns), data
//! ```
//! Tables are read from their first row to their last, and no more is needed of SQL. Source: sqlite.org, Database File Format; rosbag2's
//! `storage_sqlite3`.

use std::collections::HashMap;
use std::io::{self, Read as _, Seek as _, SeekFrom};
use std::sync::Arc;

use super::container::{Bytes, Container, Next, damaged};
use crate::scans::mcap::{Channel, Message};

const INNER: u8 = 5;
const LEAF: u8 = 13;
/// Deeper trees have no place in a file.
const DEPTH_MAX: usize = 20;
/// Longer rows are not believed.
const LONGEST: u64 = 1 << 28;

/// A value of a row.
#[derive(Debug, Clone, PartialEq)]
enum Value {
    Number(i64),
    Bytes(Vec<u8>),
    /// A NULL, or a number with a point.
    Other,
}

struct File {
    input: Box<dyn Bytes>,
    page_size: u64,
    /// Of a page, without what is reserved at its end.
    usable: u64,
    pages: u64,
}

/// A table, from one row to the next.
struct Cursor {
    /// Pages, and the cell to look at next in each.
    stack: Vec<(Page, usize)>,
    /// Pages that may still be read: each once.
    budget: u64,
}

struct Page {
    number: u64,
    bytes: Vec<u8>,
    /// Where its head begins.
    head: usize,
}

/// See the [module](self).
pub(super) struct SqliteBag {
    file: File,
    topics: HashMap<i64, Arc<Channel>>,
    messages: Cursor,
    read: u64,
    is_over: bool,
}

impl SqliteBag {
    pub fn new(input: Box<dyn Bytes>) -> io::Result<Self> {
        let mut file = File::new(input)?;
        let no_bag = || io::Error::other("an SQLite file, but no bag: expected the tables topics and messages");
        let mut roots = HashMap::new();
        let mut tables = file.table(1);
        while let Ok(Some((_, row))) = file.next_row(&mut tables) {
            if let [Value::Bytes(_), Value::Bytes(name), _, Value::Number(root), ..] = &row[..] {
                roots.insert(name.clone(), *root as u64);
            }
        }
        let root = |name: &[u8]| roots.get(name).copied().ok_or_else(no_bag);
        let (mut rows, messages) = (file.table(root(b"topics")?), file.table(root(b"messages")?));
        let mut topics = HashMap::new();
        while let Ok(Some((id, row))) = file.next_row(&mut rows) {
            let [_, Value::Bytes(topic), Value::Bytes(schema), Value::Bytes(encoding), ..] = &row[..] else { continue };
            let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
            let channel = Channel { topic: text(topic), encoding: text(encoding), schema: text(schema) };
            topics.insert(id, Arc::new(channel));
        }
        Ok(Self { file, topics, messages, read: 0, is_over: false })
    }
}

impl Container for SqliteBag {
    fn next(&mut self) -> Next {
        while !self.is_over {
            let at = self.messages.stack.last().map_or(0, |(page, _)| (page.number.max(1) - 1) * self.file.page_size);
            self.read = self.read.max(at);
            let (id, row) = match self.file.next_row(&mut self.messages) {
                Ok(Some(row)) => row,
                Ok(None) => break,
                Err(Broken) => {
                    self.is_over = true;
                    return damaged(at, "a page of the table messages");
                }
            };
            let [_, Value::Number(topic), Value::Number(time), Value::Bytes(data)] = &row[..] else {
                return damaged(at, &format!("topic, time and data in row {id} of messages"));
            };
            if let Some(channel) = self.topics.get(topic) {
                let (channel, time_ns) = (channel.clone(), (*time).max(0) as u64);
                return Next::Message(Message { channel, sequence: 0, time_ns, data: data.clone(), is_suspect: false });
            }
        }
        let is_cut = self.is_over;
        self.is_over = true;
        Next::End { is_cut }
    }

    fn position(&self) -> u64 {
        self.read
    }
}

/// The tree of a table is damaged, or the file ends within it.
#[derive(Debug)]
struct Broken;

impl File {
    fn new(mut input: Box<dyn Bytes>) -> io::Result<Self> {
        let mut head = [0; 100];
        input.read_exact(&mut head)?;
        let page_size = match u16::from_be_bytes([head[16], head[17]]) {
            1 => 65_536,
            size => u64::from(size),
        };
        let usable = page_size.saturating_sub(head[20].into());
        if usable < 480 || !page_size.is_power_of_two() {
            return Err(io::Error::other(format!(
                "an SQLite file with pages of {page_size} bytes: expected 512 to 65536"
            )));
        }
        let pages = input.seek(SeekFrom::End(0))?.div_ceil(page_size);
        Ok(Self { input, page_size, usable, pages })
    }

    /// The table whose tree begins at page `root`.
    fn table(&mut self, root: u64) -> Cursor {
        let mut cursor = Cursor { stack: Vec::new(), budget: self.pages };
        // What cannot be read is found out by the first row; such a page has no place in the file.
        let page = self.page(root).unwrap_or(Page { number: 0, bytes: Vec::new(), head: 0 });
        cursor.stack.push((page, 0));
        cursor
    }

    fn page(&mut self, number: u64) -> Option<Page> {
        let begin = number.checked_sub(1)?.checked_mul(self.page_size)?;
        self.input.seek(SeekFrom::Start(begin)).ok()?;
        let mut bytes = vec![0; self.page_size as usize];
        self.input.read_exact(&mut bytes).ok()?;
        Some(Page { number, bytes, head: if number == 1 { 100 } else { 0 } })
    }

    /// The next row: its id and values.
    fn next_row(&mut self, cursor: &mut Cursor) -> Result<Option<(i64, Vec<Value>)>, Broken> {
        while let Some((page, cell)) = cursor.stack.last_mut() {
            let (kind, count) = (page.u8(0).ok_or(Broken)?, usize::from(page.u16(3).ok_or(Broken)?));
            let index = *cell;
            *cell += 1;
            match kind {
                LEAF if index < count => {
                    let at = page.cell(8, index).ok_or(Broken)?;
                    let (length, used) = varint(page.bytes.get(at..).ok_or(Broken)?).ok_or(Broken)?;
                    let at = at + used;
                    let (id, used) = varint(page.bytes.get(at..).ok_or(Broken)?).ok_or(Broken)?;
                    let rest = page.bytes.get(at + used..).ok_or(Broken)?.to_vec();
                    let row = self.payload(length as u64, &rest).ok_or(Broken)?;
                    return Ok(Some((id, values(&row).ok_or(Broken)?)));
                }
                INNER if index <= count => {
                    let child = if index < count {
                        let at = page.cell(12, index).ok_or(Broken)?;
                        be_u32(&page.bytes, at).ok_or(Broken)?
                    } else {
                        be_u32(&page.bytes, page.head + 8).ok_or(Broken)?
                    };
                    cursor.budget = cursor.budget.checked_sub(1).ok_or(Broken)?;
                    let child = self.page(child.into()).ok_or(Broken)?;
                    if cursor.stack.len() >= DEPTH_MAX {
                        return Err(Broken);
                    }
                    cursor.stack.push((child, 0));
                }
                LEAF | INNER => drop(cursor.stack.pop()),
                _ => return Err(Broken),
            }
        }
        Ok(None)
    }

    /// A row of `length` bytes that begins with `here`; what has no room there is on pages of its own.
    fn payload(&mut self, length: u64, here: &[u8]) -> Option<Vec<u8>> {
        if length > LONGEST || length > self.pages * self.page_size {
            return None;
        }
        let (most, least) = (self.usable - 35, (self.usable - 12) * 32 / 255 - 23);
        let local = if length <= most {
            length
        } else {
            let local = least + (length - least) % (self.usable - 4);
            if local <= most { local } else { least }
        };
        let mut row = here.get(..local as usize)?.to_vec();
        let mut next = if local < length { be_u32(here, local as usize)? } else { 0 };
        while (row.len() as u64) < length {
            let page = self.page(next.into())?;
            next = be_u32(&page.bytes, 0)?;
            let count = (length - row.len() as u64).min(self.usable - 4) as usize;
            row.extend_from_slice(page.bytes.get(4..4 + count)?);
        }
        Some(row)
    }
}

impl Page {
    fn u8(&self, at: usize) -> Option<u8> {
        self.bytes.get(self.head + at).copied()
    }

    fn u16(&self, at: usize) -> Option<u16> {
        Some(u16::from_be_bytes([self.u8(at)?, self.u8(at + 1)?]))
    }

    /// Where a cell begins; `head` is the length of the page's head.
    fn cell(&self, head: usize, index: usize) -> Option<usize> {
        self.u16(head + 2 * index).map(usize::from)
    }
}

fn be_u32(bytes: &[u8], at: usize) -> Option<u32> {
    bytes.get(at..)?.first_chunk().map(|bytes| u32::from_be_bytes(*bytes))
}

/// A number of 1 to 9 bytes, and how many they are.
fn varint(bytes: &[u8]) -> Option<(i64, usize)> {
    let mut value = 0u64;
    for (place, byte) in bytes.iter().take(9).enumerate() {
        if place == 8 {
            return Some(((value << 8 | u64::from(*byte)) as i64, 9));
        }
        value = value << 7 | u64::from(byte & 0x7f);
        if byte & 0x80 == 0 {
            return Some((value as i64, place + 1));
        }
    }
    None
}

/// The values of a row: their types first, then they themselves.
fn values(row: &[u8]) -> Option<Vec<Value>> {
    let (head, used) = varint(row)?;
    let mut types = row.get(used..usize::try_from(head).ok()?)?;
    let mut content = row.get(head as usize..)?;
    let mut values = Vec::new();
    while !types.is_empty() {
        let (kind, used) = varint(types)?;
        types = types.get(used..)?;
        let length = match kind {
            0 | 8 | 9 => 0,
            1..=4 => kind as usize,
            5 => 6,
            6 | 7 => 8,
            12.. => usize::try_from((kind - 12) / 2).ok()?,
            _ => return None,
        };
        let (bytes, rest) = content.split_at_checked(length)?;
        content = rest;
        values.push(match kind {
            1..=6 => {
                let sign = if bytes.first()? & 0x80 == 0 { 0 } else { -1 };
                Value::Number(bytes.iter().fold(sign, |value, byte| value << 8 | i64::from(*byte)))
            }
            8 | 9 => Value::Number(kind - 8),
            12.. => Value::Bytes(bytes.to_vec()),
            _ => Value::Other,
        });
    }
    Some(values)
}
