//! The frame around a payload, host and sensor side.

use super::crc::crc;

/// First byte of a telegram.
pub const STX: u8 = 0x02;
/// "Telegram taken": a bare byte.
pub const ACK: u8 = 0x06;
/// "Telegram damaged": a bare byte.
pub const NAK: u8 = 0x15;
/// Longest payload: 401 values and what is around them.
pub const MAX_PAYLOAD: usize = 812;
/// Bytes around the payload: STX, address, two of length, two of check sum.
pub const OVERHEAD: usize = 6;
/// Longest telegram, bytes: what a decoder's buffer should hold.
pub const MAX_TELEGRAM: usize = MAX_PAYLOAD + OVERHEAD;

/// Which way a telegram goes; its second byte.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Direction {
    /// Host to sensor: address 0.
    ToSensor,
    /// Sensor to host: address 0x80.
    ToHost,
}

impl Direction {
    /// The byte on the wire.
    pub const fn address(self) -> u8 {
        match self {
            Direction::ToSensor => 0x00,
            Direction::ToHost => 0x80,
        }
    }
}

/// The telegram does not fit into the buffer lent, or its payload is longer than [`MAX_PAYLOAD`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("telegram does not fit")]
pub struct TooLong;

/// Writes a telegram around `payload` into `out`: number of bytes.
///
/// # Errors
/// [`TooLong`]; `out` is then unchanged.
pub fn emit(direction: Direction, payload: &[u8], out: &mut [u8]) -> Result<usize, TooLong> {
    let total = payload.len() + OVERHEAD;
    let out = out.get_mut(..total).filter(|_| payload.len() <= MAX_PAYLOAD).ok_or(TooLong)?;
    let (body, sum) = out.split_at_mut_checked(total - 2).ok_or(TooLong)?;
    let (head, content) = body.split_first_chunk_mut::<4>().ok_or(TooLong)?;
    let [low, high] = (payload.len() as u16).to_le_bytes();
    *head = [STX, direction.address(), low, high];
    content.copy_from_slice(payload);
    sum.copy_from_slice(&crc(body).to_le_bytes());
    Ok(total)
}

/// What the bytes at the start of a buffer are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Head {
    /// A whole telegram of this many bytes, its sum right.
    Whole(usize),
    /// Could be the start of one: more bytes are needed.
    Partial,
    /// None: drop one byte and look again.
    No,
}

/// Looks whether `bytes` begin with a telegram of `direction`.
///
/// Implausible lengths (0, or over [`MAX_PAYLOAD`]) are refused at once, so that a damaged length holds nothing up for long.
pub fn check(direction: Direction, bytes: &[u8]) -> Head {
    let Some((head, _)) = bytes.split_first_chunk::<4>() else {
        let begins = [STX, direction.address()];
        return if bytes.iter().zip(begins).all(|(byte, expected)| *byte == expected) {
            Head::Partial
        } else {
            Head::No
        };
    };
    let [stx, address, low, high] = *head;
    let length = usize::from(u16::from_le_bytes([low, high]));
    if stx != STX || address != direction.address() || !(1..=MAX_PAYLOAD).contains(&length) {
        return Head::No;
    }
    let Some(telegram) = bytes.get(..length + OVERHEAD) else { return Head::Partial };
    match telegram.split_last_chunk::<2>() {
        Some((body, sum)) if crc(body) == u16::from_le_bytes(*sum) => Head::Whole(length + OVERHEAD),
        _ => Head::No,
    }
}

/// Payload of a telegram that [`check`] called whole.
pub fn payload(telegram: &[u8]) -> &[u8] {
    telegram.get(4..telegram.len().saturating_sub(2)).unwrap_or(b"")
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn telegram_is_built_and_taken_apart() {
        let mut out = [0; 8];
        assert_eq!(emit(Direction::ToSensor, &[0x20, 0x24], &mut out), Ok(8));
        assert_eq!(out, [0x02, 0x00, 0x02, 0x00, 0x20, 0x24, 0x34, 0x08]);
        assert_eq!(check(Direction::ToSensor, &out), Head::Whole(8));
        assert_eq!(payload(&out), [0x20, 0x24]);
        assert_eq!(check(Direction::ToHost, &out), Head::No);
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        assert_eq!(emit(Direction::ToSensor, &[0; 3], &mut [0; 8]), Err(TooLong));
        assert_eq!(emit(Direction::ToHost, &[0; 813], &mut [0; 900]), Err(TooLong));
    }

    #[test]
    fn impossible_length_is_refused_at_once() {
        assert_eq!(check(Direction::ToHost, &[2, 0x80, 0xFF, 0x7F]), Head::No);
        assert_eq!(check(Direction::ToHost, &[2, 0x80, 0, 0]), Head::No);
        assert_eq!(check(Direction::ToHost, &[2, 0x80, 4]), Head::Partial);
    }

    proptest! {
        #[test]
        fn what_is_emitted_is_whole(content in proptest::collection::vec(any::<u8>(), 1..MAX_PAYLOAD)) {
            let mut out = [0; MAX_TELEGRAM];
            let length = emit(Direction::ToHost, &content, &mut out).unwrap();
            prop_assert_eq!(check(Direction::ToHost, &out[..length]), Head::Whole(length));
            prop_assert_eq!(payload(&out[..length]), &content[..]);
            prop_assert_eq!(check(Direction::ToHost, &out[..length - 1]), Head::Partial);
        }
    }
}
