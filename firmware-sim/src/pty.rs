//! Serves a virtual laser range finder on a pseudo-terminal, so that any driver opens it as a serial port.
//!
//! The client's baud rate is read from the terminal, also a rate that plain `tcgetattr` does not know; bytes take the time
//! that the line's rate gives them; what nobody reads is dropped once 64 KiB wait, which is what Linux keeps for a real
//! port (a pseudo-terminal alone keeps 4 to 12); unplugging closes the terminal and takes its name away.

use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Context, Result};
use lrfslam_core::time::{Duration, Instant};
use rustix::event::{PollFd, PollFlags, Timespec};
use rustix::fs::{Mode, OFlags};
use rustix::io::{Errno, FdFlags};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};

use crate::cable::{Cable, resample};
use crate::fault::{FaultLink, FaultPlan};
use crate::virtual_lrf::VirtualLrf;

/// Bytes are handed over at least this often while some are under way: the time resolution of the line.
const GRAIN: Duration = Duration::from_millis(1);
/// Bytes that wait for a slow client, as many as the kernel keeps for a serial port.
const KERNEL_BUFFER: usize = 64 * 1024;
/// Longest sleep, so that a stop is noticed.
const IDLE: Duration = Duration::from_millis(20);

/// A pseudo-terminal under a stable name.
pub(crate) struct Terminal {
    master: OwnedFd,
    link: PathBuf,
    target: PathBuf,
}

/// What happened on the line so far.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct LineReport {
    /// Writes of the device (replies and scans).
    pub writes: u32,
    /// Bytes that nobody took in time.
    pub dropped: u64,
    /// Writes damaged or lost by the fault plan, both ways.
    pub faults: u32,
}

/// The time since this call.
pub fn wall_clock() -> impl FnMut() -> Instant {
    let started = std::time::Instant::now();
    move || Instant::from_micros(started.elapsed().as_micros() as i64)
}

/// Serves `device` under the symbolic link `link` until `stop` is set; the link is removed at the end.
///
/// * `clock` — the device's time, from zero on; [`wall_clock`] where nothing else is wanted
///
/// # Errors
/// If no pseudo-terminal or link can be made.
pub fn serve(
    device: &mut dyn VirtualLrf,
    link: &Path,
    plan: FaultPlan,
    seed: u64,
    clock: &mut dyn FnMut() -> Instant,
    stop: &AtomicBool,
) -> Result<LineReport> {
    let mut terminal = Some(Terminal::open(link)?);
    let mut line = Line::new(plan, seed);
    while !stop.load(Ordering::Relaxed) {
        match (&terminal, plan.is_unplugged(clock())) {
            (Some(_), true) => terminal = None,
            (None, false) => terminal = Some(Terminal::open(link)?),
            _ => {}
        }
        let wait = line.step(device, terminal.as_ref(), clock());
        sleep(terminal.as_ref(), wait);
    }
    line.report.faults = line.to_host.faults() + line.to_device.faults();
    Ok(line.report)
}

impl AsFd for Terminal {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.master.as_fd()
    }
}

impl Terminal {
    pub(crate) fn open(link: &Path) -> Result<Self> {
        let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).context("pseudo-terminal")?;
        // A program that this one starts must not hold the terminal open.
        rustix::io::fcntl_setfd(&master, FdFlags::CLOEXEC).context("pseudo-terminal")?;
        rustix::fs::fcntl_setfl(&master, OFlags::RDWR | OFlags::NONBLOCK).context("pseudo-terminal")?;
        grantpt(&master).context("pseudo-terminal")?;
        unlockpt(&master).context("pseudo-terminal")?;
        let name = ptsname(&master, Vec::new()).context("pseudo-terminal")?;
        // Opened and closed once: from now on the master tells whether a client is there. Raw, so that nothing is echoed to the
        // device before the client sets the port up.
        let slave = rustix::fs::open(&name, OFlags::RDWR | OFlags::NOCTTY, Mode::empty()).context("pseudo-terminal")?;
        let mut settings = tcgetattr(&slave).context("pseudo-terminal")?;
        settings.make_raw();
        settings.set_speed(9600).context("pseudo-terminal")?;
        tcsetattr(&slave, OptionalActions::Now, &settings).context("pseudo-terminal")?;
        let target = name.to_string_lossy().into_owned();
        replace_link(&target, link)?;
        Ok(Self { master, link: link.to_owned(), target: target.into() })
    }

    /// The rate that the client set, bit/s.
    fn baud(&self) -> u32 {
        tcgetattr(&self.master).map_or(9600, |settings| settings.output_speed())
    }

    pub(crate) fn has_client(&self) -> bool {
        let mut polled = [PollFd::new(&self.master, PollFlags::IN)];
        let _ = rustix::event::poll(&mut polled, Some(&Timespec { tv_sec: 0, tv_nsec: 0 }));
        !polled[0].revents().contains(PollFlags::HUP)
    }

    fn read(&self) -> Vec<u8> {
        let mut buffer = [0; 1024];
        let length = rustix::io::read(&self.master, &mut buffer).unwrap_or(0);
        buffer[..length].to_vec()
    }

    /// Writes what the terminal takes; returns the number of bytes that it did not.
    fn write(&self, bytes: &[u8]) -> usize {
        let mut rest = bytes;
        while !rest.is_empty() {
            match rustix::io::write(&self.master, rest) {
                Ok(0) => break,
                Ok(written) => rest = &rest[written..],
                Err(Errno::INTR) => {}
                Err(_) => break,
            }
        }
        rest.len()
    }
}

impl Drop for Terminal {
    fn drop(&mut self) {
        // Another simulator may have taken the name meanwhile.
        if std::fs::read_link(&self.link).is_ok_and(|target| target == self.target) {
            let _ = std::fs::remove_file(&self.link);
        }
    }
}

/// Puts a symbolic link in place of an old one; never in place of a file.
fn replace_link(target: &str, link: &Path) -> Result<()> {
    if link.symlink_metadata().is_ok_and(|old| old.file_type().is_symlink()) {
        std::fs::remove_file(link).with_context(|| format!("removing the old link {}", link.display()))?;
    }
    std::os::unix::fs::symlink(target, link).with_context(|| format!("making the link {}", link.display()))
}

/// The way between terminal and device.
struct Line {
    cable: Cable,
    /// Arrived, but not taken by the terminal yet.
    waiting: Vec<u8>,
    to_host: FaultLink,
    to_device: FaultLink,
    report: LineReport,
}

impl Line {
    fn new(plan: FaultPlan, seed: u64) -> Self {
        Self {
            cable: Cable::default(),
            waiting: Vec::new(),
            to_host: FaultLink::new(plan.damage, seed),
            to_device: FaultLink::new(plan.damage, seed ^ 0x5EED),
            report: LineReport::default(),
        }
    }

    /// Moves bytes both ways; returns how long nothing will happen.
    fn step(&mut self, device: &mut dyn VirtualLrf, terminal: Option<&Terminal>, now: Instant) -> Duration {
        let terminal = terminal.filter(|terminal| terminal.has_client());
        let host_baud = terminal.map_or(9600, Terminal::baud);
        let bytes = terminal.map(Terminal::read).unwrap_or_default();
        if !bytes.is_empty() {
            let heard = device.baud(now).map_or_else(|| bytes.clone(), |baud| resample(&bytes, host_baud, baud));
            device.receive(now, &self.to_device.pass(now, heard));
        }
        device.timeout(now);
        while let Some(mut emission) = device.poll() {
            self.report.writes += 1;
            emission.bytes = self.to_host.pass(now, emission.bytes);
            self.cable.push(emission);
        }
        let arrived = self.cable.arrived(now, host_baud);
        self.deliver(terminal, &arrived);
        let retry = if self.waiting.is_empty() { IDLE } else { GRAIN };
        let next = device.deadline().min(self.cable.next_arrival(now, GRAIN).unwrap_or(now + IDLE)).min(now + retry);
        Duration::from_micros(next.since(now).micros.clamp(100, IDLE.micros))
    }
}

impl Line {
    /// Hands over what arrived; without a client it is lost.
    fn deliver(&mut self, terminal: Option<&Terminal>, arrived: &[u8]) {
        let Some(terminal) = terminal else {
            self.report.dropped += (arrived.len() + self.waiting.len()) as u64;
            return self.waiting.clear();
        };
        let room = KERNEL_BUFFER.saturating_sub(self.waiting.len()).min(arrived.len());
        self.waiting.extend(&arrived[..room]);
        self.report.dropped += (arrived.len() - room) as u64;
        let left = terminal.write(&self.waiting);
        self.waiting.drain(..self.waiting.len() - left);
    }
}

/// Sleeps, but no longer than until the client says something.
fn sleep(terminal: Option<&Terminal>, wait: Duration) {
    match terminal.filter(|terminal| terminal.has_client()) {
        Some(terminal) => {
            let mut polled = [PollFd::new(&terminal.master, PollFlags::IN)];
            let timeout = Timespec { tv_sec: 0, tv_nsec: wait.micros * 1000 };
            let _ = rustix::event::poll(&mut polled, Some(&timeout));
        }
        None => std::thread::sleep(std::time::Duration::from_micros(wait.micros as u64)),
    }
}
