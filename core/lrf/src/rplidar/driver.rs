//! A session with an RPLIDAR: stop, find the rate, ask what it is and how it is, motor on, express scan.

use super::decoder::{DecoderEvent, RplidarDecoder};
use super::request::Request;
use super::response::{Capsule, Health, Measured, ResponseKind, parse_sample};
use crate::dialogue::{DialogueBase, Pending, State};
use crate::driver::{BaudRates, Cause, Counters, Input, LrfDriver, Output, Step};
use crate::session::{Question, Session};
use crate::turn::{Sample, TurnAssembler, sample_time};
use identity::describe;
use lrfslam_scan::time::{Duration, Instant};
use lrfslam_scan::{Beam, Echo};

mod identity;

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

    fn step(self) -> Step {
        match self {
            Ask::Info => Step::Find,
            Ask::Health => Step::Identify,
            Ask::Express | Ask::Scan => Step::Start,
            Ask::Stop => Step::Stream,
        }
    }

    fn text(self) -> &'static str {
        match self {
            Ask::Info => "request 50 (information)",
            Ask::Health => "request 52 (health)",
            Ask::Express => "request 82 (express scan)",
            Ask::Scan => "request 20 (scan)",
            Ask::Stop => "request 25 (stop)",
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
            turns: TurnAssembler::new(beams),
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
                None => {}
            }
            self.after_input(now);
            if !more && taken >= bytes.len() {
                break;
            }
        }
        taken
    }

    /// Takes over what the session wants of the decoder, and what the decoder found wrong.
    fn after_input(&mut self, now: Instant) {
        self.dialogue.count_damaged(now, self.decoder.damaged());
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
        self.previous = None;
        self.base.outbox.transmit(&Request::Stop.emit());
        self.base.state = State::Pausing(Ask::Info);
        self.base.wait(now, QUIET);
        self.awaits_descriptor = true;
    }

    fn attempts(&self, ask: Ask) -> u8 {
        u8::from(ask != Ask::Stop)
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
            Ask::Express => self.ask(now, Ask::Scan),
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
                self.base.begin_streaming(now, self.base.baud, self.base.identity.turn, SPIN_UP);
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
            (State::Streaming, ResponseKind::Sample) => {
                if let Some((measured, _)) = parse_sample(bytes) {
                    self.base.wait(now, SILENCE);
                    self.publish(core::iter::once(sample(measured, now)));
                }
            }
            _ => {}
        }
    }

    fn on_health(&mut self, now: Instant, bytes: &[u8]) {
        let health = Health::parse(bytes).unwrap_or(Health { status: 2, code: 0 });
        if health.status >= 2 {
            // Only a reset leaves this state.
            self.base.outbox.transmit(&Request::Reset.emit());
            let [code, _] = health.code.to_le_bytes();
            return self.fail(now, Ask::Health, Cause::HardwareFault([code.max(1), 0]));
        }
        let state = if health.status == 0 { "well" } else { "warning" };
        self.base.identity.state = heapless::String::try_from(state).unwrap_or_default();
        self.base.outbox.push(Pending::Identified);
        self.base.outbox.transmit(&Request::MotorPower(MOTOR_POWER).emit());
        self.ask(now, Ask::Express);
    }

    /// The samples of a packet lie between its start and that of the next.
    fn on_capsule(&mut self, now: Instant, capsule: Capsule) {
        if self.base.state != State::Streaming {
            return;
        }
        self.base.bad_in_a_row = 0;
        self.base.wait(now, SILENCE);
        if capsule.starts() {
            self.turns.forget();
            self.previous = None;
        }
        if let Some(previous) = self.previous.replace(capsule.clone()) {
            let measured = previous.samples(&capsule);
            let count = measured.len();
            let taken = now.since(self.previous_end).micros.clamp(0, 100_000);
            let each = Duration::from_micros(taken / count.max(1) as i64);
            // When a packet arrives, its last sample is as old as it; the samples read now are those of the one before.
            let end = self.previous_end;
            let samples = measured.into_iter().enumerate();
            self.publish(samples.map(|(index, measured)| sample(measured, sample_time(end, index, count, each))));
        }
        self.previous_end = now;
    }

    fn publish(&mut self, samples: impl Iterator<Item = Sample>) {
        if self.turns.add(samples) {
            self.base.announce_scan();
        }
    }

    fn count_damaged(&mut self, now: Instant, damaged: u32) {
        if self.base.is_damage_new(damaged) && self.base.state == State::Streaming {
            self.turns.spoil();
            self.previous = None;
            self.base.bad_scan(now, MAX_BAD);
        }
    }
}

fn sample(measured: Measured, at: Instant) -> Sample {
    let range_m = measured.distance_mm / 1000.0;
    // 0 is no measurement: it frees nothing.
    Sample { clockwise_deg: measured.clockwise_deg, at, echo: Echo::from_range(range_m, RANGE_MAX_M) }
}

impl LrfDriver for RplidarDriver<'_> {
    fn handle_input(&mut self, now: Instant, input: Input<'_>) -> usize {
        if let Input::Bytes(bytes) = input {
            return self.take(now, bytes);
        }
        self.dialogue.on_input(now, input);
        self.after_input(now);
        0
    }

    fn poll_output(&mut self) -> Output<'_> {
        let latency = self.dialogue.config.latency;
        self.dialogue.base.poll_output(|| self.dialogue.turns.scan(latency, RANGE_MAX_M))
    }

    fn counters(&self) -> Counters {
        self.dialogue.base.counters(self.decoder.damaged())
    }
}

#[cfg(test)]
mod tests;
