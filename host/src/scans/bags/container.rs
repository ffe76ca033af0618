//! What messages are kept in, told apart by the first bytes of the file.

use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::Path;

use super::ros1::Ros1Bag;
use super::sqlite::SqliteBag;
use crate::input::text::FieldFault;
use crate::scans::mcap::{McapReader, Message, is_mcap};

/// The kinds of bags.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BagKind {
    /// MCAP: ROS 2 by default, Foxglove, this program.
    Mcap,
    /// SQLite: ROS 2 up to Humble.
    Sqlite,
    /// ROS 1, version 2.0.
    Ros1,
}

/// Which bag begins with these bytes; 16 are enough.
pub fn bag_kind(bytes: &[u8]) -> Option<BagKind> {
    match bytes {
        _ if is_mcap(bytes) => Some(BagKind::Mcap),
        _ if bytes.starts_with(b"SQLite format 3\0") => Some(BagKind::Sqlite),
        _ if bytes.starts_with(b"#ROSBAG V2.0\n") => Some(BagKind::Ros1),
        _ => None,
    }
}

/// What comes next out of a file.
pub(super) enum Next {
    Message(Message),
    Damaged(FieldFault),
    End { is_cut: bool },
}

/// Messages in the order of their file.
pub(super) trait Container: Send {
    /// After the end, the end again.
    fn next(&mut self) -> Next;
    /// Bytes that were read.
    fn position(&self) -> u64;
}

/// Bytes with places.
pub(super) trait Bytes: Read + Seek + Send {}
impl<T: Read + Seek + Send> Bytes for T {}

pub(super) fn open(path: &Path) -> io::Result<Box<dyn Container>> {
    let mut wal = path.as_os_str().to_owned();
    wal.push("-wal");
    let is_unfinished = std::fs::metadata(&wal).is_ok_and(|about| about.len() > 0);
    let mut file = BufReader::with_capacity(1 << 16, File::open(path)?);
    if is_unfinished && kind_of(&mut file)? == Some(BagKind::Sqlite) {
        let wal = Path::new(&wal).display();
        return Err(io::Error::other(format!(
            "a part of this bag is still in {wal}: its recorder was killed; `sqlite3 BAG .tables` puts it in"
        )));
    }
    from_reader(Box::new(file))
}

pub(super) fn from_reader(mut input: Box<dyn Bytes>) -> io::Result<Box<dyn Container>> {
    match kind_of(&mut input)? {
        Some(BagKind::Mcap) => Ok(Box::new(McapBag(McapReader::new(input)?))),
        Some(BagKind::Sqlite) => Ok(Box::new(SqliteBag::new(input)?)),
        Some(BagKind::Ros1) => Ok(Box::new(Ros1Bag::new(input)?)),
        None => Err(io::Error::other("not a bag: neither MCAP nor SQLite nor ROS 1")),
    }
}

fn kind_of(input: &mut (impl Read + Seek + ?Sized)) -> io::Result<Option<BagKind>> {
    let mut magic = Vec::new();
    input.take(16).read_to_end(&mut magic)?;
    input.seek(SeekFrom::Start(0))?;
    Ok(bag_kind(&magic))
}

/// A part of a file is damaged.
pub(super) fn damaged(at: u64, expected: &str) -> Next {
    let (field, found) = (format!("bytes from {at} on"), "damage".to_owned());
    Next::Damaged(FieldFault { field, expected: expected.to_owned(), found })
}

struct McapBag<R>(McapReader<R>);

impl<R: Read + Seek + Send> Container for McapBag<R> {
    fn next(&mut self) -> Next {
        loop {
            self.0.look_ahead();
            if let Some(at) = self.0.take_damage().first() {
                return damaged(*at, "a whole chunk");
            }
            match self.0.next_message() {
                // Which of a damaged chunk's messages is wrong, nobody knows.
                Some(message) if message.is_suspect => {}
                Some(message) => return Next::Message(message),
                None => return Next::End { is_cut: !self.0.is_closed() },
            }
        }
    }

    fn position(&self) -> u64 {
        self.0.position()
    }
}
