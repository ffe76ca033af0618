//! Telegrams from sensor to host.

use super::config_block::ConfigBlock;
use super::measurement::Measurement;
use super::request::Variant;

/// The status byte at the end of every telegram of a sensor.
///
/// Bits 3–4 are 10 on an LMS2xx, so 0x10 is "all well"; some manuals number bits 3–5 otherwise, so they are not judged.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DeviceStatus(pub u8);

impl DeviceStatus {
    /// All well.
    pub const OK: Self = Self(0x10);

    /// 0 well, 1 information, 2 warning, 3 error, 4 fatal.
    pub const fn severity(self) -> u8 {
        self.0 & 7
    }
}

/// Fields of a B1 status report, in place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StatusReport<'a> {
    payload: &'a [u8],
}

/// Bytes of a B1 payload without the status byte.
pub const STATUS_REPORT: usize = 153;

impl<'a> StatusReport<'a> {
    fn byte(&self, at: usize) -> u8 {
        self.payload.get(at).copied().unwrap_or(0)
    }

    fn word(&self, at: usize) -> u16 {
        u16::from_le_bytes([self.byte(at), self.byte(at + 1)])
    }

    /// Software version text (1–7).
    pub fn software(&self) -> &'a str {
        self.payload.get(1..8).and_then(|text| core::str::from_utf8(text).ok()).unwrap_or("")
    }

    /// True if the sensor found an error in itself (9).
    pub fn has_error(&self) -> bool {
        self.byte(9) != 0
    }

    /// Field of view and resolution (107–110).
    pub fn variant(&self) -> Variant {
        Variant { angle_deg: self.word(107), resolution_cdeg: self.word(109) }
    }

    /// Measuring mode (102).
    pub fn measuring_mode(&self) -> u8 {
        self.byte(102)
    }
}

/// How a sensor took a mode telegram.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ModeResult {
    /// 00.
    Done,
    /// 01: wrong password.
    WrongPassword,
    /// 02 and others: the sensor could not.
    Fault,
}

/// What a reply says.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum ReplyBody<'a> {
    /// 90: switched on; its type text.
    PowerOn(&'a [u8]),
    /// 91: will reset.
    Reset,
    /// 92: request not known, or not allowed now.
    Refused,
    /// A0.
    Mode(ModeResult),
    /// B0, B6, B7, BF, C4, F5.
    Scan(Measurement<'a>),
    /// B1.
    Status(StatusReport<'a>),
    /// B2: pairs of type and number.
    Errors(&'a [u8]),
    /// BA: type text.
    Type(&'a [u8]),
    /// BB: taken or not, and what holds now.
    Variant(bool, Variant),
    /// E6: baud rate made permanent or not.
    PermanentBaud(bool),
    /// F4.
    Config(ConfigBlock),
    /// F7: taken or not, and what holds now.
    ConfigSet(bool, Option<ConfigBlock>),
}

/// A reply, read.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Reply<'a> {
    /// What it says.
    pub body: ReplyBody<'a>,
    /// How the sensor is.
    pub status: DeviceStatus,
}

impl<'a> Reply<'a> {
    /// Reads the payload of a telegram whose sum is right; `None` for an unknown one, or one whose parts do not add up.
    pub fn parse(payload: &'a [u8]) -> Option<Self> {
        let (status, content) = payload.split_last()?;
        let body = match content {
            [0x90, text @ ..] => ReplyBody::PowerOn(text),
            [0x91] => ReplyBody::Reset,
            [0x92] => ReplyBody::Refused,
            [0xA0, 0] => ReplyBody::Mode(ModeResult::Done),
            [0xA0, 1] => ReplyBody::Mode(ModeResult::WrongPassword),
            [0xA0, _] => ReplyBody::Mode(ModeResult::Fault),
            // Lengths differ between firmwares; what is read lies within 119 bytes.
            [0xB1, ..] if content.len() >= 119 => ReplyBody::Status(StatusReport { payload: content }),
            [0xB2, errors @ ..] => ReplyBody::Errors(errors),
            [0xBA, text @ ..] => ReplyBody::Type(text),
            [0xBB, taken, a, b, c, d] => ReplyBody::Variant(
                *taken == 1,
                Variant { angle_deg: u16::from_le_bytes([*a, *b]), resolution_cdeg: u16::from_le_bytes([*c, *d]) },
            ),
            [0xE6, result] => ReplyBody::PermanentBaud(*result == 0),
            [0xF4, block @ ..] => ReplyBody::Config(ConfigBlock::parse(block)?),
            [0xF7, taken, block @ ..] => ReplyBody::ConfigSet(*taken == 1, ConfigBlock::parse(block)),
            _ => ReplyBody::Scan(Measurement::parse(content)?),
        };
        Some(Self { body, status: DeviceStatus(*status) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sick_lms::measurement::Part;
    use crate::sick_lms::telegram::{self, Direction, Head};
    use std::vec::Vec;

    fn hex(text: &str) -> Vec<u8> {
        text.split_whitespace().map(|byte| u8::from_str_radix(byte, 16).unwrap()).collect()
    }

    fn whole(text: &str) -> Vec<u8> {
        let bytes = hex(text);
        assert_eq!(telegram::check(Direction::ToHost, &bytes), Head::Whole(bytes.len()), "{text}");
        telegram::payload(&bytes).to_vec()
    }

    #[test]
    fn small_replies_of_the_manual_are_read() {
        for (bytes, body) in [
            ("02 80 03 00 A0 00 10 16 0A", ReplyBody::Mode(ModeResult::Done)),
            ("02 80 03 00 A0 01 10 14 0B", ReplyBody::Mode(ModeResult::WrongPassword)),
            ("02 80 02 00 91 10 79 30", ReplyBody::Reset),
            ("02 80 02 00 92 10 7F 33", ReplyBody::Refused),
            ("02 80 07 00 BB 01 B4 00 32 00 10 03 9D", ReplyBody::Variant(true, Variant::DEG_180_BY_HALF)),
        ] {
            assert_eq!(Reply::parse(&whole(bytes)), Some(Reply { body, status: DeviceStatus::OK }), "{bytes}");
        }
    }

    #[test]
    fn power_on_and_type_texts_have_their_known_sums() {
        let text = b"LMS200;301063;V02.30 ";
        for (command, sum) in [(0x90, [0x73, 0x56]), (0xBA, [0x32, 0x69])] {
            let payload = [&[command][..], text, &[0x10]].concat();
            let mut out = [0; 29];
            assert_eq!(telegram::emit(Direction::ToHost, &payload, &mut out), Ok(29));
            assert_eq!((&out[..5], &out[27..]), (&[0x02, 0x80, 0x17, 0x00, command][..], &sum[..]));
            match Reply::parse(&payload).unwrap().body {
                ReplyBody::PowerOn(read) | ReplyBody::Type(read) => assert_eq!(read, text),
                other => panic!("{other:?}"),
            }
        }
    }

    #[test]
    fn scans_of_the_manual_are_read() {
        for (bytes, part, values) in [
            ("02 80 0A 00 B0 03 40 E8 03 D0 07 F7 1F 10 36 A1", Part::All, &[1000, 2000, 8183][..]),
            ("02 80 08 00 B0 02 00 96 20 FE 1F 10 CF 46", Part::All, &[150 | 0x2000, 8190]),
            ("02 80 08 00 B0 02 70 E8 03 E9 03 10 48 80", Part::Turn(2), &[1000, 1001]),
            ("02 80 0C 00 B7 5B 00 5C 00 02 40 E8 03 E9 03 10 66 BC", Part::Subrange(91, 92), &[1000, 1001]),
            ("02 80 04 00 B0 00 00 10 7C 24", Part::All, &[]),
        ] {
            let payload = whole(bytes);
            let Some(Reply { body: ReplyBody::Scan(scan), .. }) = Reply::parse(&payload) else {
                panic!("{bytes}");
            };
            assert_eq!((scan.part, scan.raw_values().collect::<Vec<_>>()), (part, values.to_vec()));
        }
    }

    #[test]
    fn config_replies_of_both_sizes_are_read() {
        for len in [32, 34] {
            let payload = [&[0xF4][..], ConfigBlock::new(len).bytes(), &[0x10]].concat();
            assert_eq!(Reply::parse(&payload).unwrap().body, ReplyBody::Config(ConfigBlock::new(len)));
            let payload = [&[0xF7, 1][..], ConfigBlock::new(len).bytes(), &[0x10]].concat();
            assert_eq!(Reply::parse(&payload).unwrap().body, ReplyBody::ConfigSet(true, Some(ConfigBlock::new(len))));
        }
    }

    #[test]
    fn severity_of_the_status_byte() {
        let status = DeviceStatus(0xD3);
        assert!(status.severity() == 3);
        assert_eq!(DeviceStatus::OK.severity(), 0);
    }
}
