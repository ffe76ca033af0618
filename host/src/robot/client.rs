//! One conversation with a robot, sans-IO.

use lrfslam_core::robot::RobotConfig;
use lrfslam_core::time::Instant;
use lrfslam_core::wire::frame::MAX_FRAME;
use lrfslam_core::wire::message::{FromRobot, Status, ToRobot};
use lrfslam_core::wire::session::{Progress, QueueFullError, Received, Session, SessionMemory};

/// Bytes of requests that wait for the robot.
const QUEUE: usize = 4096;

/// The memory that a [`RobotClient`] works in.
#[derive(Debug)]
pub struct ClientMemory {
    queue: Vec<u8>,
    frame: Vec<u8>,
}

impl Default for ClientMemory {
    fn default() -> Self {
        Self { queue: vec![0; QUEUE], frame: vec![0; MAX_FRAME] }
    }
}

/// What the robot says.
// An event lives for a moment on the stack.
#[allow(clippy::large_enum_variant)]
#[derive(Debug)]
pub enum RobotEvent<'a> {
    /// A robot that was not there before, or was started anew.
    NewRobot,
    /// A message, once and in order.
    Message(FromRobot<'a>),
    /// How it is now.
    Status(Status),
    /// It speaks another version of the protocol.
    OtherVersion(u16),
}

/// The host's end of a session: bytes and the time in, frames and events out.
#[derive(Debug)]
pub struct RobotClient<'m> {
    config: RobotConfig,
    session: Session<'m>,
}

impl<'m> RobotClient<'m> {
    /// A host that will give `config` to the robot.
    ///
    /// * `epoch` — another number than that of the last run; `resume` — how far that one had come
    pub fn new(config: &RobotConfig, epoch: u32, resume: Option<Progress>, memory: &'m mut ClientMemory) -> Self {
        let memory = SessionMemory { queue: &mut memory.queue, frame: &mut memory.frame };
        Self { config: *config, session: Session::new(epoch, resume, memory) }
    }

    /// The session below.
    pub fn session(&mut self) -> &mut Session<'m> {
        &mut self.session
    }

    /// Asks the robot for something.
    ///
    /// # Errors
    /// If too many requests wait already.
    pub fn ask(&mut self, request: &ToRobot) -> Result<(), QueueFullError> {
        self.session.send(request).map(|_| ())
    }

    /// Takes bytes, and gives what they say to `sink`. A robot that introduces itself is configured.
    pub fn take(&mut self, now: Instant, bytes: &[u8], sink: &mut dyn FnMut(RobotEvent<'_>)) {
        let mut rest = bytes;
        while !rest.is_empty() {
            let (taken, received) = self.session.take(now, rest);
            rest = &rest[taken..];
            let mut is_identity = false;
            match received {
                Some(Received::Reliable(message)) => {
                    if let Ok(message) = postcard::from_bytes::<FromRobot<'_>>(message) {
                        is_identity = matches!(message, FromRobot::Identity(_));
                        sink(RobotEvent::Message(message));
                    }
                }
                Some(Received::Latest(message)) => {
                    postcard::from_bytes(message).into_iter().for_each(|status| sink(RobotEvent::Status(status)));
                }
                Some(Received::NewPeer { .. }) => sink(RobotEvent::NewRobot),
                Some(Received::OtherVersion(version)) => sink(RobotEvent::OtherVersion(version)),
                None => {}
            }
            if is_identity {
                // A full queue holds requests that the robot has not taken; it will introduce itself to the next host again.
                let _ = self.ask(&ToRobot::Configure(self.config));
            }
        }
    }
}
