//! LDROBOT LD06: it turns and talks while it has power, whatever it hears.
//!
//! Source: as cited in `lrfslam_lrf::ldrobot`: 4500 samples a second, twelve in a packet, ten turns a second.

use lrfslam_core::time::{Duration, Instant};
use lrfslam_lrf::ldrobot::packet::{POINTS, STAMP_PERIOD_MS};
use lrfslam_lrf::ldrobot::{Packet, Point};

use super::{Emission, Line, VirtualLrf};
use crate::lrf_model::{LrfErrors, RangeMeter, Reading};
use crate::scene::Scene;

const BAUD: u32 = 230_400;
const SAMPLES_PER_SECOND: i64 = 4500;
const SPEED_DEGPS: u16 = 3600;
/// Hundredths of a degree from sample to sample: 0.8 degrees.
const STEP_CDEG: i64 = 100 * SPEED_DEGPS as i64 / SAMPLES_PER_SECOND;
/// It measures from 0.02 m to 12 m.
const RANGE_MM: std::ops::Range<f64> = 20.0..12_000.0;

/// A virtual LD06.
pub struct VirtualLd06 {
    scene: Box<dyn Scene>,
    meter: RangeMeter,
    line: Line,
    /// When its clock was zero.
    zero: Instant,
    next_packet: i64,
}

impl VirtualLd06 {
    /// A sensor that has been on since the clock's zero; `seed` decides its errors.
    pub fn new(errors: LrfErrors, scene: Box<dyn Scene>, seed: u64) -> Self {
        let meter = RangeMeter::new(errors, seed);
        Self { scene, meter, line: Line::new(Some(BAUD)), zero: Instant::default(), next_packet: 0 }
    }

    fn sample_at(&self, sample: i64) -> Instant {
        self.zero + Duration::from_micros(sample * 1_000_000 / SAMPLES_PER_SECOND)
    }

    /// When the last sample of the next packet is taken.
    fn packet_due(&self) -> Instant {
        self.sample_at((self.next_packet + 1) * POINTS as i64 - 1)
    }

    fn packet(&mut self) -> Packet {
        let first = self.next_packet * POINTS as i64;
        let angle_cdeg = |sample: i64| (sample * STEP_CDEG).rem_euclid(36_000) as u16;
        let points = std::array::from_fn(|index| self.measure(first + index as i64));
        let last = first + POINTS as i64 - 1;
        let stamp_ms = (self.sample_at(last).since(self.zero).micros / 1000 % STAMP_PERIOD_MS) as u16;
        Packet { speed_degps: SPEED_DEGPS, start_cdeg: angle_cdeg(first), points, end_cdeg: angle_cdeg(last), stamp_ms }
    }

    fn measure(&mut self, sample: i64) -> Point {
        let clockwise_deg = (sample * STEP_CDEG) as f64 / 100.0 % 360.0;
        let distance_mm =
            match self.meter.measure(self.scene.as_ref(), self.sample_at(sample), -clockwise_deg.to_radians()) {
                Reading::Range(range_m) if RANGE_MM.contains(&(range_m * 1000.0)) => (range_m * 1000.0).round() as u16,
                _ => 0,
            };
        Point { distance_mm, intensity: if distance_mm == 0 { 0 } else { 200 } }
    }
}

impl VirtualLrf for VirtualLd06 {
    fn power_on(&mut self, now: Instant) {
        (self.zero, self.next_packet) = (now, 0);
        self.line.reset(now, Some(BAUD));
    }

    fn receive(&mut self, _: Instant, _: &[u8]) {}

    fn timeout(&mut self, now: Instant) {
        while self.packet_due() <= now {
            let (due, packet) = (self.packet_due(), self.packet());
            self.next_packet += 1;
            self.line.send(due, packet.emit().to_vec());
        }
    }

    fn poll(&mut self) -> Option<Emission> {
        self.line.poll()
    }

    fn deadline(&self) -> Instant {
        self.packet_due()
    }

    fn baud(&self, now: Instant) -> Option<u32> {
        self.line.baud(now)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::Scenario;

    #[test]
    fn a_turn_has_450_samples_in_a_tenth_of_a_second() {
        let mut device = VirtualLd06::new(LrfErrors::NONE, Box::new(Scenario::load("room").unwrap().scene()), 1);
        device.timeout(Instant::from_micros(1_000_000));
        let packets: Vec<Packet> = std::iter::from_fn(|| device.poll())
            .map(|emission| Packet::parse(&emission.bytes.try_into().unwrap()).unwrap())
            .collect();
        assert_eq!(packets.len(), 375);
        assert!(
            packets
                .windows(2)
                .all(|pair| (i32::from(pair[1].start_cdeg) - i32::from(pair[0].end_cdeg)).rem_euclid(36_000) == 80)
        );
        let wraps = packets.windows(2).filter(|pair| pair[1].start_cdeg < pair[0].start_cdeg).count();
        assert!(wraps == 9 || wraps == 10, "{wraps}");
        assert_eq!(packets[374].stamp_ms, 999);
        assert!(packets.iter().flat_map(|packet| packet.points).all(|point| point.distance_mm > 100));
    }
}
