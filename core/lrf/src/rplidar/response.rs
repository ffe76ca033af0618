//! Descriptors, and what follows them.
//!
//! Source: Interface Protocol, "Response Packets' Format", and for each response its figure.

use super::request::xor;
use crate::turn::MAX_PACKET;

/// Bytes of a descriptor.
pub const DESCRIPTOR: usize = 7;
/// Bytes of an express packet, both forms.
pub const CAPSULE: usize = 84;
/// Bytes of the longest response read here.
pub const MAX_RESPONSE: usize = CAPSULE;

/// Type of a response: the descriptor's last byte. With it goes one length, so that both can be checked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ResponseKind {
    /// 04: 20 bytes of device information.
    Info,
    /// 06: 3 bytes of health.
    Health,
    /// 81: 5 bytes a sample.
    Sample,
    /// 82: express packet, 32 samples with an angle correction each.
    Capsule,
    /// 85: dense express packet, 40 samples.
    DenseCapsule,
}

impl ResponseKind {
    const ALL: [Self; 5] = [Self::Info, Self::Health, Self::Sample, Self::Capsule, Self::DenseCapsule];

    /// The type byte.
    pub const fn code(self) -> u8 {
        match self {
            Self::Info => 0x04,
            Self::Health => 0x06,
            Self::Sample => 0x81,
            Self::Capsule => 0x82,
            Self::DenseCapsule => 0x85,
        }
    }

    /// Bytes of one response.
    pub const fn length(self) -> usize {
        match self {
            Self::Info => 20,
            Self::Health => 3,
            Self::Sample => 5,
            Self::Capsule | Self::DenseCapsule => CAPSULE,
        }
    }

    /// True if responses follow without end.
    pub const fn repeats(self) -> bool {
        matches!(self, Self::Sample | Self::Capsule | Self::DenseCapsule)
    }
}

/// What follows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Descriptor {
    /// Type, and with it length.
    pub kind: ResponseKind,
}

impl Descriptor {
    /// The descriptor as bytes.
    pub fn emit(self) -> [u8; DESCRIPTOR] {
        let mode = if self.kind.repeats() { 1 << 30 } else { 0 };
        let [a, b, c, d] = (self.kind.length() as u32 | mode).to_le_bytes();
        [0xA5, 0x5A, a, b, c, d, self.kind.code()]
    }

    /// Reads a descriptor; it has no sum, so only those whose length fits their type are taken.
    pub fn parse(bytes: &[u8; DESCRIPTOR]) -> Option<Self> {
        let known = ResponseKind::ALL.into_iter().map(|kind| Self { kind });
        known.into_iter().find(|descriptor| descriptor.emit() == *bytes)
    }
}

/// Health of a sensor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Health {
    /// 0 well, 1 warning, 2 error: it then does not scan.
    pub status: u8,
    /// The maker's code.
    pub code: u16,
}

impl Health {
    /// Reads the response.
    pub fn parse(bytes: &[u8]) -> Option<Self> {
        match bytes {
            [status, low, high] => Some(Self { status: *status, code: u16::from_le_bytes([*low, *high]) }),
            _ => None,
        }
    }
}

/// One sample of a packet.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Measured {
    /// mm; 0 is no measurement.
    pub distance_mm: f32,
    /// Clockwise from straight ahead, degrees; may be a little below 0 or above 360.
    pub clockwise_deg: f32,
}

/// A sample of the old scan mode; `starts_turn` with it. `None` if its check bits are wrong.
pub fn parse_sample(bytes: &[u8]) -> Option<(Measured, bool)> {
    let [quality, low, high, distance_low, distance_high] = bytes else { return None };
    let (start, not_start) = (quality & 1, quality >> 1 & 1);
    if start == not_start || low & 1 == 0 {
        return None;
    }
    let angle_q6 = u16::from_le_bytes([*low, *high]) >> 1;
    let distance_q2 = u16::from_le_bytes([*distance_low, *distance_high]);
    let measured = Measured { distance_mm: f32::from(distance_q2) / 4.0, clockwise_deg: f32::from(angle_q6) / 64.0 };
    (angle_q6 < 360 * 64).then_some((measured, start == 1))
}

/// An express packet whose sum is right, as it came: its angles need the next one.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Capsule {
    bytes: [u8; CAPSULE],
    dense: bool,
}

impl Capsule {
    /// Checks marks, sum and angle.
    pub fn parse(bytes: &[u8; CAPSULE], dense: bool) -> Option<Self> {
        let [first, second, rest @ ..] = bytes;
        let sum = (first & 0x0F) | second << 4;
        let is_right = first >> 4 == 0xA && second >> 4 == 0x5 && xor(rest) == sum;
        let capsule = Self { bytes: *bytes, dense };
        (is_right && capsule.start_deg() < 360.0).then_some(capsule)
    }

    /// Builds a packet from samples: dense, or with all corrections 0. Missing samples are 0, distances are cut to what fits.
    pub fn build(dense: bool, starts: bool, start_deg: f32, distances_mm: &[u16]) -> Self {
        Self::build_corrected(dense, starts, start_deg, distances_mm, 0.0)
    }

    /// The same with one correction for all samples that is subtracted from their angles, 0 to 7.875 degrees; a dense packet has none.
    pub fn build_corrected(
        dense: bool,
        starts: bool,
        start_deg: f32,
        distances_mm: &[u16],
        correction_deg: f32,
    ) -> Self {
        let eighths = (correction_deg * 8.0) as u16 & 0x3F;
        let mut bytes = [0; CAPSULE];
        let angle_q6 = (start_deg * 64.0) as u16 & 0x7FFF | u16::from(starts) << 15;
        let mut distances = distances_mm.iter().copied();
        let mut next = || distances.next().unwrap_or(0);
        let [_, _, low, high, cabins @ ..] = &mut bytes;
        [*low, *high] = angle_q6.to_le_bytes();
        for cabin in cabins.chunks_exact_mut(if dense { 2 } else { 5 }) {
            match cabin {
                [low, high] => [*low, *high] = next().to_le_bytes(),
                [a, b, c, d, low_bits] => {
                    [*a, *b] = (next() << 2 | eighths >> 4).to_le_bytes();
                    [*c, *d] = (next() << 2 | eighths >> 4).to_le_bytes();
                    *low_bits = (eighths & 0x0F) as u8 * 0x11;
                }
                _ => {}
            }
        }
        let sum = xor(&bytes);
        let [first, second, ..] = &mut bytes;
        (*first, *second) = (0xA0 | sum & 0x0F, 0x50 | sum >> 4);
        Self { bytes, dense }
    }

    /// The packet on the wire.
    pub fn bytes(&self) -> &[u8; CAPSULE] {
        &self.bytes
    }

    fn angle_word(&self) -> u16 {
        match self.bytes {
            [_, _, low, high, ..] => u16::from_le_bytes([low, high]),
        }
    }

    /// True for the first packet after the request: it does not follow the one before.
    pub fn starts(&self) -> bool {
        self.angle_word() & 0x8000 != 0
    }

    /// Angle of the first sample, degrees.
    pub fn start_deg(&self) -> f32 {
        f32::from(self.angle_word() & 0x7FFF) / 64.0
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        if self.dense { 40 } else { 32 }
    }

    /// Never true.
    pub fn is_empty(&self) -> bool {
        false
    }

    /// From this packet's first sample to that of `next`, degrees, 0 to 360.
    pub fn span_deg(&self, next: &Capsule) -> f32 {
        let span = next.start_deg() - self.start_deg();
        if span < 0.0 { span + 360.0 } else { span }
    }

    /// The samples: evenly spread to the start of `next`, less a correction each in packets that are not dense.
    ///
    /// Source: Interface Protocol, "Data Processing of the Express Scan Data": θₖ = ω + (ω' − ω)/N · k − dθₖ, dθ in eighths of a
    /// degree. Departure: the protocol calls the highest of its six bits a sign; the maker's SDK (`handler_capsules.cpp`), which devices
    /// are sold with, reads all six as a number.
    pub fn samples(&self, next: &Capsule) -> heapless::Vec<Measured, MAX_PACKET> {
        let step_deg = self.span_deg(next) / self.len() as f32;
        let mut samples = heapless::Vec::new();
        // MAX_PACKET is the length of the longer form: no push can fail.
        let mut put = |distance_mm: u16, correction_deg: f32| {
            let clockwise_deg = self.start_deg() + step_deg * samples.len() as f32 - correction_deg;
            let _ = samples.push(Measured { distance_mm: f32::from(distance_mm), clockwise_deg });
        };
        let cabins = self.bytes.get(4..).unwrap_or(b"");
        for cabin in cabins.chunks_exact(if self.dense { 2 } else { 5 }) {
            match cabin {
                [low, high] => put(u16::from_le_bytes([*low, *high]), 0.0),
                [a, b, c, d, low_bits] => {
                    let (first, second) = (u16::from_le_bytes([*a, *b]), u16::from_le_bytes([*c, *d]));
                    put(first >> 2, correction_deg((first & 3) as u8, low_bits & 0x0F));
                    put(second >> 2, correction_deg((second & 3) as u8, low_bits >> 4));
                }
                _ => {}
            }
        }
        samples
    }
}

/// Six bits: eighths of a degree.
fn correction_deg(high_bits: u8, low_bits: u8) -> f32 {
    f32::from((high_bits & 3) << 4 | low_bits & 0x0F) / 8.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn descriptors_of_the_manual_are_read() {
        for (bytes, kind) in [
            ([0xA5, 0x5A, 0x14, 0, 0, 0, 0x04], ResponseKind::Info),
            ([0xA5, 0x5A, 0x03, 0, 0, 0, 0x06], ResponseKind::Health),
            ([0xA5, 0x5A, 0x05, 0, 0, 0x40, 0x81], ResponseKind::Sample),
            ([0xA5, 0x5A, 0x54, 0, 0, 0x40, 0x82], ResponseKind::Capsule),
            ([0xA5, 0x5A, 0x54, 0, 0, 0x40, 0x85], ResponseKind::DenseCapsule),
        ] {
            assert_eq!(Descriptor::parse(&bytes), Some(Descriptor { kind }));
            assert_eq!(Descriptor { kind }.emit(), bytes);
        }
        assert_eq!(Descriptor::parse(&[0xA5, 0x5A, 0x15, 0, 0, 0, 0x04]), None);
    }

    #[test]
    fn sample_has_check_bits() {
        // Quality 15, start; 90 degrees; 1000 mm.
        let angle = ((90_u16 * 64) << 1 | 1).to_le_bytes();
        let distance = (4000_u16).to_le_bytes();
        let bytes = [15 << 2 | 1, angle[0], angle[1], distance[0], distance[1]];
        let measured = Measured { distance_mm: 1000.0, clockwise_deg: 90.0 };
        assert_eq!(parse_sample(&bytes), Some((measured, true)));
        for (at, flip) in [(0, 1), (0, 2), (1, 1)] {
            let mut damaged = bytes;
            damaged[at] ^= flip;
            assert_eq!(parse_sample(&damaged), None);
        }
    }

    #[test]
    fn capsules_spread_their_samples_to_the_next_start() {
        for (dense, count) in [(false, 32), (true, 40)] {
            let distances: std::vec::Vec<u16> = (0..count).map(|sample| 1000 + sample).collect();
            let capsule = Capsule::build(dense, true, 350.0, &distances);
            let next = Capsule::build(dense, false, 10.0, &distances);
            assert_eq!(Capsule::parse(capsule.bytes(), dense), Some(capsule.clone()));
            let samples = capsule.samples(&next);
            assert_eq!((samples.len(), samples[3].distance_mm), (usize::from(count), 1003.0));
            assert!((samples[usize::from(count / 2)].clockwise_deg - 360.0).abs() < 1e-3);
            assert!(capsule.starts() && !next.starts());
        }
    }

    #[test]
    fn corrections_are_all_positive() {
        assert_eq!((correction_deg(0, 8), correction_deg(1, 0), correction_deg(2, 8)), (1.0, 2.0, 5.0));
        for degrees in [0.5_f32, 3.875, 4.0, 5.0, 7.875] {
            let capsule = |start_deg| Capsule::build_corrected(false, false, start_deg, &[1000; 32], degrees);
            let samples = capsule(100.0).samples(&capsule(132.0));
            assert!((samples[0].clockwise_deg - (100.0 - degrees)).abs() < 1e-3, "{degrees}: {:?}", samples[0]);
            assert!((samples[31].clockwise_deg - (131.0 - degrees)).abs() < 1e-3 && samples[31].distance_mm == 1000.0);
        }
    }

    #[test]
    fn every_flipped_bit_of_a_capsule_is_seen() {
        let capsule = Capsule::build(true, false, 123.0, &[777; 40]);
        for at in 0..CAPSULE {
            for bit in 0..8 {
                let mut damaged = *capsule.bytes();
                damaged[at] ^= 1 << bit;
                assert_eq!(Capsule::parse(&damaged, true), None, "byte {at} bit {bit}");
            }
        }
    }
}
