//! Which times a log has had, to count repeated ones.

use std::collections::HashSet;

use lrfslam_core::time::Instant;

/// Times of scans. As long as none is earlier than the one before, as in most logs, each takes some three bytes.
#[derive(Debug, Default)]
pub(super) struct Stamps {
    /// From each to the next later one, µs, packed; the first from 0.
    steps: Vec<u8>,
    last: Option<i64>,
    /// Instead of these, once one was earlier.
    all: HashSet<i64>,
}

impl Stamps {
    /// Adds one; false if it was there.
    pub(super) fn insert(&mut self, stamp: Instant) -> bool {
        let micros = stamp.micros;
        match self.last {
            _ if !self.all.is_empty() => self.all.insert(micros),
            Some(last) if micros == last => false,
            Some(last) if micros < last => {
                self.all = risen(&self.steps);
                self.steps = Vec::new();
                self.all.insert(micros)
            }
            last => {
                let step = micros.wrapping_sub(last.unwrap_or_default());
                // Into memory, which cannot fail.
                self.steps = postcard::to_extend(&step, std::mem::take(&mut self.steps)).unwrap_or_default();
                self.last = Some(micros);
                true
            }
        }
    }
}

/// The times that these are the steps of.
fn risen(mut steps: &[u8]) -> HashSet<i64> {
    let mut micros = 0_i64;
    std::iter::from_fn(|| {
        let (step, rest) = postcard::take_from_bytes::<i64>(steps).ok()?;
        (steps, micros) = (rest, micros.wrapping_add(step));
        Some(micros)
    })
    .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_time_is_new_once(jumps in prop::collection::vec(prop_oneof![9 => 0_i64..400_000, 1 => any::<i64>()], 1..300)) {
            let (mut stamps, mut seen, mut micros) = (Stamps::default(), HashSet::new(), 0_i64);
            for jump in jumps {
                micros = micros.wrapping_add(jump);
                prop_assert_eq!(stamps.insert(Instant::from_micros(micros)), seen.insert(micros));
            }
        }
    }

    #[test]
    fn a_day_takes_three_bytes_a_scan_until_a_time_runs_back() {
        let mut stamps = Stamps::default();
        let at = |scan: i64| Instant::from_micros(1_700_000_000_000_000 + 200_000 * scan);
        assert!((0..100_000).all(|scan| stamps.insert(at(scan))) && !stamps.insert(at(99_999)));
        assert!(stamps.steps.len() < 3 * 100_010, "{} bytes", stamps.steps.len());
        assert!(!stamps.insert(at(500)) && stamps.insert(at(-1)) && stamps.insert(at(100_000)));
        assert!((0..=100_000).all(|scan| !stamps.insert(at(scan))));
    }
}
