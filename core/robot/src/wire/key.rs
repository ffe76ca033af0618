//! A key that robot and host share, and what is made of it: HMAC-SHA-256.
//!
//! Sources: RFC 2104 (HMAC), FIPS 180-4 (SHA-256); a tag is the first half of the 32 bytes, as RFC 2104 §5 allows.

use hmac::{Hmac, KeyInit as _, Mac as _};
use sha2::Sha256;

/// Bytes of a key.
pub const KEY_BYTES: usize = 32;
/// Bytes of a [`Tag`].
pub(super) const TAG_BYTES: usize = 16;
/// A block of SHA-256, bytes.
const BLOCK: usize = 64;

/// What proves that its sender has the key.
pub(super) type Tag = [u8; TAG_BYTES];

/// What robot and host both know, and nobody else. It is not shown by `Debug`.
#[derive(Clone)]
pub struct Key([u8; KEY_BYTES]);

impl core::fmt::Debug for Key {
    fn fmt(&self, out: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        out.write_str("Key")
    }
}

impl Key {
    /// A key of these bytes, which must come from a generator for cryptography.
    pub const fn new(bytes: [u8; KEY_BYTES]) -> Self {
        Self(bytes)
    }

    /// A key as 64 hexadecimal digits; `None` if it is anything else.
    pub const fn from_hex(text: &str) -> Option<Self> {
        let (mut digits, mut bytes) = (text.as_bytes(), [0; KEY_BYTES]);
        if digits.len() != 2 * KEY_BYTES {
            return None;
        }
        let mut free: &mut [u8] = &mut bytes;
        while let ([high, low, rest @ ..], Some((byte, others))) = (digits, free.split_first_mut()) {
            let (Some(high), Some(low)) = (nibble(*high), nibble(*low)) else { return None };
            *byte = high << 4 | low;
            (digits, free) = (rest, others);
        }
        Some(Self(bytes))
    }

    fn mac(&self, parts: &[&[u8]]) -> Hmac<Sha256> {
        // HMAC fills a key that is shorter than a block with zeros.
        let mut block = [0; BLOCK];
        block.iter_mut().zip(self.0).for_each(|(byte, of_key)| *byte = of_key);
        let mut mac = Hmac::new(&block.into());
        parts.iter().for_each(|part| mac.update(part));
        mac
    }

    /// Another key, from this one and `parts`.
    pub(super) fn derive(&self, parts: &[&[u8]]) -> Self {
        Self(self.mac(parts).finalize().into_bytes().into())
    }

    /// The first half of what is derived from `parts`: a tag, or a number that nobody guesses.
    pub(super) fn tag(&self, parts: &[&[u8]]) -> Tag {
        let Self(bytes) = self.derive(parts);
        bytes.first_chunk().copied().unwrap_or_default()
    }

    /// True if `tag` is that of `parts`; takes as long for a wrong one as for the right one.
    pub(super) fn is_tag(&self, tag: &Tag, parts: &[&[u8]]) -> bool {
        self.mac(parts).verify_truncated_left(tag).is_ok()
    }
}

/// The value of a hexadecimal digit.
const fn nibble(digit: u8) -> Option<u8> {
    match digit {
        b'0'..=b'9' => Some(digit - b'0'),
        b'a'..=b'f' => Some(digit - b'a' + 10),
        b'A'..=b'F' => Some(digit - b'A' + 10),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mac_is_that_of_rfc_4231() {
        // Test case 2: key "Jefe", padded to 32 bytes, which HMAC does anyway.
        let mut key = [0; KEY_BYTES];
        key[..4].copy_from_slice(b"Jefe");
        let parts: [&[u8]; 2] = [b"what do ya want ", b"for nothing?"];
        let Key(bytes) = Key::new(key).derive(&parts);
        assert_eq!(bytes[..8], [0x5b, 0xdc, 0xc1, 0x46, 0xbf, 0x60, 0x75, 0x4e]);
        assert_eq!(bytes[28..], [0x64, 0xec, 0x38, 0x43]);
        let mut tag = Key::new(key).tag(&parts);
        assert!(Key::new(key).is_tag(&tag, &parts));
        tag[15] ^= 1;
        assert!(!Key::new(key).is_tag(&tag, &parts));
    }

    #[test]
    fn a_key_is_64_digits_and_nothing_else() {
        const DIGITS: &str = "00112233445566778899aabbccddeeff00112233445566778899AABBCCDDEEFF";
        const KEY: Option<Key> = Key::from_hex(DIGITS);
        let Some(Key(bytes)) = KEY else { panic!("a key") };
        assert_eq!((bytes[0], bytes[1], bytes[15], bytes[31]), (0, 0x11, 0xff, 0xff));
        for wrong in ["", &DIGITS[1..], &DIGITS[2..], &std::format!("{DIGITS}0"), &DIGITS.replace('f', "g")] {
            assert!(Key::from_hex(wrong).is_none(), "{wrong}");
        }
        assert_eq!(std::format!("{KEY:?}"), "Some(Key)");
    }
}
