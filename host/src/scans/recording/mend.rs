//! A single flipped bit, found again by its checksum.
//!
//! CRC-32 is linear: the sum of a damaged block differs from the one written by what the flipped bit alone does, and that tells where it is. Two flipped
//! bits are never taken for one; of longer damage one in eight thousand is, in a block of 64 KiB.
//!
//! Source: Koopman, *32-bit cyclic redundancy codes for Internet applications*, DSN 2002: CRC-32 tells all pairs of bits apart in blocks this long.

/// CRC-32 (ISO-HDLC), the polynomial with its lowest power first.
const POLYNOMIAL: u32 = 0xEDB8_8320;

/// The sum goes on over a byte of zeros.
fn after_zeros(sum: u32) -> u32 {
    (0..8).fold(sum, |sum, _| (sum >> 1) ^ (POLYNOMIAL & (sum & 1).wrapping_neg()))
}

/// Flips the one bit that makes the sum of `block` right, if there is one.
///
/// * `difference` — of the sum that `block` has now and the one that it had
/// * returns true if now the block is what was written: also if the difference itself is one flipped bit, of the sum
pub(super) fn mend(block: &mut [u8], difference: u32) -> bool {
    if difference.count_ones() == 1 {
        return true;
    }
    // What each bit of a byte does, as many bytes from the end.
    let mut effects: [u32; 8] = std::array::from_fn(|bit| after_zeros(1 << bit));
    for byte in block.iter_mut().rev() {
        if let Some(bit) = effects.iter().position(|effect| *effect == difference) {
            *byte ^= 1 << bit;
            return true;
        }
        effects = effects.map(after_zeros);
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scans::recording::CRC32;

    #[test]
    fn any_single_bit_is_flipped_back_and_two_are_not() {
        let block: Vec<u8> = (0..500_u32).map(|number| (number * number) as u8).collect();
        let sum = CRC32.checksum(&block);
        let flipped = |bits: &[usize]| {
            let mut damaged = block.clone();
            bits.iter().for_each(|bit| damaged[bit / 8] ^= 1 << (bit % 8));
            damaged
        };
        for bit in 0..8 * block.len() {
            let mut damaged = flipped(&[bit]);
            let difference = CRC32.checksum(&damaged) ^ sum;
            assert!(mend(&mut damaged, difference) && damaged == block, "bit {bit}");
            let mut damaged = flipped(&[bit, (bit + 1234) % 4000]);
            let difference = CRC32.checksum(&damaged) ^ sum;
            assert!(!mend(&mut damaged, difference), "bit {bit} and another");
        }
        assert!(mend(&mut block.clone(), 1 << 7), "the sum itself");
    }
}
