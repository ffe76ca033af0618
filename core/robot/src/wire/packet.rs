//! What is in a frame.

use serde::{Deserialize, Serialize};

use crate::config::RobotConfig;
use lrfslam_core::config::Layout as _;

/// Version of this protocol; ends of different versions do not talk.
pub const VERSION: u16 = 11;
/// Fingerprint of the configuration that a robot is given: as this program has it.
pub const LAYOUT: u32 = RobotConfig::LAYOUT;
/// Number of [`Packet::Hello`], in every version.
pub(super) const HELLO: u32 = 0;

/// What is in a frame; with a key, what is sealed in it ([`lock`](super::lock), whose own payloads begin with 64 to 67).
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
        /// [`LAYOUT`].
        layout: u32,
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
    /// To a host that comes while another is attached: the robot is not to be had now.
    Busy {
        /// The receiver's epoch.
        peer: u32,
    },
}

/// Why two ends do not talk, in the words of the host's.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Foreign {
    /// The other end speaks this version of the protocol.
    #[error("the robot speaks version {0} of the robot link, this program {VERSION}: build both from the same version")]
    Version(u16),
    /// It speaks the same version, and means another configuration: a build between two versions.
    #[error("the robot's program has another configuration layout: build both from the same version")]
    Layout,
    /// It speaks with who has its key, and this end has none.
    #[error("this robot wants a key: --key-file")]
    WantsKey,
    /// It has no key, and this end speaks with one that has.
    #[error("this robot has no key, and was to have one: start it with the key, or leave --key-file out")]
    NoKey,
    /// It has another key.
    #[error("this robot has another key than this program: the same is to be at both ends")]
    OtherKey,
}

impl Foreign {
    /// What a hello of another version says of itself, whatever else is in it.
    pub(super) fn of_hello(payload: &[u8]) -> Option<Self> {
        let (packet, version) = postcard::from_bytes::<(u32, u16)>(payload).ok()?;
        (packet == HELLO && version != VERSION).then_some(Self::Version(version))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::frame::{MAX_FRAME, encode};
    use crate::wire::message::{FromRobot, ToRobot};
    use crate::wire::session::{Received, Session, SessionMemory};
    use lrfslam_core::time::{Duration, Instant};
    use std::string::ToString;
    use std::vec;
    use std::vec::Vec;

    /// A session that has something to say, and is open.
    fn session(epoch: u32) -> Session<'static> {
        let memory = SessionMemory { queue: vec![0; 2000].leak(), frame: vec![0; MAX_FRAME].leak() };
        let mut session = Session::new(epoch, None, memory);
        session.connected(Instant::default());
        session.send(&ToRobot::Configure(RobotConfig::default())).unwrap();
        session
    }

    fn framed(packet: &impl Serialize) -> Vec<u8> {
        let (mut payload, mut frame) = ([0; MAX_FRAME], [0; MAX_FRAME]);
        encode(postcard::to_slice(packet, &mut payload).unwrap(), &mut frame).unwrap().to_vec()
    }

    fn hello(version: u16, layout: u32) -> Packet<'static> {
        Packet::Hello { version, epoch: 7, peer: Some(1), next: 0, base: 0, credit: 32, is_heard: true, layout }
    }

    /// What is made of a hello, and then of a message and of a status by the same end; and whether anything but hellos is sent.
    fn hear(hello: &[u8]) -> (Vec<Received<'static>>, bool) {
        let mut session = session(1);
        let mut message = [0; 16];
        let message = &*postcard::to_slice(&FromRobot::Configured, &mut message).unwrap();
        let reliable = framed(&Packet::Reliable { epoch: 7, sequence: 0, message });
        let latest = framed(&Packet::Latest { epoch: 7, message });
        let (mut received, mut says_more) = (Vec::new(), false);
        for (step, frame) in [hello, &reliable, &latest].into_iter().enumerate() {
            let now = Instant::default() + Duration::from_millis(600 * step as i64);
            received.extend(session.take(now, frame).1.map(|received| match received {
                Received::Foreign(why) => Received::Foreign(why),
                Received::NewPeer { epoch } => Received::NewPeer { epoch },
                _ => Received::Reliable(&[]),
            }));
            session.timeout(now);
            let mut memory = [0; MAX_FRAME];
            while let Some(frame) = session.poll_transmit(now, &mut memory) {
                // Behind COBS' own byte: the number of the packet, which in a hello COBS writes as the distance to the next zero.
                says_more |= frame[0] > 1;
            }
        }
        (received, says_more)
    }

    #[test]
    fn an_end_of_another_build_is_told_nothing_and_not_listened_to() {
        let (received, says_more) = hear(&framed(&hello(VERSION, LAYOUT)));
        assert_eq!(received, [Received::NewPeer { epoch: 7 }, Received::Reliable(&[]), Received::Reliable(&[])]);
        assert!(says_more);
        for (hello, why) in [
            (framed(&hello(VERSION, LAYOUT ^ 1)), Foreign::Layout),
            (framed(&hello(VERSION + 1, LAYOUT)), Foreign::Version(VERSION + 1)),
            // Version 4's own: it ends before the layout.
            (framed(&(0_u8, 4_u8, 7_u8, 0_u8, 0_u8, 0_u8, 32_u8, 0_u8)), Foreign::Version(4)),
            (framed(&(0_u8, 1_u8)), Foreign::Version(1)),
        ] {
            assert_eq!(hear(&hello), (vec![Received::Foreign(why)], false), "{why:?}");
        }
    }

    #[test]
    fn a_version_before_reads_the_version_of_ours() {
        let mut memory = [0; 64];
        let ours = postcard::to_slice(&hello(VERSION, LAYOUT), &mut memory).unwrap();
        // Version 4's hello: what is behind it is not looked at.
        type Before = (u32, u16, u32, Option<u32>, u32, u32, u16, bool);
        let before: Before = postcard::from_bytes(ours).unwrap();
        assert_eq!(before, (0, VERSION, 7, Some(1), 0, 0, 32, true));
    }

    #[test]
    fn the_reason_is_told_in_plain_words() {
        let told = "the robot's program has another configuration layout: build both from the same version";
        assert_eq!(Foreign::Layout.to_string(), told);
        let told = std::format!("the robot speaks version 4 of the robot link, this program {VERSION}: ");
        assert!(Foreign::Version(4).to_string().starts_with(&told));
    }
}
