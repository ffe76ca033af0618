//! A session with a Hokuyo sensor, from whatever state it is in to verified scans: see the [contract](crate::driver).
//!
//! Find its rate (line feed, silence, `QT`), lead it out of SCIP 1.1 and of time mode, read `VV`, `PP` and `II`, raise the
//! rate as asked, compare clocks, stream. Eight damaged scans in a row, silence, a reset or a stuck clock begin the session
//! anew, with back-off and all parameters read again, for it may be another sensor.

mod connect;
mod stream;

pub use self::connect::RATES;
use super::command::{Acquire, Command, Encoding, TimeMode};
use super::decoder::ScipDecoder;
use super::parameters::SensorParameters;
use super::reply::Reply;
use crate::clock::{ClockOffset, PERIOD_24_BIT_MS, StampUnwrapper};
use crate::dialogue::{DialogueBase, ScanMemory, State};
use crate::driver::{BaudPolicy, Counters, Input, LrfDriver, Output, Step};
use crate::session::{Question, Session};
use lrfslam_scan::Beam;
use lrfslam_scan::time::{Duration, Instant};

/// Bytes that hold any frame of a UTM-30LX, with intensities: the frame memory to lend.
pub const FRAME_MEMORY: usize = 7168;
/// Beams of the widest scan, a UTM-30LX's: the beam memory to lend.
pub const BEAM_MEMORY: usize = 1081;

/// What to ask of the sensor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct HokuyoConfig {
    /// The line's rate.
    pub baud: BaudPolicy,
    /// How values are written; [`Encoding::Intensity`] only for models known to have it: it can wedge an old URG-04LX.
    pub encoding: Encoding,
    /// First and last step; `None` for the whole field of view.
    pub steps: Option<(u16, u16)>,
    /// Neighbouring steps merged into one beam, 1..=99.
    pub cluster: u8,
    /// Turns dropped after each scan, 0..=9.
    pub interval: u8,
    /// Subtracted from every stamp: for a driver or adapter known to be late.
    pub latency: Duration,
}

impl Default for HokuyoConfig {
    /// Every step of every turn, in millimetres, at the rate found.
    fn default() -> Self {
        Self {
            baud: BaudPolicy::Keep,
            encoding: Encoding::Long,
            steps: None,
            cluster: 1,
            interval: 0,
            latency: Duration::ZERO,
        }
    }
}

/// What a reply is awaited to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
enum Ask {
    #[default]
    Quit,
    SwitchToScip2,
    LeaveTime,
    Version,
    Parameters,
    Information,
    Rate,
    VerifyRate,
    EnterTime,
    ReadTime,
    EndTime,
    LaserOn,
    Stream,
    Stop,
}

impl Question for Ask {
    const STOP: Self = Ask::Stop;

    fn told(self) -> (Step, &'static str) {
        match self {
            Ask::Quit => (Step::Find, "QT"),
            Ask::SwitchToScip2 => (Step::Find, "SCIP2.0"),
            Ask::LeaveTime => (Step::Find, "TM2"),
            Ask::Version => (Step::Identify, "VV"),
            Ask::Parameters => (Step::Identify, "PP"),
            Ask::Information => (Step::Identify, "II"),
            Ask::Rate => (Step::RaiseBaud, "SS"),
            Ask::VerifyRate => (Step::RaiseBaud, "VV"),
            Ask::EnterTime => (Step::Configure, "TM0"),
            Ask::ReadTime => (Step::Configure, "TM1"),
            Ask::EndTime => (Step::Configure, "TM2"),
            Ask::LaserOn => (Step::Start, "BM"),
            Ask::Stream => (Step::Start, "the command for scans"),
            Ask::Stop => (Step::Stream, "QT"),
        }
    }
}

/// Driver for SCIP sensors over any byte link.
#[derive(Debug)]
pub struct HokuyoDriver<'a> {
    decoder: ScipDecoder<'a>,
    dialogue: Dialogue<'a>,
}

/// Everything but the bytes: lives beside the decoder, so that a frame can be read in place.
#[derive(Debug)]
struct Dialogue<'a> {
    config: HokuyoConfig,
    base: DialogueBase<Ask>,
    sent_at: Instant,
    frame_began: Instant,

    /// The sensor is on USB, where the rate means nothing.
    is_usb: bool,
    detours: u8,
    noise: LineNoise,

    parameters: Option<SensorParameters>,
    acquire: Acquire,
    stamps: StampUnwrapper,
    offset: ClockOffset,

    memory: ScanMemory<'a>,
}

/// Tells a wrong rate by what is no text.
#[derive(Debug, Clone, Copy, Default)]
struct LineNoise {
    bytes: u32,
    no_text: u32,
}

impl LineNoise {
    fn add(&mut self, bytes: &[u8]) {
        self.bytes = self.bytes.saturating_add(bytes.len() as u32);
        let odd = bytes.iter().filter(|byte| !matches!(**byte, b'\n' | 0x20..0x7F)).count();
        self.no_text = self.no_text.saturating_add(odd as u32);
    }

    fn is_wrong_rate(self) -> bool {
        self.bytes >= 100 && self.no_text > self.bytes / 5
    }
}

impl<'a> HokuyoDriver<'a> {
    /// A driver that waits for [`Input::Connected`].
    ///
    /// * `frame` — holds one reply: [`FRAME_MEMORY`] is enough for every model, 2300 for a URG-04LX
    /// * `beams` — holds one scan: [`BEAM_MEMORY`], or 682
    pub fn new(config: HokuyoConfig, frame: &'a mut [u8], beams: &'a mut [Beam]) -> Self {
        let dialogue = Dialogue {
            config,
            base: DialogueBase::default(),
            sent_at: Instant::default(),
            frame_began: Instant::default(),
            is_usb: false,
            detours: 0,
            noise: LineNoise::default(),
            parameters: None,
            acquire: Acquire { encoding: config.encoding, multi_echo: false, first: 0, last: 0, cluster: 1 },
            stamps: StampUnwrapper::new(PERIOD_24_BIT_MS),
            offset: ClockOffset::default(),
            memory: ScanMemory::new(beams),
        };
        Self { decoder: ScipDecoder::new(frame), dialogue }
    }

    /// What the sensor said of its geometry, once it was asked.
    pub fn parameters(&self) -> Option<&SensorParameters> {
        self.dialogue.parameters.as_ref()
    }
}

impl LrfDriver for HokuyoDriver<'_> {
    fn handle_input(&mut self, now: Instant, input: Input<'_>) -> usize {
        match input {
            Input::Bytes(bytes) => return self.take(now, bytes),
            Input::Connected | Input::Disconnected => self.decoder.forget(),
            Input::Timeout | Input::Stop => {}
        }
        self.dialogue.on_input(now, input);
        0
    }

    fn poll_output(&mut self) -> Output<'_> {
        self.dialogue.base.poll_output(|| self.dialogue.memory.scan())
    }

    fn counters(&self) -> Counters {
        self.dialogue.base.counters(self.decoder.oversize_frames(), 0)
    }
}

impl HokuyoDriver<'_> {
    /// Takes bytes up to the first frame that leads to an output; none while outputs wait.
    fn take(&mut self, now: Instant, bytes: &[u8]) -> usize {
        let mut taken = 0;
        while self.dialogue.base.outbox.is_empty() {
            let rest = bytes.get(taken..).unwrap_or(b"");
            if rest.is_empty() {
                break;
            }
            if !self.decoder.is_inside_frame() {
                self.dialogue.frame_began = now;
            }
            let (count, frame) = self.decoder.feed(rest);
            taken += count;
            self.dialogue.on_bytes(now, rest.get(..count).unwrap_or(b""));
            if let Some(frame) = frame {
                self.dialogue.on_frame(now, frame);
            }
        }
        taken
    }
}

impl Dialogue<'_> {
    fn on_frame(&mut self, now: Instant, frame: &[u8]) {
        match self.base.state {
            State::Asking(ask) => {
                let command = self.command(ask).emit();
                match Reply::find(frame, &command, command.len()) {
                    Ok(reply) => self.on_reply(now, ask, &reply),
                    Err(_) if ask == Ask::Stream => self.on_scan_frame(now, frame),
                    Err(_) => {}
                }
            }
            State::Streaming => self.on_scan_frame(now, frame),
            State::Idle | State::BackOff | State::Pausing(_) => {}
        }
    }

    /// The rate that bytes travel at, bit/s; 0 if it means nothing.
    fn line_baud(&self) -> u32 {
        if self.is_usb { 0 } else { self.base.baud }
    }

    fn command(&self, ask: Ask) -> Command {
        match ask {
            Ask::Quit | Ask::Stop => Command::Quit,
            Ask::SwitchToScip2 => Command::SwitchToScip2,
            Ask::LeaveTime | Ask::EndTime => Command::Time(TimeMode::Leave),
            Ask::Version | Ask::VerifyRate => Command::Version,
            Ask::Parameters => Command::Parameters,
            Ask::Information => Command::Information,
            Ask::Rate => Command::BitRate(self.config.baud.wanted()),
            Ask::EnterTime => Command::Time(TimeMode::Enter),
            Ask::ReadTime => Command::Time(TimeMode::Read),
            Ask::LaserOn => Command::LaserOn,
            Ask::Stream => Command::Stream { acquire: self.acquire, interval: self.config.interval, count: 0 },
        }
    }
}

#[cfg(test)]
mod tests;
