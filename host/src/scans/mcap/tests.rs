//! What is written is read, whatever is missing of it.

use std::fs::File;
use std::io::{Cursor, Read as _};

use super::*;
use crate::output::GrowingFile;

const PLANS: &[ChannelPlan] = &[
    ChannelPlan { topic: RAW_TOPIC, encoding: RAW_ENCODING, schema: None },
    ChannelPlan { topic: "/a", encoding: "json", schema: Some(("A", "{}")) },
];

/// A file of `count` messages each in two channels, a chunk for every ten.
fn written(count: u8, is_finished: bool) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let mut file = McapFile::new(GrowingFile::new(&path, File::create(&path).unwrap()), PLANS, 1 << 30);
    for number in 0..count {
        assert!(file.write(0, u64::from(number) + 1, &[number; 50]) && file.write(1, u64::from(number) + 1, b"{}"));
        if number % 10 == 9 {
            file.flush();
        }
    }
    if is_finished {
        file.finish().unwrap();
    } else {
        file.flush();
    }
    std::fs::read(path).unwrap()
}

/// Numbers of the messages read, whether the end was there, and how often there was damage.
fn read(bytes: &[u8]) -> (Vec<u8>, bool, usize) {
    let mut reader = McapReader::new(Cursor::new(bytes)).unwrap();
    let mut numbers = Vec::new();
    while let Some(message) = reader.next_message() {
        if message.channel.topic == RAW_TOPIC && !message.is_suspect {
            assert!(message.data.len() == 50 && message.time_ns == u64::from(message.data[0]) + 1);
            assert_eq!(message.sequence, u32::from(message.data[0]));
            numbers.push(message.data[0]);
        }
    }
    (numbers, reader.is_closed(), reader.take_damage().len())
}

#[test]
fn all_is_read_and_of_a_file_cut_anywhere_all_whole_chunks() {
    let whole = written(100, true);
    assert_eq!(read(&whole), ((0..100).collect(), true, 0));
    let killed = written(100, false);
    assert!(whole.starts_with(&killed[..killed.len()]));
    for cut in (8..killed.len()).step_by(37) {
        let (numbers, is_closed, damage) = read(&killed[..cut]);
        let count = numbers.len() as u8;
        assert!(
            numbers == (0..count).collect::<Vec<_>>() && count.is_multiple_of(10) && !is_closed && damage == 0,
            "{cut}"
        );
        assert!(usize::from(count) * killed.len() + 2 * killed.len() * 10 > cut * 100, "{cut}: only {count}");
    }
}

#[test]
fn flipped_bits_cost_a_chunk_at_most() {
    let whole = written(100, true);
    let end = written(100, false).len();
    for at in (300..end).step_by(13) {
        let mut bytes = whole.clone();
        bytes[at] ^= 0x10;
        let (numbers, _, _) = read(&bytes);
        assert!(numbers.len() >= 90, "{at}: {}", numbers.len());
        assert!(numbers.is_sorted(), "{at}");
    }
}

#[test]
fn the_laser_s_bytes_are_a_stream_with_its_holes_marked() {
    let whole = written(30, true);
    let stream = |bytes: Vec<u8>| {
        let mut all = Vec::new();
        RawBytes::new(Cursor::new(bytes)).unwrap().unwrap().read_to_end(&mut all).unwrap();
        all
    };
    let wanted: Vec<u8> = (0..30).flat_map(|number| [number; 50]).collect();
    assert_eq!(stream(whole.clone()), wanted);
    // The second chunk loses its kind: it is passed over.
    let begins = |at: &usize| {
        let mut fields = Fields(&whole[*at..]);
        fields.u8() == Some(CHUNK) && fields.u64().is_some() && (fields.u64(), fields.u64()) == (Some(11), Some(20))
    };
    let second = (0..whole.len()).find(begins).unwrap();
    let mut bytes = whole.clone();
    bytes[second] = 0x7e;
    let damaged = stream(bytes);
    assert_eq!(damaged.len(), 20 * 50 + 33);
    assert!(damaged[..500] == wanted[..500] && damaged[533..] == wanted[1000..]);
}
