//! One random stream for every sample of every step, so that the order of work and the number of threads cannot change
//! a result.
//!
//! (seed, step, index) → mixed to a start state (SplitMix64's finaliser) → PCG-XSH-RR 64/32. A stream is made where it is
//! used and thrown away after it: nothing has to be stored or handed round.
//!
//! Sources: O'Neill, *PCG*, 2014; Steele, Lea & Flood, *Fast splittable pseudorandom number generators*, 2014.

use core::convert::Infallible;

use rand_core::TryRng;

/// PCG's multiplier.
const MULTIPLIER: u64 = 6_364_136_223_846_793_005;

/// A stream of random words; see the [module](self). Not for secrets.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RandomStream {
    state: u64,
    /// Odd; tells streams apart even if their states should meet.
    increment: u64,
}

impl RandomStream {
    /// The stream of item `index` in step `step` of a run with `seed`.
    pub fn new(seed: u64, step: u32, index: u32) -> Self {
        let place = (u64::from(step) << 32) | u64::from(index);
        let state = mix(seed ^ mix(place));
        Self { state, increment: (mix(state ^ place) << 1) | 1 }
    }
}

/// SplitMix64's finaliser: every bit of the input moves every bit of the output.
fn mix(word: u64) -> u64 {
    let word = word.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let word = (word ^ (word >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let word = (word ^ (word >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    word ^ (word >> 31)
}

impl TryRng for RandomStream {
    type Error = Infallible;

    #[inline]
    fn try_next_u32(&mut self) -> Result<u32, Infallible> {
        let state = self.state;
        self.state = state.wrapping_mul(MULTIPLIER).wrapping_add(self.increment);
        let shifted = (((state >> 18) ^ state) >> 27) as u32;
        Ok(shifted.rotate_right((state >> 59) as u32))
    }

    #[inline]
    fn try_next_u64(&mut self) -> Result<u64, Infallible> {
        let low = self.try_next_u32()?;
        Ok((u64::from(self.try_next_u32()?) << 32) | u64::from(low))
    }

    fn try_fill_bytes(&mut self, bytes: &mut [u8]) -> Result<(), Infallible> {
        for chunk in bytes.chunks_mut(4) {
            let word = self.try_next_u32()?.to_le_bytes();
            chunk.iter_mut().zip(word).for_each(|(to, from)| *to = from);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_core::Rng;

    #[test]
    fn the_same_place_gives_the_same_stream_and_another_place_another() {
        let word = |seed, step, index| RandomStream::new(seed, step, index).next_u64();
        assert_eq!(word(1, 2, 3), word(1, 2, 3));
        assert_eq!(word(1, 2, 3), 0xb207_92f9_9544_34f8, "{:#x}", word(1, 2, 3));
        for other in [word(2, 2, 3), word(1, 3, 3), word(1, 2, 4), word(1, 3, 2)] {
            assert_ne!(other, word(1, 2, 3));
        }
    }

    #[test]
    fn first_words_of_neighbouring_streams_are_uniform_and_uncorrelated() {
        let n = 40_000;
        let draw = |index| f64::from(RandomStream::new(7, 3, index).next_u32()) / 4_294_967_296.0 - 0.5;
        let (mut mean, mut variance, mut covariance) = (0.0, 0.0, 0.0);
        for index in 0..n {
            mean += draw(index) / f64::from(n);
            variance += draw(index) * draw(index) / f64::from(n);
            covariance += draw(index) * draw(index + 1) / f64::from(n);
        }
        assert!(mean.abs() < 0.006 && (variance - 1.0 / 12.0).abs() < 0.002 && covariance.abs() < 0.002);
    }

    #[test]
    fn bytes_are_the_words() {
        let mut bytes = [0; 6];
        RandomStream::new(1, 1, 1).fill_bytes(&mut bytes);
        let mut words = RandomStream::new(1, 1, 1);
        assert_eq!(bytes[..4], words.next_u32().to_le_bytes());
        assert_eq!(bytes[4..], words.next_u32().to_le_bytes()[..2]);
    }
}
