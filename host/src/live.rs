//! Scans as they come: from a laser at a port, or from a recording of one. The seam behind which the mapper stands.
//!
//! [`for_each_scan`] is all there is to call. A live laser is read by a thread of its own, so that a slow mapper loses scans,
//! which are counted, and not bytes, which would damage them.

use std::io;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::time::{Duration as WallDuration, Instant as WallInstant};

use lrfslam_core::lrf::driver::{Counters, Event, Identity, Input, LrfDriver, Output, Trouble, drain, run_bytes};
use lrfslam_core::scan::{Beam, RangeScan};
use lrfslam_core::time::{Duration, Instant};

use crate::driver::{DriverEvent, LaserMemory, LrfFamily, LrfOptions, run_driver};
use crate::link::{Address, Link};
use crate::recording::{Recorder, RecordingHeader, RecordingReader};

/// Where scans come from.
#[derive(Debug, Clone)]
pub enum ScanSource {
    /// A laser, now.
    Live(LiveLaser),
    /// A recording.
    Recording {
        /// The file.
        path: PathBuf,
        /// As fast as possible instead of as it was.
        fast: bool,
    },
}

/// A laser at a port.
#[derive(Debug, Clone)]
pub struct LiveLaser {
    /// Where it is plugged in.
    pub address: Address,
    /// Which it is, and what to ask of it.
    pub options: LrfOptions,
    /// Write everything to this file.
    pub record: Option<PathBuf>,
}

/// A scan, or what else is worth telling.
#[derive(Debug)]
pub enum Item<'a> {
    /// A scan, whole and verified; stamps are on the host's clock, µs since 1970.
    Scan(RangeScan<'a>),
    /// What is plugged in.
    Identified(&'a Identity),
    /// Something in words: connected, streaming, trouble and what is done about it.
    Said(&'a str),
}

/// How a source ended.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct SourceReport {
    /// The driver's counters.
    pub counters: Counters,
    /// Scans that were not taken in time by a slow consumer.
    pub overrun: u32,
    /// The laser confirmed that it is off; true for recordings that say so.
    pub laser_off: bool,
}

/// Calls `take` with every scan and message of `source`, in order, on this thread, until the source ends, `stop` is set, or
/// `take` breaks; the laser is then stopped. **This is where a mapper plugs in.**
///
/// ```no_run
/// # use std::{ops::ControlFlow, sync::atomic::AtomicBool};
/// # use lrfslam_host::{driver::{LrfFamily, LrfOptions}, live::{Item, LiveLaser, ScanSource, for_each_scan}};
/// let options = LrfOptions::new(LrfFamily::Hokuyo);
/// let source = ScanSource::Live(LiveLaser { address: "/dev/ttyACM0".parse()?, options, record: None });
/// for_each_scan(&source, &AtomicBool::new(false), &mut |item| {
///     if let Item::Scan(scan) = item {
///         println!("{} beams at {} s", scan.beams.len(), scan.stamp.as_secs_f64());
///     }
///     ControlFlow::Continue(())
/// })?;
/// # Ok::<(), Box<dyn std::error::Error + Send + Sync>>(())
/// ```
///
/// # Errors
/// If the recording cannot be read, or the file to record to not be made. A port that cannot be opened is no error: it is
/// told, and tried again.
pub fn for_each_scan(
    source: &ScanSource,
    stop: &AtomicBool,
    take: &mut dyn FnMut(Item<'_>) -> ControlFlow<()>,
) -> anyhow::Result<SourceReport> {
    match source {
        ScanSource::Live(laser) => live(laser, stop, take),
        ScanSource::Recording { path, fast } => replay(path, *fast, stop, take),
    }
}

/// An event that goes from the laser's thread to the consumer's.
enum Message {
    Scan { stamp: Instant, range_max_m: f32, beams: Vec<Beam> },
    Identified(Box<Identity>),
    Said(String),
}

/// Scans that may wait for a slow consumer.
const WAITING: usize = 64;

fn live(
    laser: &LiveLaser,
    stop: &AtomicBool,
    take: &mut dyn FnMut(Item<'_>) -> ControlFlow<()>,
) -> anyhow::Result<SourceReport> {
    let options = LrfOptions { has_baud: laser.address.has_baud(), ..laser.options.clone() };
    let header = RecordingHeader {
        program: concat!("lrfslam ", env!("CARGO_PKG_VERSION")).to_owned(),
        port: laser.address.to_string(),
        lrf: options.clone(),
    };
    let recorder = laser.record.as_deref().map(|path| Recorder::create(path, &header)).transpose()?;
    let (sender, receiver) = sync_channel(WAITING);
    let (enough, overrun) = (AtomicBool::new(false), AtomicU32::new(0));
    let address = laser.address.clone();
    let mut report = std::thread::scope(|scope| {
        let (enough, overrun) = (&enough, &overrun);
        let reader = scope.spawn(move || {
            let mut open = || open_for(&address, &options);
            read_laser(&options, &mut open, recorder, enough, &Mailbox { sender, overrun, stop })
        });
        consume(&receiver, enough, take);
        // Only a panic in the reader ends it without a report.
        reader.join().unwrap_or_default()
    });
    report.overrun = overrun.load(Ordering::Relaxed);
    Ok(report)
}

/// Opens the port, and lets an RPLIDAR A1's motor run, which DTR stops; a port without that line has no such motor.
fn open_for(address: &Address, options: &LrfOptions) -> io::Result<Box<dyn Link>> {
    let mut link = address.open()?;
    if options.family == LrfFamily::Rplidar {
        let _ = link.set_dtr(false);
    }
    Ok(link)
}

/// Gives messages to the consumer until the reader is done; breaking asks the reader to stop.
fn consume(receiver: &Receiver<Message>, enough: &AtomicBool, take: &mut dyn FnMut(Item<'_>) -> ControlFlow<()>) {
    while let Ok(message) = receiver.recv() {
        if enough.load(Ordering::Relaxed) && matches!(message, Message::Scan { .. }) {
            continue;
        }
        let flow = match &message {
            Message::Scan { stamp, range_max_m, beams } => {
                take(Item::Scan(RangeScan { stamp: *stamp, range_max_m: *range_max_m, beams }))
            }
            Message::Identified(identity) => take(Item::Identified(identity)),
            Message::Said(text) => take(Item::Said(text)),
        };
        if flow.is_break() {
            enough.store(true, Ordering::Relaxed);
        }
    }
}

/// The laser thread's way to the consumer.
struct Mailbox<'m> {
    sender: SyncSender<Message>,
    overrun: &'m AtomicU32,
    stop: &'m AtomicBool,
}

impl Mailbox<'_> {
    /// A scan that finds no room is dropped and counted; words wait.
    fn post(&self, message: Message) {
        match message {
            Message::Scan { .. } => {
                if let Err(TrySendError::Full(_)) = self.sender.try_send(message) {
                    self.overrun.fetch_add(1, Ordering::Relaxed);
                }
            }
            words => {
                let _ = self.sender.send(words);
            }
        }
    }
}

fn read_laser(
    options: &LrfOptions,
    open: &mut (dyn FnMut() -> io::Result<Box<dyn Link>> + Send),
    recorder: Option<Recorder>,
    enough: &AtomicBool,
    mailbox: &Mailbox<'_>,
) -> SourceReport {
    let mut memory = LaserMemory::default();
    let mut driver = options.driver(&mut memory);
    let mut laser_off = false;
    let mut last_refusal = String::new();
    // Either side may want an end.
    let ended = || enough.load(Ordering::Relaxed) || mailbox.stop.load(Ordering::Relaxed);
    let counters = run_driver(driver.as_mut(), open, recorder, &ended, &mut |_, event| {
        match event {
            DriverEvent::Driver(event) => {
                laser_off |= matches!(event, Event::Stopped { laser_off: true });
                tell(event, &mut |message| mailbox.post(message));
            }
            DriverEvent::CannotOpen(error) => {
                let refusal = error.to_string();
                if refusal != last_refusal {
                    mailbox.post(Message::Said(format!("{refusal}; trying again")));
                }
                last_refusal = refusal;
            }
            DriverEvent::RecordingFailed(error) => {
                mailbox.post(Message::Said(format!("the recording cannot be written any more: {error}")));
            }
        }
        ControlFlow::Continue(())
    });
    SourceReport { counters, overrun: 0, laser_off }
}

/// An event of a driver as a message.
fn tell(event: Event<'_>, post: &mut dyn FnMut(Message)) {
    post(match event {
        Event::Scan(scan) => {
            Message::Scan { stamp: scan.stamp, range_max_m: scan.range_max_m, beams: scan.beams.to_vec() }
        }
        Event::Identified(identity) => Message::Identified(Box::new(identity.clone())),
        Event::Found { baud: 0 } => Message::Said("laser found".to_owned()),
        Event::Found { baud } => Message::Said(format!("laser found at {baud} baud")),
        Event::Streaming { baud, period } => Message::Said(streaming(baud, period)),
        Event::Trouble(trouble) => Message::Said(troubled(&trouble)),
        Event::Stopped { laser_off: true } => Message::Said("laser stopped".to_owned()),
        Event::Stopped { laser_off: false } => {
            Message::Said("no answer to the stop: if a laser is there, it may still be on".to_owned())
        }
    });
}

fn streaming(baud: u32, period: Duration) -> String {
    let rate = 1.0 / period.as_secs_f32();
    match baud {
        0 => format!("receiving up to {rate:.1} scans a second"),
        baud => format!("receiving up to {rate:.1} scans a second at {baud} baud"),
    }
}

fn troubled(trouble: &Trouble) -> String {
    match trouble.retry_in.micros {
        0 => trouble.to_string(),
        wait => format!("{trouble}; trying again in {:.1} s", wait as f64 * 1e-6),
    }
}

/// Gives a recorded driver its recorded inputs at their recorded times: it then says what it said.
fn replay(
    path: &Path,
    fast: bool,
    stop: &AtomicBool,
    take: &mut dyn FnMut(Item<'_>) -> ControlFlow<()>,
) -> anyhow::Result<SourceReport> {
    let reader = RecordingReader::open(path)?;
    let mut memory = LaserMemory::default();
    let options = reader.header().lrf.clone();
    let mut driver = options.driver(&mut memory);
    let mut report = SourceReport::default();
    let mut pace = Pace::new(fast);
    for (now, entry) in reader {
        let Some(input) = entry.input() else { continue };
        if stop.load(Ordering::Relaxed) || !pace.wait_for(now, stop) {
            break;
        }
        if give(driver.as_mut(), now, input, &mut report, take).is_break() {
            break;
        }
    }
    report.counters = driver.counters();
    Ok(report)
}

fn give(
    driver: &mut dyn LrfDriver,
    now: Instant,
    input: Input<'_>,
    report: &mut SourceReport,
    take: &mut dyn FnMut(Item<'_>) -> ControlFlow<()>,
) -> ControlFlow<()> {
    let mut flow = ControlFlow::Continue(());
    let mut sink = |output: Output<'_>| {
        let Output::Event(event) = output else { return };
        report.laser_off |= matches!(event, Event::Stopped { laser_off: true });
        if flow.is_break() {
            return;
        }
        if let Event::Scan(scan) = event {
            flow = take(Item::Scan(scan));
            return;
        }
        tell(event, &mut |message| match &message {
            Message::Identified(identity) => flow = take(Item::Identified(identity)),
            Message::Said(text) => flow = take(Item::Said(text)),
            Message::Scan { .. } => {}
        });
    };
    match input {
        Input::Bytes(bytes) => {
            run_bytes(driver, now, bytes, &mut sink);
        }
        input => {
            let _ = driver.handle_input(now, input);
            drain(driver, &mut sink);
        }
    }
    flow
}

/// Lets recorded time pass as it did.
struct Pace {
    fast: bool,
    begun: Option<(WallInstant, Instant)>,
}

impl Pace {
    fn new(fast: bool) -> Self {
        Self { fast, begun: None }
    }

    /// False if it was told to stop while waiting.
    fn wait_for(&mut self, now: Instant, stop: &AtomicBool) -> bool {
        let (wall, first) = *self.begun.get_or_insert((WallInstant::now(), now));
        let due = WallDuration::from_micros(now.since(first).micros.max(0) as u64);
        while !self.fast && wall.elapsed() < due {
            if stop.load(Ordering::Relaxed) {
                return false;
            }
            std::thread::sleep((due - wall.elapsed().min(due)).min(WallDuration::from_millis(50)));
        }
        true
    }
}
