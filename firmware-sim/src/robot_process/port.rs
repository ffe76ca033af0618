//! A line of the robot's: a serial port, a pseudo-terminal of our own, or a TCP connection; bytes never wait for anybody.

use std::net::TcpStream;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::SyncSender;
use std::sync::{Arc, Weak};
use std::time::Duration as WallDuration;

use anyhow::{Context as _, Result};
use lrfslam_core::time::Instant;
use rustix::event::{PollFd, PollFlags, Timespec};
use rustix::fs::{Mode, OFlags};
use rustix::io::Errno;
use rustix::termios::{ControlModes, OptionalActions, QueueSelector, tcdrain, tcflush, tcgetattr, tcsetattr};

use super::clock::Clock;
use crate::pty::Terminal;

/// Bytes that wait for a line that is slower than the program.
const PENDING_MAX: usize = 16 * 1024;
/// Longest wait for bytes, so that an end is noticed.
const LISTEN: Timespec = Timespec { tv_sec: 0, tv_nsec: 50_000_000 };

/// What a line brought.
#[derive(Debug)]
pub(super) enum News {
    /// Bytes, and when they came.
    Bytes(Instant, Vec<u8>),
    /// It is gone.
    Gone,
}

enum Line {
    Serial(OwnedFd),
    /// Like a UART: what is sent while nobody listens is gone, and nobody is told.
    Terminal(Terminal),
    Tcp(TcpStream),
}

impl AsFd for Line {
    fn as_fd(&self) -> BorrowedFd<'_> {
        match self {
            Line::Serial(fd) => fd.as_fd(),
            Line::Terminal(terminal) => terminal.as_fd(),
            Line::Tcp(stream) => stream.as_fd(),
        }
    }
}

impl Line {
    /// True if there is no hearer who could lack what is not sent.
    fn is_idle(&self) -> bool {
        matches!(self, Line::Terminal(terminal) if !terminal.has_client())
    }
}

/// A line that is open; see the [module](self).
pub(super) struct Port {
    line: Arc<Line>,
    pending: Vec<u8>,
    /// Its number among all that were opened: what an older one still says is not heard.
    pub(super) generation: u32,
}

impl Port {
    /// Opens a serial port: 8 data bits, no parity, no flow control.
    pub(super) fn serial(path: &Path, baud: u32) -> Result<Self> {
        let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
        let fd = rustix::fs::open(path, flags, Mode::empty()).with_context(|| format!("{}", path.display()))?;
        let not_serial = || format!("{}: cannot be set up as a serial port", path.display());
        let mut settings = tcgetattr(&fd).with_context(not_serial)?;
        settings.make_raw();
        settings.control_modes |= ControlModes::CLOCAL | ControlModes::CREAD;
        settings.set_speed(baud).with_context(not_serial)?;
        tcsetattr(&fd, OptionalActions::Now, &settings).with_context(not_serial)?;
        // What came before this moment belongs to nobody.
        let _ = tcflush(&fd, QueueSelector::IFlush);
        Ok(Self::new(Line::Serial(fd)))
    }

    /// Makes a pseudo-terminal and the symbolic link `path` to it.
    pub(super) fn terminal(path: &Path) -> Result<Self> {
        Ok(Self::new(Line::Terminal(Terminal::open(path)?)))
    }

    /// A connection that was accepted.
    pub(super) fn tcp(stream: TcpStream) -> Result<Self> {
        stream.set_nonblocking(true).context("the connection")?;
        let _ = stream.set_nodelay(true);
        Ok(Self::new(Line::Tcp(stream)))
    }

    fn new(line: Line) -> Self {
        Self { line: Arc::new(line), pending: Vec::new(), generation: 0 }
    }

    /// Sends what comes, as news made by `tell`, until the line is gone or dropped.
    pub(super) fn listen<T: Send + 'static>(
        &self,
        clock: Clock,
        sender: SyncSender<T>,
        tell: impl Fn(News) -> T + Send + 'static,
    ) {
        let line = Arc::downgrade(&self.line);
        std::thread::spawn(move || {
            while let Some(news) = hear(&line, clock) {
                let is_end = matches!(news, News::Gone);
                if sender.send(tell(news)).is_err() || is_end {
                    return;
                }
            }
        });
    }

    /// Bytes that wait to be sent.
    pub(super) fn pending(&self) -> usize {
        self.pending.len()
    }

    /// Bytes that [`write`](Self::write) takes now.
    pub(super) fn room(&self) -> usize {
        PENDING_MAX.saturating_sub(self.pending.len())
    }

    /// Sends bytes as far as the line takes them; the rest waits for [`flush`](Self::flush).
    pub(super) fn write(&mut self, bytes: &[u8]) {
        self.pending.extend_from_slice(bytes);
        self.flush();
    }

    /// Sends what waits, as far as the line takes it. A line that is gone is noticed by its listener.
    pub(super) fn flush(&mut self) {
        if self.line.is_idle() {
            self.pending.clear();
        }
        while !self.pending.is_empty() {
            match rustix::io::write(&*self.line, &self.pending) {
                Ok(written) if written > 0 => {
                    self.pending.drain(..written);
                }
                Err(Errno::INTR) => {}
                _ => break,
            }
        }
    }

    /// Sets the rate once all is out; a rate that the port cannot do leaves the old one, at which nothing will be heard.
    pub(super) fn set_baud(&mut self, baud: u32) {
        for _ in 0..100 {
            self.flush();
            if self.pending.is_empty() {
                break;
            }
            std::thread::sleep(WallDuration::from_millis(5));
        }
        let Line::Serial(fd) = &*self.line else { return };
        let _ = tcdrain(fd);
        let Ok(mut settings) = tcgetattr(fd) else { return };
        if settings.set_speed(baud).is_ok() {
            let _ = tcsetattr(fd, OptionalActions::Now, &settings);
        }
    }
}

/// Waits for bytes; `None` once nobody holds the line any more.
fn hear(line: &Weak<Line>, clock: Clock) -> Option<News> {
    let mut buffer = [0; 4096];
    loop {
        let line = line.upgrade()?;
        if line.is_idle() {
            std::thread::sleep(WallDuration::from_millis(20));
            continue;
        }
        let mut polled = [PollFd::new(&*line, PollFlags::IN)];
        let _ = rustix::event::poll(&mut polled, Some(&LISTEN));
        if polled[0].revents().is_empty() {
            continue;
        }
        match rustix::io::read(&*line, &mut buffer) {
            Ok(count) if count > 0 => return Some(News::Bytes(clock.now(), buffer[..count].to_vec())),
            Err(Errno::AGAIN | Errno::INTR) => {}
            // The last client of a pseudo-terminal has closed it: the next one is waited for.
            _ if matches!(&*line, Line::Terminal(_)) => {}
            _ => return Some(News::Gone),
        }
    }
}

/// Accepts connections until `stop` is set.
pub(super) fn accept<T: Send + 'static>(
    listener: std::net::TcpListener,
    sender: SyncSender<T>,
    stop: Arc<AtomicBool>,
    tell: impl Fn(TcpStream) -> T + Send + 'static,
) {
    std::thread::spawn(move || {
        while !stop.load(Ordering::Relaxed) {
            let mut polled = [PollFd::new(&listener, PollFlags::IN)];
            let _ = rustix::event::poll(&mut polled, Some(&LISTEN));
            if polled[0].revents().is_empty() {
                continue;
            }
            if let Ok((stream, _)) = listener.accept()
                && sender.send(tell(stream)).is_err()
            {
                return;
            }
        }
    });
}
