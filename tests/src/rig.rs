//! Driver, cable with faults, device, and the clock.

use std::collections::VecDeque;

use lrfslam_core::scan::RangeScan;
use lrfslam_core::time::{Duration, Instant};
use lrfslam_firmware_sim::cable::{Cable, resample};
use lrfslam_firmware_sim::fault::{FaultLink, FaultPlan};
use lrfslam_firmware_sim::virtual_lrf::{Emission, VirtualLrf};
use lrfslam_lrf::driver::{Event, Input, LrfDriver, Output, run_input};

use crate::oracle::{Seen, published};

/// Sent scans that are remembered: a published one must be among them.
const REMEMBERED: usize = 64;

/// Reads the scan in a device's write.
pub type Oracle = fn(&[u8]) -> Option<Vec<Seen>>;
/// Says whether a published scan is of what is there.
pub type Judge = fn(&RangeScan<'_>) -> bool;

/// What happened so far.
#[derive(Debug, Clone, Default)]
pub struct RigReport {
    /// Scans that the device sent.
    pub sent: u32,
    /// Scans that reached the host undamaged, while it was there.
    pub whole: u32,
    /// Scans published that the device had sent so.
    pub published: u32,
    /// Scans published that the device had never sent.
    pub damaged: u32,
    /// Writes damaged or lost, both ways.
    pub faults: u32,
    /// Times without a published scan after trouble or unplugging, until the next: longest, and all together.
    pub longest_gap: Duration,
    /// Events in words, without scans.
    pub events: Vec<String>,
    /// Stamp of the last published scan.
    pub last_stamp: Instant,
    /// From plugging in to the next published scan, each time.
    pub recoveries: Vec<Duration>,
}

impl RigReport {
    /// Median and longest time from plugging in to a published scan, seconds.
    pub fn recovery(&self) -> (f64, f64) {
        let mut times: Vec<i64> = self.recoveries.iter().map(|time| time.micros).collect();
        times.sort_unstable();
        let seconds = |micros: Option<&i64>| micros.map_or(0.0, |micros| *micros as f64 / 1e6);
        (seconds(times.get(times.len() / 2)), seconds(times.last()))
    }
}

/// See the [module](self).
pub struct Rig<'d> {
    /// The clock.
    pub now: Instant,
    /// What happened.
    pub report: RigReport,
    driver: Box<dyn LrfDriver + 'd>,
    device: Box<dyn VirtualLrf>,
    oracle: Oracle,
    judge: Option<Judge>,
    plan: FaultPlan,
    cable: Cable,
    to_host: FaultLink,
    to_device: FaultLink,
    upstream: VecDeque<(Instant, Vec<u8>, u32)>,
    host_baud: u32,
    plugged: bool,
    deadline: Instant,
    grain: Duration,
    remembered: VecDeque<Vec<Seen>>,
    last_published: Instant,
    plugged_in: Option<Instant>,
    /// Host cuts bytes into pieces of this size; 0 as they come.
    pub piece: usize,
}

impl<'d> Rig<'d> {
    /// Plugs `driver` to `device`; nothing has happened yet.
    pub fn new(driver: Box<dyn LrfDriver + 'd>, device: Box<dyn VirtualLrf>, oracle: Oracle) -> Self {
        Self {
            now: Instant::default(),
            report: RigReport::default(),
            driver,
            device,
            oracle,
            judge: None,
            plan: FaultPlan::default(),
            cable: Cable::default(),
            to_host: FaultLink::new(0.0, 0),
            to_device: FaultLink::new(0.0, 0),
            upstream: VecDeque::new(),
            host_baud: 9600,
            plugged: false,
            deadline: Instant::default(),
            grain: Duration::from_millis(5),
            remembered: VecDeque::new(),
            last_published: Instant::default(),
            plugged_in: None,
            piece: 0,
        }
    }

    /// The same with faults.
    pub fn with_faults(mut self, plan: FaultPlan, seed: u64) -> Self {
        self.plan = plan;
        self.to_host = FaultLink::new(plan.damage, seed);
        self.to_device = FaultLink::new(plan.damage, seed ^ 0x5EED);
        self
    }

    /// The same for a laser that spins, whose turns are in no one write: `judge` says which are right.
    pub fn judged_by(mut self, judge: Judge) -> Self {
        self.judge = Some(judge);
        self
    }

    /// The device itself.
    pub fn device(&mut self) -> &mut dyn VirtualLrf {
        self.device.as_mut()
    }

    /// Counters of the driver.
    pub fn counters(&self) -> lrfslam_lrf::driver::Counters {
        self.driver.counters()
    }

    /// Runs for `span`.
    pub fn run_for(&mut self, span: Duration) {
        let until = self.now + span;
        while self.next_event() < until {
            self.step();
        }
        self.now = until;
    }

    /// Runs until the device has sent so many scans.
    pub fn run_until_sent(&mut self, scans: u32) {
        while self.report.sent < scans {
            self.step();
        }
    }

    /// Runs until a scan is published, or for `at_most`: how long that took.
    pub fn time_to_scan(&mut self, at_most: Duration) -> Option<Duration> {
        let (start, before) = (self.now, self.report.published);
        while self.report.published == before {
            if self.now.since(start) > at_most {
                return None;
            }
            self.step();
        }
        Some(self.now.since(start))
    }

    /// Asks the driver to stop, and runs until it has.
    pub fn stop(&mut self) {
        self.give(Input::Stop);
        self.run_for(Duration::from_millis(5000));
    }

    fn next_event(&self) -> Instant {
        let plug = next_plug_event(&self.plan, self.now);
        let upstream = self.upstream.front().map(|(at, _, _)| *at);
        let arrival = self.cable.next_arrival(self.now, self.grain);
        let mut next = self.deadline.min(self.device.deadline());
        for at in [plug, upstream, arrival].into_iter().flatten() {
            next = next.min(at);
        }
        if self.plugged {
            next
        } else {
            next.min(self.now.max(next_plug_event(&self.plan, self.now).unwrap_or(self.now)))
        }
    }

    /// Jumps to the next event, and lets it happen.
    pub fn step(&mut self) {
        self.now = self.now.max(self.next_event());
        self.plug();
        self.move_upstream();
        self.device.timeout(self.now);
        self.move_emissions();
        self.move_downstream();
        if self.now >= self.deadline {
            self.give(Input::Timeout);
        }
    }

    fn plug(&mut self) {
        let plugged = !self.plan.is_unplugged(self.now);
        if plugged == self.plugged {
            return;
        }
        self.plugged = plugged;
        if plugged {
            self.plugged_in = Some(self.now);
            self.give(Input::Connected);
        } else {
            self.cable.cut();
            self.upstream.clear();
            self.give(Input::Disconnected);
        }
    }

    fn move_upstream(&mut self) {
        while self.upstream.front().is_some_and(|(at, _, _)| *at <= self.now) {
            let Some((_, bytes, host_baud)) = self.upstream.pop_front() else { return };
            let heard = match self.device.baud(self.now) {
                Some(baud) => resample(&bytes, host_baud, baud),
                None => bytes,
            };
            let heard = self.to_device.pass(self.now, heard);
            self.device.receive(self.now, &heard);
        }
    }

    fn move_emissions(&mut self) {
        while let Some(emission) = self.device.poll() {
            let scan = (self.oracle)(&emission.bytes);
            let sent = emission.bytes.clone();
            let bytes = self.to_host.pass(self.now, emission.bytes);
            if let Some(scan) = scan {
                self.report.sent += 1;
                let same_rate = emission.baud.is_none_or(|baud| baud == self.host_baud);
                self.report.whole += u32::from(bytes == sent && self.plugged && same_rate);
                self.remembered.push_back(scan);
                if self.remembered.len() > REMEMBERED {
                    self.remembered.pop_front();
                }
            }
            self.cable.push(Emission { bytes, ..emission });
        }
        self.report.faults = self.to_host.faults() + self.to_device.faults();
    }

    fn move_downstream(&mut self) {
        let bytes = self.cable.arrived(self.now, self.host_baud);
        if bytes.is_empty() || !self.plugged {
            return;
        }
        let piece = if self.piece == 0 { bytes.len() } else { self.piece };
        for bytes in bytes.chunks(piece) {
            self.give(Input::Bytes(bytes));
        }
    }

    fn give(&mut self, input: Input<'_>) {
        let mut outputs = Vec::new();
        let judge = self.judge;
        let mut sink = |output: Output<'_>| outputs.push(Owned::new(output, judge));
        self.deadline = run_input(self.driver.as_mut(), self.now, input, &mut sink);
        outputs.into_iter().for_each(|output| self.act(output));
    }

    fn act(&mut self, output: Owned) {
        match output {
            Owned::Transmit(bytes) => {
                let took = Duration::from_micros(bytes.len() as i64 * 10_000_000 / i64::from(self.host_baud.max(1)));
                if self.plugged {
                    self.upstream.push_back((self.now + took, bytes, self.host_baud));
                }
            }
            Owned::SetBaud(rate) => self.host_baud = rate,
            Owned::Scan(stamp, scan, judged) => {
                match judged.unwrap_or_else(|| self.remembered.contains(&scan)) {
                    true => self.report.published += 1,
                    false => self.report.damaged += 1,
                }
                let gap = self.now.since(self.last_published);
                self.report.longest_gap = self.report.longest_gap.max(gap);
                self.last_published = self.now;
                self.report.last_stamp = stamp;
                let plugged_in = self.plugged_in.take();
                self.report.recoveries.extend(plugged_in.map(|at| self.now.since(at)));
            }
            Owned::Said(text) => self.report.events.push(text),
        }
    }
}

/// An output, kept.
enum Owned {
    Transmit(Vec<u8>),
    SetBaud(u32),
    /// Stamp, beams, and whether they are right, if that is judged.
    Scan(Instant, Vec<Seen>, Option<bool>),
    Said(String),
}

impl Owned {
    fn new(output: Output<'_>, judge: Option<Judge>) -> Self {
        match output {
            Output::Transmit(bytes) => Owned::Transmit(bytes.to_vec()),
            Output::SetBaud(rate) => Owned::SetBaud(rate),
            Output::Event(Event::Scan(scan)) => {
                Owned::Scan(scan.stamp, published(&scan), judge.map(|judge| judge(&scan)))
            }
            Output::Event(Event::Trouble(trouble)) => Owned::Said(trouble.to_string()),
            Output::Event(event) => Owned::Said(format!("{event:?}")),
            Output::Timeout(_) => Owned::Said("timeout among outputs".to_owned()),
        }
    }
}

/// The next instant at which the plug goes out or in.
fn next_plug_event(plan: &FaultPlan, now: Instant) -> Option<Instant> {
    let period = plan.unplug_every.micros;
    if period <= 0 {
        return None;
    }
    let (turn, within) = (now.micros.div_euclid(period), now.micros.rem_euclid(period));
    let next = if turn >= 1 && within < plan.unplugged_for.micros {
        turn * period + plan.unplugged_for.micros
    } else {
        (turn + 1) * period
    };
    Some(Instant::from_micros(next))
}
