//! A source's scans, pulled one by one instead of pushed.

use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::thread::JoinHandle;

use lrfslam_core::scan::RangeScan;

use super::{Item, NOTICED_AFTER, Say, ScanSource, SourceReport, Take, for_each_scan};
use crate::scans::log::LogScan;

/// The scans of a laser or a recording; a thread of its own fetches them when the first one is wanted, and says what else there is to say.
pub struct ScanStream {
    state: State,
    stop: &'static AtomicBool,
    /// For the thread: nothing more is wanted.
    enough: Arc<AtomicBool>,
}

/// Gives every scan of a source, and what else it has to say, to what takes them, until the flag is set or nothing more is taken.
pub type Fetch = Box<dyn FnOnce(&AtomicBool, &mut Take<'_>) -> anyhow::Result<SourceReport> + Send>;

enum State {
    New(Fetch, Say),
    Running(Receiver<LogScan>, JoinHandle<anyhow::Result<SourceReport>>),
    Ended,
}

impl ScanStream {
    /// * `stop` — ends it early; what was fetched until then is still handed out
    pub fn new(source: ScanSource, stop: &'static AtomicBool, say: Say) -> Self {
        Self::of(Box::new(move |enough, take| for_each_scan(&source, enough, take)), stop, say)
    }

    /// The same of a source of another kind.
    pub fn of(fetch: Fetch, stop: &'static AtomicBool, say: Say) -> Self {
        Self { state: State::New(fetch, say), stop, enough: Arc::default() }
    }

    /// How it ended, with nothing more wanted; told once, and only of what has begun.
    pub fn end(&mut self) -> Option<anyhow::Result<SourceReport>> {
        self.enough.store(true, Ordering::Relaxed);
        match std::mem::replace(&mut self.state, State::Ended) {
            State::Running(scans, thread) => {
                drop(scans);
                // Only a panic ends it without a report.
                Some(thread.join().unwrap_or_else(|_| Ok(SourceReport::default())))
            }
            _ => None,
        }
    }

    fn begin(&mut self) {
        let (sender, scans) = sync_channel(0);
        if let State::New(source, say) = std::mem::replace(&mut self.state, State::Ended) {
            let enough = self.enough.clone();
            let thread = std::thread::spawn(move || fetch(source, &enough, &sender, say));
            self.state = State::Running(scans, thread);
        }
    }
}

impl Iterator for ScanStream {
    type Item = LogScan;

    fn next(&mut self) -> Option<LogScan> {
        if matches!(self.state, State::New(..)) {
            self.begin();
        }
        let State::Running(scans, _) = &self.state else { return None };
        loop {
            if self.stop.load(Ordering::Relaxed) {
                self.enough.store(true, Ordering::Relaxed);
            }
            match scans.recv_timeout(NOTICED_AFTER) {
                Ok(scan) => return Some(scan),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return None,
            }
        }
    }
}

impl Drop for ScanStream {
    /// A laser is not left on.
    fn drop(&mut self) {
        let _ = self.end();
    }
}

fn fetch(
    source: Fetch,
    enough: &AtomicBool,
    scans: &SyncSender<LogScan>,
    mut say: Say,
) -> anyhow::Result<SourceReport> {
    let mut number = 0;
    source(enough, &mut |item| {
        match item {
            Item::Scan(scan) => {
                number += 1;
                if scans.send(taken(&scan, number)).is_err() {
                    return ControlFlow::Break(());
                }
            }
            Item::Identified(identity) => say(identity.model.trim()),
            Item::Said(text) => say(text),
        }
        ControlFlow::Continue(())
    })
}

/// A scan of a laser, its `number`th, kept as one of a log is.
pub fn taken(scan: &RangeScan<'_>, number: u64) -> LogScan {
    LogScan {
        stamp: scan.stamp,
        range_max_m: scan.range_max_m,
        beams: scan.beams.to_vec(),
        map_from_robot_odometry: None,
        robot_from_lrf: None,
        line: number,
    }
}
