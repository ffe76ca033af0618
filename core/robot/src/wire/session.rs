//! A session over a link that damages, loses, doubles and reorders frames, and that may be cut at either end.
//!
//! Each end has an **epoch**, a number that changes when it starts anew, and a stream of **reliable** messages numbered from 0.
//! The receiver takes them in order and says which one it expects; the sender keeps them until then, and sends again from
//! there when the receiver misses one or nothing is heard (go-back-N). **Latest** messages have no number: the newest replaces
//! one that was not sent yet, and a lost one is lost.
//!
//! `Hello` begins: who I am, whom I know, what I expect of you, and the oldest message that I still have. So a host that
//! has kept (epoch, next) goes on where it was; one that has not, with what the robot still has; and a robot that was reset is
//! known by its epoch. Ends of another version, or with another layout of the configuration, do not talk ([`Foreign`]).
//!
//! # Contract
//! [`take`](Session::take) every byte and [`timeout`](Session::timeout) at [`deadline`](Session::deadline); whenever the port has room for a
//! frame, [`poll_transmit`](Session::poll_transmit) until it gives none. A message that `take` returned is acknowledged by the
//! next `poll_transmit`: who must not lose it stores it before.
//!
//! With a key ([`with_lock`](Session::with_lock)) all this is said under seals, and nobody else is heard.

use serde::{Deserialize, Serialize};

use super::conversation::Conversation;
use super::frame::{FrameCounters, FrameDecoder, MAX_FRAME, MAX_PACKET, encode};
use super::lock::{self, Heard, Lock};
pub use super::packet::{Foreign, LAYOUT, Packet, VERSION};
pub use super::queue::QueueFullError;
use lrfslam_core::time::Instant;

/// Longest message, bytes.
pub const MAX_MESSAGE: usize = 1000;
/// Longest latest message, bytes.
pub const MAX_LATEST: usize = 160;
/// Messages that an end lets the other send ahead.
pub const CREDIT: u16 = 32;

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
    /// It is of another build; nothing is said to it, and nothing taken from it.
    Foreign(Foreign),
    /// It talks to somebody else.
    Busy,
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
    /// Frames that came without the right key, or again; 0 where no key is asked for.
    pub refused: u32,
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
    /// Lives beside the decoder, so that a frame can be read in place.
    conversation: Conversation<'m>,
    lock: Option<Lock>,
}

impl<'m> Session<'m> {
    /// An end that waits for [`connected`](Self::connected).
    ///
    /// * `epoch` — another one than before, after every start
    /// * `resume` — how far an earlier run of this end had come with the other one
    pub fn new(epoch: u32, resume: Option<Progress>, memory: SessionMemory<'m>) -> Self {
        let conversation = Conversation::new(epoch, resume, memory.queue);
        Self { decoder: FrameDecoder::new(memory.frame), conversation, lock: None }
    }

    /// The same for an end that speaks only with who has its key, if it has one.
    #[must_use]
    pub fn with_lock(mut self, lock: impl Into<Option<Lock>>) -> Self {
        self.lock = lock.into();
        self
    }

    /// The link is open (again).
    pub fn connected(&mut self, now: Instant) {
        self.decoder.forget();
        self.lock.iter_mut().for_each(Lock::close);
        self.conversation.connected(now);
    }

    /// The link is gone.
    pub fn disconnected(&mut self) {
        self.decoder.forget();
        self.lock.iter_mut().for_each(Lock::close);
        self.conversation.disconnected();
    }

    /// True if both ends have said hello.
    pub fn is_live(&self) -> bool {
        self.conversation.is_live
    }

    /// True if the other end seems to be gone, on a line that does not say so: messages wait, and for some seconds nothing was acknowledged.
    pub fn is_silent(&self) -> bool {
        self.conversation.is_silent()
    }

    /// How far this end has come with the other's messages; to be stored together with them.
    pub fn progress(&self) -> Option<Progress> {
        self.conversation.peer
    }

    /// True if the other end has everything.
    pub fn is_idle(&self) -> bool {
        self.conversation.queue.base() == self.conversation.queue.end()
    }

    /// True if the other end has the reliable message with this number.
    pub fn is_acknowledged(&self, number: u32) -> bool {
        self.conversation.queue.base().wrapping_sub(number) as i32 > 0
    }

    /// Bytes that the queue has for reliable messages.
    pub fn queue_capacity(&self) -> usize {
        self.conversation.queue.capacity()
    }

    /// Bytes of reliable messages that the queue takes now.
    pub fn queue_room(&self) -> usize {
        self.conversation.queue.room()
    }

    /// What happened so far.
    pub fn counters(&self) -> SessionCounters {
        let refused = self.lock.as_ref().map_or(0, Lock::refused);
        SessionCounters { frames: self.decoder.counters(), refused, ..self.conversation.counters }
    }

    /// How many messages the other end may send ahead from now on; 0 stops it.
    pub fn set_credit(&mut self, credit: u16) {
        self.conversation.set_credit(credit);
    }

    /// Queues a reliable message and returns its number.
    ///
    /// # Errors
    /// [`QueueFullError`] if there is no room for it now; nothing has changed then.
    pub fn send(&mut self, message: &impl Serialize) -> Result<u32, QueueFullError> {
        self.conversation.queue.push(|room| {
            let end = room.len().min(MAX_MESSAGE);
            postcard::to_slice(message, room.get_mut(..end)?).ok().map(|written| written.len())
        })
    }

    /// Puts a message in place of the last one that was not sent yet; one longer than [`MAX_LATEST`] is not sent.
    pub fn send_latest(&mut self, message: &impl Serialize) {
        let mut bytes = [0; MAX_LATEST];
        let written = postcard::to_slice(message, &mut bytes).map_or(0, |written| written.len());
        self.conversation.latest =
            heapless::Vec::from_slice(bytes.get(..written).unwrap_or_default()).unwrap_or_default();
    }

    /// Takes bytes up to the end of a frame; returns how many, and what that frame brought.
    #[must_use]
    pub fn take(&mut self, now: Instant, bytes: &[u8]) -> (usize, Option<Received<'_>>) {
        let (taken, payload) = self.decoder.take(bytes);
        let Some(payload) = payload else { return (taken, None) };
        let heard = match &mut self.lock {
            Some(lock) => lock.hear(now, payload),
            None => hear_without_key(payload),
        };
        let payload = match heard {
            Heard::Packet(packet) => packet,
            Heard::Foreign(why) => return (taken, Some(Received::Foreign(why))),
            Heard::Opened => {
                self.conversation.introduce();
                return (taken, None);
            }
            Heard::Nothing => return (taken, None),
        };
        if let Some(foreign) = Foreign::of_hello(payload) {
            return (taken, Some(Received::Foreign(foreign)));
        }
        let packet = postcard::from_bytes(payload).ok();
        (taken, packet.and_then(|packet| self.conversation.on_packet(now, packet)))
    }

    /// When [`timeout`](Self::timeout) is due.
    pub fn deadline(&self) -> Instant {
        self.conversation.deadline()
    }

    /// Time has passed.
    pub fn timeout(&mut self, now: Instant) {
        self.conversation.on_timeout(now);
    }

    /// The next frame, in `memory` ([`MAX_FRAME`]); `None` if there is nothing to send now.
    pub fn poll_transmit<'b>(&mut self, now: Instant, memory: &'b mut [u8]) -> Option<&'b [u8]> {
        let mut payload = [0; MAX_FRAME];
        let length = match &mut self.lock {
            Some(lock) => {
                if !lock.is_open() && self.conversation.introduces_itself(now) {
                    lock.ask(now);
                }
                match lock.poll(&mut payload) {
                    Some(length) => length,
                    None if !lock.is_open() => return None,
                    None => {
                        let length = next_packet(&mut self.conversation, now, payload.get_mut(Lock::HEAD..)?)?;
                        lock.seal(&mut payload, length)?
                    }
                }
            }
            None => next_packet(&mut self.conversation, now, &mut payload)?,
        };
        encode(payload.get(..length)?, memory)
    }
}

/// What an end without a key makes of a payload.
fn hear_without_key(payload: &[u8]) -> Heard<'_> {
    match payload {
        [lock::WANTED] => Heard::Foreign(Foreign::WantsKey),
        // It is told that there is none.
        [lock::KNOCK, ..] => Heard::Opened,
        _ => Heard::Packet(payload),
    }
}

/// Writes the next packet to the front of `memory`, and takes it for sent; returns its length.
fn next_packet(conversation: &mut Conversation<'_>, now: Instant, memory: &mut [u8]) -> Option<usize> {
    let length = {
        let packet = conversation.next_packet(now)?;
        postcard::to_slice(&packet, memory.get_mut(..MAX_PACKET)?).ok()?.len()
    };
    conversation.on_sent(now);
    Some(length)
}
