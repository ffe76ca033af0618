//! SCIP's number coding: 6 bits per character, most significant first, character = value + 0x30; and its line sum.
//!
//! The sum cannot see a change by a multiple of 64, but a flipped bit 6 always leaves the range 0x30..=0x6F: checked
//! together, [`decode`]'s range check and [`sum`] find every single flipped bit. Damage of several bytes passes with
//! chance 1/64 a line, so lengths and counts are checked as well.
//!
//! Source: manual, section 3.4.

/// First character of the code: value 0.
const ZERO: u8 = 0x30;
/// Last character: value 63.
const LAST: u8 = 0x6F;

/// The sum character of a line, over all bytes before it.
pub fn sum(line: &[u8]) -> u8 {
    (line.iter().fold(0_u8, |sum, byte| sum.wrapping_add(*byte)) & 0x3F) + ZERO
}

/// Writes the low `6 * out.len()` bits of `value`.
pub fn encode(value: u64, out: &mut [u8]) {
    let mut rest = value;
    for character in out.iter_mut().rev() {
        *character = (rest & 0x3F) as u8 + ZERO;
        rest >>= 6;
    }
}

/// Value of `characters`; `None` for a character outside the code, for none at all, or for more than 64 bits.
pub fn decode(characters: &[u8]) -> Option<u64> {
    if characters.is_empty() {
        return None;
    }
    characters.iter().try_fold(0_u64, |value, character| match character {
        ZERO..=LAST if value < 1 << 58 => Some(value << 6 | u64::from(character - ZERO)),
        _ => None,
    })
}

/// Removes and checks the last character of `line` as its sum; `None` if it is wrong or the line is empty.
pub fn checked(line: &[u8]) -> Option<&[u8]> {
    let (last, content) = line.split_last()?;
    (sum(content) == *last).then_some(content)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn vectors_of_the_manual_hold() {
        for (value, text) in [
            (1234, &b"CB"[..]),
            (4095, b"oo"),
            (19, b"0C"),
            (5432, b"1Dh"),
            (60000, b">YP"),
            (0, b"000"),
            (262_143, b"ooo"),
            (16_000_000, b"m2@0"),
            (16_777_215, b"oooo"),
            (6_968_830, b"JUGn"),
        ] {
            assert_eq!(decode(text), Some(value));
            let mut out = [0; 8];
            let out = &mut out[..text.len()];
            encode(value, out);
            assert_eq!(out, text);
        }
    }

    #[test]
    fn character_outside_the_code_is_refused() {
        for bad in [&b""[..], b"0p0", b"0/", b"\n0", b"oooooooooooo"] {
            assert_eq!(decode(bad), None);
        }
    }

    #[test]
    fn status_sums_are_those_of_the_manual() {
        for line in ["00P", "01Q", "07W", "10Q", "99b", "0Aa", "0Ee", "0Ll", "0Mm"] {
            assert!(checked(line.as_bytes()).is_some(), "{line}");
        }
    }

    proptest! {
        #[test]
        fn decode_undoes_encode(value in 0_u64..1 << 24) {
            let mut text = [0; 4];
            encode(value, &mut text);
            prop_assert_eq!(decode(&text), Some(value));
        }

        #[test]
        fn no_single_flipped_bit_passes(values in proptest::collection::vec(0_u8..64, 1..64), at in 0_usize..64, bit in 0_u8..8) {
            let mut line: std::vec::Vec<u8> = values.iter().map(|v| v + ZERO).collect();
            line.push(sum(&line));
            let at = at % line.len();
            line[at] ^= 1_u8 << bit;
            let passes = checked(&line).is_some_and(decode_all);
            prop_assert!(!passes);
        }
    }

    fn decode_all(content: &[u8]) -> bool {
        content.iter().all(|c| decode(&[*c]).is_some())
    }
}
