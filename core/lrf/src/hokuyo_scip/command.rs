//! Commands from host to sensor: as values, as text, and back.
//!
//! Source: manual, chapters 4 and 5; statuses 0A–0M also from drivers.

use super::reply::Status;

/// Longest command line this module emits, without line feed.
pub const MAX_COMMAND: usize = 16;
/// Longest string that may follow `;` in a command.
pub const MAX_TAG: usize = 16;

/// How a sensor writes each value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Encoding {
    /// Two characters: up to 4095 mm (`S`).
    Short,
    /// Three characters: up to 262143 mm (`D`).
    Long,
    /// Three characters of range and three of intensity (`E`).
    Intensity,
}

impl Encoding {
    /// Characters per value.
    pub const fn width(self) -> usize {
        match self {
            Encoding::Short => 2,
            Encoding::Long => 3,
            Encoding::Intensity => 6,
        }
    }
}

/// Which steps to measure, and how to write them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Acquire {
    /// How values are written.
    pub encoding: Encoding,
    /// All echoes of a step instead of the first.
    pub multi_echo: bool,
    /// First step.
    pub first: u16,
    /// Last step, included.
    pub last: u16,
    /// Neighbouring steps merged to their minimum; 0 and 1 mean none.
    pub cluster: u8,
}

impl Acquire {
    /// Steps per value: at least one.
    pub fn stride(&self) -> u16 {
        u16::from(self.cluster).max(1)
    }

    /// Number of values if a short last cluster is dropped, and if it is sent: which one holds is not documented, take either.
    pub fn value_counts(&self) -> (u16, u16) {
        let steps = self.last.saturating_sub(self.first).saturating_add(1);
        (steps / self.stride(), steps.div_ceil(self.stride()))
    }
}

/// Argument of `TM`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TimeMode {
    /// Enter (0).
    Enter,
    /// Read the clock (1).
    Read,
    /// Leave (2).
    Leave,
}

/// A command of SCIP 2.x, or the one of SCIP 1.1 that leads there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Command {
    /// `VV`: who made it.
    Version,
    /// `PP`: its geometry.
    Parameters,
    /// `II`: its state.
    Information,
    /// `BM`: laser on.
    LaserOn,
    /// `QT`: stop measuring, laser off.
    Quit,
    /// `RS`: laser off, motor, bit rate and clock to their defaults.
    Reset,
    /// `RT`: like `RS`, but keeps motor speed and bit rate.
    ResetKeepingRate,
    /// `RB`: sent twice within a second, reboots.
    Reboot,
    /// `GD`, `GS`, `GE`, `HD`, `HE`: the latest scan.
    Get(Acquire),
    /// `MD`, `MS`, `ME`, `ND`, `NE`: scans as they are measured.
    Stream {
        /// What to measure.
        acquire: Acquire,
        /// Revolutions dropped after each scan sent.
        interval: u8,
        /// Scans to send, 1..=99; 0 until stopped.
        count: u8,
    },
    /// `TM0`, `TM1`, `TM2`.
    Time(TimeMode),
    /// `SS`: bit rate, bit/s.
    BitRate(u32),
    /// `CR`: motor speed, 0 default, 1..=10 slower, 99 reset.
    MotorSpeed(u8),
    /// `HS`: high sensitivity.
    Sensitivity(bool),
    /// `DB`: simulate a malfunction.
    Malfunction(u8),
    /// `SCIP2.0`: leave SCIP 1.1.
    SwitchToScip2,
    /// `%ST` (2.2): state.
    State,
    /// `%SL` (2.2): sleep.
    Sleep,
}

/// Text of a command, without line feed.
pub type CommandText = heapless::Vec<u8, MAX_COMMAND>;

/// Commands without arguments.
const SIMPLE: [(Command, &[u8]); 11] = [
    (Command::Version, b"VV"),
    (Command::Parameters, b"PP"),
    (Command::Information, b"II"),
    (Command::LaserOn, b"BM"),
    (Command::Quit, b"QT"),
    (Command::Reset, b"RS"),
    (Command::ResetKeepingRate, b"RT"),
    (Command::Reboot, b"RB"),
    (Command::State, b"%ST"),
    (Command::Sleep, b"%SL"),
    (Command::SwitchToScip2, b"SCIP2.0"),
];

impl Command {
    /// The command as text, without line feed.
    pub fn emit(&self) -> CommandText {
        let mut text = CommandText::new();
        // No command is longer than MAX_COMMAND (the longest, streaming, has 15 characters), so no push can fail.
        let mut put = |bytes: &[u8]| {
            let _ = text.extend_from_slice(bytes);
        };
        match *self {
            Command::Get(acquire) => put_acquire(&mut put, false, &acquire),
            Command::Stream { acquire, interval, count } => {
                put_acquire(&mut put, true, &acquire);
                put(&digits::<1>(u32::from(interval)));
                put(&digits::<2>(u32::from(count)));
            }
            Command::Time(mode) => put(match mode {
                TimeMode::Enter => b"TM0",
                TimeMode::Read => b"TM1",
                TimeMode::Leave => b"TM2",
            }),
            Command::BitRate(rate) => {
                put(b"SS");
                put(&digits::<6>(rate));
            }
            Command::MotorSpeed(speed) => {
                put(b"CR");
                put(&digits::<2>(u32::from(speed)));
            }
            Command::Sensitivity(high) => put(if high { b"HS1" } else { b"HS0" }),
            Command::Malfunction(kind) => {
                put(b"DB");
                put(&digits::<2>(u32::from(kind)));
            }
            simple => SIMPLE.iter().filter(|(command, _)| *command == simple).for_each(|(_, text)| put(text)),
        }
        text
    }

    /// Reads a command line, without line feed and without the `;string` part (see [`split_tag`]).
    ///
    /// # Errors
    /// The status with which a sensor answers: `0E` undefined, `0C`/`0D` too short or long, 01..07 for arguments that are no
    /// numbers. Whether the numbers suit the model is for the sensor to say.
    pub fn parse(line: &[u8]) -> Result<Command, Status> {
        if let Some((command, _)) = SIMPLE.iter().find(|(_, text)| *text == line) {
            return Ok(*command);
        }
        let (letters, arguments) = line.split_at_checked(2).ok_or(Status::UNDEFINED)?;
        match letters {
            b"GD" | b"GS" | b"GE" | b"HD" | b"HE" => parse_acquire(letters, arguments).map(Command::Get),
            b"MD" | b"MS" | b"ME" | b"ND" | b"NE" => parse_stream(letters, arguments),
            b"TM" => match arguments {
                b"0" => Ok(Command::Time(TimeMode::Enter)),
                b"1" => Ok(Command::Time(TimeMode::Read)),
                b"2" => Ok(Command::Time(TimeMode::Leave)),
                b"" => Err(Status::TOO_SHORT),
                _ => Err(Status::code(1)),
            },
            b"SS" => only_argument::<6>(arguments).map(Command::BitRate),
            b"CR" => only_argument::<2>(arguments).map(|speed| Command::MotorSpeed(speed as u8)),
            b"HS" => match arguments {
                b"0" => Ok(Command::Sensitivity(false)),
                b"1" => Ok(Command::Sensitivity(true)),
                b"" => Err(Status::TOO_SHORT),
                _ => Err(Status::code(1)),
            },
            b"DB" => only_argument::<2>(arguments).map(|malfunction| Command::Malfunction(malfunction as u8)),
            _ => Err(Status::UNDEFINED),
        }
    }
}

/// Splits `COMMAND;string` at the first semicolon; the string is `None` if there is no semicolon.
///
/// # Errors
/// `0G` for a string over 16 characters, `0H` for one with a character not allowed.
pub fn split_tag(line: &[u8]) -> Result<(&[u8], Option<&[u8]>), Status> {
    let Some(at) = line.iter().position(|byte| *byte == b';') else { return Ok((line, None)) };
    let (command, tag) = line.split_at_checked(at).unwrap_or((line, b""));
    let tag = tag.get(1..).unwrap_or(b"");
    if tag.len() > MAX_TAG {
        return Err(Status::TAG_TOO_LONG);
    }
    if !tag.iter().all(|byte| byte.is_ascii_alphanumeric() || b" ._+@".contains(byte)) {
        return Err(Status::BAD_TAG);
    }
    Ok((command, Some(tag)))
}

fn put_acquire(put: &mut impl FnMut(&[u8]), stream: bool, acquire: &Acquire) {
    put(match (stream, acquire.multi_echo) {
        (false, false) => b"G",
        (false, true) => b"H",
        (true, false) => b"M",
        (true, true) => b"N",
    });
    put(match acquire.encoding {
        Encoding::Short => b"S",
        Encoding::Long => b"D",
        Encoding::Intensity => b"E",
    });
    put(&digits::<4>(u32::from(acquire.first)));
    put(&digits::<4>(u32::from(acquire.last)));
    put(&digits::<2>(u32::from(acquire.cluster)));
}

fn parse_acquire(letters: &[u8], arguments: &[u8]) -> Result<Acquire, Status> {
    if arguments.len() < 10 {
        return Err(Status::TOO_SHORT);
    }
    if arguments.len() > 10 {
        return Err(Status::UNDEFINED_1);
    }
    let field = |from: usize, to: usize, status: u8| {
        arguments.get(from..to).and_then(number).and_then(narrow).ok_or(Status::code(status))
    };
    let first = field(0, 4, 1)?;
    let last = field(4, 8, 2)?;
    let cluster: u16 = field(8, 10, 3)?;
    let encoding = match letters.get(1) {
        Some(b'S') => Encoding::Short,
        Some(b'E') => Encoding::Intensity,
        _ => Encoding::Long,
    };
    let multi_echo = matches!(letters.first(), Some(b'H' | b'N'));
    Ok(Acquire { encoding, multi_echo, first, last, cluster: cluster as u8 })
}

fn parse_stream(letters: &[u8], arguments: &[u8]) -> Result<Command, Status> {
    let Some((acquire, rest)) = arguments.split_at_checked(10) else { return Err(Status::TOO_SHORT) };
    if rest.len() < 3 {
        return Err(Status::TOO_SHORT);
    }
    if rest.len() > 3 {
        return Err(Status::UNDEFINED_1);
    }
    let acquire = parse_acquire(letters, acquire)?;
    let interval = rest.get(..1).and_then(number).and_then(narrow).ok_or(Status::code(6))?;
    let count = rest.get(1..).and_then(number).and_then(narrow).ok_or(Status::code(7))?;
    Ok(Command::Stream { acquire, interval, count })
}

/// `value` in exactly `N` decimal digits (higher ones are cut off).
fn digits<const N: usize>(value: u32) -> [u8; N] {
    let mut text = [b'0'; N];
    let mut rest = value;
    for digit in text.iter_mut().rev() {
        *digit = b'0' + (rest % 10) as u8;
        rest /= 10;
    }
    text
}

/// The number of `N` digits that is a command's only argument.
fn only_argument<const N: usize>(arguments: &[u8]) -> Result<u32, Status> {
    match arguments.len() {
        length if length < N => Err(Status::TOO_SHORT),
        length if length > N => Err(Status::UNDEFINED_1),
        _ => number(arguments).ok_or(Status::code(1)),
    }
}

/// A non-empty run of up to nine decimal digits.
fn number(text: &[u8]) -> Option<u32> {
    if text.is_empty() || text.len() > 9 {
        return None;
    }
    text.iter().try_fold(0_u32, |value, byte| byte.is_ascii_digit().then(|| value * 10 + u32::from(byte - b'0')))
}

fn narrow<T: TryFrom<u32>>(value: u32) -> Option<T> {
    T::try_from(value).ok()
}

#[cfg(test)]
mod tests;
