//! The loop between a link, the clock and the driver whose turn it is.

use std::io;
use std::ops::ControlFlow;
use std::time::{Duration as WallDuration, Instant as WallInstant, SystemTime, UNIX_EPOCH};

use lrfslam_core::time::{Duration, Instant};
use lrfslam_lrf::driver::{Counters, Event, Input, NEVER, Output, Step, run_input};

use super::search::{GaveUp, Search, Signs, Verdict};
use crate::scans::family::LrfFamily;
use crate::scans::link::Link;
use crate::scans::recording::{Recorder, RecordingReport};

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
    /// The laser was found: of this family.
    Found(LrfFamily),
    /// The port cannot be opened; it is tried again.
    CannotOpen(&'a io::Error),
    /// The laser that was asked for does not answer: it is found out whether another is there.
    LookingForOthers,
    /// The recording ends here, and why; the run goes on without.
    RecordingFailed(&'a io::Error),
    /// The recording's disk has no room, or has room again; the recording goes on as it can.
    OfTheDisk(&'a str),
}

/// How [`run_driver`] ended.
#[derive(Debug, Clone, Default)]
pub struct RunEnd {
    /// The driver's counters.
    pub counters: Counters,
    /// Why there was no scan, if it ended by itself.
    pub gave_up: Option<GaveUp>,
    /// What was recorded, if that was asked for and a laser was found.
    pub recording: Option<RecordingReport>,
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

/// Runs the drivers of `search` until `stop` says so or `sink` breaks, then stops the laser.
///
/// A port that cannot be opened, or is unplugged, is tried again until then, or until `search` gives up.
pub fn run_driver(
    search: Search<'_>,
    open: &mut Opener<'_>,
    recorder: Option<Recorder>,
    stop: &dyn Fn() -> bool,
    sink: &mut EventSink<'_>,
) -> RunEnd {
    let mut run = DriverRun {
        search,
        link: None,
        baud: 0,
        recorder,
        clock: HostClock::default(),
        deadline: NEVER,
        signs: Signs::default(),
        gave_up: None,
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
        if give_up_at.is_none() {
            run.go_on_searching();
        }
    }
    run.finish()
}

struct DriverRun<'r, 's> {
    search: Search<'r>,
    link: Option<Box<dyn Link>>,
    /// The rate that was set last, bit/s; 0 if none was.
    baud: u32,
    recorder: Option<Recorder>,
    clock: HostClock,
    deadline: Instant,
    /// Of the driver, since they were judged.
    signs: Signs,
    gave_up: Option<GaveUp>,
    done: bool,
    broke: bool,
    sink: &'r mut EventSink<'s>,
}

/// An output that acts on the link, kept until the driver is drained.
enum Act {
    Send(Vec<u8>),
    Baud(u32),
}

impl DriverRun<'_, '_> {
    fn connect(&mut self, open: &mut Opener<'_>) {
        match open() {
            Ok(link) => {
                self.link = Some(link);
                self.search.opened(self.clock.now());
                self.begin_session();
            }
            Err(error) => {
                self.search.refused(self.clock.now(), error.to_string());
                self.tell(DriverEvent::CannotOpen(&error));
                std::thread::sleep(REOPEN);
            }
        }
    }

    /// The driver whose turn it is has the port. DTR lets an RPLIDAR A1's motor run when it is off.
    fn begin_session(&mut self) {
        let Some(link) = &mut self.link else { return };
        // A port without that line has no such motor.
        let _ = link.set_dtr(self.search.family() != LrfFamily::Rplidar);
        self.give(Input::Connected);
    }

    /// Judges what the driver did, and lets the next have its turn, or ends, if that is due.
    fn go_on_searching(&mut self) {
        let signs = std::mem::take(&mut self.signs);
        match self.search.judge(self.clock.now(), &signs) {
            Verdict::GoOn if self.recorder.as_ref().is_some_and(Recorder::is_swamped) => self.begin_turn(),
            Verdict::GoOn => {}
            Verdict::Next => {
                if !self.search.is_wanted() {
                    self.tell(DriverEvent::LookingForOthers);
                }
                self.begin_turn();
            }
            // It has been found, so it is to be switched off.
            Verdict::GiveUp(why @ GaveUp::NoScan(_)) => (self.gave_up, self.broke) = (Some(why), true),
            Verdict::GiveUp(why) => (self.gave_up, self.done) = (Some(why), true),
        }
    }

    /// What came before is no part of this driver's session.
    fn begin_turn(&mut self) {
        self.recorder.iter_mut().for_each(Recorder::forget);
        self.begin_session();
    }

    /// Waits for bytes until the driver's deadline, and gives what came.
    fn listen(&mut self, buffer: &mut [u8]) {
        let Some(link) = &mut self.link else { return };
        let until = self.deadline.since(self.clock.now()).micros.max(0) as u64;
        match link.receive(buffer, WallDuration::from_micros(until).min(LISTEN)) {
            Ok(0) => {}
            Ok(count) => {
                self.search.hear(self.baud, count);
                self.give(Input::Bytes(buffer.get(..count).unwrap_or_default()));
            }
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
        let (mut acts, mut faults) = (Vec::new(), Vec::new());
        let (mut done, mut broke) = (false, false);
        let (is_wanted, is_among_many) = (self.search.is_wanted(), self.search.is_among_many());
        let mut found = self.search.is_looking().then(|| self.search.family()).filter(|_| is_wanted);
        let (sink, signs, recorder) = (&mut *self.sink, &mut self.signs, &mut self.recorder);
        let driver = self.search.driver();
        let mut take = |output: Output<'_>| match output {
            Output::Transmit(bytes) => acts.push(Act::Send(bytes.to_vec())),
            Output::SetBaud(rate) => acts.push(Act::Baud(rate)),
            Output::Event(event) => {
                signs.note(&event);
                done |= matches!(event, Event::Stopped { .. });
                if let (Event::Found { .. }, Some(family)) = (&event, found.take()) {
                    broke |= sink(now, DriverEvent::Found(family)).is_break();
                    faults.extend(recorder.as_mut().and_then(|recorder| recorder.begin(family).err()));
                }
                if matches!(event, Event::Scan(_)) {
                    faults.extend(recorder.as_mut().and_then(|recorder| recorder.scan_came().err()));
                }
                let is_news = is_wanted && !(is_among_many && is_vain(&event));
                broke |= is_news && sink(now, DriverEvent::Driver(event)).is_break();
            }
            Output::Timeout(_) => {}
        };
        self.deadline = run_input(driver, now, input, &mut take);
        self.done |= done;
        self.broke |= broke;
        faults.iter().for_each(|error| self.tell(DriverEvent::RecordingFailed(error)));
        self.act(now, acts);
    }

    fn act(&mut self, now: Instant, acts: Vec<Act>) {
        for act in acts {
            let Some(link) = &mut self.link else { return };
            let result = match &act {
                Act::Send(bytes) => link.send(bytes),
                Act::Baud(rate) => {
                    self.baud = *rate;
                    link.set_baud(*rate)
                }
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
            self.tell(DriverEvent::RecordingFailed(&error));
        }
        if let Some(news) = self.recorder.as_mut().and_then(Recorder::news) {
            self.tell(DriverEvent::OfTheDisk(&news));
        }
    }

    fn tell(&mut self, event: DriverEvent<'_>) {
        self.broke |= (self.sink)(self.clock.now(), event).is_break();
    }

    fn finish(mut self) -> RunEnd {
        self.record(Recorder::finish);
        let recording = self.recorder.as_ref().and_then(Recorder::report);
        RunEnd { counters: self.search.driver().counters(), gave_up: self.gave_up, recording }
    }
}

impl Signs {
    fn note(&mut self, event: &Event<'_>) {
        match event {
            Event::Found { baud } => self.found = Some(*baud),
            Event::Scan(_) => self.scanned = true,
            Event::Trouble(trouble) => self.trouble = Some(*trouble),
            _ => {}
        }
    }
}

/// A driver has tried everything.
fn is_vain(event: &Event<'_>) -> bool {
    matches!(event, Event::Trouble(trouble) if trouble.step == Step::Find)
}
