//! Hokuyo sensors: URG-04LX (SCIP 1.1 at power-up, RS-232 or USB), URG-04LX-UG01 and UTM-30LX (SCIP 2, USB).
//!
//! Outside time mode commands are answered at the next turn of the mirror, as captured from both models. A scan goes out
//! when its turn has passed the last step asked for, if the line is free; else that turn is skipped.
//!
//! Source: manual C-42-03320B; captures. Chosen where nothing is settled: a short last cluster is dropped; a new streaming
//! command replaces the running one; `SCSP` of a slower motor has words of ours.

mod commands;
mod scan;
mod scip1;

use lrfslam_core::scan::Beam;
use lrfslam_core::time::{Duration, Instant};
use lrfslam_lrf::hokuyo_scip::{Acquire, Command, SensorParameters};

use super::recording::{RecordedScan, Sight, are_on_grid};
use super::{Emission, Line, VirtualLrf};
use crate::lrf_model::{LrfErrors, LrfModel, RangeMeter};
use crate::scene::Scene;

/// Longest command line that is kept; the rest of a longer one is dropped.
const MAX_LINE: usize = 64;
/// Rate of a serial port at power-up, bit/s.
const POWER_UP_BAUD: u32 = 19_200;
/// Most commands awaiting their answers.
const MAX_QUEUE: usize = 16;

/// What tells the models apart.
#[derive(Debug, Clone)]
pub struct HokuyoModel {
    /// Geometry, as in `PP`.
    pub parameters: SensorParameters,
    product: &'static str,
    firmware: &'static str,
    serial: &'static str,
    /// Power-up rate of the line; `None` for USB.
    baud: Option<u32>,
    /// It has a serial port, in use or not: it knows `SS` and `CR`.
    has_serial_port: bool,
    starts_in_scip1: bool,
    has_intensity: bool,
    boot: Duration,
    errors: LrfErrors,
}

impl HokuyoModel {
    /// URG-04LX: 240° of 4 m at 10 Hz, 19200 bit/s.
    pub fn urg_04lx() -> Self {
        Self {
            parameters: parameters("URG-04LX(Hokuyo Automatic Co.,Ltd.)", [20, 5600], [1024, 44, 725, 384, 600]),
            product: "SOKUIKI Sensor URG-04LX",
            firmware: "3.1.04(02/Aug./2007)",
            serial: "H0700001",
            baud: Some(POWER_UP_BAUD),
            has_serial_port: true,
            starts_in_scip1: true,
            has_intensity: false,
            boot: Duration::from_millis(1500),
            errors: LrfModel::URG_04LX.errors,
        }
    }

    /// The same plugged in by its USB port: bytes come as fast as USB is, but it wakes in SCIP 1.1, and says and takes rates.
    ///
    /// Source: capture of one.
    pub fn urg_04lx_usb() -> Self {
        Self { baud: None, ..Self::urg_04lx() }
    }

    /// The URG-04LX-UG01, if its directions are all those of `beams`.
    pub fn seeing(beams: &[Beam]) -> Option<Self> {
        let model = Self::urg_04lx_ug01();
        let bearing_deg = |step: u16| f64::from(model.parameters.bearing_rad(f32::from(step)).to_degrees());
        let (first, last) = (model.parameters.step_min, model.parameters.step_max);
        let step_deg = 360.0 / f64::from(model.parameters.steps_per_turn);
        are_on_grid(beams, bearing_deg(first), step_deg, bearing_deg(last)).then_some(model)
    }

    /// URG-04LX-UG01: the same on USB, SCIP 2, and less exact.
    pub fn urg_04lx_ug01() -> Self {
        Self {
            parameters: parameters("URG-04LX-UG01(Simple-URG)", [20, 5600], [1024, 44, 725, 384, 600]),
            product: "SOKUIKI Sensor URG-04LX-UG01(Simple-URG)",
            firmware: "3.4.03(17/Dec./2012)",
            serial: "H1200001",
            baud: None,
            has_serial_port: false,
            starts_in_scip1: false,
            errors: LrfModel::URG_04LX_UG01.errors,
            ..Self::urg_04lx()
        }
    }

    /// UTM-30LX: 270° of 30 m at 40 Hz, USB.
    pub fn utm_30lx() -> Self {
        Self {
            parameters: parameters("UTM-30LX(Hokuyo Automatic Co.,Ltd.)", [23, 60_000], [1440, 0, 1080, 540, 2400]),
            product: "SOKUIKI Sensor TOP-URG UTM-30LX",
            firmware: "P.1.05(17/Apr./2009)",
            serial: "00900001",
            baud: None,
            has_serial_port: false,
            starts_in_scip1: false,
            has_intensity: true,
            boot: Duration::from_millis(2000),
            errors: LrfModel::UTM_30LX.errors,
        }
    }
}

/// Numbers in the order of the `PP` lines: [DMIN, DMAX], [ARES, AMIN, AMAX, AFRT, SCAN].
fn parameters(model: &str, [distance_min_mm, distance_max_mm]: [u32; 2], steps: [u16; 5]) -> SensorParameters {
    let [steps_per_turn, step_min, step_max, step_front, turns_per_minute] = steps;
    SensorParameters {
        model: model.try_into().unwrap_or_default(),
        distance_min_mm,
        distance_max_mm,
        steps_per_turn,
        step_min,
        step_max,
        step_front,
        turns_per_minute,
    }
}

/// A stream of scans that was asked for.
#[derive(Debug, Clone)]
struct Stream {
    command: Command,
    acquire: Acquire,
    tag: Vec<u8>,
    interval: u8,
    /// Scans left; `None` until stopped.
    remaining: Option<u8>,
    /// Turns to let pass before the next scan.
    skip: u8,
}

/// A virtual Hokuyo.
pub struct VirtualHokuyo {
    model: HokuyoModel,
    sight: Sight,
    line: Line,

    ready_at: Instant,
    /// When the sensor's clock was zero (start of a turn too).
    zero: Instant,
    clock_start_ms: u32,
    scip1: bool,
    laser_on: bool,
    time_mode: bool,
    /// The rate that it believes in; on USB it means nothing, bit/s.
    said_baud: u32,
    /// Steps of 1 % by which the motor is slower.
    motor: u8,
    /// When turn 0 began.
    turns_from: Instant,
    reboot_asked_at: Option<Instant>,

    incoming: Vec<u8>,
    queue: Vec<(Instant, Vec<u8>)>,
    stream: Option<Stream>,
    /// Number of the next turn whose scan may go out.
    next_turn: i64,
}

impl VirtualHokuyo {
    /// A sensor that has been on for long; `seed` decides its errors.
    pub fn new(model: HokuyoModel, scene: Box<dyn Scene>, seed: u64) -> Self {
        let meter = RangeMeter::new(model.errors, seed);
        Self::seeing(Sight::World(scene, meter), model)
    }

    /// One that says what a real one has seen, from when it is asked to stream.
    pub fn of_recording(model: HokuyoModel, scans: Vec<RecordedScan>) -> Self {
        Self::seeing(Sight::recorded(scans), model)
    }

    fn seeing(sight: Sight, model: HokuyoModel) -> Self {
        let line = Line::new(model.baud);
        let mut device = Self {
            sight,
            line,
            ready_at: Instant::default(),
            zero: Instant::default(),
            clock_start_ms: 0,
            scip1: false,
            laser_on: false,
            time_mode: false,
            said_baud: POWER_UP_BAUD,
            motor: 0,
            turns_from: Instant::default(),
            reboot_asked_at: None,
            incoming: Vec::new(),
            queue: Vec::new(),
            stream: None,
            next_turn: 0,
            model,
        };
        device.power_on(Instant::default());
        device.ready_at = Instant::default();
        device
    }

    /// Starts the sensor's clock at this value, ms: to see it wrap.
    pub fn set_clock(&mut self, ms: u32) {
        self.clock_start_ms = ms;
    }

    /// Sets the rate as another host may have left it; nothing on USB.
    pub fn set_baud(&mut self, baud: u32) {
        self.line = Line::new(self.model.baud.map(|_| baud));
        self.said_baud = baud;
    }

    fn clock_ms(&self, now: Instant) -> u32 {
        let ms = now.since(self.zero).micros / 1000 + i64::from(self.clock_start_ms);
        ms as u32 & 0x00FF_FFFF
    }

    fn turn_start(&self, turn: i64) -> Instant {
        self.turns_from + Duration::from_micros(turn * self.turn().micros)
    }

    fn turn_at(&self, now: Instant) -> i64 {
        now.since(self.turns_from).micros.div_euclid(self.turn().micros)
    }

    fn turns_per_minute(&self) -> u32 {
        u32::from(self.model.parameters.turns_per_minute) * (100 - u32::from(self.motor)) / 100
    }

    /// One turn of the mirror at the motor's speed.
    fn turn(&self) -> Duration {
        Duration::from_micros(60_000_000 / i64::from(self.turns_per_minute().max(1)))
    }

    /// Time from step 0 to `step`.
    fn step_time(&self, step: u16) -> Duration {
        let steps = i64::from(self.model.parameters.steps_per_turn.max(1));
        Duration::from_micros(self.turn().micros * i64::from(step) / steps)
    }

    /// When a command that arrives now is answered: at the next turn; at once in time mode.
    fn answer_time(&self, now: Instant) -> Instant {
        if self.time_mode {
            return now + Duration::from_millis(1);
        }
        self.turn_start(self.turn_at(now) + 1)
    }

    fn take_line(&mut self, now: Instant) {
        let line = std::mem::take(&mut self.incoming);
        if !line.is_empty() && now >= self.ready_at && self.queue.len() < MAX_QUEUE {
            let due = self.answer_time(now);
            self.queue.push((due, line));
        }
    }

    /// When the scan of turn `next_turn` is complete, if one is wanted.
    fn scan_due(&self) -> Option<Instant> {
        let stream = self.stream.as_ref()?;
        Some(self.sight.next_at(self.turn_start(self.next_turn))? + self.step_time(stream.acquire.last))
    }
}

impl VirtualLrf for VirtualHokuyo {
    fn power_on(&mut self, now: Instant) {
        self.ready_at = now + self.model.boot;
        (self.zero, self.turns_from, self.said_baud) = (now, now, POWER_UP_BAUD);
        self.scip1 = self.model.starts_in_scip1;
        self.laser_on = self.model.starts_in_scip1;
        (self.time_mode, self.motor) = (false, 0);
        self.incoming.clear();
        self.queue.clear();
        self.stream = None;
        self.line.reset(now, self.model.baud);
    }

    fn receive(&mut self, now: Instant, bytes: &[u8]) {
        for byte in bytes {
            match byte {
                b'\n' | b'\r' => self.take_line(now),
                byte if self.incoming.len() < MAX_LINE => self.incoming.push(*byte),
                _ => {}
            }
        }
    }

    /// Everything happens when it is due, also if the caller comes late.
    fn timeout(&mut self, now: Instant) {
        loop {
            let due = self.deadline();
            if due > now {
                return;
            }
            if self.queue.first().is_none_or(|(at, _)| *at > due) {
                self.finish_turn(due);
                continue;
            }
            let (_, line) = self.queue.remove(0);
            let repeats = self.drop_repetitions(&line);
            self.answer(due, &line);
            (0..repeats).for_each(|_| self.refuse_repetition(due, &line));
        }
    }

    fn poll(&mut self) -> Option<Emission> {
        self.line.poll()
    }

    fn deadline(&self) -> Instant {
        let never = lrfslam_lrf::driver::NEVER;
        let answer = self.queue.first().map_or(never, |(due, _)| *due);
        answer.min(self.scan_due().unwrap_or(never))
    }

    fn baud(&self, now: Instant) -> Option<u32> {
        self.line.baud(now)
    }
}

#[cfg(test)]
mod tests;
