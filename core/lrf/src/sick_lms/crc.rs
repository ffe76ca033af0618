//! The check sum of LMS2xx telegrams. It looks like CRC-16 with polynomial 0x8005, but is none.
//!
//! Per byte the register moves by one bit only, and then takes in the byte and, in its upper half, the byte before. So bit
//! `b` of a byte and bit `b + 1` of the next weigh the same: **two flips so placed are not seen**. A single flip always
//! is; other damage passes with a chance of about 2⁻¹⁶. Therefore lengths, counts and modes are checked as well.
//!
//! Source: drivers; capture.

/// Check sum over `bytes`, which begin with the 02; sent low byte first.
///
/// ```
/// assert_eq!(lrfslam_lrf::sick_lms::crc::crc(b"123456789"), 0xA656);
/// ```
pub fn crc(bytes: &[u8]) -> u16 {
    let step = |(register, previous): (u16, u8), byte: &u8| {
        let shifted = if register & 0x8000 == 0 { register << 1 } else { (register << 1) ^ 0x8005 };
        (shifted ^ u16::from_be_bytes([previous, *byte]), *byte)
    };
    bytes.iter().fold((0, 0), step).0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn vectors_hold() {
        assert_eq!(crc(b""), 0);
        assert_eq!(crc(&[2]), 2);
        assert_eq!(crc(&[2, 0, 1, 0, 0x31]), 0x1215);
        assert_eq!(crc(b"123456789"), 0xA656);
    }

    #[test]
    fn every_single_flip_is_seen_but_a_diagonal_pair_is_not() {
        let telegram: std::vec::Vec<u8> = (0..726_u32).map(|i| ((i * 37) >> 2) as u8).collect();
        let right = crc(&telegram);
        for at in 0..telegram.len() {
            for bit in 0..8 {
                let mut damaged = telegram.clone();
                damaged[at] ^= 1 << bit;
                assert_ne!(crc(&damaged), right, "byte {at} bit {bit}");
                if bit < 7 && at + 2 < telegram.len() {
                    damaged[at + 1] ^= 2 << bit;
                    assert_eq!(crc(&damaged), right, "byte {at} bit {bit}: the weakness this module's text states");
                }
            }
        }
    }
}
