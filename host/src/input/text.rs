//! Text files line by line: plain or gzip, in bounded memory, with count and hash of the bytes read so far.
//!
//! Data flow: file → byte counter and hash → gzip if its magic bytes say so → lines of at most [`LINE_BYTES_MAX`].
//! What a line means is its reader's business; [`Words`] cuts it into fields and says which one is wrong.

use std::fs::File;
use std::io::{self, BufRead, BufReader, Chain, Cursor, ErrorKind, Read};
use std::path::Path;
use std::str::FromStr;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use flate2::read::MultiGzDecoder;
use serde::Serialize;
use sha2::{Digest, Sha256};

/// A longer line is not text of ours: a scan of 1081 beams with remissions needs 20 kB.
pub const LINE_BYTES_MAX: usize = 1 << 20;

/// First bytes of every gzip file (RFC 1952, 2.3.1).
const GZIP_MAGIC: [u8; 2] = [0x1f, 0x8b];

/// Why no further line can be had.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LineFault {
    /// The compressed data end early.
    #[error("the gzip data end early: the file is cut off")]
    Truncated,
    /// More than [`LINE_BYTES_MAX`] bytes without a line end.
    #[error("a line is longer than {LINE_BYTES_MAX} bytes: not a text file")]
    TooLong,
    /// The file cannot be read, or its gzip data are damaged.
    #[error("{0}")]
    Io(#[from] io::Error),
}

/// A field that is missing or not what it should be.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error, Serialize)]
#[error("field {field}: expected {expected}, found {found}")]
pub struct FieldFault {
    /// Its name, such as `range 17`.
    pub field: String,
    /// What would be right.
    pub expected: String,
    /// What stands there, or that nothing does.
    pub found: String,
}

/// One line without its end.
#[derive(Debug)]
pub struct Line<'a> {
    /// Counted from 1.
    pub number: u64,
    /// Bytes that are not UTF-8 are replaced.
    pub text: std::borrow::Cow<'a, str>,
    /// False for a last line without line end: it may have been cut.
    pub ended: bool,
}

/// Bytes taken from the file so far; clones share the count.
#[derive(Debug, Clone, Default)]
pub struct ByteCount(Arc<AtomicU64>);

impl ByteCount {
    /// So many now, for who reads in other ways.
    pub(crate) fn set(&self, bytes: u64) {
        self.0.store(bytes, Ordering::Relaxed);
    }

    /// Bytes, compressed ones if the file is gzip.
    pub fn get(&self) -> u64 {
        self.0.load(Ordering::Relaxed)
    }
}

/// Bytes as they come, counted and hashed.
struct Source {
    inner: Box<dyn Read + Send>,
    count: ByteCount,
    hash: Sha256,
}

impl Read for Source {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = self.inner.read(buffer)?;
        self.count.0.fetch_add(read as u64, Ordering::Relaxed);
        self.hash.update(buffer.get(..read).unwrap_or_default());
        Ok(read)
    }
}

/// The first two bytes again, then the rest.
type Whole = Chain<Cursor<Vec<u8>>, Source>;

enum Text {
    Plain(Whole),
    Gzip(Box<MultiGzDecoder<Whole>>),
}

impl Text {
    fn source(&mut self) -> &mut Source {
        match self {
            Self::Plain(whole) => whole.get_mut().1,
            Self::Gzip(packed) => packed.get_mut().get_mut().1,
        }
    }
}

impl Read for Text {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        match self {
            Self::Plain(whole) => whole.read(buffer),
            Self::Gzip(packed) => packed.read(buffer),
        }
    }
}

/// The lines of a plain or gzip text.
pub struct Lines {
    input: BufReader<Text>,
    buffer: Vec<u8>,
    number: u64,
    count: ByteCount,
}

impl Lines {
    /// Opens the file at `path`; its size in bytes comes with it.
    ///
    /// # Errors
    /// If it cannot be opened, or is not a file with bytes in it (a folder).
    pub fn open(path: &Path) -> Result<(Self, u64), LineFault> {
        let file = File::open(path)?;
        let about = file.metadata()?;
        if about.is_dir() {
            return Err(io::Error::new(ErrorKind::IsADirectory, "it is a folder").into());
        }
        Ok((Self::new(BufReader::with_capacity(1 << 16, file))?, about.len()))
    }

    /// Reads from anything.
    ///
    /// # Errors
    /// If its first two bytes cannot be read.
    pub fn new(source: impl Read + Send + 'static) -> Result<Self, LineFault> {
        let count = ByteCount::default();
        let mut source = Source { inner: Box::new(source), count: count.clone(), hash: Sha256::new() };
        let mut magic = Vec::with_capacity(GZIP_MAGIC.len());
        source.by_ref().take(GZIP_MAGIC.len() as u64).read_to_end(&mut magic)?;
        let gzip = magic == GZIP_MAGIC;
        let whole = Cursor::new(magic).chain(source);
        let text = if gzip { Text::Gzip(Box::new(MultiGzDecoder::new(whole))) } else { Text::Plain(whole) };
        Ok(Self { input: BufReader::with_capacity(1 << 16, text), buffer: Vec::new(), number: 0, count })
    }

    /// The count of bytes read, to watch while lines are taken.
    pub fn bytes_read(&self) -> ByteCount {
        self.count.clone()
    }

    /// SHA-256 of the bytes read so far, hexadecimal; compressed ones if the file is gzip.
    pub fn sha256(&mut self) -> String {
        let hash = self.input.get_mut().source().hash.clone();
        hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
    }

    /// Reads what is left behind the last line or a fault, for the hash alone.
    ///
    /// # Errors
    /// If reading fails; what was read until then counts.
    pub fn read_rest(&mut self) -> io::Result<()> {
        io::copy(self.input.get_mut().source(), &mut io::sink()).map(drop)
    }

    /// The next line; `None` at the end. After a fault there is nothing more to be had, but see
    /// [`skip_line`](Self::skip_line).
    ///
    /// # Errors
    /// See [`LineFault`].
    pub fn next_line(&mut self) -> Result<Option<Line<'_>>, LineFault> {
        self.buffer.clear();
        let mut limited = (&mut self.input).take(LINE_BYTES_MAX as u64 + 1);
        limited.read_until(b'\n', &mut self.buffer).map_err(cut_or_io)?;
        if self.buffer.is_empty() {
            return Ok(None);
        }
        self.number += 1;
        let ended = self.buffer.last() == Some(&b'\n');
        if !ended && self.buffer.len() > LINE_BYTES_MAX {
            return Err(LineFault::TooLong);
        }
        let text = String::from_utf8_lossy(self.buffer.trim_ascii());
        Ok(Some(Line { number: self.number, text, ended }))
    }

    /// Passes over the rest of a line that was [too long](LineFault::TooLong).
    ///
    /// # Errors
    /// As [`next_line`](Self::next_line).
    pub fn skip_line(&mut self) -> Result<(), LineFault> {
        self.input.skip_until(b'\n').map(drop).map_err(cut_or_io)
    }

    /// Number of the line read last, from 1; 0 before the first.
    pub fn line_number(&self) -> u64 {
        self.number
    }
}

fn cut_or_io(error: io::Error) -> LineFault {
    if error.kind() == ErrorKind::UnexpectedEof { LineFault::Truncated } else { LineFault::Io(error) }
}

/// Numbers in files are no larger, either way: times in s fit µs in 64 bits, and squares of lengths stay numbers.
const FIELD_MAX: f64 = 1e12;

/// The fields of one line, taken from left to right.
pub struct Words<'a> {
    words: std::str::SplitAsciiWhitespace<'a>,
}

impl<'a> Words<'a> {
    /// The fields of `text`.
    pub fn new(text: &'a str) -> Self {
        Self { words: text.split_ascii_whitespace() }
    }

    /// The next field as it is.
    pub fn word(&mut self) -> Option<&'a str> {
        self.words.next()
    }

    /// How many fields are left.
    pub fn left(&self) -> usize {
        self.words.clone().count()
    }

    /// The next field as `T`; `name` is asked for only if it is wrong.
    ///
    /// # Errors
    /// If it is missing or does not parse.
    pub fn parse<T: FromStr>(&mut self, name: impl Fn() -> String, expected: &str) -> Result<T, FieldFault> {
        let word = self.words.next();
        word.and_then(|w| w.parse().ok()).ok_or_else(|| fault(name(), expected, word))
    }

    /// The next field as a number up to `FIELD_MAX` (1e12) either way.
    ///
    /// # Errors
    /// If it is missing, does not parse or is larger.
    pub fn finite(&mut self, name: &str) -> Result<f64, FieldFault> {
        const EXPECTED: &str = "a finite number up to 1e12";
        let word = self.words.next();
        let number = word.and_then(|w| w.parse::<f64>().ok()).filter(|n| n.abs() <= FIELD_MAX);
        number.ok_or_else(|| fault(name.to_owned(), EXPECTED, word))
    }
}

/// Describes a wrong field; `found` is cut to a length that fits a message.
pub fn fault(field: String, expected: &str, found: Option<&str>) -> FieldFault {
    let found = match found {
        None => "the end of the line".to_owned(),
        Some(word) if word.chars().count() > 40 => format!("\"{}…\"", word.chars().take(40).collect::<String>()),
        Some(word) => format!("\"{word}\""),
    };
    FieldFault { field, expected: expected.to_owned(), found }
}

#[cfg(test)]
mod tests {
    use super::*;
    use flate2::{Compression, write::GzEncoder};
    use std::io::Write;

    fn gzip(text: &[u8]) -> Vec<u8> {
        let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
        encoder.write_all(text).unwrap();
        encoder.finish().unwrap()
    }

    fn all(bytes: Vec<u8>) -> Result<Vec<(u64, String, bool)>, LineFault> {
        let mut lines = Lines::new(Cursor::new(bytes))?;
        let mut found = Vec::new();
        while let Some(line) = lines.next_line()? {
            found.push((line.number, line.text.into_owned(), line.ended));
        }
        Ok(found)
    }

    #[test]
    fn plain_and_gzip_give_the_same_lines() {
        let text = b"one\r\n\n two \nlast".to_vec();
        let expected =
            [(1, "one".into(), true), (2, "".into(), true), (3, "two".into(), true), (4, "last".into(), false)];
        assert_eq!(all(text.clone()).unwrap(), expected);
        assert_eq!(all(gzip(&text)).unwrap(), expected);
        assert!(all(Vec::new()).unwrap().is_empty());
        assert_eq!(all(vec![0x1f]).unwrap().len(), 1);
    }

    #[test]
    fn cut_gzip_and_endless_lines_are_told_apart() {
        let numbers: String = (0..20_000).map(|i| format!("{}\n", i * i)).collect();
        let mut packed = gzip(numbers.as_bytes());
        packed.truncate(packed.len() / 2);
        assert!(matches!(all(packed), Err(LineFault::Truncated)));
        assert!(matches!(all(vec![b'x'; LINE_BYTES_MAX + 1]), Err(LineFault::TooLong)));
        assert_eq!(all(vec![b'x'; LINE_BYTES_MAX]).unwrap().len(), 1);
    }

    #[test]
    fn lines_go_on_behind_one_that_is_too_long() {
        let mut lines =
            Lines::new(Cursor::new([vec![b'x'; 3 * LINE_BYTES_MAX], b"\nnext\n".to_vec()].concat())).unwrap();
        assert!(matches!(lines.next_line(), Err(LineFault::TooLong)));
        lines.skip_line().unwrap();
        let next = lines.next_line().unwrap().unwrap();
        assert_eq!((next.number, next.text.as_ref()), (2, "next"));
    }

    #[test]
    fn hash_is_that_of_the_bytes_in_the_file() {
        let sha256 = |bytes: &[u8]| {
            let mut lines = Lines::new(Cursor::new(bytes.to_vec())).unwrap();
            while let Ok(Some(_)) = lines.next_line() {}
            lines.read_rest().unwrap();
            assert_eq!(lines.bytes_read().get(), bytes.len() as u64);
            lines.sha256()
        };
        // FIPS 180-4, one block.
        assert_eq!(sha256(b"abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
        let packed = gzip(&[b'a'; 3 << 20]);
        let expected: String = Sha256::digest(&packed).iter().map(|byte| format!("{byte:02x}")).collect();
        assert_eq!(sha256(&packed), expected);
        let plain = [vec![b'x'; 5 * LINE_BYTES_MAX], b"\nrest".to_vec()].concat();
        let expected: String = Sha256::digest(&plain).iter().map(|byte| format!("{byte:02x}")).collect();
        assert_eq!(sha256(&plain), expected, "behind a fault too");
    }

    #[test]
    fn wrong_fields_are_named() {
        let mut words = Words::new("1.5 abc inf 1e308");
        assert_eq!(words.finite("x"), Ok(1.5));
        let error = words.parse::<u32>(|| "count".into(), "a whole number").unwrap_err();
        assert_eq!(error.to_string(), "field count: expected a whole number, found \"abc\"");
        assert!(words.finite("t").is_err() && words.finite("t").is_err());
        assert_eq!(words.finite("y").unwrap_err().found, "the end of the line");
    }
}
