//! Bytes to descriptors, and to the responses that a descriptor announced.

use super::response::{CAPSULE, Capsule, DESCRIPTOR, Descriptor, MAX_RESPONSE, ResponseKind, parse_sample};

/// What the decoder found.
#[derive(Debug, Clone, PartialEq)]
pub enum DecoderEvent<'a> {
    /// A descriptor: what follows is of this kind.
    Descriptor(ResponseKind),
    /// A response of `Info`, `Health` or `Sample`; samples with right check bits only.
    Response(ResponseKind, &'a [u8]),
    /// An express packet whose sum is right.
    Capsule(Capsule),
    /// What came behind the last response is none: something there was damaged or lost. Said before what comes after it.
    Damage,
}

/// Finds descriptors, then responses; after damage it goes on one byte further.
#[derive(Debug)]
pub struct RplidarDecoder {
    buffer: [u8; MAX_RESPONSE],
    len: usize,
    used: usize,
    /// What is awaited; `None` for a descriptor.
    awaited: Option<ResponseKind>,
    damaged: u32,
    lost: bool,
}

impl Default for RplidarDecoder {
    fn default() -> Self {
        Self { buffer: [0; MAX_RESPONSE], len: 0, used: 0, awaited: None, damaged: 0, lost: false }
    }
}

impl RplidarDecoder {
    /// Takes bytes up to the next event: how many were taken, and the event. Call again with the rest until nothing is left
    /// and no event comes.
    pub fn feed(&mut self, bytes: &[u8]) -> (usize, Option<DecoderEvent<'_>>) {
        self.drop_front(self.used);
        self.used = 0;
        let mut taken = 0;
        loop {
            let wanted = self.awaited.map_or(DESCRIPTOR, ResponseKind::length);
            if self.len >= wanted {
                match self.awaited {
                    None => {
                        if let Some(descriptor) = self.descriptor() {
                            (self.awaited, self.used) = (Some(descriptor.kind), DESCRIPTOR);
                            return (taken, Some(DecoderEvent::Descriptor(descriptor.kind)));
                        }
                    }
                    Some(kind) => {
                        if let Some(capsule) = self.accept(kind) {
                            (self.used, self.lost) = (wanted, false);
                            self.awaited = Some(kind).filter(|kind| kind.repeats());
                            let event = match capsule {
                                Some(capsule) => DecoderEvent::Capsule(capsule),
                                None => DecoderEvent::Response(kind, self.buffer.get(..wanted).unwrap_or(b"")),
                            };
                            return (taken, Some(event));
                        }
                        if !core::mem::replace(&mut self.lost, true) {
                            self.damaged = self.damaged.saturating_add(1);
                            self.used = 1;
                            return (taken, Some(DecoderEvent::Damage));
                        }
                    }
                }
                self.drop_front(1);
                continue;
            }
            let Some(byte) = bytes.get(taken) else { return (taken, None) };
            if let Some(slot) = self.buffer.get_mut(self.len) {
                *slot = *byte;
                self.len += 1;
            }
            taken += 1;
        }
    }

    /// A request was sent: a descriptor is awaited, whatever comes before it.
    pub fn expect_descriptor(&mut self) {
        (self.awaited, self.len, self.used, self.lost) = (None, 0, 0, false);
    }

    /// Times that a response turned out damaged after one that was not.
    pub fn damaged(&self) -> u32 {
        self.damaged
    }

    fn descriptor(&self) -> Option<Descriptor> {
        self.buffer.first_chunk::<DESCRIPTOR>().and_then(Descriptor::parse)
    }

    /// `None` if the buffer holds no right response; the packet, if it is one.
    fn accept(&self, kind: ResponseKind) -> Option<Option<Capsule>> {
        let packet =
            |dense| self.buffer.first_chunk::<CAPSULE>().and_then(|bytes| Capsule::parse(bytes, dense)).map(Some);
        match kind {
            ResponseKind::Info | ResponseKind::Health => Some(None),
            ResponseKind::Sample => self.buffer.get(..5).and_then(parse_sample).map(|_| None),
            ResponseKind::Capsule => packet(false),
            ResponseKind::DenseCapsule => packet(true),
        }
    }

    fn drop_front(&mut self, count: usize) {
        self.buffer.copy_within(count.min(self.len)..self.len, 0);
        self.len = self.len.saturating_sub(count);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::string::String;
    use std::vec::Vec;

    fn events(bytes: &[u8], piece: usize) -> Vec<String> {
        let mut decoder = RplidarDecoder::default();
        let mut found = Vec::new();
        for mut rest in bytes.chunks(piece) {
            loop {
                let (taken, event) = decoder.feed(rest);
                rest = &rest[taken..];
                match event {
                    Some(event) => found.push(std::format!("{event:?}")),
                    None if rest.is_empty() => break,
                    None => {}
                }
            }
        }
        found
    }

    proptest! {
        #[test]
        fn any_cut_gives_the_same_events(
            garbage in proptest::collection::vec(prop_oneof![Just(0xA5), Just(0x5A), any::<u8>()], 0..100),
            damage in 0_usize..300,
            piece in 1_usize..100,
        ) {
            let capsule = *Capsule::build(true, false, 12.0, &[500; 40]).bytes();
            let descriptor = Descriptor { kind: ResponseKind::DenseCapsule }.emit();
            let mut bytes = [&garbage[..], &descriptor, &capsule, &capsule, &capsule].concat();
            let at = damage % bytes.len();
            bytes[at] ^= 0x10;
            prop_assert_eq!(events(&bytes, piece), events(&bytes, bytes.len()));
            prop_assert_eq!(events(&bytes, 1), events(&bytes, bytes.len()));
        }
    }

    #[test]
    fn health_then_descriptor_of_a_stream() {
        let stream = Descriptor { kind: ResponseKind::Sample }.emit();
        let bytes =
            [&Descriptor { kind: ResponseKind::Health }.emit()[..], &[0, 0, 0], &stream, &[0x3D, 1, 0x2D, 0, 16]]
                .concat();
        assert_eq!(events(&bytes, 3).len(), 4);
    }
}
