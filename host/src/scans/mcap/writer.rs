//! Writes a file of chunks, each whole and on its way to the disk at once.

use std::time::{Duration, Instant};

use crc::{CRC_32_ISO_HDLC, Crc};

use super::fields::Filling;
use super::{CHANNEL, CHUNK, CHUNK_INDEX, DATA_END, FOOTER, HEADER, MAGIC, MESSAGE, MESSAGE_INDEX};
use super::{SCHEMA, STATISTICS, SUMMARY_OFFSET};
use crate::output::GrowingFile;

/// A chunk is written when its first message has waited so long: what a kill takes.
const SAVE_EVERY: Duration = Duration::from_millis(300);
/// It is also written when it has so many bytes.
const CHUNK_BYTES: usize = 1 << 20;
/// Room that is left for what closes a file, besides a chunk's index each.
const CLOSING: u64 = 64 << 10;

pub(super) static CRC32: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);

/// A channel, and what its messages are like.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ChannelPlan {
    /// Its name.
    pub topic: &'static str,
    /// How a message is written: `json`.
    pub encoding: &'static str,
    /// Name and text of the JSON schema that describes it, if one does.
    pub schema: Option<(&'static str, &'static str)>,
}

struct ChunkEntry {
    times: [u64; 2],
    at: u64,
    length: u64,
    /// Of each channel: where its index is.
    indices: Vec<(u16, u64)>,
    index_length: u64,
    bytes: u64,
}

/// See the [module](super).
pub struct McapFile {
    file: GrowingFile,
    plans: &'static [ChannelPlan],
    max_bytes: u64,
    /// In the file.
    at: u64,
    chunk: Vec<u8>,
    since: Option<Instant>,
    times: Option<[u64; 2]>,
    /// Of each channel: times of the chunk's messages, and where they begin in it.
    index: Vec<Vec<(u64, u64)>>,
    /// Of each channel: messages handed over, and those in the file.
    counts: Vec<[u64; 2]>,
    chunks: Vec<ChunkEntry>,
    is_full: bool,
}

impl McapFile {
    /// Begins a file in which a channel's number is its place in `plans`.
    ///
    /// * `max_bytes` — it does not get larger
    pub fn new(file: GrowingFile, plans: &'static [ChannelPlan], max_bytes: u64) -> Self {
        let mut head = MAGIC.to_vec();
        let library = concat!("lrfslam ", env!("CARGO_PKG_VERSION"));
        Filling::default().text("").text(library).close(HEADER, &mut head);
        describe(plans, &mut head);
        let (index, counts) = (vec![Vec::new(); plans.len()], vec![[0; 2]; plans.len()]);
        let mut new = Self {
            file,
            plans,
            max_bytes,
            at: 0,
            chunk: Vec::new(),
            since: None,
            times: None,
            index,
            counts,
            chunks: Vec::new(),
            is_full: false,
        };
        new.put(&head);
        new
    }

    /// The file below, for its news.
    pub fn file(&mut self) -> &mut GrowingFile {
        &mut self.file
    }

    /// Bytes in the file, and those that wait.
    pub fn bytes(&self) -> u64 {
        self.at + self.chunk.len() as u64
    }

    /// True if it has ended at its largest size.
    pub fn is_full(&self) -> bool {
        self.is_full
    }

    /// Adds a message; `time_ns` since 1970. False if there is no room for it, nor will be.
    pub fn write(&mut self, channel: usize, time_ns: u64, data: &[u8]) -> bool {
        let needed = self.bytes() + data.len() as u64 + CLOSING + 200 * self.chunks.len() as u64;
        self.is_full |= needed > self.max_bytes;
        let Some([given, _]) = self.counts.get_mut(channel).filter(|_| !self.is_full) else { return false };
        if let Some(entries) = self.index.get_mut(channel) {
            entries.push((time_ns, self.chunk.len() as u64));
        }
        let sequence = *given as u32;
        *given += 1;
        let message = Filling::default().u16(channel as u16).u32(sequence).u64(time_ns).u64(time_ns);
        message.bytes(data).close(MESSAGE, &mut self.chunk);
        self.times = Some(spanned(self.times, [time_ns; 2]));
        let since = *self.since.get_or_insert_with(Instant::now);
        if since.elapsed() >= SAVE_EVERY || self.chunk.len() >= CHUNK_BYTES {
            self.flush();
        }
        true
    }

    /// Puts what waits into the file, as a chunk of its own.
    pub fn flush(&mut self) {
        self.since = None;
        let Some(times) = self.times.take() else { return };
        let records = std::mem::take(&mut self.chunk);
        let sum = CRC32.checksum(&records);
        let mut out = Vec::with_capacity(records.len() + 256);
        let chunk = Filling::default().u64(times[0]).u64(times[1]).u64(records.len() as u64).u32(sum).text("");
        chunk.u64(records.len() as u64).bytes(&records).close(CHUNK, &mut out);
        let length = out.len() as u64;
        let mut indices = Vec::new();
        let index: Vec<_> = self.index.iter_mut().map(std::mem::take).collect();
        for (channel, entries) in index.iter().enumerate().filter(|(_, entries)| !entries.is_empty()) {
            indices.push((channel as u16, self.at + out.len() as u64));
            let list = entries.iter().fold(Filling::default(), |list, (time, at)| list.u64(*time).u64(*at));
            Filling::default().u16(channel as u16).counted(&list.0).close(MESSAGE_INDEX, &mut out);
        }
        let index_length = out.len() as u64 - length;
        let at = self.at;
        if self.put(&out) {
            self.counts.iter_mut().zip(&index).for_each(|([_, kept], entries)| *kept += entries.len() as u64);
            self.chunks.push(ChunkEntry { times, at, length, indices, index_length, bytes: records.len() as u64 });
        }
    }

    /// What the disk has no room for, and memory neither, is a hole.
    fn put(&mut self, bytes: &[u8]) -> bool {
        let is_taken = self.file.write(bytes).is_ok();
        self.at += if is_taken { bytes.len() as u64 } else { 0 };
        is_taken
    }

    /// Writes what waits, and the summary.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn finish(&mut self) -> std::io::Result<()> {
        self.flush();
        let mut out = Vec::new();
        Filling::default().u32(0).close(DATA_END, &mut out);
        let begin = out.len();
        let mut groups = Vec::new();
        let mut group = |kind: u8, from: usize, out: &Vec<u8>| groups.push((kind, from, out.len() - from));
        let schemas_end = schemas(self.plans, &mut out);
        group(SCHEMA, begin, &out);
        channels(self.plans, &mut out);
        group(CHANNEL, schemas_end, &out);
        let from = out.len();
        self.statistics().close(STATISTICS, &mut out);
        group(STATISTICS, from, &out);
        let from = out.len();
        self.chunks.iter().for_each(|chunk| chunk.entry().close(CHUNK_INDEX, &mut out));
        group(CHUNK_INDEX, from, &out);
        let offsets = out.len();
        for (kind, from, length) in groups.into_iter().filter(|(.., length)| *length > 0) {
            let group = Filling::default().u8(kind).u64(self.at + from as u64).u64(length as u64);
            group.close(SUMMARY_OFFSET, &mut out);
        }
        let (summary, offsets) = (self.at + begin as u64, self.at + offsets as u64);
        // The sum goes over the summary and the footer up to itself.
        out.push(FOOTER);
        out.extend_from_slice(&20u64.to_le_bytes());
        out.extend_from_slice(&summary.to_le_bytes());
        out.extend_from_slice(&offsets.to_le_bytes());
        let sum = CRC32.checksum(out.get(begin..).unwrap_or_default());
        out.extend_from_slice(&sum.to_le_bytes());
        out.extend_from_slice(MAGIC);
        self.put(&out);
        self.file.finish()
    }

    fn statistics(&self) -> Filling {
        let count: u64 = self.counts.iter().map(|[_, kept]| kept).sum();
        let schemas = self.plans.iter().filter(|plan| plan.schema.is_some()).count();
        let times = self.chunks.iter().map(|chunk| chunk.times).fold(None, |all, times| Some(spanned(all, times)));
        let [first, last] = times.unwrap_or_default();
        let counts = self.counts.iter().enumerate().filter(|(_, [_, kept])| *kept > 0);
        let counts = counts.fold(Filling::default(), |list, (channel, [_, kept])| list.u16(channel as u16).u64(*kept));
        let head = Filling::default().u64(count).u16(schemas as u16).u32(self.plans.len() as u32).u32(0).u32(0);
        head.u32(self.chunks.len() as u32).u64(first).u64(last).counted(&counts.0)
    }
}

impl ChunkEntry {
    fn entry(&self) -> Filling {
        let indices = self.indices.iter().fold(Filling::default(), |map, (channel, at)| map.u16(*channel).u64(*at));
        let times = Filling::default().u64(self.times[0]).u64(self.times[1]).u64(self.at).u64(self.length);
        times.counted(&indices.0).u64(self.index_length).text("").u64(self.bytes).u64(self.bytes)
    }
}

/// The first and the last time.
fn spanned(known: Option<[u64; 2]>, [from, to]: [u64; 2]) -> [u64; 2] {
    known.map_or([from, to], |[first, last]| [first.min(from), last.max(to)])
}

/// A schema has the number of its channel, and one more: 0 is none.
fn describe(plans: &[ChannelPlan], out: &mut Vec<u8>) {
    schemas(plans, out);
    channels(plans, out);
}

fn schemas(plans: &[ChannelPlan], out: &mut Vec<u8>) -> usize {
    for (number, plan) in plans.iter().enumerate() {
        let Some((name, text)) = plan.schema else { continue };
        let schema = Filling::default().u16(number as u16 + 1).text(name).text("jsonschema");
        schema.counted(text.as_bytes()).close(SCHEMA, out);
    }
    out.len()
}

fn channels(plans: &[ChannelPlan], out: &mut Vec<u8>) {
    for (number, plan) in plans.iter().enumerate() {
        let schema = plan.schema.map_or(0, |_| number as u16 + 1);
        let channel = Filling::default().u16(number as u16).u16(schema).text(plan.topic).text(plan.encoding);
        channel.counted(&[]).close(CHANNEL, out);
    }
}
