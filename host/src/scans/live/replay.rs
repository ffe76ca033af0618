//! A recording as a source of scans.

use std::ops::ControlFlow;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration as WallDuration, Instant as WallInstant};

use lrfslam_core::time::Instant;
use lrfslam_lrf::driver::{Counters, Event, Input, LrfDriver, Output, run_input};

use super::words::tell;
use super::{Item, SourceReport, Take};
use crate::scans::driver::LaserMemory;
use crate::scans::family::LrfFamily;
use crate::scans::recording::{Entry, RecordingEnd, RecordingReader};

/// How a recording is gone through.
#[derive(Debug, Clone, Copy)]
pub(super) struct Going {
    /// As fast as possible.
    pub fast: bool,
    /// Not beyond the last check: what a run that goes on takes as recorded.
    pub only_checked: bool,
}

/// Gives a recorded driver its recorded inputs at their recorded times: it then says what it said.
pub(super) fn replay(
    path: &Path,
    going: Going,
    stop: &AtomicBool,
    take: &mut Take<'_>,
) -> anyhow::Result<SourceReport> {
    let mut reader = RecordingReader::open(path)?;
    if going.only_checked {
        reader.skip_unchecked();
    }
    let mut report = SourceReport::default();
    let mut pace = Pace::new(going.fast);
    while replay_driver(&mut reader, &mut pace, stop, &mut report, take) {}
    report.input = reader.end();
    if let Some(end) = report.input.filter(|end| *end != RecordingEnd::WHOLE && !going.only_checked) {
        let _ = take(Item::Said(&end.to_string()));
    }
    Ok(report)
}

/// One program's part of a recording; true if another one's follows.
fn replay_driver(
    reader: &mut RecordingReader,
    pace: &mut Pace,
    stop: &AtomicBool,
    report: &mut SourceReport,
    take: &mut Take<'_>,
) -> bool {
    let mut memory = LaserMemory::default();
    let options = reader.header().lrf.clone();
    let mut driver = options.driver(&mut memory);
    let mut is_followed = false;
    for (now, entry) in reader {
        if entry == Entry::GoesOn {
            is_followed = true;
            break;
        }
        let Some(input) = entry.input() else { continue };
        if stop.load(Ordering::Relaxed) || !pace.wait_for(now, stop) {
            break;
        }
        if give(driver.as_mut(), now, input, report, (options.family, take)).is_break() {
            break;
        }
    }
    report.counters = sum(report.counters, driver.counters());
    is_followed
}

/// What two drivers counted, one after the other.
pub(super) fn sum(before: Counters, then: Counters) -> Counters {
    let Counters { scans, damaged, restarts, incomplete } = before;
    Counters {
        scans: scans.saturating_add(then.scans),
        damaged: damaged.saturating_add(then.damaged),
        restarts: restarts.saturating_add(then.restarts),
        incomplete: incomplete.saturating_add(then.incomplete),
    }
}

fn give(
    driver: &mut dyn LrfDriver,
    now: Instant,
    input: Input<'_>,
    report: &mut SourceReport,
    (family, take): (LrfFamily, &mut Take<'_>),
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
        tell(event, Some(family), &mut |message| flow = take(message.item()));
    };
    run_input(driver, now, input, &mut sink);
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
