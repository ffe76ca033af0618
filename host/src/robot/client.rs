//! One conversation with a robot, sans-IO.

use std::collections::VecDeque;

use lrfslam_core::distributed_map::{Region, TilePlace};
use lrfslam_core::slam::SlamConfig;
use lrfslam_core::time::Instant;
use lrfslam_robot::RobotConfig;
use lrfslam_robot::wire::frame::{DELIMITER, MAX_FRAME};
use lrfslam_robot::wire::lock::Lock;
use lrfslam_robot::wire::message::{Capacities, FromRobot, Status, TileUpdate, ToRobot};
use lrfslam_robot::wire::session::{Foreign, Progress, QueueFullError, Received, Session, SessionMemory};

use super::judge::Absurd;
use super::map::Tiles;

/// Bytes of requests and tiles that wait for the robot.
const QUEUE: usize = 16_384;
/// No robot is given less of a view, m: one that has no memory for it says so.
const VIEW_MIN_M: f32 = 1.0;

/// Regions that a robot may wait for: its program asks for four, and again if its host is new.
const RECALLS_MAX: usize = 16;
/// Messages a second that a robot may send for long …
const MESSAGES_PER_S: f32 = 2000.0;
/// … and at once, after a time without a host.
const MESSAGES_AT_ONCE: f32 = 100_000.0;

/// `config` with no more particles, and no longer beams, than the robot has memory for.
pub(super) fn fitted(config: &SlamConfig, capacities: &Capacities) -> SlamConfig {
    let mut config = *config;
    let room = capacities.particles / config.particles.samples_per_particle.max(1);
    config.particles.particles = config.particles.particles.min(room.max(1));
    let reach_m = capacities.reach_m(config.particle_map.square_size_m).max(VIEW_MIN_M);
    config.rays.range_max_m = config.rays.range_max_m.min(reach_m);
    config.rays.miss_range_m = config.rays.miss_range_m.min(reach_m);
    config
}

/// A region whose tiles the robot asks for.
#[derive(Debug)]
pub struct Recall {
    region: Region,
    /// Still to be given.
    tiles: VecDeque<((i16, i16), Vec<u8>)>,
}

impl Recall {
    /// It is given what `tiles` have there now.
    pub fn answer(&mut self, tiles: &Tiles) {
        let is_asked = |(column, row): (i16, i16)| self.region.contains(TilePlace { column, row });
        let asked = tiles.iter().filter(|(place, _)| is_asked(**place));
        self.tiles = asked.map(|(place, squares)| (*place, squares.clone())).collect();
    }
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
    /// It asks for tiles that it has left, and is to be given what there is after the messages before, and before those that follow: so what it gets
    /// does not depend on how they come.
    Recall(&'a mut Recall),
    /// How it is now.
    Status(Status),
    /// It is of another build; it is told nothing, and nothing is taken from it.
    Foreign(Foreign),
    /// It has another host, and is not to be had now.
    Busy,
    /// It says more than a robot can; what was too much was not taken.
    Absurd(Absurd),
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
    /// Messages that it may send now, and when that was counted.
    allowance: (f32, Option<Instant>),
}

impl<'m> RobotClient<'m> {
    /// A host that will give `config` to the robot.
    ///
    /// * `epoch` — another number than that of the last run; `resume` — how far that one had come
    pub fn new(config: &RobotConfig, epoch: u32, resume: Option<Progress>, memory: &'m mut ClientMemory) -> Self {
        let memory = SessionMemory { queue: &mut memory.queue, frame: &mut memory.frame };
        Self {
            config: Some(*config),
            session: Session::new(epoch, resume, memory),
            recalls: VecDeque::new(),
            allowance: (MESSAGES_AT_ONCE, None),
        }
    }

    /// The same for a robot that has a key, if it has one.
    #[must_use]
    pub fn with_lock(mut self, lock: impl Into<Option<Lock>>) -> Self {
        self.session = self.session.with_lock(lock);
        self
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

    /// Gives the robot what it has asked for, as far as the queue has room.
    fn give_back(&mut self) {
        while let Some(Recall { region, tiles }) = self.recalls.front_mut() {
            let answer = match tiles.front() {
                Some(((column, row), squares)) => ToRobot::Tile(TileUpdate { column: *column, row: *row, squares }),
                None => ToRobot::Recalled(*region),
            };
            if self.session.send(&answer).is_err() {
                return;
            }
            if tiles.pop_front().is_none() {
                self.recalls.pop_front();
            }
        }
    }

    /// Counts a frame that ends in `bytes`; the error of one that is too many.
    fn count_message_if_whole(&mut self, now: Instant, bytes: &[u8]) -> Result<(), Absurd> {
        // Zeros in a row are an idle line.
        if !bytes.contains(&DELIMITER) || bytes.first() == Some(&DELIMITER) {
            return Ok(());
        }
        let (left, at) = self.allowance;
        let seconds = at.map_or(0.0, |at| now.since(at).micros.max(0) as f32 * 1e-6);
        let left = (left + seconds * MESSAGES_PER_S).min(MESSAGES_AT_ONCE) - 1.0;
        if left < 0.0 {
            let why = format!("more than {MESSAGES_PER_S} messages a second");
            return Err(Absurd { message: "flood", why });
        }
        self.allowance = (left, Some(now));
        Ok(())
    }

    /// Takes bytes, and gives what they say to `sink`. A robot that introduces itself is configured.
    pub fn take(&mut self, now: Instant, bytes: &[u8], sink: &mut dyn FnMut(RobotEvent<'_>)) {
        let mut rest = bytes;
        while !rest.is_empty() {
            let before = self.session.progress();
            if let Err(absurd) = self.count_message_if_whole(now, rest) {
                return sink(RobotEvent::Absurd(absurd));
            }
            let (taken, received) = self.session.take(now, rest);
            rest = rest.get(taken..).unwrap_or_default();
            let (mut introduced, mut asked) = (None, None);
            match received {
                Some(Received::Reliable(bytes)) => {
                    // Only one whose epoch was known has come through.
                    let at = before.unwrap_or(Progress { epoch: 0, next: 0 });
                    let told = Told { at, bytes };
                    match told.message() {
                        Some(FromRobot::Identity(identity)) => introduced = Some(identity.capacities),
                        Some(FromRobot::Recall(region)) => asked = Some(Recall { region, tiles: VecDeque::new() }),
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
                Some(Received::Foreign(why)) => sink(RobotEvent::Foreign(why)),
                Some(Received::Busy) => sink(RobotEvent::Busy),
                None => {}
            }
            if let Some(recall) = asked
                && let Err(absurd) = self.take_recall(recall, sink)
            {
                return sink(RobotEvent::Absurd(absurd));
            }
            introduced.iter().for_each(|capacities| self.configure(capacities));
        }
        self.give_back();
    }

    /// Gives a robot with these capacities its configuration.
    fn configure(&mut self, capacities: &Capacities) {
        if let Some(config) = self.config {
            // A full queue holds requests that the robot has not taken; it will introduce itself to the next host again.
            let slam = fitted(&config.slam, capacities);
            let _ = self.ask(&ToRobot::Configure(RobotConfig { slam, ..config }));
        }
    }

    /// Has a recall answered, unless too many wait already.
    fn take_recall(&mut self, mut recall: Recall, sink: &mut dyn FnMut(RobotEvent<'_>)) -> Result<(), Absurd> {
        if self.recalls.len() >= RECALLS_MAX {
            let why = format!("{RECALLS_MAX} of them wait for an answer already");
            return Err(Absurd { message: "Recall", why });
        }
        sink(RobotEvent::Recall(&mut recall));
        self.recalls.push_back(recall);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn left(column: i16) -> FromRobot<'static> {
        FromRobot::Left(TileUpdate { column, row: 0, squares: &[1; 128] })
    }

    /// Bytes that an end has to say.
    fn said(session: &mut Session<'_>, now: Instant) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut memory = [0; MAX_FRAME];
        while let Some(frame) = session.poll_transmit(now, &mut memory) {
            bytes.extend_from_slice(frame);
        }
        bytes
    }

    #[test]
    fn a_recall_is_answered_from_what_came_before_it() {
        let (mut client_memory, mut robot_memory, now) =
            (ClientMemory::default(), ClientMemory::default(), Instant::default());
        let mut client = RobotClient::new(&RobotConfig::default(), 2, None, &mut client_memory);
        let memory = SessionMemory { queue: &mut robot_memory.queue, frame: &mut robot_memory.frame };
        let mut robot = Session::new(1, None, memory);
        robot.connected(now);
        client.session().connected(now);
        let region = Region { columns: [0, 3], rows: [0, 1] };
        for message in [left(0), left(7), FromRobot::Recall(region), left(1), FromRobot::Recall(region)] {
            robot.send(&message).unwrap();
        }
        let (mut tiles, mut given) = (Tiles::new(), Vec::new());
        for _ in 0..6 {
            client.take(now, &said(&mut robot, now), &mut |event| match event {
                RobotEvent::Message(told) => {
                    if let Some(FromRobot::Left(tile)) = told.message() {
                        tiles.insert((tile.column, tile.row), tile.squares.to_vec());
                    }
                }
                RobotEvent::Recall(recall) => recall.answer(&tiles),
                _ => {}
            });
            let bytes = said(client.session(), now);
            let mut rest = bytes.as_slice();
            while !rest.is_empty() {
                let (taken, received) = robot.take(now, rest);
                rest = rest.get(taken..).unwrap_or_default();
                if let Some(Received::Reliable(message)) = received {
                    given.push(match postcard::from_bytes(message).unwrap() {
                        ToRobot::Tile(tile) => Ok(tile.column),
                        ToRobot::Recalled(region) => Err(region),
                        other => panic!("{other:?}"),
                    });
                }
            }
        }
        assert_eq!(tiles.len(), 3);
        assert_eq!(given, [Ok(0), Err(region), Ok(0), Ok(1), Err(region)]);
    }
}
