//! What is in a frame.

use serde::{Deserialize, Serialize};

/// Version of this protocol; ends of different versions do not talk.
pub const VERSION: u16 = 4;

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
