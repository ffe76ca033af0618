//! Bytes as text, RFC 4648, section 4.

const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";

/// Adds `bytes` to `out`.
pub(super) fn encode(bytes: impl IntoIterator<Item = u8>, out: &mut String) {
    let mut bytes = bytes.into_iter();
    while let Some(first) = bytes.next() {
        let (second, third) = (bytes.next(), bytes.next());
        let three = u32::from_be_bytes([0, first, second.unwrap_or(0), third.unwrap_or(0)]);
        let letter = |place: u32| {
            LETTERS.get((three >> (18 - 6 * place)) as usize & 63).map_or('=', |letter| char::from(*letter))
        };
        out.extend([letter(0), letter(1)]);
        out.push(second.map_or('=', |_| letter(2)));
        out.push(third.map_or('=', |_| letter(3)));
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn rfc_4648_section_10() {
        let pairs = [("", ""), ("f", "Zg=="), ("fo", "Zm8="), ("foo", "Zm9v"), ("foobar", "Zm9vYmFy")];
        for (bytes, text) in pairs {
            let mut out = String::new();
            super::encode(bytes.bytes(), &mut out);
            assert_eq!(out, text);
        }
    }
}
