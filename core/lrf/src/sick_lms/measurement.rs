//! Telegrams with ranges: B0 and its relatives.

use core::num::NonZeroU16;

use super::config_block::Unit;

/// Bits of a 16-bit value that are range, by measuring mode; and what some numbers mean instead of a range.
///
/// Source: manual, table of measuring modes; drivers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ValueFormat {
    /// Range bits.
    pub mask: u16,
}

impl ValueFormat {
    /// For a measuring mode; `None` for the modes that give no ranges, and for unknown ones.
    pub const fn of_mode(measuring_mode: u8) -> Option<Self> {
        match measuring_mode {
            0x00..=0x02 => Some(Self { mask: 0x1FFF }),
            0x03 | 0x04 => Some(Self { mask: 0x3FFF }),
            0x05 | 0x06 => Some(Self { mask: 0x7FFF }),
            0x0F => Some(Self { mask: 0xFFFF }),
            _ => None,
        }
    }

    /// What `raw` says.
    pub const fn read(self, raw: u16) -> RawEcho {
        let value = raw & self.mask;
        match self.mask - value {
            8 => RawEcho::BeyondMaximum,
            0..8 => RawEcho::Error,
            _ => RawEcho::Range(value),
        }
    }

    /// The number for "beyond maximum range"; the largest range is below it.
    pub const fn beyond_maximum(self) -> u16 {
        self.mask - 8
    }
}

/// The measuring mode with ranges up to 8 or 80 m and 8 levels of brightness.
///
/// Source: manual, table of measuring modes: "reflector values in 8 levels".
pub const REFLECTOR_MODE: u8 = 0x01;

/// Bits above the range that tell how bright an echo is; 0 in modes that use them for something else.
const fn level_bits(measuring_mode: u8) -> u32 {
    match measuring_mode {
        REFLECTOR_MODE => 3,
        0x03 => 2,
        0x05 => 1,
        _ => 0,
    }
}

/// The level of a brightness from 0 to 255 in `measuring_mode`, where its values have it.
pub const fn level(measuring_mode: u8, brightness: u8) -> u16 {
    let bits = level_bits(measuring_mode);
    if bits == 0 { 0 } else { ((brightness as u16) >> (8 - bits)) << (16 - bits) }
}

/// What a 16-bit value says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RawEcho {
    /// A range, in the scan's unit.
    Range(u16),
    /// Nothing up to the largest range.
    BeyondMaximum,
    /// Dazzled, overflow, too much noise, read error, invalid.
    Error,
}

/// Which values a telegram carries.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// B0: all of them.
    All,
    /// B0 with the partial bit: one mirror turn, which began at this many quarter degrees (0..=3).
    Turn(u8),
    /// B7: values first..=last, counted from 1.
    Subrange(u16, u16),
    /// B6: means of this many scans.
    Mean(u8),
    /// BF: means of a number of scans, of values first..=last.
    MeanSubrange(u8, u16, u16),
    /// C4: all ranges, followed by reflectivities that are not read here.
    Reflectivity,
    /// F5: range and remission by turns, of values first..=last.
    ///
    /// Source: CARMEN's `sick.c`, made with an LMS291 that sends it; the same order as in the request.
    Remission(u16, u16),
}

/// The ranges of a telegram, in place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Measurement<'a> {
    /// Which values.
    pub part: Part,
    /// Their unit.
    pub unit: Unit,
    values: &'a [u8],
    /// Bytes from one value to the next.
    stride: usize,
    /// Bytes after the values: indices that count mirror turns and telegrams, if the sensor is set to send them.
    pub tail: &'a [u8],
}

impl<'a> Measurement<'a> {
    /// Reads a payload without its status byte; `None` if it is no measurement or its parts do not add up.
    ///
    /// Up to two bytes after the values are taken: the real-time index, and a telegram index that some models add.
    pub fn parse(payload: &'a [u8]) -> Option<Self> {
        let (part, rest) = match payload {
            [0xB0, rest @ ..] => (Part::All, rest),
            [0xB6, scans, rest @ ..] => (Part::Mean(*scans), rest),
            [0xB7, a, b, c, d, rest @ ..] => {
                (Part::Subrange(u16::from_le_bytes([*a, *b]), u16::from_le_bytes([*c, *d])), rest)
            }
            [0xBF, scans, a, b, c, d, rest @ ..] => {
                (Part::MeanSubrange(*scans, u16::from_le_bytes([*a, *b]), u16::from_le_bytes([*c, *d])), rest)
            }
            [0xC4, rest @ ..] => (Part::Reflectivity, rest),
            // The number of parts, of which one is read, then each with its own first, last and count.
            [0xF5, 1, _, a, b, c, d, rest @ ..] => {
                (Part::Remission(u16::from_le_bytes([*a, *b]), u16::from_le_bytes([*c, *d])), rest)
            }
            _ => return None,
        };
        let (word, rest) = rest.split_first_chunk::<2>()?;
        let word = u16::from_le_bytes(*word);
        let stride = if matches!(part, Part::Remission(..)) { 4 } else { 2 };
        let (values, tail) = rest.split_at_checked(usize::from(word & 0x03FF) * stride)?;
        let part = match part {
            Part::All if word & 0x2000 != 0 => Part::Turn((word >> 11 & 3) as u8),
            other => other,
        };
        let measurement = Self { part, unit: Unit::from_code((word >> 14) as u8)?, values, stride, tail };
        measurement.adds_up().then_some(measurement)
    }

    fn adds_up(&self) -> bool {
        let short_tail = self.tail.len() <= 2;
        let spans = |first: u16, last: u16| {
            first >= 1 && last.checked_sub(first).is_some_and(|span| usize::from(span) + 1 == self.len())
        };
        match self.part {
            Part::Subrange(first, last) | Part::MeanSubrange(_, first, last) | Part::Remission(first, last) => {
                short_tail && spans(first, last)
            }
            Part::Reflectivity => true,
            _ => short_tail,
        }
    }

    /// Number of values.
    pub fn len(&self) -> usize {
        self.values.len() / self.stride.max(1)
    }

    /// True if there are none.
    pub fn is_empty(&self) -> bool {
        self.values.is_empty()
    }

    /// How bright each echo is, 0 to 255: by the bits above its range, or the remission behind it; `None` if neither is sent.
    pub fn brightness(&self, measuring_mode: u8) -> Option<impl Iterator<Item = u8> + use<'a>> {
        let bits = level_bits(measuring_mode);
        let has_remission = matches!(self.part, Part::Remission(..));
        let highest = NonZeroU16::new((1 << bits) - 1).unwrap_or(NonZeroU16::MIN);
        let of = move |value: &[u8]| match value {
            [_, _, low, high, ..] if has_remission => u16::from_le_bytes([*low, *high]).min(255) as u8,
            [_, high, ..] if bits > 0 => (u16::from(high >> (8 - bits)) * 255 / highest) as u8,
            _ => 0,
        };
        (has_remission || bits > 0).then(|| self.values.chunks_exact(self.stride.max(1)).map(of))
    }

    /// The 16-bit values, flags and codes included.
    pub fn raw_values(&self) -> impl Iterator<Item = u16> + use<'a> {
        self.values.chunks_exact(self.stride.max(1)).map(|value| match value {
            [low, high, ..] => u16::from_le_bytes([*low, *high]),
            _ => 0,
        })
    }
}

/// The count word: number of values (cut to 10 bits), unit, and for one mirror turn its start in quarter degrees.
pub fn count_word(values: u16, unit: Unit, turn: Option<u8>) -> u16 {
    let partial = turn.map_or(0, |quarter| 0x2000 | u16::from(quarter & 3) << 11);
    (values & 0x03FF) | partial | u16::from(unit.code()) << 14
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    #[test]
    fn codes_are_no_ranges_in_any_mode() {
        for (mode, mask) in [(0x00, 0x1FFF), (0x01, 0x1FFF), (0x03, 0x3FFF), (0x05, 0x7FFF), (0x0F, 0xFFFF)] {
            let format = ValueFormat::of_mode(mode).unwrap();
            assert_eq!(format.read(mask - 8), RawEcho::BeyondMaximum);
            for code in [0, 1, 2, 4, 5] {
                assert_eq!(format.read(mask - code), RawEcho::Error);
            }
            assert_eq!(format.read(mask - 9), RawEcho::Range(mask - 9));
        }
        assert_eq!(ValueFormat::of_mode(0x0D), None);
    }

    #[test]
    fn flags_are_masked_off() {
        let format = ValueFormat::of_mode(0).unwrap();
        assert_eq!(format.read(0x2000 | 150), RawEcho::Range(150));
        assert_eq!(format.read(0x1FFE), RawEcho::Error);
    }

    #[test]
    fn brightness_is_read_from_its_bits_or_its_word() {
        let values = |mode: u8, bytes: &[u8]| {
            let brightness = Measurement::parse(bytes).unwrap().brightness(mode);
            brightness.map(|levels| levels.collect::<Vec<_>>())
        };
        let plain = [0xB0, 3, 0x40, 1, 0xE0, 1, 0x60, 1, 0];
        assert_eq!(values(REFLECTOR_MODE, &plain), Some(vec![255, 109, 0]));
        assert_eq!(values(0, &plain), None, "these bits tell of fields");
        let both = [0xF5, 1, 0, 1, 0, 2, 0, 2, 0x40, 1, 0, 9, 0, 2, 0, 77, 1];
        assert_eq!(values(0, &both), Some(vec![9, 255]));
        assert_eq!([255, 128, 31].map(|brightness| level(REFLECTOR_MODE, brightness)), [0xE000, 0x8000, 0]);
        assert_eq!(level(0, 255), 0);
    }

    #[test]
    fn count_word_of_the_capture_is_read() {
        assert_eq!(count_word(361, Unit::Millimetre, None).to_le_bytes(), [0x69, 0x41]);
        assert_eq!(count_word(2, Unit::Millimetre, Some(2)).to_le_bytes(), [0x02, 0x70]);
    }

    #[test]
    fn parts_that_do_not_add_up_are_refused() {
        assert_eq!(Measurement::parse(&[0xB0, 3, 0x40, 1, 0, 2, 0]), None);
        assert_eq!(Measurement::parse(&[0xB0, 1, 0x40, 1, 0, 9, 9, 9]), None);
        assert_eq!(Measurement::parse(&[0xB7, 91, 0, 93, 0, 1, 0x40, 1, 0]), None);
        assert_eq!(Measurement::parse(&[0xB0, 1, 0xC0, 1, 0]), None);
        let indexed = Measurement::parse(&[0xB0, 1, 0x40, 7, 1, 0x55]).unwrap();
        assert_eq!((indexed.raw_values().collect::<Vec<_>>(), indexed.tail), (vec![263], &[0x55][..]));
    }

    #[test]
    fn relatives_of_b0_are_read() {
        let sub = Measurement::parse(&[0xB7, 0x5B, 0, 0x5C, 0, 2, 0x40, 0xE8, 3, 0xE9, 3]).unwrap();
        assert_eq!((sub.part, sub.len()), (Part::Subrange(91, 92), 2));
        let mean = Measurement::parse(&[0xB6, 10, 1, 0, 5, 0]).unwrap();
        assert_eq!((mean.part, mean.unit), (Part::Mean(10), Unit::Centimetre));
        let both = Measurement::parse(&[0xF5, 1, 0, 1, 0, 2, 0, 2, 0x40, 1, 0, 9, 9, 2, 0, 9, 9]).unwrap();
        assert_eq!((both.part, both.raw_values().collect::<Vec<_>>()), (Part::Remission(1, 2), vec![1, 2]));
        assert_eq!(
            Measurement::parse(&[0xF5, 2, 0x40, 1, 0, 9, 9, 2, 0, 9, 9]),
            None,
            "not parts, first and last first"
        );
    }
}
