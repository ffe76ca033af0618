//! What a run publishes.

use std::time::{Duration as WallDuration, Instant as WallInstant};

use lrfslam_core::geometry::Pose2;
use lrfslam_core::scan::RangeScan;
use lrfslam_core::time::{Duration, Instant};
use lrfslam_host::maps::occupancy::Raster;
use lrfslam_host::runs::map::Whereabouts;
use rustdds::no_key::DataWriter;
use rustdds::{DataWriterStatus, StatusEvented as _};

use crate::messages::{self, Frames, Motion};
use crate::node::{Node, NodeError, Quality};
use crate::raw::{Raw, Whole};

/// From one map to the next, at least.
const MAP_EVERY: WallDuration = WallDuration::from_secs(2);
/// Drawing maps takes no more than one in so many parts of the time.
const MAP_SHARE: u32 = 20;
/// At the end, those who have not got all are waited for so long.
const FAREWELL: WallDuration = WallDuration::from_secs(2);

/// A scan that was placed.
#[derive(Debug, Clone, Copy)]
pub struct Step<'a> {
    /// The scan.
    pub scan: RangeScan<'a>,
    /// The laser on the robot.
    pub robot_from_lrf: Pose2,
    /// Where the robot is by it.
    pub place: Whereabouts,
}

/// `/map`, `/tf`, `/odom`, `/pose`, and `/scan` if the laser is this program's.
pub struct Topics {
    /// The participant leaves with the last of its users; its writers do not keep it.
    _node: Node,
    scan: Option<DataWriter<Raw, Whole>>,
    map: DataWriter<Raw, Whole>,
    transforms: DataWriter<Raw, Whole>,
    odometry: DataWriter<Raw, Whole>,
    pose: DataWriter<Raw, Whole>,
    /// Of the scan before.
    stamp: Option<Instant>,
    pace: MapPace,
    left_out: u64,
}

impl std::fmt::Debug for Topics {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        out.debug_struct("Topics").field("pace", &self.pace).finish_non_exhaustive()
    }
}

impl Topics {
    /// Announces them.
    ///
    /// * `has_scan` — false if the scans come from a topic: its frame, and where that is on the robot, are another's to tell
    ///
    /// # Errors
    /// If DDS refuses one.
    pub fn announce(node: &Node, has_scan: bool) -> Result<Self, NodeError> {
        let last = |depth| Quality { depth, is_reliable: true, is_kept: false };
        let scan = has_scan.then(|| node.writer("/scan", "sensor_msgs/LaserScan", last(10))).transpose()?;
        let kept = Quality { depth: 1, is_reliable: true, is_kept: true };
        Ok(Self {
            _node: node.clone(),
            scan,
            map: node.writer("/map", "nav_msgs/OccupancyGrid", kept)?,
            transforms: node.writer("/tf", "tf2_msgs/TFMessage", last(100))?,
            odometry: node.writer("/odom", "nav_msgs/Odometry", last(10))?,
            pose: node.writer("/pose", "geometry_msgs/PoseWithCovarianceStamped", last(10))?,
            stamp: None,
            pace: MapPace::default(),
            left_out: 0,
        })
    }

    /// Tells a scan, and where the robot is by it.
    pub fn step(&mut self, step: &Step<'_>) {
        let Step { scan, robot_from_lrf, place } = step;
        let stamp = scan.stamp;
        let duration = self.stamp.replace(stamp).map_or(Duration::ZERO, |before| stamp.since(before));
        let robot_from_lrf = self.scan.is_some().then(|| (*robot_from_lrf).into());
        let (map_from_robot, odom_from_robot) = (place.map_from_robot.into(), place.odom_from_robot);
        let frames = Frames { map_from_robot, odom_from_robot, robot_from_lrf };
        let motion = Motion { moved: place.moved, duration, covariance: place.match_covariance };
        // Frames first: who gets a scan knows where it is.
        let mut sent = [
            send(&self.transforms, messages::transforms(stamp, &frames)),
            send(&self.odometry, messages::odometry(stamp, odom_from_robot, &motion)),
            send(&self.pose, messages::pose_in_map(stamp, map_from_robot, &place.covariance)),
            true,
        ];
        if let Some(writer) = &self.scan {
            sent[3] = send(writer, messages::scan(scan, duration));
        }
        self.left_out += sent.iter().filter(|sent| !**sent).count() as u64;
    }

    /// A new map is due: somebody has subscribed, or still looks after a while; the first is always.
    pub fn wants_map(&mut self) -> bool {
        while let Some(status) = self.map.try_recv_status() {
            if let DataWriterStatus::PublicationMatched { current, .. } = status {
                self.pace.watchers(current.count(), current.count_change() > 0);
            }
        }
        self.pace.is_due(WallInstant::now())
    }

    /// Tells the map.
    ///
    /// * `drawn_in` — what it took to draw
    pub fn map(&mut self, raster: &Raster, drawn_in: WallDuration) {
        let stamp = self.stamp.unwrap_or_default();
        self.pace.drawn(WallInstant::now(), drawn_in);
        self.left_out += u64::from(!send(&self.map, messages::map(stamp, raster)));
    }

    /// Waits until those who listen have what was sent, two seconds at most; how many messages were left out because DDS had no room.
    pub fn finish(self) -> u64 {
        let ended = WallInstant::now();
        for writer in [&self.map, &self.transforms, &self.pose, &self.odometry].into_iter().chain(&self.scan) {
            // Who does not answer is gone.
            let _ = writer.wait_for_acknowledgments(FAREWELL.saturating_sub(ended.elapsed()));
        }
        self.left_out
    }
}

/// False if there is no room.
fn send(writer: &DataWriter<Raw, Whole>, message: Vec<u8>) -> bool {
    writer.write(Raw(message), None).is_ok()
}

/// When the next map is due.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct MapPace {
    watchers: i32,
    has_newcomer: bool,
    /// When the last one was drawn, and how long the next is to wait.
    last: Option<(WallInstant, WallDuration)>,
}

impl MapPace {
    fn watchers(&mut self, watchers: i32, is_newcomer: bool) {
        self.watchers = watchers;
        self.has_newcomer |= is_newcomer;
    }

    fn is_due(&self, now: WallInstant) -> bool {
        let is_late = self.last.is_none_or(|(at, wait)| now.duration_since(at) >= wait);
        is_late && (self.last.is_none() || self.watchers > 0 || self.has_newcomer)
    }

    fn drawn(&mut self, now: WallInstant, cost: WallDuration) {
        self.has_newcomer = false;
        self.last = Some((now, MAP_EVERY.max(cost * MAP_SHARE)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn maps_are_drawn_for_those_who_look_and_seldom() {
        let start = WallInstant::now();
        let at = |seconds: u64| start + WallDuration::from_secs(seconds);
        let mut pace = MapPace::default();
        assert!(pace.is_due(at(0)), "one for those who come later");
        pace.drawn(at(0), WallDuration::ZERO);
        assert!(!pace.is_due(at(100)), "nobody looks");
        pace.watchers(1, true);
        assert!(!pace.is_due(at(1)) && pace.is_due(at(2)));
        pace.drawn(at(2), WallDuration::from_secs(1));
        assert!(!pace.is_due(at(21)) && pace.is_due(at(22)), "a twentieth of the time");
        pace.watchers(0, false);
        assert!(!pace.is_due(at(200)));
    }
}
