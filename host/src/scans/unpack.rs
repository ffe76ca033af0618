//! Chunks of bags, unpacked: `lz4`, `zstd` and `bz2`, each in Rust alone.

use std::io::Read;

/// What `packed` holds, at most `most` bytes; an empty codec or `none` is no packing. `None` if it is damaged, or the codec not known.
pub(crate) fn unpack(codec: &str, packed: &[u8], most: u64) -> Option<Vec<u8>> {
    let read = |source: &mut dyn Read| {
        let mut records = Vec::new();
        source.take(most).read_to_end(&mut records).ok().map(|_| records)
    };
    match codec {
        "" | "none" => Some(packed.to_vec()),
        "lz4" => read(&mut lz4_flex::frame::FrameDecoder::new(packed)),
        "zstd" => read(&mut ruzstd::decoding::StreamingDecoder::new(packed).ok()?),
        "bz2" => read(&mut bzip2::read::BzDecoder::new(packed)),
        _ => None,
    }
}
