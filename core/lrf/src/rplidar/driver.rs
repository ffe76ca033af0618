//! A session with an RPLIDAR: stop, find the rate, ask what it is and how it is, motor on, express scan.

use super::decoder::{DecoderEvent, RplidarDecoder};
use super::request::Request;
use super::response::{Capsule, Health, ResponseKind};
use crate::beat::{BeatClock, BeatFinder};
use crate::dialogue::{DialogueBase, Pending, State};
use crate::driver::{BaudRates, Cause, Counters, Input, LrfDriver, Output, Step};
use crate::session::{Question, Session};
use crate::turn::TurnAssembler;
use identity::describe;
use lrfslam_scan::Beam;
use lrfslam_scan::time::{Duration, Instant};

mod identity;
mod stream;

/// The beam memory to lend: a turn of the fastest model at its slowest speed.
pub const BEAM_MEMORY: usize = 3300;
/// A1 and most A2; A2M12 and A3; C1; S models (drivers).
const RATES: [u32; 4] = [115_200, 256_000, 460_800, 1_000_000];
/// Motor power of A2 and A3 that makers' drivers use, of 1023.
const MOTOR_POWER: u16 = 660;
/// Nothing farther is believed, m: A1 and A2 reach 12, C1 12, A3 25.
const RANGE_MAX_M: f32 = 25.0;
/// After a stop, what was under way still comes.
const QUIET: Duration = Duration::from_millis(60);
/// To an answer; to the first samples, for which the motor must turn steadily; between packets.
const REPLY: Duration = Duration::from_millis(300);
const SPIN_UP: Duration = Duration::from_millis(4000);
const SILENCE: Duration = Duration::from_millis(1500);
/// Damaged packets in a row after which the session begins anew.
const MAX_BAD: u8 = 30;
/// Corrections move single angles by up to 7.9 degrees; a lost packet leaves 11 at least.
const HOLE_DEG: f32 = 9.0;

/// What to ask of the sensor.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct RplidarConfig {
    /// The sensor's rate, bit/s, if it is known; 0 tries those of all models. It cannot be changed.
    pub baud: u32,
    /// Subtracted from every stamp.
    pub latency: Duration,
}

/// What a reply is awaited to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
enum Ask {
    #[default]
    Info,
    Health,
    Express,
    Scan,
    /// Nothing answers it.
    Stop,
}

impl Question for Ask {
    const STOP: Self = Ask::Stop;

    fn told(self) -> (Step, &'static str) {
        match self {
            Ask::Info => (Step::Find, "request 50 (information)"),
            Ask::Health => (Step::Identify, "request 52 (health)"),
            Ask::Express => (Step::Start, "request 82 (express scan)"),
            Ask::Scan => (Step::Start, "request 20 (scan)"),
            Ask::Stop => (Step::Stream, "request 25 (stop)"),
        }
    }
}

/// Driver for RPLIDAR A1, A2, A3 and C1.
#[derive(Debug)]
pub struct RplidarDriver<'a> {
    decoder: RplidarDecoder,
    dialogue: Dialogue<'a>,
}

#[derive(Debug)]
struct Dialogue<'a> {
    config: RplidarConfig,
    base: DialogueBase<Ask>,
    /// A request was put out: the decoder is to look for its descriptor.
    awaits_descriptor: bool,
    /// The packet before, and when its successor must have begun.
    previous: Option<Capsule>,
    previous_end: Instant,
    /// When it came.
    packet_at: Instant,
    /// From one packet to the next, degrees; 0 if it is not known.
    span_deg: f32,
    /// Packets in a row that did not fit it.
    misfits: u8,
    /// The packets' beat, once it is found.
    beat: Option<BeatClock>,
    finder: BeatFinder,
    /// It scans in the mode without check sums.
    unchecked: bool,
    last_sample_deg: Option<f32>,
    turns: TurnAssembler<'a>,
}

impl<'a> RplidarDriver<'a> {
    /// A driver that waits for [`Input::Connected`]; `beams`: [`BEAM_MEMORY`] of them.
    pub fn new(config: RplidarConfig, beams: &'a mut [Beam]) -> Self {
        let dialogue = Dialogue {
            config,
            base: DialogueBase::default(),
            awaits_descriptor: false,
            previous: None,
            previous_end: Instant::default(),
            packet_at: Instant::default(),
            span_deg: 0.0,
            misfits: 0,
            beat: None,
            finder: BeatFinder::default(),
            unchecked: false,
            last_sample_deg: None,
            turns: TurnAssembler::new(beams, HOLE_DEG),
        };
        Self { decoder: RplidarDecoder::default(), dialogue }
    }

    fn take(&mut self, now: Instant, bytes: &[u8]) -> usize {
        let mut taken = 0;
        while self.dialogue.base.outbox.is_empty() {
            let rest = bytes.get(taken..).unwrap_or(b"");
            let (count, event) = self.decoder.feed(rest);
            taken += count;
            let more = event.is_some();
            match event {
                Some(DecoderEvent::Descriptor(kind)) => self.dialogue.on_descriptor(now, kind),
                Some(DecoderEvent::Response(kind, bytes)) => self.dialogue.on_response(now, kind, bytes),
                Some(DecoderEvent::Capsule(capsule)) => self.dialogue.on_capsule(now, capsule),
                Some(DecoderEvent::Damage) => self.dialogue.on_damage(now),
                None => {}
            }
            self.after_input();
            if !more && taken >= bytes.len() {
                break;
            }
        }
        taken
    }

    /// Takes over what the session wants of the decoder.
    fn after_input(&mut self) {
        if core::mem::take(&mut self.dialogue.awaits_descriptor) {
            self.decoder.expect_descriptor();
        }
    }
}

impl Session for Dialogue<'_> {
    type Ask = Ask;

    fn base(&mut self) -> &mut DialogueBase<Ask> {
        &mut self.base
    }

    fn forget(&mut self) -> BaudRates {
        let known = [self.base.last_good_baud, self.config.baud].into_iter();
        let others = RATES.into_iter().filter(|_| self.config.baud == 0);
        BaudRates::new(known.chain(others))
    }

    /// Stops whatever runs at this rate, then listens until it is quiet.
    fn look(&mut self, now: Instant) {
        self.base.set_rate();
        self.turns.forget();
        (self.previous, self.unchecked) = (None, false);
        self.base.outbox.transmit(&Request::Stop.emit());
        self.base.state = State::Pausing(Ask::Info);
        self.base.wait(now, QUIET);
        self.awaits_descriptor = true;
    }

    /// Express scans have a sum, so they are asked for most often.
    fn attempts(&self, ask: Ask) -> u8 {
        match ask {
            Ask::Stop => 0,
            Ask::Express => 3,
            Ask::Info | Ask::Health | Ask::Scan => 1,
        }
    }

    fn send(&mut self, now: Instant, ask: Ask) {
        let request = match ask {
            Ask::Info => Request::GetInfo,
            Ask::Health => Request::GetHealth,
            Ask::Express => Request::ExpressScan,
            Ask::Scan => Request::Scan,
            Ask::Stop => return self.send_stop(now),
        };
        self.base.outbox.transmit(&request.emit());
        self.awaits_descriptor = true;
        self.base.wait(now, REPLY);
    }

    fn on_no_reply(&mut self, now: Instant, ask: Ask) {
        match ask {
            Ask::Info => self.try_next_rate(now),
            // Old firmware has no express mode.
            Ask::Express => self.scan_unchecked(now),
            Ask::Stop => self.base.stopped(true),
            Ask::Health | Ask::Scan => self.fail(now, ask, Cause::NoReply),
        }
    }
}

impl Dialogue<'_> {
    /// Neither is answered; the stop is said twice, for it may be damaged on its way.
    fn send_stop(&mut self, now: Instant) {
        self.base.outbox.transmit(&Request::Stop.emit());
        self.base.outbox.transmit(&Request::MotorPower(0).emit());
        self.base.outbox.transmit(&Request::Stop.emit());
        self.base.wait(now, QUIET);
    }

    fn on_descriptor(&mut self, now: Instant, kind: ResponseKind) {
        match (self.base.state, kind) {
            (State::Asking(Ask::Express), ResponseKind::Capsule | ResponseKind::DenseCapsule)
            | (State::Asking(Ask::Express | Ask::Scan), ResponseKind::Sample) => {
                self.begin_streaming(now, SPIN_UP);
            }
            _ => {}
        }
    }

    fn on_response(&mut self, now: Instant, kind: ResponseKind, bytes: &[u8]) {
        match (self.base.state, kind) {
            (State::Asking(Ask::Info), ResponseKind::Info) => {
                self.base.found();
                self.base.identity = describe(bytes);
                self.ask(now, Ask::Health);
            }
            (State::Asking(Ask::Health), ResponseKind::Health) => self.on_health(now, bytes),
            (State::Streaming, ResponseKind::Sample) => self.on_sample(now, bytes),
            _ => {}
        }
    }

    fn on_health(&mut self, now: Instant, bytes: &[u8]) {
        let health = Health::parse(bytes).unwrap_or(Health { status: 2, code: 0 });
        if health.status >= 2 {
            // Only a reset leaves this state.
            self.base.outbox.transmit(&Request::Reset.emit());
            return self.fail(now, Ask::Health, Cause::FaultCode(health.code));
        }
        let state = if health.status == 0 { "well" } else { "warning" };
        self.base.identity.state = heapless::String::try_from(state).unwrap_or_default();
        self.base.outbox.push(Pending::Identified);
        self.base.outbox.transmit(&Request::MotorPower(MOTOR_POWER).emit());
        self.ask(now, Ask::Express);
    }
}

impl LrfDriver for RplidarDriver<'_> {
    fn handle_input(&mut self, now: Instant, input: Input<'_>) -> usize {
        if let Input::Bytes(bytes) = input {
            return self.take(now, bytes);
        }
        self.dialogue.on_input(now, input);
        self.after_input();
        0
    }

    fn poll_output(&mut self) -> Output<'_> {
        let latency = self.dialogue.config.latency;
        self.dialogue.base.poll_output(|| self.dialogue.turns.scan(latency, RANGE_MAX_M))
    }

    fn counters(&self) -> Counters {
        self.dialogue.base.counters(self.decoder.damaged(), self.dialogue.turns.incomplete())
    }
}

#[cfg(test)]
mod tests;
