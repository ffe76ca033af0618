//! A host that comes by the network while another one is attached, or that has a key to show: it is heard out, and told if the robot has a host.

use lrfslam_core::time::{Duration, Instant};
use lrfslam_robot::wire::frame::{DELIMITER, FrameDecoder, MAX_FRAME, encode};
use lrfslam_robot::wire::lock::{Heard, Lock};
use lrfslam_robot::wire::session::Packet;

use super::port::Port;

/// One that has not introduced itself by then is sent away.
const PATIENCE: Duration = Duration::from_millis(2000);

/// So many are heard at a time; the one that came first makes room.
pub(super) const GUESTS_MAX: usize = 8;

/// See the [module](self).
pub(super) struct Guest {
    /// Its line.
    pub(super) port: Port,
    since: Instant,
    /// All that it has said: a hello, or it is none.
    heard: Vec<u8>,
    /// Bytes of that whose frames were taken already, where there is a key.
    taken: usize,
    /// The robot's end of what it says, if there is a key.
    lock: Option<Lock>,
}

/// What a host says of itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Introduction {
    /// Nothing yet.
    None,
    /// Its epoch.
    Host(u32),
    /// It is no host.
    Nonsense,
}

impl Guest {
    /// One that has just come.
    pub(super) fn new(port: Port, now: Instant, lock: Option<Lock>) -> Self {
        let mut guest = Self { port, since: now, heard: Vec::new(), taken: 0, lock };
        if let Some(lock) = &mut guest.lock {
            lock.ask(now);
        }
        guest.answer();
        guest
    }

    /// True if it has had its time.
    pub(super) fn is_late(&self, now: Instant) -> bool {
        now.since(self.since) > PATIENCE
    }

    /// What it has said so far, with these bytes.
    pub(super) fn hear(&mut self, now: Instant, bytes: &[u8]) -> Introduction {
        self.heard.extend_from_slice(bytes);
        if self.heard.len() > 4 * MAX_FRAME {
            return Introduction::Nonsense;
        }
        let introduction = self.introduction(now);
        self.answer();
        introduction
    }

    /// All that it has said, and its line; of one with a key, nothing: it is to show it to the robot itself.
    pub(super) fn welcome(self) -> (Port, Vec<u8>) {
        let heard = if self.lock.is_some() { Vec::new() } else { self.heard };
        (self.port, heard)
    }

    /// Tells the host with this epoch that there is another, and closes its line.
    pub(super) fn send_away(mut self, epoch: u32) {
        let (mut payload, mut memory) = ([0; MAX_FRAME], [0; MAX_FRAME]);
        let busy = Packet::Busy { peer: epoch };
        let length = match &mut self.lock {
            Some(lock) => {
                let length = postcard::to_slice(&busy, &mut payload[Lock::HEAD..]).map_or(0, |packet| packet.len());
                lock.seal(&mut payload, length)
            }
            None => postcard::to_slice(&busy, &mut payload).ok().map(|packet| packet.len()),
        };
        let frame = length.and_then(|length| encode(&payload[..length], &mut memory));
        frame.into_iter().for_each(|frame| self.port.write(frame));
    }

    /// Sends what the lock has to say.
    fn answer(&mut self) {
        let (mut payload, mut memory) = ([0; MAX_FRAME], [0; MAX_FRAME]);
        while let Some(length) = self.lock.as_mut().and_then(|lock| lock.poll(&mut payload)) {
            encode(&payload[..length], &mut memory).into_iter().for_each(|frame| self.port.write(frame));
        }
    }

    fn introduction(&mut self, now: Instant) -> Introduction {
        let mut memory = [0; MAX_FRAME];
        let mut decoder = FrameDecoder::new(&mut memory);
        let mut rest = &self.heard[self.taken..];
        while !rest.is_empty() {
            let (taken, payload) = decoder.take(rest);
            rest = &rest[taken..];
            let packet = match (&mut self.lock, payload) {
                (Some(lock), Some(payload)) => match lock.hear(now, payload) {
                    Heard::Packet(packet) => Some(packet),
                    _ => None,
                },
                (_, payload) => payload,
            };
            if let Some(Ok(Packet::Hello { epoch, .. })) = packet.map(postcard::from_bytes) {
                return Introduction::Host(epoch);
            }
        }
        // A frame that has not ended yet is looked at again.
        let ended = self.heard.iter().rposition(|byte| *byte == DELIMITER);
        self.taken = ended.map_or(0, |end| end + 1);
        Introduction::None
    }
}
