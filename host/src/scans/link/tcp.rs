//! A TCP connection, as Hokuyo's Ethernet models offer it.

use std::io::{self, ErrorKind, Read as _, Write as _};
use std::net::{TcpStream, ToSocketAddrs as _};
use std::time::Duration;

use super::Link;

/// A connection that is open.
pub struct TcpLink {
    stream: TcpStream,
}

/// How long to wait for the connection, and for a send.
const PATIENCE: Duration = Duration::from_secs(2);

impl TcpLink {
    /// Connects to `HOST:PORT`.
    ///
    /// # Errors
    /// With the address.
    pub fn open(host: &str) -> io::Result<Self> {
        let named = |error: io::Error| {
            let advice = match error.kind() {
                ErrorKind::ConnectionRefused => " (is this the laser's TCP port?)",
                ErrorKind::TimedOut | ErrorKind::HostUnreachable | ErrorKind::NetworkUnreachable => {
                    " (is the laser on, and in this network?)"
                }
                _ => "",
            };
            io::Error::new(error.kind(), format!("tcp:{host}: {error}{advice}"))
        };
        let mut last = io::Error::new(ErrorKind::NotFound, format!("{host}: no such host"));
        for address in host.to_socket_addrs().map_err(named)? {
            match TcpStream::connect_timeout(&address, PATIENCE) {
                Ok(stream) => {
                    stream.set_nodelay(true)?;
                    stream.set_write_timeout(Some(PATIENCE))?;
                    return Ok(Self { stream });
                }
                Err(error) => last = named(error),
            }
        }
        Err(last)
    }
}

impl Link for TcpLink {
    fn receive(&mut self, buffer: &mut [u8], wait: Duration) -> io::Result<usize> {
        self.stream.set_read_timeout(Some(wait.max(Duration::from_millis(1))))?;
        match self.stream.read(buffer) {
            Ok(0) => Err(ErrorKind::BrokenPipe.into()),
            Ok(count) => Ok(count),
            Err(error) => match error.kind() {
                ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted => Ok(0),
                _ => Err(error),
            },
        }
    }

    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.stream.write_all(bytes)
    }

    fn set_baud(&mut self, _baud: u32) -> io::Result<()> {
        Ok(())
    }
}
