//! The packet: 47 bytes, `54 2C`, and a CRC-8 at the end.

/// Bytes of a packet.
pub const PACKET: usize = 47;
/// Samples of a packet.
pub const POINTS: usize = 12;
/// The stamp counts ms up to this, then from 0 again.
pub const STAMP_PERIOD_MS: i64 = 30_000;

const HEADER: [u8; 2] = [0x54, 0x2C];

/// One sample.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Point {
    /// mm; 0 is no measurement.
    pub distance_mm: u16,
    /// Strength of the signal, 0 to 255.
    pub intensity: u8,
}

/// What a packet says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Packet {
    /// Turning speed, degrees a second.
    pub speed_degps: u16,
    /// Angle of the first sample, 1/100 degree.
    pub start_cdeg: u16,
    /// The samples.
    pub points: [Point; POINTS],
    /// Angle of the last sample, 1/100 degree.
    pub end_cdeg: u16,
    /// ms, modulo [`STAMP_PERIOD_MS`].
    pub stamp_ms: u16,
}

impl Packet {
    /// The packet as bytes.
    pub fn emit(&self) -> [u8; PACKET] {
        let mut body: heapless::Vec<u8, PACKET> = heapless::Vec::new();
        // The parts are 46 bytes by construction.
        let mut put = |bytes: &[u8]| {
            let _ = body.extend_from_slice(bytes);
        };
        put(&HEADER);
        put(&self.speed_degps.to_le_bytes());
        put(&self.start_cdeg.to_le_bytes());
        for point in &self.points {
            put(&point.distance_mm.to_le_bytes());
            put(&[point.intensity]);
        }
        put(&self.end_cdeg.to_le_bytes());
        put(&self.stamp_ms.to_le_bytes());
        let mut packet = [0; PACKET];
        packet.iter_mut().zip(&body).for_each(|(byte, value)| *byte = *value);
        packet[PACKET - 1] = crc(&body);
        packet
    }

    /// Reads a packet whose sum is right; `None` for another header, a wrong sum, or angles that are none.
    pub fn parse(bytes: &[u8; PACKET]) -> Option<Self> {
        let (body, sum) = bytes.split_at(PACKET - 1);
        if !body.starts_with(&HEADER) || sum != [crc(body)] {
            return None;
        }
        let word = |at: usize| Some(u16::from_le_bytes([*body.get(at)?, *body.get(at + 1)?]));
        let mut points = [Point::default(); POINTS];
        for (index, point) in points.iter_mut().enumerate() {
            *point = Point { distance_mm: word(6 + 3 * index)?, intensity: *body.get(8 + 3 * index)? };
        }
        let packet =
            Self { speed_degps: word(2)?, start_cdeg: word(4)?, points, end_cdeg: word(42)?, stamp_ms: word(44)? };
        (packet.start_cdeg < 36_000 && packet.end_cdeg < 36_000).then_some(packet)
    }

    /// From the first sample to the last, degrees.
    pub fn span_deg(&self) -> f32 {
        let span = (i32::from(self.end_cdeg) - i32::from(self.start_cdeg)).rem_euclid(36_000);
        span as f32 / 100.0
    }

    /// Angle of sample `index`, clockwise from straight ahead, degrees; may pass 360.
    pub fn angle_deg(&self, index: usize) -> f32 {
        f32::from(self.start_cdeg) / 100.0 + self.span_deg() * index as f32 / (POINTS - 1) as f32
    }
}

/// CRC-8, polynomial 0x4D, from 0, highest bit first.
///
/// Source: maker's driver, whose table begins 00 4D 9A D7; the manual's example has this sum.
pub fn crc(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0, |sum, byte| {
        (0..8).fold(sum ^ byte, |sum, _| if sum & 0x80 == 0 { sum << 1 } else { (sum << 1) ^ 0x4D })
    })
}

/// Finds packets in a stream of bytes; after damage it goes on one byte further.
#[derive(Debug)]
pub struct PacketDecoder {
    buffer: [u8; PACKET],
    len: usize,
    damaged: u32,
}

impl Default for PacketDecoder {
    fn default() -> Self {
        Self { buffer: [0; PACKET], len: 0, damaged: 0 }
    }
}

impl PacketDecoder {
    /// Takes bytes up to the end of the next packet: how many were taken, and the packet.
    pub fn feed(&mut self, bytes: &[u8]) -> (usize, Option<Packet>) {
        for (index, byte) in bytes.iter().enumerate() {
            if let Some(slot) = self.buffer.get_mut(self.len) {
                *slot = *byte;
                self.len += 1;
            }
            self.skip_garbage();
            if self.len == PACKET {
                if let Some(packet) = Packet::parse(&self.buffer) {
                    self.len = 0;
                    return (index + 1, Some(packet));
                }
                self.damaged = self.damaged.saturating_add(1);
                self.drop_front(1);
                self.skip_garbage();
            }
        }
        (bytes.len(), None)
    }

    /// Drops everything.
    pub fn forget(&mut self) {
        self.len = 0;
    }

    /// True while a packet has begun and has not ended.
    pub fn is_inside_packet(&self) -> bool {
        self.len > 0
    }

    /// Packets, or what looked like one, with a wrong sum so far.
    pub fn damaged(&self) -> u32 {
        self.damaged
    }

    fn skip_garbage(&mut self) {
        while self.len > 0 && !self.begins() {
            self.drop_front(1);
        }
    }

    fn begins(&self) -> bool {
        self.buffer.iter().take(self.len).zip(HEADER).all(|(byte, expected)| *byte == expected)
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
    use std::vec::Vec;

    /// The example of the manual.
    const EXAMPLE: [u8; PACKET] = [
        0x54, 0x2C, 0x68, 0x08, 0xAB, 0x7E, 0xE0, 0x00, 0xE4, 0xDC, 0x00, 0xE2, 0xD9, 0x00, 0xE5, 0xD5, 0x00, 0xE3,
        0xD3, 0x00, 0xE4, 0xD0, 0x00, 0xE9, 0xCD, 0x00, 0xE4, 0xCA, 0x00, 0xE2, 0xC7, 0x00, 0xE9, 0xC5, 0x00, 0xE5,
        0xC2, 0x00, 0xE5, 0xC0, 0x00, 0xE5, 0xBE, 0x82, 0x3A, 0x1A, 0x50,
    ];

    #[test]
    fn example_of_the_manual_is_read_and_written_back() {
        let packet = Packet::parse(&EXAMPLE).unwrap();
        assert_eq!(
            (packet.speed_degps, packet.start_cdeg, packet.end_cdeg, packet.stamp_ms),
            (2152, 32_427, 33_470, 6714)
        );
        assert_eq!(packet.points[0], Point { distance_mm: 224, intensity: 228 });
        assert_eq!(packet.points[11], Point { distance_mm: 192, intensity: 229 });
        assert!((packet.angle_deg(11) - 334.7).abs() < 1e-3);
        assert_eq!(packet.emit(), EXAMPLE);
    }

    #[test]
    fn every_flipped_bit_is_seen() {
        for at in 0..PACKET {
            for bit in 0..8 {
                let mut damaged = EXAMPLE;
                damaged[at] ^= 1 << bit;
                assert_eq!(Packet::parse(&damaged), None, "byte {at} bit {bit}");
            }
        }
    }

    fn packets(bytes: &[u8], piece: usize) -> Vec<Packet> {
        let mut decoder = PacketDecoder::default();
        let mut found = Vec::new();
        for mut rest in bytes.chunks(piece) {
            while !rest.is_empty() {
                let (taken, packet) = decoder.feed(rest);
                found.extend(packet);
                rest = &rest[taken..];
            }
        }
        found
    }

    proptest! {
        #[test]
        fn any_cut_gives_the_same_packets(
            garbage in proptest::collection::vec(prop_oneof![Just(0x54), Just(0x2C), any::<u8>()], 0..120),
            piece in 1_usize..60,
        ) {
            let bytes = [&garbage[..], &EXAMPLE, &EXAMPLE[..20], &EXAMPLE, &EXAMPLE].concat();
            let found = packets(&bytes, piece);
            prop_assert_eq!(&found, &packets(&bytes, 1));
            prop_assert!(found.len() >= 2);
        }
    }
}
