//! Bytes to telegrams, and the bare ACK and NAK between them.

use super::telegram::{self, ACK, Direction, Head, NAK};

/// What the decoder found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DecoderEvent<'a> {
    /// Payload of a telegram whose sum is right.
    Telegram(&'a [u8]),
    /// A bare 06.
    Ack,
    /// A bare 15.
    Nak,
}

/// Finds telegrams in a stream of bytes. After damage it goes on one byte further, never a whole frame, so that a telegram
/// inside a broken one is found.
///
/// Work is bounded: each byte is looked at as a start once, and a start with a plausible length costs at most one
/// check sum.
#[derive(Debug)]
pub struct TelegramDecoder<'a> {
    buffer: &'a mut [u8],
    direction: Direction,
    len: usize,
    /// Bytes at the front that were handed out and are to be dropped.
    used: usize,
    /// Nothing whole was found since something broken was.
    lost: bool,
    damaged: u32,
}

enum Step {
    Ack,
    Nak,
    Telegram(usize),
    NeedMore,
}

impl<'a> TelegramDecoder<'a> {
    /// A decoder for telegrams of `direction`; longer ones than `buffer` are not found: see [`telegram::MAX_TELEGRAM`].
    pub fn new(direction: Direction, buffer: &'a mut [u8]) -> Self {
        Self { buffer, direction, len: 0, used: 0, lost: false, damaged: 0 }
    }

    /// Takes bytes up to the next event: how many were taken, and the event. Call again with the rest until nothing is left
    /// *and* no event comes.
    pub fn feed(&mut self, bytes: &[u8]) -> (usize, Option<DecoderEvent<'_>>) {
        self.drop_front(self.used);
        self.used = 0;
        let mut taken = 0;
        loop {
            match self.look() {
                Step::Ack => return (taken, Some(DecoderEvent::Ack)),
                Step::Nak => return (taken, Some(DecoderEvent::Nak)),
                Step::Telegram(length) => {
                    self.used = length;
                    self.lost = false;
                    let whole = self.buffer.get(..length).unwrap_or(b"");
                    return (taken, Some(DecoderEvent::Telegram(telegram::payload(whole))));
                }
                Step::NeedMore => {
                    let rest = bytes.get(taken..).unwrap_or(b"");
                    let stored = self.store(rest);
                    if stored == 0 {
                        return (taken, None);
                    }
                    taken += stored;
                }
            }
        }
    }

    /// Gives up the telegram begun: what is buffered of it is searched for another one at the next [`feed`](Self::feed) (also of no
    /// bytes).
    pub fn abandon(&mut self) {
        if self.used == 0 && self.len > 0 {
            self.count_damage();
            self.drop_front(1);
        }
    }

    /// Drops everything.
    pub fn forget(&mut self) {
        (self.len, self.used) = (0, 0);
    }

    /// True while a telegram has begun and has not ended.
    pub fn is_inside_telegram(&self) -> bool {
        self.len > self.used
    }

    /// Times that a telegram, or what looked like one, turned out damaged after one that was whole.
    pub fn damaged(&self) -> u32 {
        self.damaged
    }

    /// Skips garbage at the front, and says what is there.
    fn look(&mut self) -> Step {
        loop {
            let content = self.buffer.get(..self.len).unwrap_or(b"");
            match content.first() {
                None => return Step::NeedMore,
                Some(&ACK) => {
                    self.drop_front(1);
                    return Step::Ack;
                }
                Some(&NAK) => {
                    self.drop_front(1);
                    return Step::Nak;
                }
                Some(_) => {}
            }
            match telegram::check(self.direction, content) {
                Head::Whole(length) => return Step::Telegram(length),
                Head::Partial if self.len < self.buffer.len() => return Step::NeedMore,
                Head::Partial | Head::No => {
                    if self.len > telegram::OVERHEAD {
                        self.count_damage();
                    }
                    self.drop_front(self.next_start());
                }
            }
        }
    }

    fn count_damage(&mut self) {
        if !self.lost {
            self.damaged = self.damaged.saturating_add(1);
        }
        self.lost = true;
    }

    /// Distance to the next byte that can begin anything.
    fn next_start(&self) -> usize {
        let content = self.buffer.get(1..self.len).unwrap_or(b"");
        let begins = |byte: &u8| matches!(*byte, telegram::STX | ACK | NAK);
        content.iter().position(begins).map_or(self.len, |at| at + 1)
    }

    fn drop_front(&mut self, count: usize) {
        if let Some(held) = self.buffer.get_mut(..self.len) {
            let count = count.min(held.len());
            held.copy_within(count.., 0);
            self.len -= count;
        }
    }

    /// Appends what fits and is needed; the telegram's own length bounds it, so that nothing behind it is read early.
    fn store(&mut self, bytes: &[u8]) -> usize {
        let wanted = match self.buffer.get(..self.len.min(4)) {
            Some([_, _, low, high]) => usize::from(u16::from_le_bytes([*low, *high])) + telegram::OVERHEAD,
            _ => 4,
        };
        let room = wanted.saturating_sub(self.len).min(self.buffer.len() - self.len).min(bytes.len());
        if let (Some(target), Some(source)) = (self.buffer.get_mut(self.len..self.len + room), bytes.get(..room)) {
            target.copy_from_slice(source);
        }
        self.len += room;
        room
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::vec::Vec;

    #[derive(Debug, PartialEq)]
    enum Found {
        Telegram(Vec<u8>),
        Ack,
        Nak,
    }

    fn decode<'a>(chunks: impl Iterator<Item = &'a [u8]>) -> Vec<Found> {
        let mut memory = [0; telegram::MAX_TELEGRAM];
        let mut decoder = TelegramDecoder::new(Direction::ToHost, &mut memory);
        let mut found = Vec::new();
        for chunk in chunks {
            let mut rest = chunk;
            loop {
                let (taken, event) = decoder.feed(rest);
                rest = &rest[taken..];
                match event {
                    Some(DecoderEvent::Telegram(payload)) => found.push(Found::Telegram(payload.to_vec())),
                    Some(DecoderEvent::Ack) => found.push(Found::Ack),
                    Some(DecoderEvent::Nak) => found.push(Found::Nak),
                    None if rest.is_empty() => break,
                    None => {}
                }
            }
        }
        found
    }

    fn telegram(payload: &[u8]) -> Vec<u8> {
        let mut out = [0; telegram::MAX_TELEGRAM];
        let length = telegram::emit(Direction::ToHost, payload, &mut out).unwrap();
        out[..length].to_vec()
    }

    #[test]
    fn telegram_inside_a_broken_one_is_found() {
        let inner = telegram(&[0xA0, 0x00, 0x10]);
        let broken = [&[0x02, 0x80, 0x20, 0x00, 0xB0][..], &inner, &[0; 40], &inner].concat();
        let payload = || Found::Telegram(vec![0xA0, 0x00, 0x10]);
        assert_eq!(decode([&broken[..]].into_iter()), [payload(), payload()]);
    }

    #[test]
    fn ack_then_reply_is_two_events() {
        let bytes = [&[ACK][..], &telegram(&[0x91, 0x10]), &[NAK]].concat();
        assert_eq!(decode([&bytes[..]].into_iter()), [Found::Ack, Found::Telegram(vec![0x91, 0x10]), Found::Nak]);
    }

    #[test]
    fn abandoned_start_gives_way_to_what_is_inside() {
        let mut memory = [0; telegram::MAX_TELEGRAM];
        let mut decoder = TelegramDecoder::new(Direction::ToHost, &mut memory);
        let bytes = [&[0x02, 0x80, 0xFF, 0x02, 0xB0][..], &telegram(&[0x91, 0x10])].concat();
        assert_eq!(decoder.feed(&bytes), (bytes.len(), None));
        decoder.abandon();
        assert_eq!(decoder.feed(&[]).1, Some(DecoderEvent::Telegram(&[0x91, 0x10])));
    }

    /// Garbage that likes to look like telegrams.
    fn stream() -> impl Strategy<Value = Vec<u8>> {
        let piece = prop_oneof![
            proptest::collection::vec(any::<u8>(), 1..12),
            proptest::collection::vec(any::<u8>(), 1..40).prop_map(|payload| telegram(&payload)),
            Just(vec![0x02, 0x80, 0x10, 0x00]),
            Just(vec![ACK]),
        ];
        proptest::collection::vec(piece, 0..12).prop_map(|pieces| pieces.concat())
    }

    proptest! {
        #[test]
        fn any_cut_gives_the_same_events(bytes in stream(), size in 1_usize..50) {
            let whole = decode([&bytes[..]].into_iter());
            prop_assert_eq!(&decode(bytes.chunks(size)), &whole);
            prop_assert_eq!(&decode(bytes.chunks(1)), &whole);
        }

        #[test]
        fn telegram_after_any_garbage_and_a_pause_is_found(garbage in proptest::collection::vec(any::<u8>(), 0..900)) {
            let mut memory = [0; telegram::MAX_TELEGRAM];
            let mut decoder = TelegramDecoder::new(Direction::ToHost, &mut memory);
            let bytes = [&garbage[..], &telegram(&[0xB1, 0x55, 0x10])].concat();
            let mut rest = &bytes[..];
            let mut found = false;
            for _ in 0..5000 {
                let (taken, event) = decoder.feed(rest);
                found |= event == Some(DecoderEvent::Telegram(&[0xB1, 0x55, 0x10]));
                let quiet = event.is_none();
                rest = &rest[taken..];
                if rest.is_empty() && quiet {
                    decoder.abandon();
                }
            }
            prop_assert!(found);
        }
    }
}
