//! MCAP: the container in which robots' messages are kept and that Foxglove, Lichtblick and others open.
//!
//! ```text
//! file    = magic, header, (schema | channel | message | chunk | index)…, end of data, summary, footer, magic
//! record  = kind (u8), length (u64), so many bytes; all numbers little-endian, texts with their length (u32) before them
//! chunk   = times, CRC-32, codec, and in it schemas, channels and messages
//! ```
//! A [`McapFile`] writes whole chunks, three a second: a program that is killed leaves a file that opens, without its last moment.
//! A [`McapReader`] goes from record to record, and over damage to the next chunk. Source: MCAP specification, version 0.
//!
//! Not here: attachments and metadata, which are passed over.

mod fields;
mod reader;
mod shared;
mod stream;
mod writer;

pub use fields::Fields;
pub use reader::{Channel, McapReader, Message};
pub use shared::SharedMcap;
pub use stream::{RAW_ENCODING, RAW_TOPIC, RawBytes};
pub use writer::{ChannelPlan, McapFile};

/// First and last bytes of a file.
pub const MAGIC: &[u8; 8] = b"\x89MCAP0\r\n";

const HEADER: u8 = 1;
const FOOTER: u8 = 2;
const SCHEMA: u8 = 3;
const CHANNEL: u8 = 4;
const MESSAGE: u8 = 5;
const CHUNK: u8 = 6;
const MESSAGE_INDEX: u8 = 7;
const CHUNK_INDEX: u8 = 8;
const STATISTICS: u8 = 11;
const SUMMARY_OFFSET: u8 = 14;
const DATA_END: u8 = 15;

/// Kind and length of a record, bytes.
const HEAD: usize = 9;

/// True if `bytes` begin as a file does.
pub fn is_mcap(bytes: &[u8]) -> bool {
    bytes.starts_with(MAGIC)
}

#[cfg(test)]
mod tests;
