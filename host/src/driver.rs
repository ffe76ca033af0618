//! Runs a core driver over a link: the only place where a laser meets the clock.
//!
//! [`LrfOptions`] says which driver; [`run_driver`] opens the port, and opens it again after it was unplugged, moves bytes
//! and deadlines between both, records them, and hands out events until it is told to stop.

use std::io;
use std::ops::ControlFlow;
use std::time::{Duration as WallDuration, Instant as WallInstant, SystemTime, UNIX_EPOCH};

use lrfslam_core::lrf::driver::{BaudPolicy, Counters, Event, Input, LrfDriver, NEVER, Output, drain, run_bytes};
use lrfslam_core::lrf::hokuyo_scip::driver as hokuyo;
use lrfslam_core::lrf::hokuyo_scip::{HokuyoConfig, HokuyoDriver};
use lrfslam_core::lrf::ldrobot::LdrobotDriver;
use lrfslam_core::lrf::rplidar::driver as rplidar;
use lrfslam_core::lrf::rplidar::{RplidarConfig, RplidarDriver};
use lrfslam_core::lrf::sick_lms::driver as sick;
use lrfslam_core::lrf::sick_lms::{SickConfig, SickDriver, Variant};
use lrfslam_core::scan::{Beam, Echo};
use lrfslam_core::time::{Duration, Instant};
use serde::{Deserialize, Serialize};

use crate::link::Link;
use crate::recording::Recorder;

/// Which protocol the sensor speaks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum LrfFamily {
    /// SICK LMS200, 211, 220, 221, 291
    #[serde(rename = "sick-lms2xx")]
    #[value(name = "sick-lms2xx")]
    SickLms2xx,
    /// Hokuyo URG, UBG, UHG, UTM, UXM, UST (SCIP), serial or Ethernet
    Hokuyo,
    /// Slamtec RPLIDAR A1, A2, A3, C1
    Rplidar,
    /// LDROBOT LD06, LD19
    Ld06,
}

/// Everything that decides what a driver does; with the same inputs it then does the same.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LrfOptions {
    /// Which driver.
    pub family: LrfFamily,
    /// Rate to change to, bit/s; 0 for "auto": found, and raised to what every serial port can.
    #[serde(default)]
    pub baud: u32,
    /// False for TCP.
    pub has_baud: bool,
    /// SICK: field of view, degrees, and resolution, 1/100 degree.
    #[serde(default)]
    pub variant: Option<(u16, u16)>,
    /// SICK below 1°: whole scans instead of mirror turns.
    #[serde(default)]
    pub whole_scans: bool,
    /// Hokuyo: neighbouring steps merged.
    #[serde(default)]
    pub cluster: u8,
    /// Subtracted from every stamp, µs.
    #[serde(default)]
    pub latency_us: i64,
}

impl LrfOptions {
    /// Everything as the sensor has it, on a serial port.
    pub fn new(family: LrfFamily) -> Self {
        Self { family, baud: 0, has_baud: true, variant: None, whole_scans: false, cluster: 1, latency_us: 0 }
    }

    /// The driver, in memory that the caller keeps.
    pub fn driver<'a>(&self, memory: &'a mut LaserMemory) -> Box<dyn LrfDriver + Send + 'a> {
        let latency = Duration::from_micros(self.latency_us);
        let (bytes, beams) = (&mut memory.bytes[..], &mut memory.beams[..]);
        match self.family {
            LrfFamily::SickLms2xx => {
                let variant = self.variant.map(|(angle_deg, resolution_cdeg)| Variant { angle_deg, resolution_cdeg });
                let baud = self.baud_policy(38_400);
                let config =
                    SickConfig { baud, variant, each_turn: !self.whole_scans, latency, ..SickConfig::default() };
                Box::new(SickDriver::new(config, &mut bytes[..sick::TELEGRAM_MEMORY], beams))
            }
            LrfFamily::Hokuyo => {
                let (baud, cluster) = (self.baud_policy(115_200), self.cluster.max(1));
                let config = HokuyoConfig { baud, cluster, latency, ..HokuyoConfig::default() };
                Box::new(HokuyoDriver::new(config, bytes, beams))
            }
            LrfFamily::Rplidar => Box::new(RplidarDriver::new(RplidarConfig { baud: self.baud, latency }, beams)),
            LrfFamily::Ld06 => Box::new(LdrobotDriver::new(latency, beams)),
        }
    }

    /// * `usual` — the fastest rate that any serial port and cable of this family manages
    fn baud_policy(&self, usual: u32) -> BaudPolicy {
        match self.baud {
            _ if !self.has_baud => BaudPolicy::NoRate,
            0 => BaudPolicy::AtLeast(usual),
            rate => BaudPolicy::Raise(rate),
        }
    }
}

/// Memory that a driver borrows: enough for the largest scan of any family.
#[derive(Debug)]
pub struct LaserMemory {
    bytes: Vec<u8>,
    beams: Vec<Beam>,
}

impl Default for LaserMemory {
    fn default() -> Self {
        let blank = Beam { bearing_rad: 0.0, offset: Duration::ZERO, echo: Echo::Invalid };
        let bytes = hokuyo::FRAME_MEMORY.max(sick::TELEGRAM_MEMORY);
        Self { bytes: vec![0; bytes], beams: vec![blank; hokuyo::BEAM_MEMORY.max(rplidar::BEAM_MEMORY)] }
    }
}

/// The host's clock, µs since 1970, which never goes back: the system's clock is read once.
#[derive(Debug, Clone, Copy)]
pub struct HostClock {
    started: WallInstant,
    unix_us: i64,
}

impl Default for HostClock {
    fn default() -> Self {
        let unix = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        Self { started: WallInstant::now(), unix_us: unix.as_micros() as i64 }
    }
}

impl HostClock {
    /// The time now.
    pub fn now(&self) -> Instant {
        Instant::from_micros(self.unix_us + self.started.elapsed().as_micros() as i64)
    }
}

/// What [`run_driver`] tells.
#[derive(Debug)]
pub enum DriverEvent<'a> {
    /// The driver's own event.
    Driver(Event<'a>),
    /// The port cannot be opened; it is tried again.
    CannotOpen(&'a io::Error),
    /// The recording cannot be written any more; the run goes on without.
    RecordingFailed(&'a io::Error),
}

/// How long to wait before a port that is gone is opened again.
const REOPEN: WallDuration = WallDuration::from_millis(300);
/// Longest wait for bytes, so that a stop is noticed.
const LISTEN: WallDuration = WallDuration::from_millis(50);
/// A driver that was told to stop and does not is left after this time.
const STOP_AT_MOST: Duration = Duration::from_millis(6000);

/// Opens the port as often as it takes.
pub type Opener<'o> = dyn FnMut() -> io::Result<Box<dyn Link>> + Send + 'o;
/// Takes events; `Break` stops the laser.
pub type EventSink<'s> = dyn FnMut(Instant, DriverEvent<'_>) -> ControlFlow<()> + 's;

/// Runs `driver` until `stop` says so or `sink` breaks, then stops the laser; returns the driver's counters.
///
/// A port that cannot be opened, or is unplugged, is tried again until then.
pub fn run_driver(
    driver: &mut dyn LrfDriver,
    open: &mut Opener<'_>,
    recorder: Option<Recorder>,
    stop: &dyn Fn() -> bool,
    sink: &mut EventSink<'_>,
) -> Counters {
    let mut run = Run {
        driver,
        link: None,
        recorder,
        clock: HostClock::default(),
        deadline: NEVER,
        done: false,
        broke: false,
        sink,
    };
    let mut buffer = [0; 4096];
    let mut give_up_at = None;
    while !run.done {
        if give_up_at.is_none() && (run.broke || stop()) {
            give_up_at = Some(run.clock.now() + STOP_AT_MOST);
            run.give(Input::Stop);
        }
        if give_up_at.is_some_and(|at| run.clock.now() >= at) {
            break;
        }
        if run.link.is_some() {
            run.listen(&mut buffer);
        } else if give_up_at.is_none() {
            run.connect(open);
        } else {
            break;
        }
    }
    run.finish()
}

struct Run<'r, 's> {
    driver: &'r mut dyn LrfDriver,
    link: Option<Box<dyn Link>>,
    recorder: Option<Recorder>,
    clock: HostClock,
    deadline: Instant,
    done: bool,
    broke: bool,
    sink: &'r mut EventSink<'s>,
}

/// An output that acts on the link, kept until the driver is drained.
enum Act {
    Send(Vec<u8>),
    Baud(u32),
}

impl Run<'_, '_> {
    fn connect(&mut self, open: &mut Opener<'_>) {
        match open() {
            Ok(link) => {
                self.link = Some(link);
                self.give(Input::Connected);
            }
            Err(error) => {
                self.tell(DriverEvent::CannotOpen(&error));
                std::thread::sleep(REOPEN);
            }
        }
    }

    /// Waits for bytes until the driver's deadline, and gives what came.
    fn listen(&mut self, buffer: &mut [u8]) {
        let Some(link) = &mut self.link else { return };
        let until = self.deadline.since(self.clock.now()).micros.max(0) as u64;
        match link.receive(buffer, WallDuration::from_micros(until).min(LISTEN)) {
            Ok(0) => {}
            Ok(count) => self.give(Input::Bytes(&buffer[..count])),
            Err(_) => return self.unplugged(),
        }
        if self.clock.now() >= self.deadline {
            self.give(Input::Timeout);
        }
    }

    fn unplugged(&mut self) {
        self.link = None;
        self.give(Input::Disconnected);
        std::thread::sleep(REOPEN);
    }

    fn give(&mut self, input: Input<'_>) {
        let now = self.clock.now();
        self.record(|recorder| recorder.input(now, input));
        let mut acts = Vec::new();
        let (mut done, mut broke) = (false, false);
        let sink = &mut *self.sink;
        let mut take = |output: Output<'_>| match output {
            Output::Transmit(bytes) => acts.push(Act::Send(bytes.to_vec())),
            Output::SetBaud(rate) => acts.push(Act::Baud(rate)),
            Output::Event(event) => {
                done |= matches!(event, Event::Stopped { .. });
                broke |= sink(now, DriverEvent::Driver(event)).is_break();
            }
            Output::Timeout(_) => {}
        };
        self.deadline = match input {
            Input::Bytes(bytes) => run_bytes(self.driver, now, bytes, &mut take),
            input => {
                let _ = self.driver.handle_input(now, input);
                drain(self.driver, &mut take)
            }
        };
        self.done |= done;
        self.broke |= broke;
        self.act(now, acts);
    }

    fn act(&mut self, now: Instant, acts: Vec<Act>) {
        for act in acts {
            let Some(link) = &mut self.link else { return };
            let result = match &act {
                Act::Send(bytes) => link.send(bytes),
                Act::Baud(rate) => link.set_baud(*rate),
            };
            self.record(|recorder| match &act {
                Act::Send(bytes) => recorder.sent(now, bytes),
                Act::Baud(rate) => recorder.baud(now, *rate),
            });
            // A rate that this port cannot do is one at which nothing will be heard: the driver goes on to the next.
            if result.is_err() && matches!(act, Act::Send(_)) {
                return self.unplugged();
            }
        }
    }

    fn record(&mut self, write: impl FnOnce(&mut Recorder) -> io::Result<()>) {
        if let Some(Err(error)) = self.recorder.as_mut().map(write) {
            self.recorder = None;
            self.tell(DriverEvent::RecordingFailed(&error));
        }
    }

    fn tell(&mut self, event: DriverEvent<'_>) {
        self.broke |= (self.sink)(self.clock.now(), event).is_break();
    }

    fn finish(mut self) -> Counters {
        if let Some(Err(error)) = self.recorder.take().map(Recorder::finish) {
            self.tell(DriverEvent::RecordingFailed(&error));
        }
        self.driver.counters()
    }
}
