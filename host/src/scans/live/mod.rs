//! Scans as they come: from a laser at a port, or from a recording of one. The seam behind which the mapper stands.
//!
//! [`for_each_scan`] is all there is to call. A live laser is read by a thread of its own, so that a slow mapper loses scans, the oldest first,
//! which are counted, and not bytes, which would damage them.

mod queue;
mod replay;
mod stream;
mod words;

use std::fmt;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use lrfslam_core::scan::{Beam, RangeScan};
use lrfslam_core::time::Instant;
use lrfslam_lrf::driver::{Counters, Event, Identity};

use crate::scans::driver::{DriverEvent, GaveUp, Opener, RunEnd, Search, run_driver};
use crate::scans::family::LrfOptions;
use crate::scans::link::Address;
use crate::scans::recording::{RecordPlan, Recorder, RecordingEnd, RecordingHeader, RecordingReport};
use queue::Queue;
use replay::{Going, replay, sum};
use words::Words;

pub use stream::{Fetch, ScanStream, taken};

/// How soon it is noticed that the user wants an end.
pub(crate) const NOTICED_AFTER: Duration = Duration::from_millis(50);

/// What is told on the way, in words.
pub type Say = Box<dyn FnMut(&str) + Send>;

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
    /// It may be of any family: which is found out, and the options' one means nothing.
    pub any_family: bool,
    /// Never give up on a laser that is not there.
    pub waits: bool,
    /// Write everything to a file.
    pub record: Option<RecordPlan>,
}

impl LiveLaser {
    /// A laser of the family in `options`, given up if it is not there, and not recorded.
    pub fn new(address: Address, options: LrfOptions) -> Self {
        Self { address, options, any_family: false, waits: false, record: None }
    }
}

/// There is no laser that scans at this port.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NoLaser {
    /// The port.
    pub port: String,
    /// Why it was given up.
    pub why: GaveUp,
}

impl fmt::Display for NoLaser {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.why {
            // It names the port itself.
            GaveUp::NotOpened(_) => write!(out, "{}", self.why),
            why => write!(out, "{}: {why}", self.port),
        }
    }
}

impl std::error::Error for NoLaser {}

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

/// What takes the items of a source; it breaks when it has enough.
pub type Take<'t> = dyn FnMut(Item<'_>) -> ControlFlow<()> + 't;

/// How a source ended.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct SourceReport {
    /// The driver's counters.
    pub counters: Counters,
    /// Scans that were not taken in time by a slow consumer.
    pub overrun: u32,
    /// The laser confirmed that it is off; true for recordings that say so.
    pub laser_off: bool,
    /// What was recorded of a laser that was found.
    pub recording: Option<RecordingReport>,
    /// How the recording that was replayed ended, if it was read to its end.
    pub input: Option<RecordingEnd>,
}

impl SourceReport {
    /// Why results are of a part only: what was replayed is damaged, cut, or has holes.
    pub fn input_fault(&self) -> Option<String> {
        self.input.filter(|end| !end.is_whole()).map(|end| end.to_string())
    }
}

/// Calls `take` with every scan and message of `source`, in order, on this thread, until the source ends, `stop` is set, or
/// `take` breaks; the laser is then stopped. **This is where a mapper plugs in.**
///
/// ```no_run
/// # use std::{ops::ControlFlow, sync::atomic::AtomicBool};
/// # use lrfslam_host::scans::{family::{LrfFamily, LrfOptions}, live::{Item, LiveLaser, ScanSource, for_each_scan}};
/// let options = LrfOptions::new(LrfFamily::Hokuyo);
/// let source = ScanSource::Live(LiveLaser::new("/dev/ttyACM0".parse()?, options));
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
/// If the recording cannot be read, or the file to record to not be made; [`NoLaser`] if nothing at the port scans. After the
/// first scan a port that is gone is no error: it is told, and tried again.
pub fn for_each_scan(source: &ScanSource, stop: &AtomicBool, take: &mut Take<'_>) -> anyhow::Result<SourceReport> {
    match source {
        ScanSource::Live(laser) => {
            let before = recorded_before(laser, stop, take)?;
            let report = live_over(laser, &mut || laser.address.open(), stop, take)?;
            Ok(SourceReport { counters: sum(before.counters, report.counters), ..report })
        }
        ScanSource::Recording { path, fast } => replay(path, Going { fast: *fast, only_checked: false }, stop, take),
    }
}

/// The scans of the run that this one goes on with, from its recording.
fn recorded_before(laser: &LiveLaser, stop: &AtomicBool, take: &mut Take<'_>) -> anyhow::Result<SourceReport> {
    let Some(plan) = laser.record.as_ref().filter(|plan| plan.goes_on) else { return Ok(SourceReport::default()) };
    replay(&plan.path, Going { fast: true, only_checked: true }, stop, take)
}

/// An event that goes from the laser's thread to the consumer's.
enum Message {
    Scan { stamp: Instant, range_max_m: f32, beams: Vec<Beam> },
    Identified(Box<Identity>),
    Said(String),
}

impl Message {
    fn item(&self) -> Item<'_> {
        match self {
            Message::Scan { stamp, range_max_m, beams } => {
                Item::Scan(RangeScan { stamp: *stamp, range_max_m: *range_max_m, beams })
            }
            Message::Identified(identity) => Item::Identified(identity),
            Message::Said(text) => Item::Said(text),
        }
    }
}

/// * `open` — opens the laser's port
fn live_over(
    laser: &LiveLaser,
    open: &mut Opener<'_>,
    stop: &AtomicBool,
    take: &mut Take<'_>,
) -> anyhow::Result<SourceReport> {
    let options = LrfOptions { has_baud: laser.address.has_baud(), ..laser.options.clone() };
    let header = RecordingHeader {
        program: concat!("lrfslam ", env!("CARGO_PKG_VERSION")).to_owned(),
        port: laser.address.to_string(),
        lrf: options.clone(),
    };
    let recorder = laser.record.as_ref().map(|plan| Recorder::new(plan, header)).transpose()?;
    let (queue, enough) = (Queue::default(), AtomicBool::new(false));
    let (end, laser_off) = std::thread::scope(|scope| {
        let mailbox = Mailbox { queue: &queue, enough: &enough, stop };
        let reader = scope.spawn(move || {
            let mut memories = Vec::new();
            let search = Search::new(&options, laser.any_family, laser.waits, &mut memories);
            let closing = Closing(mailbox.queue);
            let end = read_laser(search, open, recorder, &mailbox, laser.any_family);
            drop(closing);
            end
        });
        consume(&mailbox, take);
        // Only a panic in the reader ends it without a report.
        reader.join().unwrap_or_default()
    });
    if let Some(why) = end.gave_up {
        return Err(NoLaser { port: laser.address.to_string(), why }.into());
    }
    Ok(SourceReport {
        counters: end.counters,
        overrun: queue.left_out(),
        laser_off,
        recording: end.recording,
        input: None,
    })
}

/// Gives messages to the consumer until the reader is done; breaking asks the reader to stop. When the user wants an end, what waits is not mapped any more.
fn consume(mailbox: &Mailbox<'_>, take: &mut Take<'_>) {
    while let Some(message) = mailbox.queue.take() {
        if mailbox.is_over() && matches!(message, Message::Scan { .. }) {
            continue;
        }
        if take(message.item()).is_break() {
            mailbox.enough.store(true, Ordering::Relaxed);
        }
    }
}

/// The laser thread's way to the consumer.
#[derive(Clone, Copy)]
struct Mailbox<'m> {
    queue: &'m Queue,
    enough: &'m AtomicBool,
    stop: &'m AtomicBool,
}

impl Mailbox<'_> {
    /// Either side may want an end.
    fn is_over(&self) -> bool {
        self.enough.load(Ordering::Relaxed) || self.stop.load(Ordering::Relaxed)
    }
}

/// Nothing more comes when this is dropped, however the reader ends.
struct Closing<'q>(&'q Queue);

impl Drop for Closing<'_> {
    fn drop(&mut self) {
        self.0.close();
    }
}

/// How the laser's session ended, and whether it confirmed that it is off.
fn read_laser(
    search: Search<'_>,
    open: &mut Opener<'_>,
    recorder: Option<Recorder>,
    mailbox: &Mailbox<'_>,
    any_family: bool,
) -> (RunEnd, bool) {
    let mut laser_off = false;
    let mut words = Words::new(any_family);
    let end = run_driver(search, open, recorder, &|| mailbox.is_over(), &mut |_, event| {
        laser_off |= matches!(event, DriverEvent::Driver(Event::Stopped { laser_off: true }));
        words.tell(event, &mut |message| mailbox.queue.post(message));
        ControlFlow::Continue(())
    });
    (end, laser_off)
}

#[cfg(test)]
mod tests;
