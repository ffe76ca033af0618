//! The loop over scans that `run` and `replay` share: counts now, a map once the mapper is plugged into [`Tally::take`].

use std::ops::ControlFlow;
use std::sync::atomic::AtomicBool;

use clap::Args;
use lrfslam_core::scan::RangeScan;
use lrfslam_core::time::Instant;

use super::laser::say;
use super::{Failure, print};
use crate::live::{Item, ScanSource, SourceReport, for_each_scan};

/// When to end by itself.
#[derive(Debug, Args)]
pub(super) struct Limits {
    /// End after so many scans.
    #[arg(long, value_name = "N")]
    scans: Option<u64>,
    /// End after so many seconds of scans.
    #[arg(long, value_name = "S")]
    seconds: Option<f64>,
    /// No lines on the way; only the result.
    #[arg(long, short)]
    quiet: bool,
}

/// Delivers every scan of `source`, and prints how it went.
pub(super) fn deliver(source: &ScanSource, stop: &AtomicBool, limits: &Limits) -> Result<(), Failure> {
    let mut tally = Tally::default();
    let done = for_each_scan(source, stop, &mut |item| {
        match item {
            Item::Scan(scan) => tally.take(&scan),
            Item::Identified(identity) if !limits.quiet => say(identity.model.trim()),
            Item::Said(text) if !limits.quiet => say(text),
            Item::Identified(_) | Item::Said(_) => {}
        }
        if tally.reached(limits) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    });
    let report = done.map_err(Failure::Start)?;
    print(&tally.result(&report))
}

/// What came.
#[derive(Debug, Default)]
struct Tally {
    scans: u64,
    beams: u64,
    first: Option<Instant>,
    last: Instant,
}

impl Tally {
    /// One scan: here the mapper is called.
    fn take(&mut self, scan: &RangeScan<'_>) {
        self.first.get_or_insert(scan.stamp);
        self.last = scan.stamp;
        self.scans += 1;
        self.beams += scan.beams.len() as u64;
    }

    fn seconds(&self) -> f64 {
        self.first.map_or(0.0, |first| self.last.since(first).micros as f64 * 1e-6)
    }

    fn reached(&self, limits: &Limits) -> bool {
        limits.scans.is_some_and(|scans| self.scans >= scans)
            || limits.seconds.is_some_and(|seconds| self.seconds() >= seconds)
    }

    fn result(&self, report: &SourceReport) -> String {
        let seconds = self.seconds();
        let rate = if seconds > 0.0 { (self.scans - 1) as f64 / seconds } else { 0.0 };
        let mut text =
            format!("{} scans, {} beams, {seconds:.1} s, {rate:.2} scans a second\n", self.scans, self.beams);
        let counters = report.counters;
        text.push_str(&format!("{} refused as damaged, {} restarts\n", counters.damaged, counters.restarts));
        if report.overrun > 0 {
            text.push_str(&format!("{} scans were dropped: the computer is too slow for this laser\n", report.overrun));
        }
        text
    }
}
