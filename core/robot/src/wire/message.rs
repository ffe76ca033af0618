//! What robot and host say to each other; postcard's encoding of these types, in the order in which they stand here.

use heapless::Vec;
use serde::{Deserialize, Serialize};

use super::sweep::SweepPart;
use crate::config::RobotConfig;
use lrfslam_core::distributed_map::Region;
use lrfslam_core::geometry::{Point2, Pose2};
use lrfslam_core::time::Instant;

/// Most particles that a [`Segment`] tells of.
pub const PARTICLES_MAX: usize = 64;

/// From the host.
// A message lives for a moment on the stack.
#[allow(clippy::large_enum_variant)]
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum ToRobot<'a> {
    /// Begin with this configuration. Answered by [`FromRobot::Configured`] or [`FromRobot::Refused`].
    Configure(RobotConfig),
    /// Stop the laser, then send the whole map: [`FromRobot::MapBegin`] to [`FromRobot::MapEnd`].
    Stop,
    /// Forget everything, as if power had been off: the robot comes back with another epoch.
    Restart,
    /// A tile that the robot asked for by [`FromRobot::Recall`].
    #[serde(borrow)]
    Tile(TileUpdate<'a>),
    /// These were all tiles there.
    Recalled(Region),
}

/// From the robot, reliable.
// As above.
#[allow(clippy::large_enum_variant)]
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum FromRobot<'a> {
    /// The first message to a host that is new.
    Identity(Identity<'a>),
    /// The configuration is in force.
    Configured,
    /// The last request cannot be met, and why.
    Refused(&'a str),
    /// A scan was taken.
    Scan(ScanPose),
    /// The filter took a step.
    Segment(Segment),
    /// A tile of the most likely particle's map, as it is now.
    #[serde(borrow)]
    Tile(TileUpdate<'a>),
    /// All tiles that follow until [`FromRobot::MapEnd`] are the whole map; what was sent before is void.
    MapBegin,
    /// The map is complete; number of its tiles.
    MapEnd(u32),
    /// Something in words: what the laser does.
    Said(&'a str),
    /// A part of a scan, before the [`FromRobot::Scan`] with its stamp. Not of every scan: see [`ReportConfig`](crate::config::ReportConfig).
    #[serde(borrow)]
    Sweep(SweepPart<'a>),
    /// A tile that the robot is about to forget. When this is acknowledged it does, unless it has come back to it, and from then on only
    /// the host has it.
    #[serde(borrow)]
    Left(TileUpdate<'a>),
    /// All tiles that were left in a region are to be given back: [`ToRobot::Tile`], as many as there are, and then [`ToRobot::Recalled`].
    Recall(Region),
}

/// What a robot is.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Identity<'a> {
    /// Its board.
    pub board: &'a str,
    /// False until it has got a configuration.
    pub is_configured: bool,
    /// What its memory holds.
    pub capacities: Capacities,
}

/// What a robot's memory holds.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Capacities {
    /// Beams of one scan.
    pub beams: u16,
    /// Particles.
    pub particles: u16,
    /// Map tiles of all particles together.
    pub tiles: u16,
    /// Squares along the side of a tile.
    pub tile_side: u8,
    /// Tiles of the matcher's reference.
    pub ndt_tiles: u16,
    /// Map tiles along the side of the window about the robot in which its scans must lie.
    pub window_side: u16,
}

/// A window reaches so much farther to each side than the beams, m: particles apart from one another, and tiles cut at its edge.
const WINDOW_MARGIN_M: f32 = 2.4;

impl Capacities {
    /// How far beams may go in a map with such squares, m; nothing if it is negative.
    pub fn reach_m(&self, square_size_m: f32) -> f32 {
        let window_m = f32::from(self.window_side) * f32::from(self.tile_side) * square_size_m;
        0.5 * window_m - WINDOW_MARGIN_M
    }
}

/// Where the robot was at one scan: the pose of the most likely particle at the filter's last step, and what laser odometry says
/// since; and what laser odometry says by itself.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ScanPose {
    /// Of the scan, on the robot's clock.
    pub stamp: Instant,
    /// Number of the scan, from 1; what is missing between two was lost while the link was away.
    pub number: u32,
    /// Number of the filter's last step, this scan's included; 0 before the first.
    pub step: u32,
    /// From the pose of any particle at that step to the robot's now.
    pub moved: Pose2,
    /// Pose in the map of laser odometry, which goes on from the particles' mean after each step: what tells two scans apart.
    pub odometry: Pose2,
    /// Unit vector in that map about which the scene says nothing.
    pub undetermined: Option<Point2>,
    /// The scan agrees too little with the map for the pose to be believed.
    pub is_lost: bool,
}

/// One edge of every particle's path: from where its ancestor was in the segment before to where it is now.
///
/// The host walks from a particle back, segment by segment, and has its path.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Segment {
    /// Number of the filter's step that ends it, from 1.
    pub step: u32,
    /// That of the segment before; 0 for the first. More than one apart if the link was away: paths then leave steps out.
    pub since_step: u32,
    /// Of the scan that was taken then, on the robot's clock.
    pub stamp: Instant,
    /// Index of the most likely particle.
    pub best: u8,
    /// The particles, in the filter's order.
    pub particles: Vec<PathNode, PARTICLES_MAX>,
}

/// A particle at the end of a segment.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PathNode {
    /// Index of its ancestor among the particles of the segment before.
    pub parent: u8,
    /// Where the robot is, to it.
    pub map_from_robot: Pose2,
}

/// A tile of the map.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct TileUpdate<'a> {
    /// It covers `[column, column + 1) × [row, row + 1)` times its side.
    pub column: i16,
    /// See `column`.
    pub row: i16,
    /// Hits, then distance travelled in 1/8 of a square's side, of every square, row by row.
    pub squares: &'a [u8],
}

/// How the robot is; the newest replaces the others.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Status {
    /// The robot's clock.
    pub now: Instant,
    /// Where the robot is.
    pub map_from_robot: Pose2,
    /// Scans mapped.
    pub scans: u32,
    /// Steps of the filter.
    pub steps: u32,
    /// Particles alive.
    pub particles: u16,
    /// Map tiles in use.
    pub tiles: u16,
    /// Particles that had to go because no tile was free, since the start.
    pub dropped_particles: u32,
    /// Squares of the map left out because no tile was free with one particle left, since the start.
    pub squares_left_out: u32,
    /// Scans that could not be used: larger than the memory.
    pub refused_scans: u32,
    /// Scans and replies of the laser that were damaged.
    pub damaged: u32,
    /// Times that the laser's session was begun anew.
    pub restarts: u32,
    /// Scans that were not believed.
    pub lost_scans: u32,
    /// Scans that would have been told with their beams and found no room in the queue.
    pub untold_sweeps: u32,
    /// Scans left out because newer ones had come: they come faster than they are mapped.
    pub late_scans: u32,
    /// Map tiles that went to the host.
    pub tiles_left: u32,
    /// Map tiles that came back.
    pub tiles_restored: u32,
    /// Map tiles that are lost: no host was there for them, or no room when they came back.
    pub tiles_forgotten: u32,
    /// What the board says of itself.
    pub health: Health,
}

/// What only the board knows.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Health {
    /// Deepest use of the stack so far, bytes; 0 where it is not watched.
    pub stack_used: u32,
    /// Bytes that came while the laser's buffer was full.
    pub lrf_overrun: u32,
    /// … and the link's.
    pub link_overrun: u32,
    /// Longest time that one input took, µs.
    pub longest_us: u32,
    /// Where the program was at the fault or panic that made it start anew, as the processor counts; 0 for none.
    pub fault_at: u32,
}
