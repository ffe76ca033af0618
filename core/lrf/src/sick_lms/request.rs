//! Telegrams from host to sensor.

use super::config_block::ConfigBlock;
use super::telegram::{self, Direction};

/// Longest payload of a request.
pub const MAX_REQUEST: usize = 35;

/// Password for the installation mode, as delivered.
pub const PASSWORD: [u8; 8] = *b"SICK_LMS";

/// Baud rates an LMS2xx knows, with their code in mode telegrams (0x40..) and divisor in status reports.
pub const BAUD_CODES: [(u32, u8, u8); 4] =
    [(38_400, 0x40, 0x19), (19_200, 0x41, 0x33), (9_600, 0x42, 0x67), (500_000, 0x48, 0x01)];

/// Field of view and resolution, 1/100 degree as on the wire.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Variant {
    /// 100 or 180, degrees.
    pub angle_deg: u16,
    /// 25, 50 or 100, hundredths of a degree.
    pub resolution_cdeg: u16,
}

impl Variant {
    /// 180° in steps of 1°.
    pub const DEG_180_BY_1: Self = Self { angle_deg: 180, resolution_cdeg: 100 };
    /// 180° in steps of 0.5°.
    pub const DEG_180_BY_HALF: Self = Self { angle_deg: 180, resolution_cdeg: 50 };

    /// True for the five that exist: 180° by 1 or 0.5, 100° by 1, 0.5 or 0.25.
    pub const fn is_possible(self) -> bool {
        matches!((self.angle_deg, self.resolution_cdeg), (180, 50 | 100) | (100, 25 | 50 | 100))
    }

    /// The one whose full scan has so many values.
    pub fn with_values(values: usize) -> Option<Self> {
        let all = [(180, 100), (180, 50), (100, 100), (100, 50), (100, 25)];
        let variant = |(angle_deg, resolution_cdeg)| Self { angle_deg, resolution_cdeg };
        all.map(variant).into_iter().find(|variant| usize::from(variant.values()) == values)
    }

    /// Values in a full scan.
    pub const fn values(self) -> u16 {
        let resolution = if self.resolution_cdeg == 0 { 1 } else { self.resolution_cdeg };
        (self.angle_deg as u32 * 100 / resolution as u32 + 1) as u16
    }

    /// Mirror turns for a full scan: each measures one beam a degree.
    pub const fn turns(self) -> u16 {
        match self.resolution_cdeg {
            25 => 4,
            50 => 2,
            _ => 1,
        }
    }

    /// Values that one mirror turn measures, of those at `index` quarter degrees after full degrees.
    pub const fn values_of_turn(self, index: u8) -> u16 {
        self.angle_deg + if index == 0 { 1 } else { 0 }
    }

    /// Angle of value 0 on the sensor's own scale, degrees; 90 looks ahead.
    pub const fn start_deg(self) -> u16 {
        (180_u16).saturating_sub(self.angle_deg) / 2
    }
}

/// What a 0x20 telegram switches to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OperatingMode {
    /// 00: installation mode, with its password.
    Installation([u8; 8]),
    /// 10: diagnosis.
    Diagnosis,
    /// 24: stream all values.
    StreamAll,
    /// 25: scans on request only.
    OnRequest,
    /// 26: stream means of this many scans.
    StreamMean(u8),
    /// 27: stream values first..=last, counted from 1.
    StreamSubrange(u16, u16),
    /// 28: stream means of this many scans, of values first..=last, counted from 1.
    StreamMeanSubrange(u8, u16, u16),
    /// 2A: stream each mirror turn on its own.
    StreamPartial,
    /// 2B: stream range and remission of values first..=last, counted from 1. Only for one part of the scan, of up to five.
    StreamRemission(u16, u16),
    /// 20 to 23, 29, 2C to 2F: watch segments and fields. What is streamed then is not read here.
    Watch(u8),
    /// 50: stream ranges, and reflectivities of values first..=last, counted from 1.
    StreamReflectivity(u16, u16),
    /// 40, 41, 42, 48: baud rate, bit/s.
    Baud(u32),
    /// Any other: a sensor refuses it.
    Other(u8),
}

/// A request.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Request {
    /// 10: reset.
    Reset,
    /// 20: operating mode.
    Mode(OperatingMode),
    /// 30 01: one scan.
    Scan,
    /// 31: status.
    Status,
    /// 32: errors.
    Errors,
    /// 3A: type.
    Type,
    /// 3B: angle and resolution.
    Variant(Variant),
    /// 66: keep the baud rate when switched off; in installation mode.
    PermanentBaud(bool),
    /// 74: configuration.
    GetConfig,
    /// 77: new configuration; in installation mode.
    SetConfig(ConfigBlock),
    /// Any other, by its command byte: a sensor answers 92.
    Unknown(u8),
}

/// A telegram with a request.
pub type RequestTelegram = heapless::Vec<u8, { MAX_REQUEST + telegram::OVERHEAD }>;

type Payload = heapless::Vec<u8, MAX_REQUEST>;

impl Request {
    /// The whole telegram.
    pub fn emit(&self) -> RequestTelegram {
        let mut out = [0; MAX_REQUEST + telegram::OVERHEAD];
        // The longest payload is that of SetConfig, MAX_REQUEST bytes: it fits.
        let length = telegram::emit(Direction::ToSensor, &self.payload(), &mut out).unwrap_or(0);
        out.into_iter().take(length).collect()
    }

    fn payload(&self) -> Payload {
        let bytes = |bytes: &[u8]| Payload::from_slice(bytes).unwrap_or_default();
        match self {
            Request::Reset => bytes(&[0x10]),
            Request::Mode(mode) => mode.payload(),
            Request::Scan => bytes(&[0x30, 0x01]),
            Request::Status => bytes(&[0x31]),
            Request::Errors => bytes(&[0x32]),
            Request::Type => bytes(&[0x3A]),
            Request::Variant(variant) => {
                let [a, b] = variant.angle_deg.to_le_bytes();
                let [c, d] = variant.resolution_cdeg.to_le_bytes();
                bytes(&[0x3B, a, b, c, d])
            }
            Request::PermanentBaud(on) => bytes(&[0x66, u8::from(*on)]),
            Request::GetConfig => bytes(&[0x74]),
            Request::SetConfig(block) => {
                let mut payload = bytes(&[0x77]);
                // It has room for the longest block.
                let _ = payload.extend_from_slice(block.bytes());
                payload
            }
            Request::Unknown(command) => bytes(&[*command]),
        }
    }

    /// Reads the payload of a telegram whose sum is right. Anything not known is [`Request::Unknown`]; an empty payload cannot
    /// occur.
    pub fn parse(payload: &[u8]) -> Request {
        match payload {
            [0x10] => Request::Reset,
            [0x20, mode, arguments @ ..] => {
                Request::Mode(OperatingMode::parse(*mode, arguments).unwrap_or(OperatingMode::Other(*mode)))
            }
            [0x30, 0x01] => Request::Scan,
            [0x31] => Request::Status,
            [0x32] => Request::Errors,
            [0x3A] => Request::Type,
            [0x3B, a, b, c, d] => Request::Variant(Variant {
                angle_deg: u16::from_le_bytes([*a, *b]),
                resolution_cdeg: u16::from_le_bytes([*c, *d]),
            }),
            [0x66, on @ (0 | 1)] => Request::PermanentBaud(*on == 1),
            [0x74] => Request::GetConfig,
            [0x77, block @ ..] => ConfigBlock::parse(block).map_or(Request::Unknown(0x77), Request::SetConfig),
            [command, ..] => Request::Unknown(*command),
            [] => Request::Unknown(0),
        }
    }
}

impl OperatingMode {
    /// The code on the wire; a rate has that of the nearest known, see [`BAUD_CODES`].
    pub fn code(&self) -> u8 {
        match *self {
            OperatingMode::Installation(_) => 0x00,
            OperatingMode::Diagnosis => 0x10,
            OperatingMode::StreamAll => 0x24,
            OperatingMode::OnRequest => 0x25,
            OperatingMode::StreamMean(_) => 0x26,
            OperatingMode::StreamSubrange(..) => 0x27,
            OperatingMode::StreamMeanSubrange(..) => 0x28,
            OperatingMode::StreamPartial => 0x2A,
            OperatingMode::StreamRemission(..) => 0x2B,
            OperatingMode::StreamReflectivity(..) => 0x50,
            OperatingMode::Baud(rate) => {
                BAUD_CODES.iter().min_by_key(|(known, _, _)| known.abs_diff(rate)).map_or(0x42, |(_, code, _)| *code)
            }
            OperatingMode::Watch(mode) | OperatingMode::Other(mode) => mode,
        }
    }

    fn payload(&self) -> Payload {
        let mut payload = Payload::new();
        let mut put = |bytes: &[u8]| {
            let _ = payload.extend_from_slice(bytes);
        };
        put(&[0x20, self.code()]);
        match *self {
            OperatingMode::Installation(password) => put(&password),
            OperatingMode::StreamMean(scans) | OperatingMode::StreamMeanSubrange(scans, ..) => put(&[scans]),
            OperatingMode::StreamRemission(..) => put(&[1, 0]),
            _ => {}
        }
        if let Some((first, last)) = self.subrange() {
            put(&first.to_le_bytes());
            put(&last.to_le_bytes());
        }
        payload
    }

    /// The values that are asked for, first and last, counted from 1; `None` if that is not for the host to say.
    pub fn subrange(&self) -> Option<(u16, u16)> {
        match *self {
            OperatingMode::StreamSubrange(first, last)
            | OperatingMode::StreamMeanSubrange(_, first, last)
            | OperatingMode::StreamRemission(first, last)
            | OperatingMode::StreamReflectivity(first, last) => Some((first, last)),
            _ => None,
        }
    }

    fn parse(mode: u8, arguments: &[u8]) -> Option<Self> {
        let range = || match arguments {
            [.., a, b, c, d] => Some((u16::from_le_bytes([*a, *b]), u16::from_le_bytes([*c, *d]))),
            _ => None,
        };
        match (mode, arguments) {
            (0x00, _) => arguments.try_into().ok().map(OperatingMode::Installation),
            (0x10, []) => Some(OperatingMode::Diagnosis),
            (0x24, []) => Some(OperatingMode::StreamAll),
            (0x25, []) => Some(OperatingMode::OnRequest),
            (0x26, [scans]) => Some(OperatingMode::StreamMean(*scans)),
            (0x27, [_, _, _, _]) => range().map(|(first, last)| OperatingMode::StreamSubrange(first, last)),
            (0x28, [scans, _, _, _, _]) => {
                range().map(|(first, last)| OperatingMode::StreamMeanSubrange(*scans, first, last))
            }
            (0x2A, []) => Some(OperatingMode::StreamPartial),
            (0x2B, [1, 0, _, _, _, _]) => range().map(|(first, last)| OperatingMode::StreamRemission(first, last)),
            (0x20..=0x23 | 0x29 | 0x2C..=0x2F, _) => Some(OperatingMode::Watch(mode)),
            (0x50, [_, _, _, _]) => range().map(|(first, last)| OperatingMode::StreamReflectivity(first, last)),
            (_, []) => {
                BAUD_CODES.iter().find(|(_, code, _)| *code == mode).map(|(rate, _, _)| OperatingMode::Baud(*rate))
            }
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn hex(text: &str) -> std::vec::Vec<u8> {
        text.split_whitespace().map(|byte| u8::from_str_radix(byte, 16).unwrap()).collect()
    }

    #[test]
    fn telegrams_of_the_manual_are_emitted_and_parsed() {
        let mode = Request::Mode;
        let variant = |angle_deg, resolution_cdeg| Request::Variant(Variant { angle_deg, resolution_cdeg });
        for (request, bytes) in [
            (Request::Reset, "02 00 01 00 10 34 12"),
            (Request::Status, "02 00 01 00 31 15 12"),
            (Request::Errors, "02 00 01 00 32 16 12"),
            (Request::Type, "02 00 01 00 3A 1E 12"),
            (Request::GetConfig, "02 00 01 00 74 50 12"),
            (Request::Scan, "02 00 02 00 30 01 31 18"),
            (mode(OperatingMode::StreamAll), "02 00 02 00 20 24 34 08"),
            (mode(OperatingMode::OnRequest), "02 00 02 00 20 25 35 08"),
            (mode(OperatingMode::StreamPartial), "02 00 02 00 20 2A 3A 08"),
            (mode(OperatingMode::StreamMean(10)), "02 00 03 00 20 26 0A 76 3E"),
            (mode(OperatingMode::StreamSubrange(1, 181)), "02 00 06 00 20 27 01 00 B5 00 12 09"),
            (mode(OperatingMode::StreamSubrange(1, 361)), "02 00 06 00 20 27 01 00 69 01 AB D4"),
            (mode(OperatingMode::StreamMeanSubrange(10, 1, 181)), "02 00 07 00 20 28 0A 01 00 B5 00 C7 62"),
            (mode(OperatingMode::StreamRemission(1, 181)), "02 00 08 00 20 2B 01 00 01 00 B5 00 AF 5A"),
            (mode(OperatingMode::StreamReflectivity(1, 181)), "02 00 06 00 20 50 01 00 B5 00 68 B6"),
            (mode(OperatingMode::Baud(9_600)), "02 00 02 00 20 42 52 08"),
            (mode(OperatingMode::Baud(19_200)), "02 00 02 00 20 41 51 08"),
            (mode(OperatingMode::Baud(38_400)), "02 00 02 00 20 40 50 08"),
            (mode(OperatingMode::Baud(500_000)), "02 00 02 00 20 48 58 08"),
            (mode(OperatingMode::Installation(PASSWORD)), "02 00 0A 00 20 00 53 49 43 4B 5F 4C 4D 53 BE C5"),
            (Request::PermanentBaud(true), "02 00 02 00 66 01 9D 4E"),
            (Request::PermanentBaud(false), "02 00 02 00 66 00 9C 4E"),
            (variant(180, 100), "02 00 05 00 3B B4 00 64 00 97 49"),
            (variant(180, 50), "02 00 05 00 3B B4 00 32 00 3B 1F"),
            (variant(100, 100), "02 00 05 00 3B 64 00 64 00 1D 0F"),
            (variant(100, 50), "02 00 05 00 3B 64 00 32 00 B1 59"),
            (variant(100, 25), "02 00 05 00 3B 64 00 19 00 E7 72"),
        ] {
            let bytes = hex(bytes);
            assert_eq!(&request.emit()[..], &bytes[..], "{request:?}");
            assert_eq!(Request::parse(telegram::payload(&bytes)), request);
        }
    }

    #[test]
    fn set_config_ends_with_the_known_sum() {
        let telegram = Request::SetConfig(ConfigBlock::new(34)).emit();
        assert_eq!((&telegram[..5], &telegram[39..]), (&hex("02 00 23 00 77")[..], &hex("80 C1")[..]));
        assert_eq!(Request::parse(telegram::payload(&telegram)), Request::SetConfig(ConfigBlock::new(34)));
    }

    #[test]
    fn installation_telegram_with_the_wrong_sum_is_refused() {
        let bytes = hex("02 00 0A 00 20 00 53 49 43 4B 5F 4C 4D 53 5F B2");
        assert_eq!(telegram::check(Direction::ToSensor, &bytes), telegram::Head::No);
    }

    #[test]
    fn variants_have_their_number_of_values() {
        for (angle_deg, resolution_cdeg, values, turns) in
            [(180, 100, 181, 1), (180, 50, 361, 2), (100, 100, 101, 1), (100, 50, 201, 2), (100, 25, 401, 4)]
        {
            let variant = Variant { angle_deg, resolution_cdeg };
            assert!(variant.is_possible());
            assert_eq!((variant.values(), variant.turns()), (values, turns));
        }
        assert!(!Variant { angle_deg: 180, resolution_cdeg: 25 }.is_possible());
    }
}
