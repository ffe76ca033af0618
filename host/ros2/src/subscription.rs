//! A topic of scans, as a laser.

use std::collections::HashMap;
use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::task::{Wake, Waker};
use std::thread::{Thread, current, park_timeout};
use std::time::{Duration as WallDuration, Instant as WallInstant};

use lrfslam_core::time::Instant;
use lrfslam_host::scans::driver::{GaveUp, HostClock};
use lrfslam_host::scans::live::{Item, NoLaser, SourceReport, Take};
use lrfslam_host::scans::log::ToldScans;
use rustdds::GUID;
use rustdds::no_key::SimpleDataReader;

use crate::node::{Node, NodeError, Quality};
use crate::raw::{Raw, Whole};

/// Scans wait here for a slow mapper; older ones go.
const DEPTH: i32 = 32;
/// How soon it is noticed that the user wants an end.
const NOTICED_AFTER: WallDuration = WallDuration::from_millis(50);
/// A topic without a scan for so long is told …
const SILENCE: WallDuration = WallDuration::from_secs(3);
/// … and, before its first one, given up.
const GIVEN_UP_AFTER: WallDuration = WallDuration::from_secs(10);
/// Messages that cannot be read, of which the first are told.
const DAMAGE_TOLD: u32 = 3;

/// What to do while no scan comes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Patience {
    /// Give up after 10 s without a first one.
    Short,
    /// Wait.
    Endless,
}

/// Scans of a topic, from now on.
pub struct Subscription {
    /// The participant leaves with the last of its users.
    node: Node,
    reader: SimpleDataReader<Raw, Whole>,
    name: String,
    scans: ToldScans,
    patience: Patience,
}

impl std::fmt::Debug for Subscription {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        out.debug_struct("Subscription").field("name", &self.name).finish_non_exhaustive()
    }
}

impl Subscription {
    /// Of a topic such as `/scan`, whose messages are `sensor_msgs/LaserScan`. It takes what comes: publishers may be reliable or not.
    ///
    /// * `range_max_m` — see [`ToldScans::new`]
    ///
    /// # Errors
    /// If DDS refuses it.
    pub fn new(node: &Node, topic: &str, range_max_m: Option<f32>, patience: Patience) -> Result<Self, NodeError> {
        let quality = Quality { depth: DEPTH, is_reliable: false, is_kept: false };
        let reader = node.reader(topic, "sensor_msgs/LaserScan", quality)?;
        let scans = ToldScans::new(topic, range_max_m);
        Ok(Self { node: node.clone(), reader, name: format!("ros2:{topic}"), scans, patience })
    }

    /// Gives every scan to `take`, until it has enough or the flag is set.
    ///
    /// # Errors
    /// [`NoLaser`] if none comes, and nobody wants to wait.
    pub fn for_each_scan(mut self, enough: &AtomicBool, take: &mut Take<'_>) -> anyhow::Result<SourceReport> {
        let mut report = SourceReport::default();
        let mut gaps = Gaps::default();
        let (mut last, mut is_silent) = (WallInstant::now(), false);
        let clock = HostClock::default();
        let waker = Waker::from(Arc::new(Unpark(current())));
        while !enough.load(Ordering::Relaxed) {
            self.reader.set_waker(Some(waker.clone()));
            self.reader.drain_read_notifications();
            while let Ok(Some(message)) = self.reader.try_take_one() {
                report.overrun = report.overrun.saturating_add(gaps.take(message.writer_guid, message.sequence_number));
                (last, is_silent) = (WallInstant::now(), false);
                if self.give(message.sample, clock.now(), &mut report, take).is_break() {
                    return Ok(report);
                }
            }
            if report.counters.scans == 0 && self.patience == Patience::Short && last.elapsed() > GIVEN_UP_AFTER {
                return Err(self.nobody().into());
            }
            if last.elapsed() > SILENCE && !std::mem::replace(&mut is_silent, true) {
                let _ = take(Item::Said(&format!("{}: no scan comes; waiting for the next", self.name)));
            }
            park_timeout(NOTICED_AFTER);
        }
        Ok(report)
    }

    fn give(&mut self, message: Raw, now: Instant, report: &mut SourceReport, take: &mut Take<'_>) -> ControlFlow<()> {
        let counters = &mut report.counters;
        match self.scans.take(now, message.0) {
            Ok(scan) => {
                counters.scans += 1;
                if counters.scans == 1 {
                    take(Item::Said(&format!("{}: scans of {} beams", self.name, scan.beams.len())))?;
                }
                take(Item::Scan(scan.scan()))
            }
            Err(fault) => {
                counters.damaged += 1;
                if counters.damaged > DAMAGE_TOLD {
                    return ControlFlow::Continue(());
                }
                take(Item::Said(&format!("left out a message: {fault}")))
            }
        }
    }

    fn nobody(&self) -> NoLaser {
        let (name, domain) = (&self.name, self.node.domain());
        let why = format!(
            "{name}: no scan came in domain {domain} within {} s: is it published, and in this domain (ROS_DOMAIN_ID)?",
            GIVEN_UP_AFTER.as_secs()
        );
        NoLaser { port: name.clone(), why: GaveUp::NotOpened(why) }
    }
}

/// Wakes the thread that waits.
struct Unpark(Thread);

impl Wake for Unpark {
    fn wake(self: Arc<Self>) {
        self.0.unpark();
    }
}

/// Messages that a publisher has numbered, and that did not come, or went before they were taken.
#[derive(Default)]
struct Gaps(HashMap<GUID, i64>);

impl Gaps {
    fn take(&mut self, writer: GUID, number: rustdds::SequenceNumber) -> u32 {
        let number = i64::from(number);
        let before = self.0.insert(writer, number);
        before.map_or(0, |before| u32::try_from((number - before - 1).max(0)).unwrap_or(u32::MAX))
    }
}
