//! A session with an LMS2xx, from whatever state it is in to verified scans: see the [contract](crate::driver).
//!
//! Find its rate (`20 25`, which also stops a stream and leaves the installation mode), read type, status and
//! configuration, raise the rate, set angle, resolution and unit as asked, stream. Below 1° each mirror turn is asked for on
//! its own (mode 2A), so that a moving robot gets no comb; a sensor that refuses it streams whole scans, whose beams
//! carry the times of their turns. Damaged scans in a row, silence or a power-on telegram begin the session anew.

mod connect;
mod setup;
mod stream;

pub use self::connect::RATES;
use super::config_block::{ConfigBlock, Unit};
use super::decoder::{DecoderEvent, TelegramDecoder};
use super::measurement::ValueFormat;
use super::reply::Reply;
use super::request::{OperatingMode, PASSWORD, Request, Variant};
use super::scan::ScanLayout;
use super::telegram::Direction;
use crate::dialogue::{DialogueBase, Patience};
use crate::driver::{BaudPolicy, Cause, Counters, Input, LrfDriver, Output, Step};
use lrfslam_scan::time::{Duration, Instant};
use lrfslam_scan::{Beam, RangeScan};

/// The memory to lend for one telegram.
pub const TELEGRAM_MEMORY: usize = super::telegram::MAX_TELEGRAM;
/// Beams of the finest scan, 100° by 0.25°: the beam memory to lend.
pub const BEAM_MEMORY: usize = 401;

/// What to ask of the sensor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SickConfig {
    /// The line's rate; 500000 needs RS-422.
    pub baud: BaudPolicy,
    /// Field of view and resolution; `None` leaves them as they are.
    pub variant: Option<Variant>,
    /// Unit of ranges: mm reach 8 m at most in the usual measuring mode, cm 80 m. `None` leaves it. A change is written to the
    /// sensor's flash, once.
    pub unit: Option<Unit>,
    /// Below 1°: each mirror turn as its own scan, if the sensor can; else interlaced scans with a time per beam.
    pub each_turn: bool,
    /// Subtracted from every stamp: for an adapter known to be late.
    pub latency: Duration,
    /// The installation mode's password, if it was changed.
    pub password: [u8; 8],
}

impl Default for SickConfig {
    /// Everything as the sensor has it; each mirror turn a scan.
    fn default() -> Self {
        Self {
            baud: BaudPolicy::Keep,
            variant: None,
            unit: None,
            each_turn: true,
            latency: Duration::ZERO,
            password: PASSWORD,
        }
    }
}

/// What a reply is awaited to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Ask {
    Quiet,
    Type,
    Status,
    Config,
    Rate,
    VerifyRate,
    Variant,
    Install,
    SetConfig,
    LeaveInstall,
    StreamTurns,
    StreamAll,
    Stop,
}

impl Ask {
    fn step(self) -> Step {
        match self {
            Ask::Quiet => Step::Find,
            Ask::Type | Ask::Status | Ask::Config => Step::Identify,
            Ask::Rate | Ask::VerifyRate => Step::RaiseBaud,
            Ask::Variant | Ask::Install | Ask::SetConfig | Ask::LeaveInstall => Step::Configure,
            Ask::StreamTurns | Ask::StreamAll => Step::Start,
            Ask::Stop => Step::Stream,
        }
    }

    fn text(self) -> &'static str {
        match self {
            Ask::Quiet | Ask::LeaveInstall | Ask::Stop => "telegram 20 25 (scans on request)",
            Ask::Type => "telegram 3A (type)",
            Ask::Status | Ask::VerifyRate => "telegram 31 (status)",
            Ask::Config => "telegram 74 (configuration)",
            Ask::Rate => "telegram 20 4x (baud rate)",
            Ask::Variant => "telegram 3B (angle and resolution)",
            Ask::Install => "telegram 20 00 (installation mode)",
            Ask::SetConfig => "telegram 77 (new configuration)",
            Ask::StreamTurns => "telegram 20 2A (stream mirror turns)",
            Ask::StreamAll => "telegram 20 24 (stream scans)",
        }
    }

    /// How long to wait if nothing comes, and at most.
    ///
    /// Source: drivers: 60 ms to the ACK, up to 3 s for a mode, up to 15 s while flash is written.
    fn waits(self) -> (Duration, Duration) {
        let (first, most) = match self {
            Ask::SetConfig => (15_000, 20_000),
            Ask::Install | Ask::LeaveInstall | Ask::Variant => (3000, 5000),
            _ => (400, 5000),
        };
        (Duration::from_millis(first), Duration::from_millis(most))
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    /// No port, or stopped.
    Idle,
    /// Waiting before the next look for the sensor.
    BackOff,
    /// A request was sent.
    Asking(Ask),
    /// The rate was changed: both sides settle.
    Settle,
    Streaming,
}

/// Driver for LMS2xx over any byte link.
#[derive(Debug)]
pub struct SickDriver<'a> {
    decoder: TelegramDecoder<'a>,
    dialogue: Dialogue<'a>,
}

/// Everything but the bytes: lives beside the decoder, so that a telegram can be read in place.
#[derive(Debug)]
struct Dialogue<'a> {
    config: SickConfig,
    base: DialogueBase,
    state: State,
    attempts_left: u8,
    telegram_began: Instant,
    /// Bytes since the last request.
    noise: u32,
    /// A scan came since the last request.
    heard_scan: bool,
    damaged_before: u32,
    bad_in_a_row: u8,

    raise_failures: u8,

    variant: Variant,
    /// The sensor said its variant; else scans show it.
    variant_known: bool,
    measuring_mode: u8,
    block: Option<ConfigBlock>,
    turns_refused: bool,
    setup_refused: bool,
    fault_reported: bool,

    beams: &'a mut [Beam],
    scan_len: usize,
    scan_stamp: Instant,
    range_max_m: f32,
}

impl<'a> SickDriver<'a> {
    /// A driver that waits for [`Input::Connected`].
    ///
    /// * `telegram` — [`TELEGRAM_MEMORY`] bytes
    /// * `beams` — [`BEAM_MEMORY`] beams; 181 are enough for mirror turns
    pub fn new(config: SickConfig, telegram: &'a mut [u8], beams: &'a mut [Beam]) -> Self {
        let dialogue = Dialogue {
            config,
            base: DialogueBase::default(),
            state: State::Idle,
            attempts_left: 0,
            telegram_began: Instant::default(),
            noise: 0,
            heard_scan: false,
            damaged_before: 0,
            bad_in_a_row: 0,
            raise_failures: 0,
            variant: Variant::DEG_180_BY_1,
            variant_known: false,
            measuring_mode: 0,
            block: None,
            turns_refused: false,
            setup_refused: false,
            fault_reported: false,
            beams,
            scan_len: 0,
            scan_stamp: Instant::default(),
            range_max_m: 0.0,
        };
        Self { decoder: TelegramDecoder::new(Direction::ToHost, telegram), dialogue }
    }
}

impl LrfDriver for SickDriver<'_> {
    fn handle_input(&mut self, now: Instant, input: Input<'_>) -> usize {
        match input {
            Input::Bytes(bytes) => return self.take(now, bytes),
            Input::Timeout if self.dialogue.base.patience.is_over(now) => self.on_timeout(now),
            Input::Timeout => {}
            Input::Connected => {
                self.decoder.forget();
                self.dialogue.on_connected(now);
            }
            Input::Disconnected => {
                self.decoder.forget();
                self.dialogue.on_disconnected();
            }
            Input::Stop => self.dialogue.on_stop(now),
        }
        0
    }

    fn poll_output(&mut self) -> Output<'_> {
        let dialogue = &mut self.dialogue;
        dialogue.base.poll_output(|| RangeScan {
            stamp: dialogue.scan_stamp,
            range_max_m: dialogue.range_max_m,
            beams: dialogue.beams.get(..dialogue.scan_len).unwrap_or(&[]),
        })
    }

    fn counters(&self) -> Counters {
        self.dialogue.base.counters(self.decoder.damaged())
    }
}

impl SickDriver<'_> {
    /// Takes bytes up to the first telegram that leads to an output; none while outputs wait.
    fn take(&mut self, now: Instant, bytes: &[u8]) -> usize {
        let mut taken = 0;
        while self.dialogue.base.outbox.is_empty() {
            let rest = bytes.get(taken..).unwrap_or(b"");
            if !self.decoder.is_inside_telegram() {
                self.dialogue.telegram_began = now;
            }
            let (count, event) = self.decoder.feed(rest);
            taken += count;
            if count > 0 {
                self.dialogue.on_bytes(now, count);
            }
            match event {
                Some(DecoderEvent::Telegram(payload)) => self.dialogue.on_payload(now, payload),
                Some(DecoderEvent::Ack) => self.dialogue.on_ack(now),
                Some(DecoderEvent::Nak) => self.dialogue.on_nak(now),
                None if taken >= bytes.len() => break,
                None => {}
            }
        }
        self.dialogue.count_damaged(now, self.decoder.damaged());
        taken
    }

    fn on_timeout(&mut self, now: Instant) {
        // A damaged length may have swallowed the answer: look inside before asking again.
        if self.decoder.is_inside_telegram() {
            self.decoder.abandon();
            let _ = self.take(now, b"");
            if !self.dialogue.base.patience.is_over(now) {
                return;
            }
        }
        self.dialogue.on_timeout(now);
    }
}

impl Dialogue<'_> {
    fn on_payload(&mut self, now: Instant, payload: &[u8]) {
        let Some(reply) = Reply::parse(payload) else {
            return self.refuse(now);
        };
        match self.state {
            State::Asking(ask) => self.on_reply(now, ask, &reply, payload.len()),
            State::Streaming => self.on_stream(now, &reply, payload.len()),
            State::Idle | State::BackOff | State::Settle => {}
        }
    }

    fn on_timeout(&mut self, now: Instant) {
        match self.state {
            State::Idle => self.base.patience = Patience::FOREVER,
            State::BackOff => self.find(now),
            State::Settle => self.ask(now, Ask::VerifyRate),
            // A wrong rate makes much noise and no telegram: not worth a second attempt.
            State::Asking(Ask::Quiet) if self.noise > 60 && !self.heard_scan => self.on_no_reply(now, Ask::Quiet),
            State::Asking(ask) if self.attempts_left > 0 => {
                self.attempts_left -= 1;
                self.send(now, ask);
            }
            State::Asking(ask) => self.on_no_reply(now, ask),
            State::Streaming => self.restart(now, Step::Stream, Cause::Silent, ""),
        }
    }

    /// Sends the request of `ask`, and awaits its reply.
    fn ask(&mut self, now: Instant, ask: Ask) {
        self.attempts_left = match ask {
            // The first may complete half a telegram in the sensor's buffer and be lost with it.
            Ask::Quiet | Ask::SetConfig => 1,
            _ => 2,
        };
        self.state = State::Asking(ask);
        self.send(now, ask);
    }

    fn send(&mut self, now: Instant, ask: Ask) {
        let telegram = self.request(ask).emit();
        self.base.outbox.transmit(&telegram);
        (self.noise, self.heard_scan) = (0, false);
        let (wait, at_most) = ask.waits();
        let at_most = match ask {
            Ask::Quiet => Duration::from_micros(wait.micros + 2 * self.longest_telegram().micros),
            _ => at_most,
        };
        self.base.patience = Patience::new(now, wait, at_most);
    }

    fn request(&self, ask: Ask) -> Request {
        match ask {
            Ask::Quiet | Ask::LeaveInstall | Ask::Stop => Request::Mode(OperatingMode::OnRequest),
            Ask::Type => Request::Type,
            Ask::Status | Ask::VerifyRate => Request::Status,
            Ask::Config => Request::GetConfig,
            Ask::Rate => Request::Mode(OperatingMode::Baud(self.config.baud.wanted())),
            Ask::Variant => Request::Variant(self.config.variant.unwrap_or(self.variant)),
            Ask::Install => Request::Mode(OperatingMode::Installation(self.config.password)),
            Ask::SetConfig => self.wanted_block().map_or(Request::GetConfig, Request::SetConfig),
            Ask::StreamTurns => Request::Mode(OperatingMode::StreamPartial),
            Ask::StreamAll => Request::Mode(OperatingMode::StreamAll),
        }
    }

    /// How to read scans, if the measuring mode gives ranges.
    fn layout(&self) -> Option<ScanLayout> {
        ValueFormat::of_mode(self.measuring_mode).map(|format| ScanLayout { variant: self.variant, format })
    }

    /// Reports trouble and begins anew after a while.
    fn restart(&mut self, now: Instant, step: Step, cause: Cause, sent: &'static str) {
        self.base.begin_anew(now, step, cause, sent);
        self.state = State::BackOff;
    }
}

#[cfg(test)]
mod tests;
