//! A frame read as a reply: echo, status, and a body that is checked before it is used.

use super::code;
use super::command::{Acquire, Encoding};

/// Characters of data in a full line.
pub const BLOCK: usize = 64;

/// Why a frame is not used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum FrameError {
    /// No echo line followed by a status line with a right sum.
    #[error("no echo and status")]
    NoStatus,
    /// The time stamp line has a wrong length, character or sum.
    #[error("damaged time stamp")]
    BadStamp,
    /// A data line that is not the last has not 64 characters, or the last is empty or too long.
    #[error("data line of wrong length")]
    BadLength,
    /// A data line has a wrong sum.
    #[error("data line with wrong sum")]
    BadSum,
    /// A character outside 0x30..=0x6F among the data.
    #[error("character that is no data")]
    BadCharacter,
    /// Not as many values as were asked for.
    #[error("wrong number of values")]
    BadCount,
}

/// A reply's two status characters; SCIP 1.1 has one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Status([u8; 2]);

impl Status {
    /// `00`: done.
    pub const OK: Self = Self(*b"00");
    /// `99`: a scan of a stream.
    pub const SCAN: Self = Self(*b"99");
    /// `10`: the laser is off.
    pub const LASER_OFF: Self = Self(*b"10");
    /// `0B`: the same command again before its answer.
    pub const REPEATED: Self = Self(*b"0B");
    /// `0C`: too few parameters.
    pub const TOO_SHORT: Self = Self(*b"0C");
    /// `0D`: undefined, first kind: right letters with too many parameters.
    pub const UNDEFINED_1: Self = Self(*b"0D");
    /// `0E`: undefined.
    pub const UNDEFINED: Self = Self(*b"0E");
    /// `0G`: string too long.
    pub const TAG_TOO_LONG: Self = Self(*b"0G");
    /// `0H`: bad character in the string.
    pub const BAD_TAG: Self = Self(*b"0H");

    /// The status `number` in two decimal digits (the last two, if more).
    pub const fn code(number: u8) -> Self {
        Self([b'0' + number / 10 % 10, b'0' + number % 10])
    }

    /// The one-character status of SCIP 1.1.
    pub const fn scip1(character: u8) -> Self {
        Self([character, 0])
    }

    /// True for a status of SCIP 1.1.
    pub const fn is_scip1(self) -> bool {
        self.0[1] == 0
    }

    /// The characters as bytes.
    pub const fn bytes(self) -> [u8; 2] {
        self.0
    }

    /// Value of a status of two decimal digits; `None` for `0A` and the like, which is why it is not to be parsed loosely.
    pub fn number(self) -> Option<u8> {
        let [tens, units] = self.0;
        (tens.is_ascii_digit() && units.is_ascii_digit()).then(|| (tens - b'0') * 10 + (units - b'0'))
    }

    /// True for a fault of the hardware (50..=97) or a stop to verify one (21..=49).
    pub fn is_hardware_fault(self) -> bool {
        self.number().is_some_and(|number| (21..=97).contains(&number))
    }
}

/// A frame, split into echo, status and body; only the status is checked so far.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Reply<'a> {
    /// The command as it came back, with its string.
    pub echo: &'a [u8],
    /// How it went.
    pub status: Status,
    /// Lines after the status, without the last line feed.
    pub body: &'a [u8],
}

/// A `KEY:value` line of `VV`, `PP` or `II`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct InfoLine<'a> {
    /// Text before the colon.
    pub key: &'a str,
    /// Text from the colon to the semicolon.
    pub value: &'a str,
    /// Real devices send a few lines with wrong sums: a wrong one is to be mentioned, not refused.
    pub sum_is_right: bool,
}

/// One measured step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Value {
    /// Distance in mm, or a code.
    pub range: u32,
    /// Intensity, 0 if not asked for.
    pub intensity: u32,
}

impl<'a> Reply<'a> {
    /// Reads a frame whose first line is the echo.
    ///
    /// # Errors
    /// [`FrameError::NoStatus`].
    pub fn parse(frame: &'a [u8]) -> Result<Self, FrameError> {
        let (echo, rest) = split_line(frame);
        let (status, body) = split_line(rest);
        let status = parse_status(status).ok_or(FrameError::NoStatus)?;
        Ok(Self { echo, status, body })
    }

    /// Looks in a frame for the reply to a command that begins with `echo` and has `echo_len` characters, past any garbage
    /// before it. Cost O(frame).
    ///
    /// # Errors
    /// [`FrameError::NoStatus`] if there is none.
    pub fn find(frame: &'a [u8], echo: &[u8], echo_len: usize) -> Result<Self, FrameError> {
        let mut rest = frame;
        while !rest.is_empty() {
            let (line, after) = split_line(rest);
            let tail = line.len().checked_sub(echo_len).and_then(|from| line.get(from..));
            if let Some(tail) = tail.filter(|tail| tail.starts_with(echo)) {
                let (status, body) = split_line(after);
                if let Some(status) = parse_status(status) {
                    return Ok(Self { echo: tail, status, body });
                }
            }
            rest = after;
        }
        Err(FrameError::NoStatus)
    }

    /// The body's lines as `KEY:value`; lines that are none are skipped, so that those of newer devices do no harm.
    pub fn info(&self) -> impl Iterator<Item = InfoLine<'a>> {
        self.body.split(|byte| *byte == b'\n').filter_map(parse_info)
    }

    /// The time stamp in the body's first line, ms of the sensor's 24-bit clock.
    ///
    /// # Errors
    /// [`FrameError::BadStamp`].
    pub fn stamp_ms(&self) -> Result<u32, FrameError> {
        let (line, _) = split_line(self.body);
        let characters = code::checked(line).filter(|characters| characters.len() == 4).ok_or(FrameError::BadStamp)?;
        code::decode(characters).map(|stamp| stamp as u32).ok_or(FrameError::BadStamp)
    }

    /// The values after the time stamp, after every line's length, characters and sum were checked.
    ///
    /// Of several echoes of one step the first is taken. Their mark `&` is refused where one echo was asked for: it is
    /// the letter `f` with bit 6 flipped, which the sum cannot see.
    ///
    /// # Errors
    /// As [`FrameError`] says.
    pub fn values(&self, acquire: &Acquire) -> Result<impl Iterator<Item = Value> + use<'a>, FrameError> {
        let (_, data) = split_line(self.body);
        check_blocks(data, acquire.multi_echo)?;
        let encoding = acquire.encoding;
        let characters =
            data.split(|byte| *byte == b'\n').flat_map(|line| line.split_last().map_or(&[][..], |split| split.1));
        Ok(Values { characters: characters.copied(), encoding, held: None })
    }
}

fn check_blocks(data: &[u8], multi_echo: bool) -> Result<(), FrameError> {
    let mut lines = data.split(|byte| *byte == b'\n').peekable();
    while let Some(line) = lines.next() {
        let is_last = lines.peek().is_none();
        let right_length = if is_last { (2..=BLOCK + 1).contains(&line.len()) } else { line.len() == BLOCK + 1 };
        if !right_length {
            return Err(FrameError::BadLength);
        }
        if !line.iter().all(|character| (0x30..=0x6F).contains(character) || (multi_echo && *character == b'&')) {
            return Err(FrameError::BadCharacter);
        }
        if code::checked(line).is_none() {
            return Err(FrameError::BadSum);
        }
    }
    Ok(())
}

/// Reads values from characters; ends early, with one value too few, at a cut or misplaced `&`.
struct Values<I> {
    characters: I,
    encoding: Encoding,
    held: Option<u8>,
}

impl<I: Iterator<Item = u8>> Values<I> {
    fn number(&mut self, characters: usize) -> Option<u32> {
        let mut value = 0;
        for _ in 0..characters {
            let character = self.held.take().or_else(|| self.characters.next())?;
            value = value << 6 | u32::from(character.checked_sub(0x30)?);
        }
        Some(value)
    }

    fn one(&mut self) -> Option<Value> {
        match self.encoding {
            Encoding::Short => self.number(2).map(|range| Value { range, intensity: 0 }),
            Encoding::Long => self.number(3).map(|range| Value { range, intensity: 0 }),
            Encoding::Intensity => Some(Value { range: self.number(3)?, intensity: self.number(3)? }),
        }
    }
}

impl<I: Iterator<Item = u8>> Iterator for Values<I> {
    type Item = Value;
    fn next(&mut self) -> Option<Value> {
        let value = self.one()?;
        loop {
            self.held = self.characters.next();
            match self.held {
                Some(b'&') => {
                    self.held = None;
                    self.one()?;
                }
                _ => return Some(value),
            }
        }
    }
}

/// The text before the first line feed, and that after it.
fn split_line(text: &[u8]) -> (&[u8], &[u8]) {
    let end = text.iter().position(|byte| *byte == b'\n').unwrap_or(text.len());
    let (line, rest) = text.split_at_checked(end).unwrap_or((text, b""));
    (line, rest.get(1..).unwrap_or(b""))
}

fn parse_status(line: &[u8]) -> Option<Status> {
    match line {
        [character] if character.is_ascii_alphanumeric() => Some(Status::scip1(*character)),
        [first, second, _] if first.is_ascii_alphanumeric() && second.is_ascii_alphanumeric() => {
            code::checked(line).map(|_| Status([*first, *second]))
        }
        _ => None,
    }
}

fn parse_info(line: &[u8]) -> Option<InfoLine<'_>> {
    let text = core::str::from_utf8(line).ok()?;
    let (key, rest) = text.split_once(':')?;
    // Not by `rsplit_once`: it brings panics into an image, as `contains` does.
    let end = rest.bytes().rposition(|byte| byte == b';').unwrap_or(rest.len());
    let (value, sum) = (rest.get(..end).unwrap_or(rest), rest.get(end + 1..).unwrap_or(""));
    let content = text.len().checked_sub(sum.len() + 1).and_then(|end| line.get(..end)).unwrap_or(line);
    let with_semicolon = line.get(..content.len() + 1).unwrap_or(line);
    let is_right = sum.as_bytes() == [code::sum(content)] || sum.as_bytes() == [code::sum(with_semicolon)];
    Some(InfoLine { key, value, sum_is_right: is_right })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    const ONE: Acquire = Acquire { encoding: Encoding::Long, multi_echo: false, first: 384, last: 384, cluster: 1 };

    #[test]
    fn captured_version_lines_are_read_with_right_sums() {
        let frame = b"VV\n00P\nVEND:Hokuyo Automatic Co.,Ltd.;[\nPROD:SOKUIKI Sensor URG-04LX;[\nFIRM:3.1.04(02/Aug./2007);a\nPROT:SCIP 2.0;N\nSERI:H0706400;F";
        let reply = Reply::parse(frame).unwrap();
        assert_eq!((reply.echo, reply.status), (&b"VV"[..], Status::OK));
        let lines: Vec<_> = reply.info().collect();
        assert!(lines.len() == 5 && lines.iter().all(|line| line.sum_is_right));
        assert_eq!((lines[4].key, lines[4].value), ("SERI", "H0706400"));
    }

    #[test]
    fn wrong_sum_of_an_info_line_is_only_mentioned() {
        let reply = Reply::parse(b"VV\n00P\nSERI:H0706400;?\nnonsense\nNEWK:1;2").unwrap();
        let lines: Vec<_> = reply.info().collect();
        assert_eq!(lines.len(), 2);
        assert!(!lines[0].sum_is_right);
    }

    #[test]
    fn one_value_reply_is_read() {
        let reply = Reply::parse(b"GD0384038401\n00P\n00000\n0EX=").unwrap();
        assert_eq!(reply.stamp_ms(), Ok(0));
        let values: Vec<_> = reply.values(&ONE).unwrap().collect();
        assert_eq!(values, [Value { range: 1384, intensity: 0 }]);
    }

    #[test]
    fn captured_time_exchange_is_read() {
        let reply = Reply::parse(b"TM1\n00P\n<SfkP").unwrap();
        let next = Reply::parse(b"TM1\n00P\n<SflQ").unwrap();
        assert_eq!(next.stamp_ms().unwrap() - reply.stamp_ms().unwrap(), 1);
    }

    #[test]
    fn scip1_status_is_told_apart() {
        let reply = Reply::parse(b"QT\nE").unwrap();
        assert!(reply.status == Status::scip1(b'E'));
    }

    #[test]
    fn hexadecimal_looking_status_is_no_number() {
        assert_eq!(Status::UNDEFINED.number(), None);
        assert_eq!(Status::SCAN.number(), Some(99));
        assert!(Status::code(55).is_hardware_fault() && !Status::SCAN.is_hardware_fault());
    }

    #[test]
    fn reply_is_found_behind_garbage() {
        let frame = b"\xFF\x00junk\n99bQT\n00P";
        let reply = Reply::find(frame, b"QT", 2).unwrap();
        assert_eq!((reply.echo, reply.status), (&b"QT"[..], Status::OK));
        assert_eq!(Reply::find(b"QT\n00Q", b"QT", 2), Err(FrameError::NoStatus));
    }

    #[test]
    fn damaged_blocks_are_named() {
        let reply = |body: &'static [u8]| Reply { echo: b"GD", status: Status::OK, body };
        let error = |body| reply(body).values(&ONE).err();
        assert_eq!(error(b"00000\n0EX<"), Some(FrameError::BadSum));
        assert_eq!(error(b"00000\n0EX=\n0EX="), Some(FrameError::BadLength));
        assert_eq!(error(b"00000\n0\x7FX="), Some(FrameError::BadCharacter));
        // `f` with bit 6 flipped, whose sum is the same.
        assert_eq!(error(b"00000\n0&XK"), Some(FrameError::BadCharacter));
        assert_eq!(error(b"00000"), Some(FrameError::BadLength));
        assert_eq!(reply(b"00001\n0EX=").stamp_ms(), Err(FrameError::BadStamp));
    }

    #[test]
    fn first_of_several_echoes_is_taken() {
        let mut data = b"0EX&0EY00C".to_vec();
        data.push(code::sum(&data));
        let body = [&b"00000\n"[..], &data].concat();
        let reply = Reply { echo: b"HD", status: Status::OK, body: &body };
        let ranges: Vec<_> =
            reply.values(&Acquire { multi_echo: true, ..ONE }).unwrap().map(|value| value.range).collect();
        assert_eq!(ranges, [1384, 19]);
    }
}
