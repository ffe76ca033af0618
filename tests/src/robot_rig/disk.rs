//! What a host keeps of what a robot tells it.

use lrfslam_host::robot::{RobotMap, Sweeps, Tiles, Told};
use lrfslam_robot::wire::message::{FromRobot, Segment};
use lrfslam_robot::wire::session::Progress;

/// Where a host stores what it hears; it outlives the host.
pub trait HostDisk {
    /// Stores a message, which is acknowledged when this returns.
    fn take(&mut self, told: &Told<'_>);

    /// How far the robot's messages have come.
    fn progress(&self) -> Option<Progress>;

    /// What the robot is given back when it asks.
    fn to_give_back(&self) -> Option<&Tiles> {
        None
    }
}

/// All that a host has heard of one life of a robot.
#[derive(Debug, Clone, Default)]
pub struct Life {
    /// Epoch of the robot, once it is known.
    pub epoch: Option<u32>,
    /// Numbers of the reliable messages, as they came.
    pub numbers: Vec<u32>,
    /// What they say of path and map.
    pub map: RobotMap,
    /// Every segment that they tell.
    pub segments: Vec<Segment>,
    /// Beams of each scan that was told with them.
    pub sweeps: Vec<usize>,
}

impl Life {
    fn take(&mut self, at: Progress, message: &FromRobot<'_>, parts: &mut Sweeps) {
        self.epoch = Some(at.epoch);
        self.numbers.push(at.next);
        self.map.take(message);
        match message {
            FromRobot::Segment(segment) => self.segments.push(segment.clone()),
            FromRobot::Sweep(part) => parts.take_part(part),
            FromRobot::Scan(pose) => {
                self.sweeps.extend(parts.taken_at(pose.stamp).map(|sweep| sweep.scan().beams.len()));
            }
            _ => {}
        }
    }
}

/// All lives of the robot, and how far it had come with the last.
#[derive(Debug, Clone, Default)]
pub struct Disk {
    /// In order.
    pub lives: Vec<Life>,
    /// In words, and refusals.
    pub said: Vec<String>,
    progress: Option<Progress>,
    parts: Sweeps,
}

impl HostDisk for Disk {
    fn take(&mut self, told: &Told<'_>) {
        let at = told.at;
        let message = told.message().expect("robot and host are of one version");
        if self.lives.last().is_none_or(|life| life.epoch.is_some_and(|epoch| epoch != at.epoch)) {
            self.lives.push(Life::default());
        }
        let parts = &mut self.parts;
        self.lives.last_mut().into_iter().for_each(|life| life.take(at, &message, parts));
        self.progress = Some(Progress { epoch: at.epoch, next: at.next.wrapping_add(1) });
        if let FromRobot::Said(text) | FromRobot::Refused(text) = message {
            self.said.push(text.to_owned());
        }
    }

    fn progress(&self) -> Option<Progress> {
        self.progress
    }

    fn to_give_back(&self) -> Option<&Tiles> {
        self.lives.last().map(|life| life.map.to_give_back())
    }
}
