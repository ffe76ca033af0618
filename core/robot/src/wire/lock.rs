//! A link with a key: who does not know it is not listened to, and nobody can put words into a conversation or repeat an old one.
//!
//! The robot asks for a knock (`WANTED`). The host **knocks** with a nonce. The robot answers with a **challenge**: a nonce of its own, and a tag
//! over both that proves that it has the key. Both ends make two keys of the nonces, one for each way, and all that follows is **sealed** with
//! them: a number that only grows, the packet, and a tag over both. The host's first sealed packet is its proof.
//!
//! # Invariants
//! * Of a payload whose tag is wrong nothing is read but the number of its kind.
//! * A conversation under way is left only for one whose other end has proved that it has the key, with nonces that are new.
//! * What is refused is counted; it costs some tags, at most one answer in half a second, and nothing else.
//!
//! Not done here: what is said can be read by whoever sees the line.

use super::frame::SEAL_BYTES;
use super::key::{Key, TAG_BYTES, Tag};
use super::packet::{Foreign, HELLO};
use lrfslam_core::time::{Duration, Instant};

/// Bytes of a nonce.
pub const NONCE_BYTES: usize = 16;
/// A number that is used once.
type Nonce = [u8; NONCE_BYTES];

/// Kinds of payloads of a link with a key; those of [`Packet`](super::packet::Packet) are lower.
///
/// To a host: knock, this robot has a key.
pub(super) const WANTED: u8 = 64;
/// To a robot: the host's nonce.
pub(super) const KNOCK: u8 = 65;
/// To the host: its nonce, the robot's, and a tag over both.
pub(super) const CHALLENGE: u8 = 66;
/// A number, a packet, and a tag over both.
const SEALED: u8 = 67;
/// In front of the packet: the kind and the number.
const SEALED_HEAD: usize = SEAL_BYTES - TAG_BYTES;

/// From asking for a knock, or knocking, to doing so again.
const ASK_EVERY: Duration = Duration::from_millis(500);
/// Knocks that come sooner after one another are not heard.
const KNOCKS_APART: Duration = Duration::from_millis(20);

/// Which end of the link.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum End {
    Robot,
    Host,
}

/// Keys of one conversation, and how far its numbers have come.
#[derive(Debug)]
struct Seals {
    send: Key,
    receive: Key,
    /// Number of the next packet to send.
    next: u32,
    /// Lowest number that is still taken.
    lowest: u32,
}

impl Seals {
    /// What was sealed, if it was sealed with these keys and has not come before.
    fn open<'p>(&mut self, payload: &'p [u8]) -> Option<&'p [u8]> {
        let (sealed, tag) = payload.split_last_chunk::<TAG_BYTES>()?;
        let (head, packet) = sealed.split_first_chunk::<SEALED_HEAD>()?;
        let [SEALED, number @ ..] = *head else { return None };
        let number = u32::from_le_bytes(number);
        if number < self.lowest || number == u32::MAX || !self.receive.is_tag(tag, &[sealed]) {
            return None;
        }
        self.lowest = number + 1;
        Some(packet)
    }
}

/// What a payload was.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Heard<'p> {
    /// A packet of the other end, which has the key.
    Packet(&'p [u8]),
    /// The robot has proved that it has the key: a host introduces itself now.
    Opened,
    /// It does not have this key, or none.
    Foreign(Foreign),
    /// Nothing for this end, or nothing that it believes.
    Nothing,
}

/// One end's part of a link with a key; see the [module](self).
#[derive(Debug)]
pub struct Lock {
    key: Key,
    end: End,
    entropy: Nonce,
    /// Nonces drawn so far.
    drawn: u32,
    /// Of what is sent, and of what comes.
    in_force: Option<Seals>,
    /// Of what comes, too: a robot's for the host that has knocked last, a host's before the last challenge.
    beside: Option<Seals>,
    /// Of the host's last knock, until it has led to a conversation.
    host_nonce: Option<Nonce>,
    /// The robot's answer to it.
    robot_nonce: Option<Nonce>,
    owes_ask: bool,
    owes_challenge: bool,
    asked_at: Option<Instant>,
    knocked_at: Option<Instant>,
    /// Payloads that were refused since the start.
    refused: u32,
}

impl Lock {
    /// The robot's end.
    ///
    /// * `entropy` — never twice with the same key: from a generator for cryptography, or what counts the starts and is never set back
    pub fn of_robot(key: Key, entropy: [u8; NONCE_BYTES]) -> Self {
        Self::new(key, End::Robot, entropy)
    }

    /// The host's end; `entropy` as for [`of_robot`](Self::of_robot).
    pub fn of_host(key: Key, entropy: [u8; NONCE_BYTES]) -> Self {
        Self::new(key, End::Host, entropy)
    }

    fn new(key: Key, end: End, entropy: Nonce) -> Self {
        Self {
            key,
            end,
            entropy,
            drawn: 0,
            in_force: None,
            beside: None,
            host_nonce: None,
            robot_nonce: None,
            owes_ask: false,
            owes_challenge: false,
            asked_at: None,
            knocked_at: None,
            refused: 0,
        }
    }

    /// Payloads that came without the right key since the start; stays at the largest number.
    pub fn refused(&self) -> u32 {
        self.refused
    }

    /// True if packets can be sealed.
    pub fn is_open(&self) -> bool {
        self.in_force.is_some()
    }

    /// The link was opened, or is gone: the next conversation begins with a knock.
    pub fn close(&mut self) {
        (self.in_force, self.beside, self.host_nonce, self.robot_nonce) = (None, None, None, None);
        (self.owes_ask, self.owes_challenge, self.asked_at) = (false, false, None);
    }

    /// Knocks, or asks for a knock, unless that was done just now.
    pub fn ask(&mut self, now: Instant) {
        if self.asked_at.is_none_or(|at| now.since(at) >= ASK_EVERY) {
            self.asked_at = Some(now);
            self.owes_ask = true;
        }
    }

    /// Takes the payload of a frame.
    pub fn hear<'p>(&mut self, now: Instant, payload: &'p [u8]) -> Heard<'p> {
        match (self.end, payload) {
            (_, [SEALED, ..]) => self.open(now, payload),
            (End::Host, [WANTED]) => {
                self.ask(now);
                Heard::Nothing
            }
            (End::Host, [CHALLENGE, rest @ ..]) => self.take_challenge(rest),
            (End::Robot, [KNOCK, nonce @ ..]) => {
                self.take_knock(now, nonce);
                Heard::Nothing
            }
            // Its own kind of number stands first in every version. In a conversation under way it is somebody else's.
            (End::Host, [first, ..]) if u32::from(*first) == HELLO && !self.is_open() => Heard::Foreign(Foreign::NoKey),
            _ => self.refuse(now),
        }
    }

    fn refuse(&mut self, now: Instant) -> Heard<'static> {
        self.refused = self.refused.saturating_add(1);
        if self.end == End::Robot {
            self.ask(now);
        }
        Heard::Nothing
    }

    fn open<'p>(&mut self, now: Instant, payload: &'p [u8]) -> Heard<'p> {
        if let Some(packet) = self.in_force.as_mut().and_then(|seals| seals.open(payload)) {
            if self.end == End::Host {
                self.beside = None;
            }
            return Heard::Packet(packet);
        }
        if let Some(packet) = self.beside.as_mut().and_then(|seals| seals.open(payload)) {
            if self.end == End::Robot {
                // The host that has knocked has the key: its conversation begins.
                (self.in_force, self.host_nonce, self.robot_nonce) = (self.beside.take(), None, None);
            }
            return Heard::Packet(packet);
        }
        if self.in_force.is_some() {
            return self.refuse(now);
        }
        // Of a conversation before this start, most likely.
        if self.end == End::Robot {
            self.ask(now);
        }
        Heard::Nothing
    }

    fn take_knock(&mut self, now: Instant, nonce: &[u8]) {
        let is_soon = self.knocked_at.is_some_and(|at| now.since(at) < KNOCKS_APART);
        let Ok(nonce) = Nonce::try_from(nonce) else { return };
        if is_soon {
            return;
        }
        self.knocked_at = Some(now);
        self.owes_challenge = true;
        if self.host_nonce != Some(nonce) {
            (self.host_nonce, self.robot_nonce) = (Some(nonce), None);
        }
    }

    /// Makes what a conversation with these nonces is sealed with.
    fn seals(&self, host: &Nonce, robot: &Nonce) -> Seals {
        let up = self.key.derive(&[b"lrfslam robot to host", host, robot]);
        let down = self.key.derive(&[b"lrfslam host to robot", host, robot]);
        let (send, receive) = if self.end == End::Robot { (up, down) } else { (down, up) };
        Seals { send, receive, next: 0, lowest: 0 }
    }

    fn take_challenge(&mut self, rest: &[u8]) -> Heard<'static> {
        let parts = rest.split_first_chunk::<NONCE_BYTES>().and_then(|(host, rest)| {
            let (robot, tag) = rest.split_first_chunk::<NONCE_BYTES>()?;
            Some((host, robot, Tag::try_from(tag).ok()?))
        });
        let Some((host, robot, tag)) = parts.filter(|(host, ..)| self.host_nonce == Some(**host)) else {
            return Heard::Nothing;
        };
        if !self.key.is_tag(&tag, &[CHALLENGES, host, robot]) {
            self.refused = self.refused.saturating_add(1);
            return if self.is_open() { Heard::Nothing } else { Heard::Foreign(Foreign::OtherKey) };
        }
        self.beside = self.in_force.replace(self.seals(host, robot));
        (self.host_nonce, self.asked_at) = (None, None);
        Heard::Opened
    }

    fn draw(&mut self) -> Nonce {
        self.drawn = self.drawn.wrapping_add(1);
        self.key.tag(&[b"lrfslam nonce", &self.entropy, &self.drawn.to_le_bytes()])
    }

    /// Writes what this end has to say for a conversation to begin to the front of `memory`; returns its length.
    pub fn poll(&mut self, memory: &mut [u8]) -> Option<usize> {
        if core::mem::take(&mut self.owes_challenge) {
            let host = self.host_nonce?;
            let robot = match self.robot_nonce {
                Some(robot) => robot,
                None => self.offer(&host),
            };
            return write(memory, &[&[CHALLENGE], &host, &robot, &self.key.tag(&[CHALLENGES, &host, &robot])]);
        }
        if !core::mem::take(&mut self.owes_ask) {
            return None;
        }
        if self.end == End::Robot {
            return write(memory, &[&[WANTED]]);
        }
        // The same until it is answered: an answer may take longer than the next knock.
        let nonce = match self.host_nonce {
            Some(nonce) => nonce,
            None => self.draw(),
        };
        self.host_nonce = Some(nonce);
        write(memory, &[&[KNOCK], &nonce])
    }

    /// The robot's nonce for a host that has knocked.
    fn offer(&mut self, host: &Nonce) -> Nonce {
        let robot = self.draw();
        self.robot_nonce = Some(robot);
        self.beside = Some(self.seals(host, &robot));
        robot
    }

    /// Seals the packet of `length` bytes that stands in `memory` behind [`HEAD`](Self::HEAD) bytes; returns the length of all.
    ///
    /// `None` if nothing can be sealed: no conversation, or one whose numbers are used up, which ends by that.
    pub fn seal(&mut self, memory: &mut [u8], length: usize) -> Option<usize> {
        let seals = self.in_force.as_mut()?;
        let number = seals.next;
        if number == u32::MAX {
            self.close();
            return None;
        }
        let end = SEALED_HEAD + length;
        let (sealed, rest) = memory.split_at_mut_checked(end)?;
        let [kind, to_number @ ..] = sealed.first_chunk_mut::<SEALED_HEAD>()?;
        (*kind, *to_number) = (SEALED, number.to_le_bytes());
        let tag = seals.send.tag(&[sealed]);
        *rest.first_chunk_mut()? = tag;
        seals.next = number + 1;
        Some(end + TAG_BYTES)
    }

    /// Bytes that a seal has before the packet.
    pub const HEAD: usize = SEALED_HEAD;
}

/// What a challenge's tag is over, besides the nonces.
const CHALLENGES: &[u8] = b"lrfslam challenge";

fn write(memory: &mut [u8], parts: &[&[u8]]) -> Option<usize> {
    let mut at = 0;
    for part in parts {
        memory.get_mut(at..at + part.len())?.copy_from_slice(part);
        at += part.len();
    }
    Some(at)
}

#[cfg(test)]
mod tests;
