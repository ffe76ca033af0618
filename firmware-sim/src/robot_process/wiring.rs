//! What a robot is plugged to, and who may reach it.

use std::net::SocketAddr;
use std::path::PathBuf;

use anyhow::{Result, anyhow};
use lrfslam_robot::wire::key::Key;

/// Why others may not reach a robot without a key.
const OPEN: &str =
    "whoever reaches this address commands the robot: give it a key (--key-file), or listen at 127.0.0.1";

/// Where the host is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum HostLine {
    /// At a serial port, at this rate, bit/s.
    Serial(PathBuf, u32),
    /// At a pseudo-terminal that is made, under this name.
    Terminal(PathBuf),
    /// Comes by TCP, one at a time.
    Tcp(SocketAddr),
}

/// What a robot is plugged to.
#[derive(Debug, Clone)]
pub struct Wiring {
    /// The laser's serial port; it may be unplugged and plugged in again.
    pub laser: PathBuf,
    /// The host.
    pub host: HostLine,
    /// Who does not know it is not listened to; without one the network is this computer.
    pub key: Option<Key>,
    /// Chance that a frame on the host's line is damaged or lost, 0–1, and the seed of that.
    pub faults: (f32, u64),
}

impl Wiring {
    /// Looks whether others would command the robot.
    ///
    /// # Errors
    /// If it has no key, and is to listen at an address that other computers reach.
    pub fn check(&self) -> Result<()> {
        match &self.host {
            HostLine::Tcp(address) if self.key.is_none() && !address.ip().is_loopback() => {
                Err(anyhow!("{address}: {OPEN}"))
            }
            _ => Ok(()),
        }
    }
}
