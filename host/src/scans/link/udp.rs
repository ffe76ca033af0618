//! Datagrams, as a microcontroller with a radio sends a laser's bytes.
//!
//! What is in the datagrams, one after the other, is the stream of bytes. UDP may lose, double and reorder them: to a driver that is damage of
//! the line, which its sums and its turns show. Nobody is authenticated: this is for a network whose members are trusted.

use std::io::{self, ErrorKind, Read as _};
use std::net::{Ipv4Addr, SocketAddr, ToSocketAddrs as _, UdpSocket};
use std::ops::Range;
use std::time::{Duration, Instant};

use super::Link;

/// A socket that is open.
pub struct UdpLink {
    socket: UdpSocket,
    /// Whose datagrams are taken, and where ours go; while listening, nobody at first.
    peer: Option<SocketAddr>,
    /// It was named: nobody else takes its place.
    is_named: bool,
    /// When a datagram of the peer last came; at first, when the socket was opened.
    heard: Instant,
    /// When the peer was last called.
    called: Option<Instant>,
    /// The datagram that came last is at its front.
    memory: Box<[u8]>,
    /// What of it is still to be handed out.
    rest: Range<usize>,
}

/// The largest datagram: 16 bits of length.
const DATAGRAM: usize = 65_535;
/// A named peer from which nothing comes is called so often: it may have begun anew, and not know us.
const CALL_EVERY: Duration = Duration::from_secs(1);
/// While listening, a peer that is silent for so long makes room for another.
const PEER_GONE: Duration = Duration::from_secs(3);
/// A datagram of ours has at most so many bytes: none is cut up on the way.
const PAYLOAD: usize = 1_400;

impl UdpLink {
    /// Sends to `HOST:PORT` and takes what comes from there; or, with no host, listens at `:PORT`.
    ///
    /// # Errors
    /// With the address.
    pub fn open(address: &str) -> io::Result<Self> {
        Self::open_at(address).map_err(|error| io::Error::new(error.kind(), format!("udp:{address}: {error}")))
    }

    fn open_at(address: &str) -> io::Result<Self> {
        let any = |port| SocketAddr::from((Ipv4Addr::UNSPECIFIED, port));
        let (own, peer) = match address.strip_prefix(':') {
            Some(port) => (any(port.parse().map_err(|_| io::Error::from(ErrorKind::InvalidInput))?), None),
            None => {
                let none = || io::Error::new(ErrorKind::NotFound, "no such host");
                let peer = address.to_socket_addrs()?.next().ok_or_else(none)?;
                (if peer.is_ipv4() { any(0) } else { SocketAddr::from(([0_u16; 8], 0)) }, Some(peer))
            }
        };
        let socket = UdpSocket::bind(own)?;
        let (is_named, memory) = (peer.is_some(), vec![0; DATAGRAM].into_boxed_slice());
        Ok(Self { socket, peer, is_named, heard: Instant::now(), called: None, memory, rest: 0..0 })
    }

    /// Where it listens.
    ///
    /// # Errors
    /// Those of the system.
    pub fn local_addr(&self) -> io::Result<SocketAddr> {
        self.socket.local_addr()
    }

    /// An empty datagram says where we are, and is no byte: an LD06, which is asked nothing, would not know otherwise.
    fn call(&mut self) {
        let is_due = self.called.is_none_or(|at| at.elapsed() >= CALL_EVERY && self.heard.elapsed() >= CALL_EVERY);
        if let Some(peer) = self.peer.filter(|_| self.is_named && is_due) {
            self.called = Some(Instant::now());
            // A network that is away now may come.
            let _ = self.socket.send_to(&[], peer);
        }
    }

    /// Takes the next datagram, if it is the peer's.
    fn take(&mut self, wait: Duration) -> io::Result<()> {
        self.socket.set_read_timeout(Some(wait.max(Duration::from_millis(1))))?;
        let count = match self.socket.recv_from(&mut self.memory) {
            Ok((count, from)) if self.is_of_peer(from) => count,
            Ok(_) => 0,
            // Refused: nobody listens there yet. An earlier datagram of ours is what is meant.
            Err(error) => match error.kind() {
                ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted => 0,
                ErrorKind::ConnectionRefused | ErrorKind::ConnectionReset => 0,
                _ => return Err(error),
            },
        };
        self.rest = 0..count;
        Ok(())
    }

    /// The one who is heard first is the peer, until it is silent for a while.
    fn is_of_peer(&mut self, from: SocketAddr) -> bool {
        let is_free = !self.is_named && (self.peer.is_none() || self.heard.elapsed() >= PEER_GONE);
        if is_free {
            self.peer = Some(from);
        }
        let is_peer = self.peer == Some(from);
        if is_peer {
            self.heard = Instant::now();
        }
        is_peer
    }
}

impl Link for UdpLink {
    fn receive(&mut self, buffer: &mut [u8], wait: Duration) -> io::Result<usize> {
        if self.rest.is_empty() {
            self.call();
            self.take(wait)?;
        }
        let count = self.memory.get(self.rest.clone()).unwrap_or_default().read(buffer)?;
        self.rest.start += count;
        Ok(count)
    }

    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        // While listening, there is nobody to talk to before somebody is heard.
        let Some(peer) = self.peer else { return Ok(()) };
        for part in bytes.chunks(PAYLOAD) {
            match self.socket.send_to(part, peer) {
                Ok(_) => {}
                // Lost, as on the way: the driver asks again.
                Err(error) if is_passing(&error) => {}
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }

    fn set_baud(&mut self, _baud: u32) -> io::Result<()> {
        Ok(())
    }
}

/// The network or the peer is away for now.
fn is_passing(error: &io::Error) -> bool {
    use ErrorKind::{ConnectionRefused, HostUnreachable, Interrupted, NetworkUnreachable, WouldBlock};
    matches!(error.kind(), ConnectionRefused | HostUnreachable | Interrupted | NetworkUnreachable | WouldBlock)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SOON: Duration = Duration::from_secs(5);

    fn listening() -> (UdpLink, SocketAddr) {
        let link = UdpLink::open(":0").unwrap();
        let port = link.local_addr().unwrap().port();
        (link, SocketAddr::from((Ipv4Addr::LOCALHOST, port)))
    }

    fn stranger() -> UdpSocket {
        UdpSocket::bind("127.0.0.1:0").unwrap()
    }

    #[test]
    fn a_datagram_larger_than_the_buffer_is_handed_out_in_parts() {
        let (mut link, here) = listening();
        let sent: Vec<u8> = (0..3000_u32).map(|i| i as u8).collect();
        stranger().send_to(&sent, here).unwrap();
        let (mut got, mut buffer) = (Vec::<u8>::new(), [0; 700]);
        while got.len() < sent.len() {
            let count = link.receive(&mut buffer, SOON).unwrap();
            assert!(count > 0, "{} of {}", got.len(), sent.len());
            got.extend(&buffer[..count]);
        }
        assert_eq!(got, sent);
    }

    #[test]
    fn the_first_who_is_heard_is_the_peer_and_is_answered() {
        let (mut link, here) = listening();
        link.send(b"into the blue").unwrap();
        let (laser, other) = (stranger(), stranger());
        let mut buffer = [0; 100];
        laser.send_to(b"first", here).unwrap();
        assert_eq!(link.receive(&mut buffer, SOON).unwrap(), 5);
        other.send_to(b"second", here).unwrap();
        assert_eq!(link.receive(&mut buffer, SOON).unwrap(), 0, "of somebody else");
        link.send(b"answer").unwrap();
        laser.set_read_timeout(Some(SOON)).unwrap();
        let count = laser.recv(&mut buffer).unwrap();
        assert_eq!(&buffer[..count], b"answer");
    }

    #[test]
    fn a_named_peer_is_called_and_nobody_else_is_heard() {
        let (laser, other) = (stranger(), stranger());
        let mut link = UdpLink::open(&laser.local_addr().unwrap().to_string()).unwrap();
        let mut buffer = [0; 100];
        assert_eq!(link.receive(&mut buffer, Duration::from_millis(1)).unwrap(), 0);
        laser.set_read_timeout(Some(SOON)).unwrap();
        let (count, from) = laser.recv_from(&mut buffer).unwrap();
        assert_eq!(count, 0, "an empty datagram says where we are");
        other.send_to(b"other", from).unwrap();
        laser.send_to(b"bytes", from).unwrap();
        let heard = std::iter::repeat_with(|| link.receive(&mut buffer, SOON).unwrap()).find(|count| *count > 0);
        assert_eq!(heard, Some(5));
        assert_eq!(&buffer[..5], b"bytes");
    }

    #[test]
    fn nobody_at_a_named_peer_is_no_fault() {
        let gone = stranger().local_addr().unwrap().to_string();
        let mut link = UdpLink::open(&gone).unwrap();
        for _ in 0..3 {
            link.send(b"hello").unwrap();
            assert_eq!(link.receive(&mut [0; 10], Duration::from_millis(5)).unwrap(), 0);
        }
        let error = UdpLink::open("no-such-host.invalid:1").err().unwrap().to_string();
        assert!(error.contains("udp:no-such-host.invalid:1"), "{error}");
    }
}
