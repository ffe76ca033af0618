//! A session with an LMS2xx, from whatever state it is in to verified scans: see the [contract](crate::driver).
//!
//! Find its rate (`20 25`, which also stops a stream and leaves the installation mode), read type, status and
//! configuration, raise the rate, set angle, resolution and unit as asked, stream. Below 1° each mirror turn is asked for on
//! its own (mode 2A), so that a moving robot gets no comb. A sensor that refuses it streams whole scans, whose beams
//! carry the times of their turns. So does one on a line too slow for every turn: which of them it would then send, and whether each beam
//! ever came, is not documented. Damaged scans in a row, silence or a power-on telegram begin the session anew.

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
use crate::dialogue::{DialogueBase, ScanMemory, State};
use crate::driver::{BaudPolicy, Counters, Event, Input, LrfDriver, Output, Step};
use crate::pace::PaceClock;
use crate::session::{Question, Session};
use lrfslam_scan::Beam;
use lrfslam_scan::time::{Duration, Instant};

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
    /// The measuring mode that tells how bright echoes are ([`Event::Brightness`](crate::driver::Event)), if the sensor has another. A change is
    /// written to its flash, once.
    pub brightness: bool,
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
            brightness: false,
            each_turn: true,
            latency: Duration::ZERO,
            password: PASSWORD,
        }
    }
}

/// What a reply is awaited to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
enum Ask {
    #[default]
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

impl Question for Ask {
    const STOP: Self = Ask::Stop;

    fn told(self) -> (Step, &'static str) {
        match self {
            Ask::Quiet => (Step::Find, "telegram 20 25 (scans on request)"),
            Ask::Type => (Step::Identify, "telegram 3A (type)"),
            Ask::Status => (Step::Identify, "telegram 31 (status)"),
            Ask::Config => (Step::Identify, "telegram 74 (configuration)"),
            Ask::Rate => (Step::RaiseBaud, "telegram 20 4x (baud rate)"),
            Ask::VerifyRate => (Step::RaiseBaud, "telegram 31 (status)"),
            Ask::Variant => (Step::Configure, "telegram 3B (angle and resolution)"),
            Ask::Install => (Step::Configure, "telegram 20 00 (installation mode)"),
            Ask::SetConfig => (Step::Configure, "telegram 77 (new configuration)"),
            Ask::LeaveInstall => (Step::Configure, "telegram 20 25 (scans on request)"),
            Ask::StreamTurns => (Step::Start, "telegram 20 2A (stream mirror turns)"),
            Ask::StreamAll => (Step::Start, "telegram 20 24 (stream scans)"),
            Ask::Stop => (Step::Stream, "telegram 20 25 (scans on request)"),
        }
    }
}

impl Ask {
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
    base: DialogueBase<Ask>,
    telegram_began: Instant,
    /// Bytes wait behind the telegram: it was read late.
    is_late: bool,
    /// What is whole before then was under way when a telegram was read late.
    late_until: Instant,
    /// The sensor has no clock to read.
    pace: PaceClock,
    /// Bytes since the last request.
    noise: u32,
    /// A scan came since the last request.
    heard_scan: bool,

    variant: Variant,
    /// The sensor said its variant; else scans show it.
    variant_known: bool,
    measuring_mode: u8,
    block: Option<ConfigBlock>,
    turns_refused: bool,
    setup_refused: bool,
    fault_reported: bool,

    memory: ScanMemory<'a>,
    /// Brightness of the last scan's echoes, and how many of them are to be told.
    brightness: &'a mut [u8],
    brightness_untold: usize,
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
            telegram_began: Instant::default(),
            is_late: false,
            late_until: Instant::default(),
            pace: PaceClock::default(),
            noise: 0,
            heard_scan: false,
            variant: Variant::DEG_180_BY_1,
            variant_known: false,
            measuring_mode: 0,
            block: None,
            turns_refused: false,
            setup_refused: false,
            fault_reported: false,
            memory: ScanMemory::new(beams),
            brightness: &mut [],
            brightness_untold: 0,
        };
        Self { decoder: TelegramDecoder::new(Direction::ToHost, telegram), dialogue }
    }

    /// The same, with memory for how bright echoes are: as many bytes as beams.
    pub fn with_brightness(mut self, memory: &'a mut [u8]) -> Self {
        self.dialogue.brightness = memory;
        self
    }
}

impl LrfDriver for SickDriver<'_> {
    fn handle_input(&mut self, now: Instant, input: Input<'_>) -> usize {
        match input {
            Input::Bytes(bytes) => return self.take(now, bytes),
            Input::Timeout => self.look_inside(now),
            Input::Connected => {
                self.decoder.forget();
                self.dialogue.setup_refused = false;
            }
            Input::Disconnected => self.decoder.forget(),
            Input::Stop => {}
        }
        self.dialogue.on_input(now, input);
        0
    }

    fn poll_output(&mut self) -> Output<'_> {
        let untold = core::mem::take(&mut self.dialogue.brightness_untold);
        if let Some(told) = self.dialogue.brightness.get(..untold).filter(|told| !told.is_empty()) {
            return Output::Event(Event::Brightness(told));
        }
        self.dialogue.base.poll_output(|| self.dialogue.memory.scan())
    }

    fn counters(&self) -> Counters {
        self.dialogue.base.counters(self.decoder.damaged(), 0)
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
            self.dialogue.is_late = taken < bytes.len();
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

    /// A damaged length may have swallowed an answer that is due: looks inside before anything is asked again.
    fn look_inside(&mut self, now: Instant) {
        if self.dialogue.base.patience.is_over(now) && self.decoder.is_inside_telegram() {
            self.decoder.abandon();
            let _ = self.take(now, b"");
        }
    }
}

impl Dialogue<'_> {
    fn on_payload(&mut self, now: Instant, payload: &[u8]) {
        let Some(reply) = Reply::parse(payload) else { return self.refuse(now) };
        match self.base.state {
            State::Asking(ask) => self.on_reply(now, ask, &reply, payload.len()),
            State::Streaming => self.on_stream(now, &reply, payload.len()),
            State::Idle | State::BackOff | State::Pausing(_) => {}
        }
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
}

#[cfg(test)]
mod tests;
