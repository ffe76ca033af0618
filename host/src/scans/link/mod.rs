//! Byte links to a laser range finder or a robot: a serial port, a TCP connection, datagrams, or a test's own memory.
//!
//! A link moves bytes and sets the rate; what they mean is the core's business, and when to send them the
//! [`driver`](crate::scans::driver)'s. Faults are not here but where a test puts them: in front of the far end.

mod serial;
mod tcp;
mod udp;

use std::io;
use std::str::FromStr;
use std::time::Duration;

pub use serial::SerialLink;
pub use tcp::TcpLink;
pub use udp::UdpLink;

/// Two-way bytes.
pub trait Link: Send {
    /// Waits up to `wait` for bytes, and puts them into `buffer`; 0 if none came.
    ///
    /// # Errors
    /// If the far end is gone: unplugged, closed.
    fn receive(&mut self, buffer: &mut [u8], wait: Duration) -> io::Result<usize>;

    /// Sends all of `bytes`.
    ///
    /// # Errors
    /// If the far end is gone.
    fn send(&mut self, bytes: &[u8]) -> io::Result<()>;

    /// Sets the rate, bit/s, once everything sent is out; links without a rate ignore it.
    ///
    /// # Errors
    /// If the port cannot do that rate, or is gone.
    fn set_baud(&mut self, baud: u32) -> io::Result<()>;

    /// Sets the DTR line, which on an RPLIDAR A1's adapter stops the motor; links without one ignore it.
    ///
    /// # Errors
    /// If the port is gone, or has no such line.
    fn set_dtr(&mut self, _on: bool) -> io::Result<()> {
        Ok(())
    }
}

/// Where a laser range finder or a robot is plugged in.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Address {
    /// A serial port by its path or name.
    Serial(String),
    /// Host and port: `tcp:192.168.0.10:10940`.
    Tcp(String),
    /// Host and port to send to, `udp:192.168.0.20:8080`, or the port at which to listen, `udp::8080`.
    Udp(String),
}

/// Port on which Hokuyo's Ethernet models listen.
pub const HOKUYO_TCP_PORT: u16 = 10_940;

impl FromStr for Address {
    type Err = String;

    /// `tcp:HOST[:PORT]`, `udp:HOST:PORT`, `udp::PORT`, else a serial port.
    fn from_str(text: &str) -> Result<Self, String> {
        if let Some(address) = text.strip_prefix("udp:") {
            let port = address.rsplit_once(':').and_then(|(_, port)| port.parse::<u16>().ok());
            let expected = || "expected udp:HOST:PORT, or udp::PORT to listen".to_owned();
            return port.map(|_| Address::Udp(address.to_owned())).ok_or_else(expected);
        }
        match text.strip_prefix("tcp:") {
            Some("") => Err("expected tcp:HOST or tcp:HOST:PORT".to_owned()),
            Some(host) if host.contains(':') => {
                let port = host.rsplit_once(':').filter(|(name, _)| !name.is_empty());
                let port = port.and_then(|(_, port)| port.parse::<u16>().ok()).filter(|port| *port > 0);
                let expected = || "expected tcp:HOST or tcp:HOST:PORT, the port from 1 to 65535".to_owned();
                port.map(|_| Address::Tcp(host.to_owned())).ok_or_else(expected)
            }
            Some(host) => Ok(Address::Tcp(format!("{host}:{HOKUYO_TCP_PORT}"))),
            None if text.is_empty() => Err("expected a serial port, tcp:HOST or udp:HOST:PORT".to_owned()),
            None => Ok(Address::Serial(text.to_owned())),
        }
    }
}

impl std::fmt::Display for Address {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Address::Serial(path) => out.write_str(path),
            Address::Tcp(host) => write!(out, "tcp:{host}"),
            Address::Udp(host) => write!(out, "udp:{host}"),
        }
    }
}

impl Address {
    /// Opens the link.
    ///
    /// # Errors
    /// With words that name the port and what to look at.
    pub fn open(&self) -> io::Result<Box<dyn Link>> {
        match self {
            Address::Serial(path) => Ok(Box::new(SerialLink::open(path)?)),
            Address::Tcp(host) => Ok(Box::new(TcpLink::open(host)?)),
            Address::Udp(host) => Ok(Box::new(UdpLink::open(host)?)),
        }
    }

    /// True if the link has a rate to set.
    pub fn has_baud(&self) -> bool {
        matches!(self, Address::Serial(_))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn address_is_read() {
        assert_eq!("/dev/ttyUSB0".parse(), Ok(Address::Serial("/dev/ttyUSB0".into())));
        assert_eq!("tcp:10.0.0.1".parse(), Ok(Address::Tcp("10.0.0.1:10940".into())));
        assert_eq!("tcp:lrf:99".parse(), Ok(Address::Tcp("lrf:99".into())));
        assert_eq!("udp:esp:99".parse(), Ok(Address::Udp("esp:99".into())));
        assert_eq!("udp::99".parse(), Ok(Address::Udp(":99".into())));
        for wrong in [
            "tcp:",
            "tcp:lrf:",
            "tcp::99",
            "tcp:lrf:0",
            "tcp:lrf:99999",
            "",
            "udp:",
            "udp:esp",
            "udp::port",
            "udp:esp:70000",
        ] {
            assert!(wrong.parse::<Address>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn port_that_is_not_there_is_named() {
        let error = Address::Serial("/dev/there-is-none".into()).open().err().unwrap().to_string();
        assert!(error.contains("/dev/there-is-none"), "{error}");
    }
}
