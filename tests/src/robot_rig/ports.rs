//! What the robot does to its ports, and what it says of its scans on the way.

use std::hash::{DefaultHasher, Hash as _, Hasher as _};

use lrfslam_core::geometry::Pose2;
use lrfslam_robot::wire::message::Health;
use lrfslam_robot::{Mapped, Ports};

/// What mapping did so far that no host is told.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Tally {
    /// Scans mapped.
    pub scans: u32,
    /// Of these, those that could not be believed.
    pub lost: u32,
    /// Particles that went because no map tile was free.
    pub dropped: usize,
    /// Most map tiles in use.
    pub tiles: usize,
    /// Points that the matcher's reference had no room for.
    pub ndt_dropped: u32,
    /// Tiles of it that were forgotten for nearer ones.
    pub ndt_evicted: u32,
    /// Fingerprint of all poses so far, bit by bit.
    pub poses: u64,
}

impl Tally {
    /// Counts a scan that was taken here.
    pub fn add_pose(&mut self, Pose2 { x, y, heading }: Pose2) {
        self.scans += 1;
        let mut hasher = DefaultHasher::new();
        (self.poses, [x, y, heading].map(f32::to_bits)).hash(&mut hasher);
        self.poses = hasher.finish();
    }

    /// Counts a scan.
    pub fn add(&mut self, mapped: &Mapped) {
        let odometry = &mapped.report.odometry;
        self.add_pose(mapped.report.map_from_robot);
        self.lost += u32::from(odometry.is_lost);
        self.ndt_dropped += odometry.inserted.dropped;
        self.ndt_evicted += odometry.inserted.evicted;
        if let Some(filter) = &mapped.report.filter {
            self.dropped += filter.dropped;
            self.tiles = self.tiles.max(filter.tiles);
        }
    }
}

/// What one input led to.
#[derive(Default)]
pub(super) struct RigPorts {
    pub(super) to_laser: Vec<Vec<u8>>,
    pub(super) baud: Option<u32>,
    pub(super) room: usize,
    pub(super) to_host: Vec<Vec<u8>>,
    pub(super) is_restart: bool,
    pub(super) tally: Tally,
}

impl Ports for RigPorts {
    fn send_to_laser(&mut self, bytes: &[u8]) {
        self.to_laser.push(bytes.to_vec());
    }
    fn set_laser_baud(&mut self, baud: u32) {
        self.baud = Some(baud);
    }
    fn link_room(&self) -> usize {
        self.room
    }
    fn send_to_host(&mut self, frame: &[u8]) {
        self.room = self.room.saturating_sub(frame.len());
        self.to_host.push(frame.to_vec());
    }
    fn restart(&mut self) {
        self.is_restart = true;
    }
    fn health(&self) -> Health {
        Health::default()
    }
    fn mapped(&mut self, mapped: &Mapped) {
        self.tally.add(mapped);
    }
}
