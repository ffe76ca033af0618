//! One conversation with a robot, sans-IO.

use std::collections::VecDeque;
use std::ops::Bound;

use lrfslam_core::distributed_map::{Region, TilePlace};
use lrfslam_core::robot::RobotConfig;
use lrfslam_core::time::Instant;
use lrfslam_core::wire::frame::MAX_FRAME;
use lrfslam_core::wire::message::{Capacities, FromRobot, Status, TileUpdate, ToRobot};
use lrfslam_core::wire::session::{Progress, QueueFullError, Received, Session, SessionMemory};

use super::map::Tiles;

/// Bytes of requests and tiles that wait for the robot.
const QUEUE: usize = 16_384;
/// A robot's window reaches so much farther to each side than its beams: particles apart from one another, and tiles cut at the window's edge.
const WINDOW_MARGIN_M: f32 = 2.4;

/// `config` with no more particles, and no longer beams, than the robot has memory for.
pub(super) fn fitted(config: &RobotConfig, capacities: &Capacities) -> RobotConfig {
    let mut config = *config;
    config.particles.particles = config.particles.particles.min(capacities.particles);
    let window_m =
        f32::from(capacities.window_side) * f32::from(capacities.tile_side) * config.particle_map.square_size_m;
    config.rays.range_max_m = config.rays.range_max_m.min(0.5 * window_m - WINDOW_MARGIN_M).max(1.0);
    config
}

/// A region whose tiles the robot has asked for.
#[derive(Debug)]
struct Recall {
    region: Region,
    /// The last that it was given.
    given: Option<(i16, i16)>,
}

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
    Message(Told<'a>),
    /// How it is now.
    Status(Status),
    /// It speaks another version of the protocol.
    OtherVersion(u16),
}

/// A message of the robot's; it is acknowledged when the sink that is given it has returned.
#[derive(Debug, Clone, Copy)]
pub struct Told<'a> {
    /// Which it is.
    pub at: Progress,
    /// As it came.
    pub bytes: &'a [u8],
}

impl<'a> Told<'a> {
    /// What it says; `None` if this version of the protocol has no such message.
    pub fn message(&self) -> Option<FromRobot<'a>> {
        postcard::from_bytes(self.bytes).ok()
    }
}

/// The host's end of a session: bytes and the time in, frames and events out.
#[derive(Debug)]
pub struct RobotClient<'m> {
    config: Option<RobotConfig>,
    session: Session<'m>,
    /// What the robot has asked for and not been given yet.
    recalls: VecDeque<Recall>,
}

impl<'m> RobotClient<'m> {
    /// A host that will give `config` to the robot.
    ///
    /// * `epoch` — another number than that of the last run; `resume` — how far that one had come
    pub fn new(config: &RobotConfig, epoch: u32, resume: Option<Progress>, memory: &'m mut ClientMemory) -> Self {
        let memory = SessionMemory { queue: &mut memory.queue, frame: &mut memory.frame };
        Self { config: Some(*config), session: Session::new(epoch, resume, memory), recalls: VecDeque::new() }
    }

    /// The session below.
    pub fn session(&mut self) -> &mut Session<'m> {
        &mut self.session
    }

    /// Lets the robot forget everything, and configures it no more: the next host finds it as after power on.
    ///
    /// # Errors
    /// If too many requests wait already.
    pub fn release(&mut self) -> Result<(), QueueFullError> {
        self.config = None;
        self.ask(&ToRobot::Restart)
    }

    /// Asks the robot for something.
    ///
    /// # Errors
    /// If too many requests wait already.
    pub fn ask(&mut self, request: &ToRobot<'_>) -> Result<(), QueueFullError> {
        self.session.send(request).map(|_| ())
    }

    /// Gives the robot what it has asked for, as far as the queue has room; to be called after [`take`](Self::take).
    ///
    /// * `tiles` — what there is to be given back
    pub fn give_back(&mut self, tiles: &Tiles) {
        while let Some(Recall { region, given }) = self.recalls.front_mut() {
            let from = given.map_or(Bound::Unbounded, Bound::Excluded);
            let is_asked = |(column, row): (i16, i16)| region.contains(TilePlace { column, row });
            let next = tiles.range((from, Bound::Unbounded)).find(|(place, _)| is_asked(**place));
            let answer = match next {
                Some((&(column, row), squares)) => ToRobot::Tile(TileUpdate { column, row, squares }),
                None => ToRobot::Recalled(*region),
            };
            if self.session.send(&answer).is_err() {
                return;
            }
            match next {
                Some((place, _)) => *given = Some(*place),
                None => drop(self.recalls.pop_front()),
            }
        }
    }

    /// Takes bytes, and gives what they say to `sink`. A robot that introduces itself is configured.
    pub fn take(&mut self, now: Instant, bytes: &[u8], sink: &mut dyn FnMut(RobotEvent<'_>)) {
        let mut rest = bytes;
        while !rest.is_empty() {
            let before = self.session.progress();
            let (taken, received) = self.session.take(now, rest);
            rest = &rest[taken..];
            let mut introduced = None;
            match received {
                Some(Received::Reliable(bytes)) => {
                    // Only one whose epoch was known has come through.
                    let at = before.unwrap_or(Progress { epoch: 0, next: 0 });
                    let told = Told { at, bytes };
                    match told.message() {
                        Some(FromRobot::Identity(identity)) => introduced = Some(identity.capacities),
                        Some(FromRobot::Recall(region)) => self.recalls.push_back(Recall { region, given: None }),
                        _ => {}
                    }
                    sink(RobotEvent::Message(told));
                }
                Some(Received::Latest(message)) => {
                    postcard::from_bytes(message).into_iter().for_each(|status| sink(RobotEvent::Status(status)));
                }
                Some(Received::NewPeer { .. }) => {
                    self.recalls.clear();
                    sink(RobotEvent::NewRobot);
                }
                Some(Received::OtherVersion(version)) => sink(RobotEvent::OtherVersion(version)),
                None => {}
            }
            if let Some((config, capacities)) = self.config.zip(introduced) {
                // A full queue holds requests that the robot has not taken; it will introduce itself to the next host again.
                let _ = self.ask(&ToRobot::Configure(fitted(&config, &capacities)));
            }
        }
    }
}
