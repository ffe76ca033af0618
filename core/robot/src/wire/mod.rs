//! The link between the robot and its host: what is said, how it is framed, and how nothing that matters is lost.
//!
//! [`message`] (postcard, a scan by [`sweep`]) → [`session`] (sequence numbers, acknowledgement, credit) → [`lock`], if there is a [`key`] →
//! [`frame`] (CRC-32, COBS, 0x00) → bytes.
//!
//! The same code runs at both ends and is sans-IO: bytes and the time go in, frames come out. `docs/robot-link.md` is the
//! specification, with bytes that tests hold this code to.
//!
//! # Invariants
//! * A reliable message is given to the receiver once and in order, or not at all; it is kept by the sender until the
//!   receiver has said that it has it.
//! * A damaged, foreign or oversize frame costs what is between two delimiters and no more.
//! * Nothing grows: a full queue is an error that the sender sees before anything has changed.

mod conversation;
pub mod frame;
pub mod key;
pub mod lock;
pub mod message;
mod packet;
mod queue;
pub mod session;
pub mod sweep;

#[cfg(test)]
mod tests;
