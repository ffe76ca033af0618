//! What is wanted of a bag's frames, and where in the bag it is: odometry, and the laser on the robot.
//!
//! Data flow: bag → frames, until all that is wanted is among them → [`Found`]; then, scan by scan, [`Found::take`]. The bag is read twice, but
//! the first time only as far as that: static frames come at its beginning as a rule.

use lrfslam_core::geometry::Pose2;
use lrfslam_core::time::Instant;
use nalgebra::{Isometry3, Vector3};

use super::container::{Container, Next};
use super::frames::{Chain, Frames};
use super::messages;
use crate::input::text::FieldFault;
use crate::pose_f64::PoseF64;
use crate::scans::mcap::Message;

/// Frames of a robot that does not say which it has. Source: REP 105, REP 120.
const ROBOT_FRAMES: [&str; 2] = ["base_link", "base_footprint"];
/// The second of them is taken if the first did not come within so much of the bag's time, ns.
const FIRST_WITHIN_NS: u64 = 10_000_000_000;
/// A laser that leans more does not scan the robot's plane, rad.
const LEAN_MAX_RAD: f64 = 0.175;

/// What is wanted of the frames of a bag (`tf`).
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct TfWanted {
    /// Odometry is the robot in this frame, not what `nav_msgs/Odometry` says.
    pub odometry_frame: Option<&'static str>,
    /// Where the laser is on the robot.
    pub mounting: bool,
    /// The robot; `None`: `base_link`, or `base_footprint` if there is no such frame.
    pub robot_frame: Option<&'static str>,
}

impl TfWanted {
    /// Something is.
    pub fn is_any(&self) -> bool {
        self.odometry_frame.is_some() || self.mounting
    }
}

/// What is wrong with the frames of a bag.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum TfFault {
    /// There is no way from one to the other.
    #[error("no transforms {missing} in messages of tf2_msgs/TFMessage: its frames are {frames}")]
    Missing {
        /// From where to where.
        missing: String,
        /// All that there are.
        frames: String,
    },
    /// The laser does not lie in the robot's plane.
    #[error(
        "{laser} leans by {lean_deg:.0}° against {robot}: a mounting in the plane does not tell where its beams go"
    )]
    Leans {
        /// Frame of the laser.
        laser: String,
        /// Frame of the robot.
        robot: String,
        /// Between their z axes, degrees.
        lean_deg: f64,
    },
}

/// What was found among the frames of a bag.
#[derive(Debug, Clone, Default)]
pub(super) struct Found {
    frames: Frames,
    /// Frames of the odometry and of the robot.
    odometry: Option<(String, String)>,
    pub robot_from_lrf: Option<Pose2>,
    /// What it is, for the user.
    pub words: Vec<String>,
}

/// Frames as they come, until they are enough.
struct Look<'a> {
    wanted: &'a TfWanted,
    frames: Frames,
    /// Of the first scan; empty if it has none.
    laser: Option<String>,
    first_ns: Option<u64>,
}

/// Reads bags until what is wanted is known; `topic` has the scans. Without scans nothing is found, and nothing is wrong.
pub(super) fn look(
    bags: impl Iterator<Item = Box<dyn Container>>,
    topic: Option<&str>,
    wanted: &TfWanted,
) -> Result<Found, TfFault> {
    let mut look = Look { wanted, frames: Frames::default(), laser: None, first_ns: None };
    for mut bag in bags {
        loop {
            match bag.next() {
                Next::Message(message) => {
                    let is_patient = look.take(&message, topic);
                    if let Some(found) = look.found(!is_patient)? {
                        return Ok(found);
                    }
                }
                // It is told when the scans are read.
                Next::Damaged(_) => {}
                Next::End { .. } => break,
            }
        }
    }
    match look.found(true)? {
        Some(found) => Ok(found),
        None if look.laser.is_none() => Ok(Found::default()),
        None => Err(look.fault()),
    }
}

impl Look<'_> {
    /// True if the robot's usual frame may still come.
    fn take(&mut self, message: &Message, topic: Option<&str>) -> bool {
        let channel = &message.channel;
        if messages::is_tf(&channel.schema) {
            take_into(&mut self.frames, message).unwrap_or_default();
        } else if self.laser.is_none()
            && messages::is_scan(&channel.schema)
            && topic.is_none_or(|topic| topic == channel.topic)
        {
            self.laser = messages::frame_of_scan(message).ok();
        }
        let first_ns = *self.first_ns.get_or_insert(message.time_ns);
        message.time_ns.saturating_sub(first_ns) < FIRST_WITHIN_NS
    }

    fn candidates(&self) -> Vec<&'static str> {
        self.wanted.robot_frame.map_or(ROBOT_FRAMES.to_vec(), |frame| vec![frame])
    }

    /// All that is wanted, if it is there; `is_late`: of the robot's usual frames any will do.
    fn found(&self, is_late: bool) -> Result<Option<Found>, TfFault> {
        let Some(laser) = &self.laser else { return Ok(None) };
        let candidates = self.candidates();
        for robot in candidates.iter().take(if is_late { usize::MAX } else { 1 }) {
            let odometry = self.wanted.odometry_frame.map(|frame| (frame, self.frames.chain(frame, robot)));
            let mounting = self.wanted.mounting.then(|| self.frames.chain(robot, laser).filter(|chain| chain.is_fixed));
            if odometry.as_ref().is_some_and(|(_, chain)| chain.is_none())
                || mounting.as_ref().is_some_and(Option::is_none)
            {
                continue;
            }
            let mut found = Found { frames: self.frames.clone(), ..Found::default() };
            if let Some((frame, Some(chain))) = odometry {
                found.odometry = Some((frame.to_owned(), (*robot).to_owned()));
                found.words.push(format!("odometry by tf: {}", chain.names.join(" → ")));
            }
            if let Some(chain) = mounting.flatten() {
                found.take_mounting(&chain, robot, laser)?;
            }
            return Ok(Some(found));
        }
        Ok(None)
    }

    /// What is missing.
    fn fault(&self) -> TfFault {
        let (robots, laser) = (self.candidates(), self.laser.as_deref().unwrap_or_default());
        let odometry = self
            .wanted
            .odometry_frame
            .filter(|frame| robots.iter().all(|robot| self.frames.chain(frame, robot).is_none()));
        let robots = robots.join(" or ");
        let missing = match odometry {
            Some(frame) => format!("{frame} → {robots}"),
            None => format!("{robots} → {laser} that stay where they are"),
        };
        TfFault::Missing { missing, frames: self.frames.words() }
    }
}

impl Found {
    fn take_mounting(&mut self, chain: &Chain, robot: &str, laser: &str) -> Result<(), TfFault> {
        let up = chain.parent_from_child.rotation * Vector3::z();
        let lean_rad = up.angle(&Vector3::z());
        if lean_rad > LEAN_MAX_RAD {
            let (laser, robot) = (laser.to_owned(), robot.to_owned());
            return Err(TfFault::Leans { laser, robot, lean_deg: lean_rad.to_degrees() });
        }
        let pose = in_the_plane(&chain.parent_from_child);
        self.words.push(format!(
            "mounting by tf: the laser is {:.3} m forward and {:.3} m left on the robot, turned by {:.2}° ({})",
            pose.x,
            pose.y,
            pose.heading.to_degrees(),
            chain.names.join(" → ")
        ));
        self.robot_from_lrf = Some(pose.to_f32());
        Ok(())
    }

    /// Odometry is followed.
    pub fn has_odometry(&self) -> bool {
        self.odometry.is_some()
    }

    /// Takes a message with frames; when and where the robot is, if it says that anew.
    pub fn take(&mut self, message: &Message) -> Result<Option<(Instant, PoseF64)>, FieldFault> {
        let Some((odometry, robot)) = &self.odometry else { return Ok(None) };
        let told = take_into(&mut self.frames, message)?;
        let Some(chain) = self.frames.chain(odometry, robot) else { return Ok(None) };
        // The first name is not one that is told: it has no parent on the way.
        if !told.iter().any(|child| chain.names.iter().skip(1).any(|name| name == child)) {
            return Ok(None);
        }
        Ok(chain.newest.map(|stamp| (stamp, in_the_plane(&chain.parent_from_child))))
    }
}

/// Adds the frames of a message; their names.
fn take_into(frames: &mut Frames, message: &Message) -> Result<Vec<String>, FieldFault> {
    let told = messages::transforms(message)?;
    let is_static = message.channel.topic.ends_with("tf_static");
    let names = told.iter().map(|transform| transform.child.clone()).collect();
    told.into_iter().for_each(|transform| frames.add(transform, is_static));
    Ok(names)
}

/// Seen from above.
fn in_the_plane(at: &Isometry3<f64>) -> PoseF64 {
    let forward = at.rotation * Vector3::x();
    PoseF64::new(at.translation.x, at.translation.y, forward.y.atan2(forward.x))
}
