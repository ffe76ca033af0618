//! A link within the program: for tests, and for a simulator in the same process.

use std::io::{self, ErrorKind};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::Duration;

use crate::scans::link::Link;

/// The host's end.
pub struct MemoryLink {
    from_device: Receiver<Vec<u8>>,
    to_device: Sender<Sent>,
    rest: Vec<u8>,
}

/// What the host did at its end.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Sent {
    /// It sent bytes.
    Bytes(Vec<u8>),
    /// It set a rate, bit/s.
    Baud(u32),
}

/// The device's end. Dropping it unplugs.
pub struct FarEnd {
    /// Bytes to the host.
    pub to_host: Sender<Vec<u8>>,
    /// What the host does.
    pub from_host: Receiver<Sent>,
}

/// Both ends of a link.
pub fn memory_pair() -> (MemoryLink, FarEnd) {
    let (to_host, from_device) = channel();
    let (to_device, from_host) = channel();
    (MemoryLink { from_device, to_device, rest: Vec::new() }, FarEnd { to_host, from_host })
}

impl Link for MemoryLink {
    fn receive(&mut self, buffer: &mut [u8], wait: Duration) -> io::Result<usize> {
        if self.rest.is_empty() {
            match self.from_device.recv_timeout(wait) {
                Ok(bytes) => self.rest = bytes,
                Err(RecvTimeoutError::Timeout) => return Ok(0),
                Err(RecvTimeoutError::Disconnected) => return Err(ErrorKind::BrokenPipe.into()),
            }
        }
        let count = buffer.len().min(self.rest.len());
        buffer[..count].copy_from_slice(&self.rest[..count]);
        self.rest.drain(..count);
        Ok(count)
    }

    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.to_device.send(Sent::Bytes(bytes.to_vec())).map_err(|_| ErrorKind::BrokenPipe.into())
    }

    fn set_baud(&mut self, baud: u32) -> io::Result<()> {
        self.to_device.send(Sent::Baud(baud)).map_err(|_| ErrorKind::BrokenPipe.into())
    }
}
