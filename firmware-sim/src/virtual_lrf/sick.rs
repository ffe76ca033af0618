//! SICK LMS200 and LMS291.
//!
//! Source: manual, drivers, as cited in `lrfslam_lrf::sick_lms`. Chosen where nothing is settled: half a telegram is dropped after
//! 150 ms of silence; requests that are not allowed now are answered with 92; no telegram index follows the values; a line too
//! slow for every mirror turn gets them in the order of their parts; modes that watch segments and fields are taken, and say nothing.

mod requests;
mod scan;
mod status;

use lrfslam_core::scan::Beam;
use lrfslam_core::time::{Duration, Instant};
use lrfslam_lrf::driver::NEVER;
use lrfslam_lrf::sick_lms::telegram::{self, ACK, Direction, Head, NAK};
use lrfslam_lrf::sick_lms::{ConfigBlock, OperatingMode, Request, Unit, Variant};

use super::recording::{RecordedScan, Sight, are_on_grid};
use super::{Emission, Line, VirtualLrf};
use crate::lrf_model::{LrfErrors, LrfModel, RangeMeter};
use crate::scene::Scene;

/// After this silence half a telegram is forgotten.
const ABORT: Duration = Duration::from_millis(150);
/// From the end of a request to its ACK.
const ACK_DELAY: Duration = Duration::from_millis(2);

/// Logs in millimetres call this, 13 bits full, nothing; farther than that only centimetres reach, m.
const LONGEST_IN_MM_M: f32 = 8.192;

/// What tells the models apart.
#[derive(Debug, Clone)]
pub struct SickModel {
    /// 21 characters: what 90 and BA say.
    type_text: &'static [u8; 21],
    software: &'static [u8; 7],
    config: ConfigBlock,
    variant: Variant,
    /// From power-on or reset to the power-on telegram: 15 to 35 s.
    boot: Duration,
    errors: LrfErrors,
    /// It can stream ranges with reflectivities (mode 50).
    has_reflectivity_stream: bool,
}

impl SickModel {
    /// LMS200-30106: mm, 8 m, 180° by 0.5°.
    pub fn lms200() -> Self {
        Self {
            type_text: b"LMS200;301063;V02.30 ",
            software: b"V02.30 ",
            config: ConfigBlock::new(34),
            variant: Variant::DEG_180_BY_HALF,
            boot: Duration::from_millis(15_000),
            errors: LrfModel::LMS200.errors,
            has_reflectivity_stream: false,
        }
    }

    /// LMS200-30106 set to 80 m in cm, with its systematic error.
    pub fn lms200_3016() -> Self {
        let mut config = ConfigBlock::new(34);
        config.set_unit(Unit::Centimetre);
        Self { config, errors: LrfModel::LMS200_3016.errors, ..Self::lms200() }
    }

    /// LMS291-S05: cm, 80 m, 180° by 0.5°.
    pub fn lms291() -> Self {
        let mut config = ConfigBlock::new(34);
        config.set_unit(Unit::Centimetre);
        let errors = LrfModel::LMS291.errors;
        let has_reflectivity_stream = true;
        let (type_text, software) = (b"LMS291;S05   ;X01.27 ", b"X01.27 ");
        Self { type_text, software, config, errors, has_reflectivity_stream, ..Self::lms200() }
    }

    /// The same with other errors.
    pub fn with_errors(self, errors: LrfErrors) -> Self {
        Self { errors, ..self }
    }

    /// The same with the configuration block of older firmware, 32 bytes.
    pub fn with_old_firmware(mut self) -> Self {
        let mut block = ConfigBlock::new(32);
        block.set_unit(self.config.unit().unwrap_or(Unit::Millimetre));
        self.config = block;
        self
    }

    /// The one whose directions are all those of `beams` and the fewest others, its unit the finest that reaches `range_max_m`; `None` if
    /// there is none.
    pub fn seeing(beams: &[Beam], range_max_m: f32) -> Option<Self> {
        let model = if range_max_m < LONGEST_IN_MM_M { Self::lms200() } else { Self::lms291() };
        let sees = |variant: &Variant| {
            let (half_deg, step_deg) = (f64::from(variant.angle_deg) / 2.0, f64::from(variant.resolution_cdeg) / 100.0);
            are_on_grid(beams, -half_deg, step_deg, half_deg)
        };
        let variant = [(100, 100), (180, 100), (100, 50), (180, 50), (100, 25)]
            .map(|(angle_deg, resolution_cdeg)| Variant { angle_deg, resolution_cdeg });
        variant.into_iter().find(sees).map(|variant| model.with_variant(variant))
    }

    /// The same with another field of view.
    pub fn with_variant(self, variant: Variant) -> Self {
        Self { variant, ..self }
    }
}

/// A virtual LMS2xx.
pub struct VirtualSick {
    model: SickModel,
    sight: Sight,
    line: Line,

    booting_until: Option<Instant>,
    mode: OperatingMode,
    variant: Variant,
    config: ConfigBlock,
    /// The rate that power-on restores, if one was made permanent.
    permanent_baud: Option<u32>,

    incoming: Vec<u8>,
    last_byte_at: Instant,
    /// Groups of mirror turns that were measured, or let pass.
    next_group: i64,
    /// Which part of a scan comes next where each turn is sent on its own; `None` for any.
    next_part: Option<i64>,
    /// A single scan is wanted (30 01).
    single: bool,
    telegrams: u8,
}

impl VirtualSick {
    /// A sensor that has been on for long; `seed` decides its errors.
    pub fn new(model: SickModel, scene: Box<dyn Scene>, seed: u64) -> Self {
        let meter = RangeMeter::new(model.errors, seed);
        Self::seeing(Sight::World(scene, meter), model)
    }

    /// One that says what a real one has seen, from when it is asked to stream; it streams whole scans only.
    pub fn of_recording(model: SickModel, scans: Vec<RecordedScan>) -> Self {
        Self::seeing(Sight::recorded(scans), model)
    }

    fn seeing(sight: Sight, model: SickModel) -> Self {
        Self {
            sight,
            line: Line::new(Some(9600)),
            booting_until: None,
            mode: OperatingMode::OnRequest,
            variant: model.variant,
            config: model.config.clone(),
            permanent_baud: None,
            incoming: Vec::new(),
            last_byte_at: Instant::default(),
            next_group: 0,
            next_part: None,
            single: false,
            telegrams: 0,
            model,
        }
    }

    /// Sets the rate as another host may have left it.
    pub fn set_baud(&mut self, baud: u32) {
        self.line = Line::new(Some(baud));
    }

    /// Sets the operating mode as another host may have left it.
    pub fn set_mode(&mut self, mode: OperatingMode) {
        self.mode = mode;
    }

    /// Sends a payload with the status byte appended, as a telegram, at `at` or when the line is free.
    fn send(&mut self, at: Instant, payload: &[u8]) {
        let with_status = [payload, &[0x10]].concat();
        let mut out = [0; telegram::MAX_TELEGRAM];
        if let Ok(length) = telegram::emit(Direction::ToHost, &with_status, &mut out) {
            self.line.send(at, out[..length].to_vec());
        }
    }

    /// Takes telegrams out of what came in. One with a wrong sum is answered with NAK.
    fn take_telegrams(&mut self, now: Instant) {
        loop {
            match telegram::check(Direction::ToSensor, &self.incoming) {
                Head::Partial => return,
                Head::Whole(length) => {
                    let whole: Vec<u8> = self.incoming.drain(..length).collect();
                    self.line.send(now + ACK_DELAY, vec![ACK]);
                    self.obey(now, &Request::parse(telegram::payload(&whole)));
                }
                Head::No => {
                    if self.incoming.len() > telegram::OVERHEAD && self.incoming.starts_with(&[0x02, 0x00]) {
                        self.line.send(now + ACK_DELAY, vec![NAK]);
                        self.incoming.clear();
                    }
                    let next = self.incoming.iter().skip(1).position(|byte| *byte == telegram::STX);
                    self.incoming.drain(..next.map_or(self.incoming.len(), |at| at + 1));
                }
            }
            if self.incoming.is_empty() {
                return;
            }
        }
    }

    fn boot(&mut self, now: Instant) {
        self.booting_until = Some(now + self.model.boot);
        self.mode = OperatingMode::OnRequest;
        self.single = false;
        self.incoming.clear();
    }

    fn is_streaming(&self) -> bool {
        use OperatingMode::{Diagnosis, Installation, OnRequest, Watch};
        !matches!(self.mode, OnRequest | Installation(_) | Diagnosis | Watch(_))
    }
}

impl VirtualLrf for VirtualSick {
    fn power_on(&mut self, now: Instant) {
        self.boot(now);
        self.line.reset(now, Some(self.permanent_baud.unwrap_or(9600)));
    }

    fn receive(&mut self, now: Instant, bytes: &[u8]) {
        if self.booting_until.is_some() {
            return;
        }
        if now.since(self.last_byte_at) > ABORT {
            self.incoming.clear();
        }
        self.last_byte_at = now;
        self.incoming.extend(bytes);
        self.take_telegrams(now);
    }

    /// Everything happens when it is due, also if the caller comes late.
    fn timeout(&mut self, now: Instant) {
        if let Some(until) = self.booting_until.filter(|until| *until <= now) {
            self.booting_until = None;
            self.send(until, &[&[0x90][..], self.model.type_text].concat());
            self.skip_to(until);
        }
        while let Some(due) = self.scan_due().filter(|due| *due <= now && self.booting_until.is_none()) {
            self.finish_group(due);
        }
    }

    fn poll(&mut self) -> Option<Emission> {
        self.line.poll()
    }

    fn deadline(&self) -> Instant {
        self.booting_until.or_else(|| self.scan_due()).unwrap_or(NEVER)
    }

    fn baud(&self, now: Instant) -> Option<u32> {
        self.line.baud(now)
    }
}

#[cfg(test)]
mod tests;
