//! Slamtec RPLIDAR: A2 (express packets), C1 (dense packets), and an A1 of old firmware, which has only the old scan mode.
//!
//! Source: as cited in `lrfslam_lrf::rplidar`. Chosen where nothing is settled: all samples of a packet have one correction, which changes from
//! packet to packet; requests that are not known are not answered.

use lrfslam_core::time::{Duration, Instant};
use lrfslam_lrf::driver::NEVER;
use lrfslam_lrf::rplidar::{Capsule, Descriptor, Request, ResponseKind};

use super::{Emission, Line, VirtualLrf};
use crate::lrf_model::{LrfErrors, RangeMeter, Reading};
use crate::scene::Scene;

/// From a request to its answer.
const REPLY: Duration = Duration::from_millis(2);
/// Corrections of the packets by turns, degrees.
const CORRECTIONS_DEG: [f32; 3] = [1.0, 2.5, 5.0];
/// Old samples that leave at once.
const SAMPLES_AT_ONCE: i64 = 8;

/// What tells the models apart.
#[derive(Debug, Clone)]
pub struct RplidarModel {
    /// First byte of the information.
    code: u8,
    baud: u32,
    /// How express scans come; `None` if it has none.
    express: Option<ResponseKind>,
    samples_per_second: i64,
    turns_per_second: f64,
    range_max_m: f64,
    /// It turns only if it is told to.
    needs_motor: bool,
    errors: LrfErrors,
}

impl RplidarModel {
    /// A2M8: express packets of 32 samples, 4000 a second, 10 turns a second, 12 m.
    pub fn a2() -> Self {
        Self {
            code: 0x28,
            baud: 115_200,
            express: Some(ResponseKind::Capsule),
            samples_per_second: 4000,
            turns_per_second: 10.0,
            range_max_m: 12.0,
            needs_motor: true,
            errors: LrfErrors { lost: 0.01, ..LrfErrors::gaussian(0.01) },
        }
    }

    /// C1: dense packets of 40 samples, 5000 a second, 10 turns a second, 12 m.
    pub fn c1() -> Self {
        let express = Some(ResponseKind::DenseCapsule);
        Self { code: 0x41, baud: 460_800, express, samples_per_second: 5000, needs_motor: false, ..Self::a2() }
    }

    /// A1M8 of firmware before 1.17, which has no express scan: 2000 samples a second, 5.5 turns a second.
    pub fn a1_old() -> Self {
        let needs_motor = false;
        Self { code: 0x18, express: None, samples_per_second: 2000, turns_per_second: 5.5, needs_motor, ..Self::a2() }
    }

    /// The same with other errors.
    pub fn with_errors(self, errors: LrfErrors) -> Self {
        Self { errors, ..self }
    }
}

/// A virtual RPLIDAR.
pub struct VirtualRplidar {
    model: RplidarModel,
    scene: Box<dyn Scene>,
    meter: RangeMeter,
    line: Line,
    motor_on: bool,
    scanning: Option<ResponseKind>,
    /// When sample 0 of this scan was taken.
    began: Instant,
    next_sample: i64,
    incoming: Vec<u8>,
}

impl VirtualRplidar {
    /// A sensor that has been on for long; `seed` decides its errors.
    pub fn new(model: RplidarModel, scene: Box<dyn Scene>, seed: u64) -> Self {
        let meter = RangeMeter::new(model.errors, seed);
        let line = Line::new(Some(model.baud));
        let motor_on = !model.needs_motor;
        let (scanning, began, next_sample, incoming) = (None, Instant::default(), 0, Vec::new());
        Self { model, scene, meter, line, motor_on, scanning, began, next_sample, incoming }
    }

    fn sample_at(&self, sample: i64) -> Instant {
        self.began + Duration::from_micros(sample * 1_000_000 / self.model.samples_per_second)
    }

    /// Clockwise from straight ahead, before the correction, degrees.
    fn clockwise_deg(&self, sample: i64) -> f64 {
        sample as f64 * 360.0 * self.model.turns_per_second / self.model.samples_per_second as f64 % 360.0
    }

    /// Samples that leave at once.
    fn group(&self) -> i64 {
        match self.scanning {
            Some(ResponseKind::Capsule) => 32,
            Some(ResponseKind::DenseCapsule) => 40,
            _ => SAMPLES_AT_ONCE,
        }
    }

    /// When the last sample of the next group is taken.
    fn group_due(&self) -> Option<Instant> {
        self.scanning.filter(|_| self.motor_on).map(|_| self.sample_at(self.next_sample + self.group() - 1))
    }

    fn take_requests(&mut self, now: Instant) {
        loop {
            let begins = self.incoming.iter().position(|byte| *byte == 0xA5).unwrap_or(self.incoming.len());
            self.incoming.drain(..begins);
            let length = match self.incoming[..] {
                [_, command, ..] if command & 0x80 == 0 => 2,
                [_, _, payload, ..] => usize::from(payload) + 4,
                _ => return,
            };
            if self.incoming.len() < length {
                return;
            }
            match Request::parse(&self.incoming[..length]) {
                Some(request) => {
                    self.incoming.drain(..length);
                    self.obey(now, request);
                }
                None => drop(self.incoming.drain(..1)),
            }
        }
    }

    fn obey(&mut self, now: Instant, request: Request) {
        match request {
            Request::Stop => self.scanning = None,
            Request::Reset => self.power_on(now),
            Request::MotorPower(power) => {
                self.motor_on = power > 0 || !self.model.needs_motor;
                (self.began, self.next_sample) = (now, 0);
            }
            Request::GetInfo => {
                let versions = [self.model.code, 29, 1, 7];
                self.answer(now, ResponseKind::Info, &[&versions[..], &[0xA5; 16]].concat());
            }
            Request::GetHealth => self.answer(now, ResponseKind::Health, &[0, 0, 0]),
            Request::ExpressScan => self.scan(now, self.model.express),
            Request::Scan => self.scan(now, Some(ResponseKind::Sample)),
        }
    }

    fn answer(&mut self, now: Instant, kind: ResponseKind, response: &[u8]) {
        self.line.send(now + REPLY, [&Descriptor { kind }.emit()[..], response].concat());
    }

    fn scan(&mut self, now: Instant, kind: Option<ResponseKind>) {
        let Some(kind) = kind else { return };
        self.answer(now, kind, &[]);
        self.scanning = Some(kind);
        (self.began, self.next_sample) = (now + REPLY, 0);
    }

    fn measure_mm(&mut self, sample: i64, correction_deg: f32) -> u16 {
        let clockwise_deg = self.clockwise_deg(sample) - f64::from(correction_deg);
        let at = self.sample_at(sample);
        match self.meter.measure(self.scene.as_ref(), at, -clockwise_deg.to_radians()) {
            Reading::Range(range_m) if (0.15..self.model.range_max_m).contains(&range_m) => {
                (range_m * 1000.0).round() as u16
            }
            _ => 0,
        }
    }

    fn group_bytes(&mut self, kind: ResponseKind) -> Vec<u8> {
        let (first, count) = (self.next_sample, self.group());
        if kind == ResponseKind::Sample {
            return (first..first + count).flat_map(|sample| self.old_sample(sample)).collect();
        }
        let dense = kind == ResponseKind::DenseCapsule;
        let correction_deg = if dense { 0.0 } else { CORRECTIONS_DEG[(first / count) as usize % 3] };
        let distances: Vec<u16> =
            (first..first + count).map(|sample| self.measure_mm(sample, correction_deg)).collect();
        let start_deg = self.clockwise_deg(first) as f32;
        Capsule::build_corrected(dense, first == 0, start_deg, &distances, correction_deg).bytes().to_vec()
    }

    fn old_sample(&mut self, sample: i64) -> [u8; 5] {
        let degrees = self.clockwise_deg(sample);
        let starts = u8::from(sample == 0 || degrees < self.clockwise_deg(sample - 1));
        let [angle_low, angle_high] = ((((degrees * 64.0) as u16 % (360 * 64)) << 1) | 1).to_le_bytes();
        let distance_mm = self.measure_mm(sample, 0.0);
        let [low, high] = (distance_mm.min(16_383) << 2).to_le_bytes();
        let quality = if distance_mm == 0 { 0 } else { 15 };
        [quality << 2 | (1 - starts) << 1 | starts, angle_low, angle_high, low, high]
    }
}

impl VirtualLrf for VirtualRplidar {
    fn power_on(&mut self, now: Instant) {
        (self.scanning, self.motor_on) = (None, !self.model.needs_motor);
        self.incoming.clear();
        self.line.reset(now, Some(self.model.baud));
    }

    fn receive(&mut self, now: Instant, bytes: &[u8]) {
        self.incoming.extend(bytes);
        self.take_requests(now);
    }

    fn timeout(&mut self, now: Instant) {
        while let (Some(due), Some(kind)) = (self.group_due().filter(|due| *due <= now), self.scanning) {
            let bytes = self.group_bytes(kind);
            self.next_sample += self.group();
            self.line.send(due, bytes);
        }
    }

    fn poll(&mut self) -> Option<Emission> {
        self.line.poll()
    }

    fn deadline(&self) -> Instant {
        self.group_due().unwrap_or(NEVER)
    }

    fn baud(&self, now: Instant) -> Option<u32> {
        self.line.baud(now)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::Scenario;

    fn ask(device: &mut VirtualRplidar, now: &mut Instant, request: Request, ms: i64) -> Vec<u8> {
        device.receive(*now, &request.emit());
        *now = *now + Duration::from_millis(ms);
        device.timeout(*now);
        std::iter::from_fn(|| device.poll()).flat_map(|emission| emission.bytes).collect()
    }

    fn sensor(model: RplidarModel) -> (VirtualRplidar, Instant) {
        let scene = Box::new(Scenario::load("room").unwrap().scene());
        (VirtualRplidar::new(model, scene, 1), Instant::from_micros(1_000_000))
    }

    #[test]
    fn requests_are_answered_with_their_descriptors() {
        let (mut device, mut now) = sensor(RplidarModel::a2());
        let info = ask(&mut device, &mut now, Request::GetInfo, 10);
        assert_eq!((&info[..7], info.len()), (&[0xA5, 0x5A, 0x14, 0, 0, 0, 0x04][..], 27));
        assert_eq!(ask(&mut device, &mut now, Request::GetHealth, 10)[7..], [0, 0, 0]);
        assert!(ask(&mut device, &mut now, Request::Stop, 10).is_empty());
    }

    #[test]
    fn packets_come_once_the_motor_turns() {
        for (model, packets) in [(RplidarModel::a2(), 125), (RplidarModel::c1(), 125)] {
            let (mut device, mut now) = sensor(model);
            assert!(ask(&mut device, &mut now, Request::MotorPower(660), 10).is_empty());
            let bytes = ask(&mut device, &mut now, Request::ExpressScan, 1000);
            let count = (bytes.len() - 7) / 84;
            assert!((packets - 2..=packets).contains(&count), "{count}");
            let dense = bytes[6] == 0x85;
            assert!(bytes[7..].chunks(84).all(|packet| Capsule::parse(packet.try_into().unwrap(), dense).is_some()));
            assert!(ask(&mut device, &mut now, Request::Stop, 1000).is_empty());
        }
        let (mut device, mut now) = sensor(RplidarModel::a2());
        assert_eq!(ask(&mut device, &mut now, Request::ExpressScan, 1000).len(), 7, "the motor is off");
    }

    #[test]
    fn old_firmware_has_only_the_old_mode() {
        let (mut device, mut now) = sensor(RplidarModel::a1_old());
        assert!(ask(&mut device, &mut now, Request::ExpressScan, 1000).is_empty());
        let bytes = ask(&mut device, &mut now, Request::Scan, 1000);
        let starts = bytes[7..].chunks(5).filter(|sample| sample[0] & 1 == 1).count();
        assert_eq!(starts, 6, "5.5 turns a second, and the first sample");
    }
}
