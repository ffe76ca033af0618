//! A session over a link that damages, loses, doubles and reorders frames, and that may be cut at either end.
//!
//! Each end has an **epoch**, a number that changes when it starts anew, and a stream of **reliable** messages numbered from 0.
//! The receiver takes them in order and says which one it expects; the sender keeps them until then, and sends again from
//! there when the receiver misses one or nothing is heard (go-back-N). **Latest** messages have no number: the newest replaces
//! one that was not sent yet, and a lost one is lost.
//!
//! `Hello` begins: who I am, whom I know, what I expect of you, and the oldest message that I still have. So a host that
//! has kept (epoch, next) goes on where it was; one that has not, with what the robot still has; and a robot that was reset is
//! known by its epoch.
//!
//! # Contract
//! [`take`](Session::take) every byte and [`timeout`](Session::timeout) at [`deadline`](Session::deadline); whenever the port has room for a
//! frame, [`poll_transmit`](Session::poll_transmit) until it gives none. A message that `take` returned is acknowledged by the
//! next `poll_transmit`: who must not lose it stores it before.

use serde::{Deserialize, Serialize};

use super::frame::{FrameCounters, FrameDecoder, MAX_FRAME, encode};
pub use super::queue::QueueFullError;
use super::queue::SendQueue;
use crate::lrf::driver::NEVER;
use crate::time::{Duration, Instant};

/// Version of this protocol; ends of different versions do not talk.
pub const VERSION: u16 = 1;
/// Longest message, bytes.
pub const MAX_MESSAGE: usize = 1000;
/// Longest latest message, bytes.
pub const MAX_LATEST: usize = 160;
/// Messages that an end lets the other send ahead.
pub const CREDIT: u16 = 32;
const HELLO_EVERY: Duration = Duration::from_millis(500);
const RESEND_FIRST: Duration = Duration::from_millis(400);
const RESEND_LONGEST: Duration = Duration::from_millis(3200);

/// What is in a frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum Packet<'a> {
    /// Begins a session, and asks for an answer if the other end is not known.
    Hello {
        /// [`VERSION`].
        version: u16,
        /// The sender's epoch.
        epoch: u32,
        /// The receiver's epoch as far as the sender knows it.
        peer: Option<u32>,
        /// The next reliable message that the sender expects from that one.
        next: u32,
        /// The oldest reliable message that the sender still has.
        base: u32,
        /// How many messages from `next` on the sender takes.
        credit: u16,
        /// The receiver's hello has come since the link was opened.
        is_heard: bool,
    },
    /// A reliable message.
    Reliable {
        /// The sender's epoch.
        epoch: u32,
        /// Its number.
        sequence: u32,
        /// It.
        message: &'a [u8],
    },
    /// What the sender has of the receiver's reliable messages.
    Ack {
        /// The sender's epoch.
        epoch: u32,
        /// The receiver's.
        peer: u32,
        /// All before this one.
        next: u32,
        /// How many from there on it takes.
        credit: u16,
        /// A later one came: send again from `next`.
        missing: bool,
    },
    /// A message that may be lost.
    Latest {
        /// The sender's epoch.
        epoch: u32,
        /// It.
        message: &'a [u8],
    },
}

/// What came out of the bytes taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Received<'a> {
    /// A reliable message: once and in order.
    Reliable(&'a [u8]),
    /// A message that replaces earlier ones of its kind.
    Latest(&'a [u8]),
    /// The other end is new, or was started anew: it knows nothing of what was said before.
    NewPeer {
        /// Its epoch.
        epoch: u32,
    },
    /// It speaks another version of the protocol; nothing can be said.
    OtherVersion(u16),
}

/// How far one end has come with the messages of the other.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Progress {
    /// The sender's epoch.
    pub epoch: u32,
    /// The next reliable message expected of it.
    pub next: u32,
}

/// What happened so far.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct SessionCounters {
    /// Frames.
    pub frames: FrameCounters,
    /// Reliable messages that came again.
    pub doubled: u32,
    /// Reliable messages that came before one that is missing.
    pub early: u32,
    /// Times that messages were sent again.
    pub resends: u32,
}

/// Memory of a [`Session`], lent by the caller.
#[derive(Debug)]
pub struct SessionMemory<'m> {
    /// Reliable messages on their way.
    pub queue: &'m mut [u8],
    /// One frame: [`MAX_FRAME`].
    pub frame: &'m mut [u8],
}

/// One end; see the [module](self).
#[derive(Debug)]
pub struct Session<'m> {
    decoder: FrameDecoder<'m>,
    core: SessionCore<'m>,
}

/// Everything but the bytes: lives beside the decoder, so that a frame can be read in place.
#[derive(Debug)]
struct SessionCore<'m> {
    epoch: u32,
    queue: SendQueue<'m>,
    latest: heapless::Vec<u8, MAX_LATEST>,
    peer: Option<Progress>,
    /// The other end has said hello since the link was opened.
    is_live: bool,
    hello_at: Instant,
    owes_hello: bool,
    owes_ack: bool,
    is_missing: bool,
    credit: u16,
    peer_credit: u16,
    resend_at: Instant,
    back_off: Duration,
    /// Where it was last sent again from because the other end said so.
    resent_from: Option<u32>,
    counters: SessionCounters,
}

impl<'m> Session<'m> {
    /// An end that waits for [`connected`](Self::connected).
    ///
    /// * `epoch` — another one than before, after every start
    /// * `resume` — how far an earlier run of this end had come with the other one
    pub fn new(epoch: u32, resume: Option<Progress>, memory: SessionMemory<'m>) -> Self {
        let core = SessionCore {
            epoch,
            queue: SendQueue::new(memory.queue),
            latest: heapless::Vec::new(),
            peer: resume,
            is_live: false,
            hello_at: NEVER,
            owes_hello: false,
            owes_ack: false,
            is_missing: false,
            credit: CREDIT,
            peer_credit: 0,
            resend_at: NEVER,
            back_off: RESEND_FIRST,
            resent_from: None,
            counters: SessionCounters::default(),
        };
        Self { decoder: FrameDecoder::new(memory.frame), core }
    }

    /// The link is open (again).
    pub fn connected(&mut self, now: Instant) {
        self.decoder.forget();
        self.core.is_live = false;
        self.core.hello_at = now;
    }

    /// The link is gone.
    pub fn disconnected(&mut self) {
        self.decoder.forget();
        self.core.is_live = false;
        self.core.hello_at = NEVER;
        self.core.resend_at = NEVER;
    }

    /// True if both ends have said hello.
    pub fn is_live(&self) -> bool {
        self.core.is_live
    }

    /// How far this end has come with the other's messages; to be stored together with them.
    pub fn progress(&self) -> Option<Progress> {
        self.core.peer
    }

    /// True if the other end has everything.
    pub fn is_idle(&self) -> bool {
        self.core.queue.base() == self.core.queue.end()
    }

    /// Bytes of reliable messages that the queue takes now.
    pub fn queue_room(&self) -> usize {
        self.core.queue.room()
    }

    /// What happened so far.
    pub fn counters(&self) -> SessionCounters {
        SessionCounters { frames: self.decoder.counters(), ..self.core.counters }
    }

    /// How many messages the other end may send ahead from now on; 0 stops it.
    pub fn set_credit(&mut self, credit: u16) {
        self.core.owes_ack |= credit != self.core.credit;
        self.core.credit = credit;
    }

    /// Queues a reliable message and returns its number.
    ///
    /// # Errors
    /// [`QueueFullError`] if there is no room for it now; nothing has changed then.
    pub fn send(&mut self, message: &impl Serialize) -> Result<u32, QueueFullError> {
        self.core.queue.push(|room| {
            let end = room.len().min(MAX_MESSAGE);
            postcard::to_slice(message, room.get_mut(..end)?).ok().map(|written| written.len())
        })
    }

    /// Puts a message in place of the last one that was not sent yet; one longer than [`MAX_LATEST`] is not sent.
    pub fn send_latest(&mut self, message: &impl Serialize) {
        let mut bytes = [0; MAX_LATEST];
        let written = postcard::to_slice(message, &mut bytes).map_or(0, |written| written.len());
        self.core.latest = heapless::Vec::from_slice(bytes.get(..written).unwrap_or_default()).unwrap_or_default();
    }

    /// Takes bytes up to the end of a frame; returns how many, and what that frame brought.
    #[must_use]
    pub fn take(&mut self, now: Instant, bytes: &[u8]) -> (usize, Option<Received<'_>>) {
        let (taken, payload) = self.decoder.take(bytes);
        let packet = payload.and_then(|payload| postcard::from_bytes(payload).ok());
        (taken, packet.and_then(|packet| self.core.on_packet(now, packet)))
    }

    /// When [`timeout`](Self::timeout) is due.
    pub fn deadline(&self) -> Instant {
        if self.core.is_live { self.core.resend_at } else { self.core.hello_at }
    }

    /// Time has passed.
    pub fn timeout(&mut self, now: Instant) {
        self.core.on_timeout(now);
    }

    /// The next frame, in `memory` ([`MAX_FRAME`]); `None` if there is nothing to send now.
    pub fn poll_transmit<'b>(&mut self, now: Instant, memory: &'b mut [u8]) -> Option<&'b [u8]> {
        let mut payload = [0; MAX_FRAME];
        let length = {
            let packet = self.core.next_packet(now)?;
            postcard::to_slice(&packet, &mut payload).ok()?.len()
        };
        self.core.on_sent(now);
        encode(payload.get(..length)?, memory)
    }
}

/// What [`SessionCore::next_packet`] chose.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Turn {
    Hello,
    Ack,
    Latest,
    Reliable,
}

impl SessionCore<'_> {
    fn on_packet<'a>(&mut self, now: Instant, packet: Packet<'a>) -> Option<Received<'a>> {
        match packet {
            Packet::Hello { version, .. } if version != VERSION => Some(Received::OtherVersion(version)),
            Packet::Hello { epoch, peer, next, base, credit, is_heard, .. } => {
                self.owes_hello |= !is_heard;
                self.on_hello(now, Progress { epoch, next: base }, peer, next, credit)
            }
            Packet::Reliable { epoch, sequence, message } => {
                self.is_from_peer(epoch).then_some(())?;
                self.on_reliable(sequence).then_some(Received::Reliable(message))
            }
            Packet::Ack { epoch, peer, next, credit, missing } => {
                if self.is_from_peer(epoch) && peer == self.epoch {
                    self.on_ack(now, next, credit, missing);
                }
                None
            }
            Packet::Latest { epoch, message } => self.is_from_peer(epoch).then_some(Received::Latest(message)),
        }
    }

    /// False for a stranger, who is asked to introduce himself.
    fn is_from_peer(&mut self, epoch: u32) -> bool {
        let is_known = self.is_live && self.peer.is_some_and(|peer| peer.epoch == epoch);
        self.owes_hello |= !is_known;
        is_known
    }

    fn on_hello<'a>(
        &mut self,
        now: Instant,
        oldest: Progress,
        peer: Option<u32>,
        next: u32,
        credit: u16,
    ) -> Option<Received<'a>> {
        let known = self.peer.filter(|known| known.epoch == oldest.epoch);
        // What is older than the oldest was acknowledged by an earlier run of this end.
        let is_older = known.is_some_and(|known| oldest.next.wrapping_sub(known.next) as i32 <= 0);
        self.peer = if is_older { known } else { Some(oldest) };
        self.is_live = true;
        self.is_missing = false;
        if peer == Some(self.epoch) {
            self.queue.acknowledge(next);
            self.owes_ack = true;
        } else {
            self.owes_hello = true;
        }
        self.peer_credit = credit;
        self.queue.rewind();
        self.resent_from = None;
        self.back_off = RESEND_FIRST;
        self.resend_at = now + self.back_off;
        known.is_none().then_some(Received::NewPeer { epoch: oldest.epoch })
    }

    /// True if it is the one expected.
    fn on_reliable(&mut self, sequence: u32) -> bool {
        self.owes_ack = true;
        let Some(peer) = self.peer.as_mut() else { return false };
        let ahead = sequence.wrapping_sub(peer.next) as i32;
        self.is_missing = ahead > 0;
        if ahead == 0 {
            peer.next = peer.next.wrapping_add(1);
            return true;
        }
        let counter = if ahead > 0 { &mut self.counters.early } else { &mut self.counters.doubled };
        *counter = counter.saturating_add(1);
        false
    }

    fn on_ack(&mut self, now: Instant, next: u32, credit: u16, missing: bool) {
        if self.queue.acknowledge(next) {
            self.back_off = RESEND_FIRST;
            self.resend_at = now + self.back_off;
        }
        if next == self.queue.base() {
            self.peer_credit = credit;
            if missing && self.resent_from != Some(next) {
                self.resent_from = Some(next);
                self.resend(now);
            }
        }
    }

    fn resend(&mut self, now: Instant) {
        self.queue.rewind();
        self.counters.resends = self.counters.resends.saturating_add(1);
        self.resend_at = now + self.back_off;
    }

    fn on_timeout(&mut self, now: Instant) {
        if !self.is_live && now >= self.hello_at {
            self.owes_hello = true;
            self.hello_at = now + HELLO_EVERY;
        } else if self.is_live && now >= self.resend_at {
            let is_waiting = self.queue.base() != self.queue.end();
            // An acknowledgement may have been lost, or the other end waits for us to notice that it takes more.
            self.owes_hello |= is_waiting;
            self.back_off = Duration::from_micros((self.back_off.micros * 2).min(RESEND_LONGEST.micros));
            self.resent_from = None;
            if is_waiting {
                self.resend(now);
            } else {
                self.resend_at = NEVER;
            }
        }
    }

    fn turn(&self) -> Option<Turn> {
        let ahead = self.queue.next().wrapping_sub(self.queue.base());
        if self.owes_hello {
            Some(Turn::Hello)
        } else if !self.is_live {
            None
        } else if self.owes_ack {
            Some(Turn::Ack)
        } else if !self.latest.is_empty() {
            Some(Turn::Latest)
        } else {
            (ahead < u32::from(self.peer_credit) && self.queue.front().is_some()).then_some(Turn::Reliable)
        }
    }

    fn next_packet(&mut self, now: Instant) -> Option<Packet<'_>> {
        if !self.is_live && now >= self.hello_at {
            self.on_timeout(now);
        }
        let (epoch, credit) = (self.epoch, self.credit);
        let next = self.peer.map_or(0, |peer| peer.next);
        Some(match self.turn()? {
            Turn::Hello => {
                let peer = self.peer.map(|peer| peer.epoch);
                let (base, is_heard) = (self.queue.base(), self.is_live);
                Packet::Hello { version: VERSION, epoch, peer, next, base, credit, is_heard }
            }
            Turn::Ack => {
                let peer = self.peer.map_or(0, |peer| peer.epoch);
                Packet::Ack { epoch, peer, next, credit, missing: self.is_missing }
            }
            Turn::Latest => Packet::Latest { epoch, message: &self.latest },
            Turn::Reliable => {
                Packet::Reliable { epoch, sequence: self.queue.next(), message: self.queue.front().unwrap_or_default() }
            }
        })
    }

    /// The packet chosen is on its way.
    fn on_sent(&mut self, now: Instant) {
        match self.turn() {
            Some(Turn::Hello) => self.owes_hello = false,
            Some(Turn::Ack) => self.owes_ack = false,
            Some(Turn::Latest) => self.latest.clear(),
            Some(Turn::Reliable) => {
                self.queue.advance();
                if self.resend_at == NEVER {
                    self.resend_at = now + self.back_off;
                }
            }
            None => {}
        }
    }
}
