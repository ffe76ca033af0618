//! A session with an RPLIDAR: stop, find the rate, ask what it is and how it is, motor on, express scan.

use super::decoder::{DecoderEvent, RplidarDecoder};
use super::request::Request;
use super::response::{Capsule, Health, Measured, ResponseKind, parse_sample};
use crate::lrf::driver::{
    BackOff, BaudRates, Cause, Counters, Event, Identity, Input, LrfDriver, Outbox, Output, Patience, Pending, Step,
    Trouble,
};
use crate::lrf::turn::{Sample, TurnAssembler, sample_time};
use crate::scan::{Beam, Echo, RangeScan};
use crate::time::{Duration, Instant};
use identity::describe;

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

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    /// No port, or stopped.
    Idle,
    /// Waiting before the next look for the sensor.
    BackOff,
    /// Stop was sent: what is under way comes to an end.
    Quiet,
    AskInfo,
    AskHealth,
    AskExpress,
    AskScan,
    Streaming,
    /// The last stop was sent.
    Stopping,
}

/// Driver for RPLIDAR A1, A2, A3 and C1.
#[derive(Debug)]
pub struct RplidarDriver<'a> {
    decoder: RplidarDecoder,
    session: Session<'a>,
}

#[derive(Debug)]
struct Session<'a> {
    config: RplidarConfig,
    state: State,
    patience: Patience,
    attempts_left: u8,
    outbox: Outbox,
    back_off: BackOff,
    counters: Counters,
    identity: Identity,
    rates: BaudRates,
    rate_index: usize,
    baud: u32,
    last_good_baud: u32,
    /// A request was put out: the decoder is to look for its descriptor.
    awaits_descriptor: bool,
    bad_in_a_row: u8,
    damaged_before: u32,
    /// The packet before, and when its successor must have begun.
    previous: Option<Capsule>,
    previous_end: Instant,
    turns: TurnAssembler<'a>,
}

impl<'a> RplidarDriver<'a> {
    /// A driver that waits for [`Input::Connected`]; `beams`: [`BEAM_MEMORY`] of them.
    pub fn new(config: RplidarConfig, beams: &'a mut [Beam]) -> Self {
        let session = Session {
            config,
            state: State::Idle,
            patience: Patience::FOREVER,
            attempts_left: 0,
            outbox: Outbox::default(),
            back_off: BackOff::default(),
            counters: Counters::default(),
            identity: Identity::default(),
            rates: BaudRates::default(),
            rate_index: 0,
            baud: 0,
            last_good_baud: 0,
            awaits_descriptor: false,
            bad_in_a_row: 0,
            damaged_before: 0,
            previous: None,
            previous_end: Instant::default(),
            turns: TurnAssembler::new(beams),
        };
        Self { decoder: RplidarDecoder::default(), session }
    }

    fn take(&mut self, now: Instant, bytes: &[u8]) -> usize {
        let mut taken = 0;
        while self.session.outbox.is_empty() {
            let rest = bytes.get(taken..).unwrap_or(b"");
            let (count, event) = self.decoder.feed(rest);
            taken += count;
            let more = event.is_some();
            match event {
                Some(DecoderEvent::Descriptor(kind)) => self.session.on_descriptor(now, kind),
                Some(DecoderEvent::Response(kind, bytes)) => self.session.on_response(now, kind, bytes),
                Some(DecoderEvent::Capsule(capsule)) => self.session.on_capsule(now, capsule),
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
        self.session.count_damaged(now, self.decoder.damaged());
        if core::mem::take(&mut self.session.awaits_descriptor) {
            self.decoder.expect_descriptor();
        }
    }
}

impl Session<'_> {
    fn find(&mut self, now: Instant) {
        let known = [self.last_good_baud, self.config.baud].into_iter();
        let others = RATES.into_iter().filter(|_| self.config.baud == 0);
        self.rates = BaudRates::new(known.chain(others));
        self.rate_index = 0;
        self.look(now);
    }

    /// Stops whatever runs at this rate, then listens until it is quiet.
    fn look(&mut self, now: Instant) {
        if let Some(rate) = self.rates.get(self.rate_index) {
            self.baud = rate;
            self.outbox.push(Pending::SetBaud(rate));
        }
        self.turns.forget();
        self.previous = None;
        self.outbox.transmit(&Request::Stop.emit());
        self.enter(State::Quiet, now, QUIET);
        self.awaits_descriptor = true;
    }

    fn enter(&mut self, state: State, now: Instant, wait: Duration) {
        self.state = state;
        self.patience = Patience::new(now, wait, wait);
    }

    fn ask(&mut self, now: Instant, state: State) {
        self.attempts_left = 1;
        self.state = state;
        self.send(now);
    }

    fn send(&mut self, now: Instant) {
        let request = match self.state {
            State::AskInfo => Request::GetInfo,
            State::AskHealth => Request::GetHealth,
            State::AskExpress => Request::ExpressScan,
            State::AskScan => Request::Scan,
            _ => Request::Stop,
        };
        self.outbox.transmit(&request.emit());
        self.awaits_descriptor = true;
        self.patience = Patience::new(now, REPLY, REPLY);
    }

    fn on_timeout(&mut self, now: Instant) {
        match self.state {
            State::Idle => self.patience = Patience::FOREVER,
            State::BackOff => self.find(now),
            State::Quiet => self.ask(now, State::AskInfo),
            State::Streaming => self.restart(now, Step::Stream, Cause::Silent, ""),
            State::Stopping => self.stopped(true),
            _ if self.attempts_left > 0 => {
                self.attempts_left -= 1;
                self.send(now);
            }
            State::AskInfo => {
                self.rate_index += 1;
                match self.rates.get(self.rate_index) {
                    Some(_) => self.look(now),
                    None => self.restart(now, Step::Find, Cause::NoReply, "request 50 (information)"),
                }
            }
            State::AskHealth => self.restart(now, Step::Identify, Cause::NoReply, "request 52 (health)"),
            // Old firmware has no express mode.
            State::AskExpress => self.ask(now, State::AskScan),
            State::AskScan => self.restart(now, Step::Start, Cause::NoReply, "request 20 (scan)"),
        }
    }

    fn on_descriptor(&mut self, now: Instant, kind: ResponseKind) {
        match (self.state, kind) {
            (State::AskExpress, ResponseKind::Capsule | ResponseKind::DenseCapsule)
            | (State::AskExpress | State::AskScan, ResponseKind::Sample) => {
                self.bad_in_a_row = 0;
                self.enter(State::Streaming, now, SPIN_UP);
                self.outbox.push(Pending::Streaming(self.baud, self.identity.turn));
            }
            _ => {}
        }
    }

    fn on_response(&mut self, now: Instant, kind: ResponseKind, bytes: &[u8]) {
        match (self.state, kind) {
            (State::AskInfo, ResponseKind::Info) => {
                self.last_good_baud = self.baud;
                self.outbox.push(Pending::Found(self.baud));
                self.identity = describe(bytes);
                self.ask(now, State::AskHealth);
            }
            (State::AskHealth, ResponseKind::Health) => self.on_health(now, bytes),
            (State::Streaming, ResponseKind::Sample) => {
                if let Some((measured, _)) = parse_sample(bytes) {
                    self.patience = Patience::new(now, SILENCE, SILENCE);
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
            self.outbox.transmit(&Request::Reset.emit());
            let [code, _] = health.code.to_le_bytes();
            return self.restart(now, Step::Identify, Cause::HardwareFault([code.max(1), 0]), "request 52 (health)");
        }
        let state = if health.status == 0 { "well" } else { "warning" };
        self.identity.state = heapless::String::try_from(state).unwrap_or_default();
        self.outbox.push(Pending::Identified);
        self.outbox.transmit(&Request::MotorPower(MOTOR_POWER).emit());
        self.ask(now, State::AskExpress);
    }

    /// The samples of a packet lie between its start and that of the next.
    fn on_capsule(&mut self, now: Instant, capsule: Capsule) {
        if self.state != State::Streaming {
            return;
        }
        self.bad_in_a_row = 0;
        self.patience = Patience::new(now, SILENCE, SILENCE);
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
            self.outbox.push(Pending::Scan);
            self.counters.scans = self.counters.scans.saturating_add(1);
            self.back_off.reset();
        }
    }

    fn count_damaged(&mut self, now: Instant, damaged: u32) {
        if damaged == self.damaged_before {
            return;
        }
        self.damaged_before = damaged;
        if self.state == State::Streaming {
            self.turns.spoil();
            self.previous = None;
            self.bad_in_a_row += 1;
            if self.bad_in_a_row >= MAX_BAD {
                self.restart(now, Step::Stream, Cause::Damaged, "");
            }
        }
    }

    fn on_stop(&mut self, now: Instant) {
        if self.state == State::Idle {
            return self.stopped(false);
        }
        // Neither is answered; the stop is said twice, for it may be damaged on its way.
        self.outbox.transmit(&Request::Stop.emit());
        self.outbox.transmit(&Request::MotorPower(0).emit());
        self.outbox.transmit(&Request::Stop.emit());
        self.enter(State::Stopping, now, QUIET);
    }

    fn stopped(&mut self, laser_off: bool) {
        self.outbox.push(Pending::Stopped(laser_off));
        self.state = State::Idle;
        self.patience = Patience::FOREVER;
    }

    fn on_disconnected(&mut self) {
        if self.state != State::Idle {
            self.trouble(Step::Port, Cause::Unplugged, "", Duration::ZERO);
            self.state = State::Idle;
            self.patience = Patience::FOREVER;
        }
    }

    fn restart(&mut self, now: Instant, step: Step, cause: Cause, sent: &'static str) {
        let retry_in = self.back_off.advance();
        self.trouble(step, cause, sent, retry_in);
        self.counters.restarts = self.counters.restarts.saturating_add(1);
        self.enter(State::BackOff, now, retry_in);
    }

    fn trouble(&mut self, step: Step, cause: Cause, sent: &'static str, retry_in: Duration) {
        let tried = if step == Step::Find { self.rates } else { BaudRates::default() };
        self.outbox.push(Pending::Trouble(Trouble { step, cause, sent, tried, retry_in }));
    }
}

fn sample(measured: Measured, at: Instant) -> Sample {
    let range_m = measured.distance_mm / 1000.0;
    // 0 is no measurement: it frees nothing.
    Sample { clockwise_deg: measured.clockwise_deg, at, echo: Echo::from_range(range_m, RANGE_MAX_M) }
}

impl LrfDriver for RplidarDriver<'_> {
    fn handle_input(&mut self, now: Instant, input: Input<'_>) -> usize {
        match input {
            Input::Bytes(bytes) => return self.take(now, bytes),
            Input::Timeout if self.session.patience.is_over(now) => self.session.on_timeout(now),
            Input::Timeout => {}
            Input::Connected => {
                self.session.back_off.reset();
                self.session.find(now);
            }
            Input::Disconnected => self.session.on_disconnected(),
            Input::Stop => self.session.on_stop(now),
        }
        self.after_input(now);
        0
    }

    fn poll_output(&mut self) -> Output<'_> {
        let session = &mut self.session;
        let Some(pending) = session.outbox.pop() else {
            return Output::Timeout(session.patience.deadline);
        };
        Output::Event(match pending {
            Pending::Transmit(bytes) => return Output::Transmit(session.outbox.lend(bytes)),
            Pending::SetBaud(rate) => return Output::SetBaud(rate),
            Pending::Found(baud) => Event::Found { baud },
            Pending::Identified => Event::Identified(&session.identity),
            Pending::Streaming(baud, period) => Event::Streaming { baud, period },
            Pending::Trouble(trouble) => Event::Trouble(trouble),
            Pending::Stopped(laser_off) => Event::Stopped { laser_off },
            Pending::Scan => {
                let (began, beams) = session.turns.turn();
                let stamp = Instant::from_micros(began.micros - session.config.latency.micros);
                Event::Scan(RangeScan { stamp, range_max_m: RANGE_MAX_M, beams })
            }
        })
    }

    fn counters(&self) -> Counters {
        Counters { damaged: self.decoder.damaged(), ..self.session.counters }
    }
}

#[cfg(test)]
mod tests;
