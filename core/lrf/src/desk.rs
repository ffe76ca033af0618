//! A driver at a desk: what it puts out, in words; the test across it plays the sensor.

use super::driver::{Event, Input, LrfDriver, Output, run_input};
use lrfslam_scan::time::{Duration, Instant};
use std::string::String;
use std::vec::Vec;

/// A driver, what it has said so far, and when it wants to be woken.
pub(super) struct Desk<D> {
    pub(super) driver: D,
    pub(super) now: Instant,
    pub(super) said: Vec<String>,
    /// Of the scans so far.
    pub(super) stamps: Vec<Instant>,
    deadline: Instant,
    describe: fn(Output<'_>) -> String,
}

impl<D: LrfDriver> Desk<D> {
    /// A driver whose port has just been opened; `describe` says each output in words.
    pub(super) fn with(driver: D, describe: fn(Output<'_>) -> String) -> Self {
        let (now, deadline) = (Instant::default(), Instant::default());
        let mut desk = Self { driver, now, said: Vec::new(), stamps: Vec::new(), deadline, describe };
        desk.give(Input::Connected);
        desk
    }

    pub(super) fn give(&mut self, input: Input<'_>) {
        let (said, stamps, describe) = (&mut self.said, &mut self.stamps, self.describe);
        let mut sink = |output: Output<'_>| {
            if let Output::Event(Event::Scan(scan)) = output {
                stamps.push(scan.stamp);
            }
            said.push(describe(output));
        };
        self.deadline = run_input(&mut self.driver, self.now, input, &mut sink);
    }

    /// Bytes of the sensor, a while after the last.
    pub(super) fn answer(&mut self, after: Duration, bytes: &[u8]) {
        self.now = self.now + after;
        self.give(Input::Bytes(bytes));
    }

    pub(super) fn wait(&mut self) {
        self.now = self.deadline;
        self.give(Input::Timeout);
    }

    pub(super) fn heard(&mut self) -> Vec<String> {
        core::mem::take(&mut self.said)
    }
}

/// What is said alike of every family.
pub(super) fn in_words(output: Output<'_>) -> String {
    match output {
        Output::Transmit(bytes) => std::format!("{bytes:02X?}"),
        Output::SetBaud(rate) => std::format!("baud {rate}"),
        Output::Event(Event::Scan(scan)) => std::format!("scan of {}", scan.beams.len()),
        Output::Event(Event::Trouble(trouble)) => std::format!("{trouble}"),
        Output::Event(event) => std::format!("{event:?}"),
        Output::Timeout(_) => unreachable!(),
    }
}
