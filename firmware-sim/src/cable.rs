//! The line between device and host: bytes take their time, and at a wrong rate they arrive as other bytes.

use std::collections::VecDeque;

use lrfslam_core::time::{Duration, Instant};

use crate::virtual_lrf::{Emission, wire_time};

/// Bytes under way to the host.
#[derive(Debug, Default)]
pub struct Cable {
    under_way: VecDeque<(Emission, usize)>,
}

impl Cable {
    /// Puts bytes on the line.
    pub fn push(&mut self, emission: Emission) {
        if !emission.bytes.is_empty() {
            self.under_way.push_back((emission, 0));
        }
    }

    /// Takes the bytes whose last bit has arrived by `now`, as a host that listens at `host_baud` reads them.
    pub fn arrived(&mut self, now: Instant, host_baud: u32) -> Vec<u8> {
        let mut arrived = Vec::new();
        while let Some((emission, taken)) = self.under_way.front_mut() {
            let elapsed = now.since(emission.begins).micros;
            let per_byte = wire_time(1000, emission.baud).micros.max(1);
            let count = (elapsed.max(0) * 1000 / per_byte) as usize;
            let until = count.min(emission.bytes.len());
            if until > *taken {
                let bytes = &emission.bytes[*taken..until];
                match emission.baud {
                    Some(baud) => arrived.extend(resample(bytes, baud, host_baud)),
                    None => arrived.extend(bytes),
                }
                *taken = until;
            }
            if *taken < emission.bytes.len() {
                break;
            }
            self.under_way.pop_front();
        }
        arrived
    }

    /// When bytes will have arrived: the rest of the write at the front, but no later than `grain` from now.
    pub fn next_arrival(&self, now: Instant, grain: Duration) -> Option<Instant> {
        let (emission, _) = self.under_way.front()?;
        let begun = emission.begins.max(now);
        let end = emission.begins + wire_time(emission.bytes.len(), emission.baud);
        Some(end.min(begun + grain).max(now + Duration::from_micros(1)) + Duration::from_micros(1))
    }

    /// Cuts the line: what is under way is lost.
    pub fn cut(&mut self) {
        self.under_way.clear();
    }
}

/// What a receiver at `receiver_baud` reads when a sender at `sender_baud` sends `bytes` without a pause.
///
/// It samples the middle of each of its own bits, from a falling edge on; a low stop bit is a framing error, and the
/// byte is dropped. Up to some 4 % of difference nothing happens.
pub fn resample(bytes: &[u8], sender_baud: u32, receiver_baud: u32) -> Vec<u8> {
    if sender_baud == receiver_baud {
        return bytes.to_vec();
    }
    // Bits on the line: start 0, eight data bits from the lowest, stop 1.
    let bits: Vec<bool> = bytes
        .iter()
        .flat_map(|byte| {
            let data = (0..8).map(move |bit| byte >> bit & 1 == 1);
            std::iter::once(false).chain(data).chain(std::iter::once(true))
        })
        .collect();
    let step = f64::from(sender_baud) / f64::from(receiver_baud.max(1));
    let level = |position: f64| bits.get(position as usize).copied().unwrap_or(true);
    let mut read = Vec::new();
    let mut position = 0.0;
    while position < bits.len() as f64 {
        if level(position) {
            position = (position.floor() + 1.0).max(position);
            continue;
        }
        let byte = (0..8).fold(0, |byte, bit| byte | u8::from(level(position + (1.5 + f64::from(bit)) * step)) << bit);
        if level(position + 9.5 * step) {
            read.push(byte);
        }
        position += 9.5 * step;
        // A receiver waits for the line to be high again before the next falling edge.
        while position < bits.len() as f64 && !level(position) {
            position = position.floor() + 1.0;
        }
    }
    read
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn same_rate_and_a_little_off_change_nothing() {
        let bytes: Vec<u8> = (0..=255).collect();
        assert_eq!(resample(&bytes, 9600, 9600), bytes);
        assert_eq!(resample(&bytes, 115_200, 113_000), bytes);
    }

    #[test]
    fn wrong_rate_makes_other_bytes() {
        let telegram = [0x02, 0x80, 0x03, 0x00, 0xA0, 0x00, 0x10, 0x16, 0x0A];
        for (sender, receiver) in [(9600, 38_400), (38_400, 9600), (500_000, 38_400), (19_200, 38_400)] {
            assert_ne!(resample(&telegram, sender, receiver), telegram, "{sender} {receiver}");
        }
        assert!(resample(&telegram, 500_000, 9600).len() <= 1);
    }

    #[test]
    fn bytes_arrive_at_the_pace_of_the_line() {
        let mut cable = Cable::default();
        cable.push(Emission { bytes: vec![7; 96], begins: Instant::default(), baud: Some(9600) });
        assert_eq!(cable.arrived(Instant::from_micros(50_100), 9600).len(), 48);
        assert_eq!(cable.arrived(Instant::from_micros(99_000), 9600).len(), 47);
        assert_eq!(cable.arrived(Instant::from_micros(100_000), 9600).len(), 1);
        assert_eq!(cable.next_arrival(Instant::default(), Duration::from_millis(1)), None);
    }
}
