//! Bytes to frames: everything between one empty line and the next.

/// Cuts a stream of bytes into frames at each pair of line feeds. Needs no more than its lent buffer.
///
/// A frame longer than the buffer is dropped up to its end and counted. Carriage returns before a line feed are kept (a
/// sensor never sends them). Empty lines between frames are skipped.
///
/// Source: manual, section 3.3: every reply ends with an empty line, and none occurs elsewhere.
///
/// ```
/// let mut memory = [0; 64];
/// let mut decoder = lrfslam_lrf::hokuyo_scip::ScipDecoder::new(&mut memory);
/// let (taken, frame) = decoder.feed(b"QT\n00P\n\nVV\n");
/// assert_eq!((taken, frame), (8, Some(&b"QT\n00P"[..])));
/// ```
#[derive(Debug)]
pub struct ScipDecoder<'a> {
    buffer: &'a mut [u8],
    len: usize,
    /// The frame in the buffer was handed out: start anew.
    done: bool,
    /// The running frame did not fit: drop until its end.
    oversize: bool,
    /// The last byte was a line feed.
    line_ended: bool,
    oversize_frames: u32,
}

impl<'a> ScipDecoder<'a> {
    /// A decoder for frames up to `buffer.len()` bytes.
    ///
    /// A UTM-30LX scan with intensities has 6715; a URG-04LX scan 2135.
    pub fn new(buffer: &'a mut [u8]) -> Self {
        Self { buffer, len: 0, done: false, oversize: false, line_ended: true, oversize_frames: 0 }
    }

    /// Takes bytes up to the end of the next frame: how many were taken, and the frame without its last two line feeds.
    ///
    /// Call again with the rest until nothing is left. Cost O(bytes).
    pub fn feed(&mut self, bytes: &[u8]) -> (usize, Option<&[u8]>) {
        if self.done {
            self.forget();
        }
        for (index, byte) in bytes.iter().enumerate() {
            if *byte == b'\n' && self.line_ended {
                if self.end_frame() {
                    let frame = self.buffer.get(..self.len.saturating_sub(1));
                    return (index + 1, frame);
                }
            } else {
                self.store(*byte);
            }
        }
        (bytes.len(), None)
    }

    /// Drops the frame begun so far.
    pub fn forget(&mut self) {
        (self.len, self.done, self.oversize, self.line_ended) = (0, false, false, true);
    }

    /// True while a frame has begun and has not ended.
    pub fn is_inside_frame(&self) -> bool {
        !self.done && self.len > 0
    }

    /// Frames dropped so far because they did not fit.
    pub fn oversize_frames(&self) -> u32 {
        self.oversize_frames
    }

    /// At an empty line: true if it ended a frame to hand out.
    fn end_frame(&mut self) -> bool {
        let complete = self.len > 0 && !self.oversize;
        if self.oversize {
            self.oversize_frames = self.oversize_frames.saturating_add(1);
        }
        if complete {
            self.done = true;
        } else {
            self.forget();
        }
        complete
    }

    fn store(&mut self, byte: u8) {
        self.line_ended = byte == b'\n';
        match self.buffer.get_mut(self.len) {
            Some(slot) => {
                *slot = byte;
                self.len += 1;
            }
            None => self.oversize = true,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::vec::Vec;

    fn frames(chunks: &[&[u8]], capacity: usize) -> Vec<Vec<u8>> {
        let mut memory = vec![0; capacity];
        let mut decoder = ScipDecoder::new(&mut memory);
        let mut found = Vec::new();
        for chunk in chunks {
            let mut rest = *chunk;
            while !rest.is_empty() {
                let (taken, frame) = decoder.feed(rest);
                found.extend(frame.map(<[u8]>::to_vec));
                rest = &rest[taken..];
            }
        }
        found
    }

    #[test]
    fn oversize_frame_is_skipped_to_its_end() {
        let found = frames(&[b"0123456789ABCDEF\n\nQT\n00P\n\n"], 8);
        assert_eq!(found, [b"QT\n00P"]);
    }

    #[test]
    fn empty_lines_make_no_frames() {
        assert_eq!(frames(&[b"\n\n\n\nBM\n02R\n\n\n\n"], 16), [b"BM\n02R"]);
    }

    proptest! {
        #[test]
        fn any_cut_gives_the_same_frames(
            bytes in proptest::collection::vec(prop_oneof![Just(b'\n'), any::<u8>()], 0..200),
            cuts in proptest::collection::vec(0_usize..200, 0..8),
        ) {
            let mut cuts: Vec<usize> = cuts.into_iter().map(|cut| cut.min(bytes.len())).collect();
            cuts.sort_unstable();
            let mut chunks = Vec::new();
            let mut from = 0;
            for cut in cuts.into_iter().chain([bytes.len()]) {
                chunks.push(&bytes[from..cut]);
                from = cut;
            }
            let single: Vec<&[u8]> = bytes.chunks(1).collect();
            prop_assert_eq!(frames(&chunks, 32), frames(&[&bytes], 32));
            prop_assert_eq!(frames(&single, 32), frames(&[&bytes], 32));
        }
    }
}
