//! A host that comes by the network while another one is attached: it is heard out, and told that the robot has a host.

use lrfslam_core::time::{Duration, Instant};
use lrfslam_robot::wire::frame::{FrameDecoder, MAX_FRAME, encode};
use lrfslam_robot::wire::session::Packet;

use super::port::Port;

/// One that has not introduced itself by then is sent away.
const PATIENCE: Duration = Duration::from_millis(2000);

/// See the [module](self).
pub(super) struct Guest {
    /// Its line.
    pub(super) port: Port,
    since: Instant,
    /// All that it has said: a hello, or it is none.
    heard: Vec<u8>,
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
    pub(super) fn new(port: Port, now: Instant) -> Self {
        Self { port, since: now, heard: Vec::new() }
    }

    /// True if it has had its time.
    pub(super) fn is_late(&self, now: Instant) -> bool {
        now.since(self.since) > PATIENCE
    }

    /// What it has said so far, with these bytes.
    pub(super) fn hear(&mut self, bytes: &[u8]) -> Introduction {
        self.heard.extend_from_slice(bytes);
        if self.heard.len() > 4 * MAX_FRAME {
            return Introduction::Nonsense;
        }
        introduction(&self.heard)
    }

    /// All that it has said, and its line.
    pub(super) fn welcome(self) -> (Port, Vec<u8>) {
        (self.port, self.heard)
    }

    /// Tells the host with this epoch that there is another, and closes its line.
    pub(super) fn send_away(mut self, epoch: u32) {
        let (mut payload, mut memory) = ([0; MAX_FRAME], [0; MAX_FRAME]);
        let busy = Packet::Busy { peer: epoch };
        let frame = postcard::to_slice(&busy, &mut payload).ok().and_then(|payload| encode(payload, &mut memory));
        frame.into_iter().for_each(|frame| self.port.write(frame));
    }
}

fn introduction(bytes: &[u8]) -> Introduction {
    let mut memory = [0; MAX_FRAME];
    let mut decoder = FrameDecoder::new(&mut memory);
    let mut rest = bytes;
    while !rest.is_empty() {
        let (taken, payload) = decoder.take(rest);
        rest = &rest[taken..];
        if let Some(Ok(Packet::Hello { epoch, .. })) = payload.map(postcard::from_bytes) {
            return Introduction::Host(epoch);
        }
    }
    Introduction::None
}
