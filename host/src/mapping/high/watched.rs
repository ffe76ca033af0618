//! What a watcher is shown of the high level while it works: stretches of path, where they lie now, and what ties them together.
//!
//! Nothing is computed that is not asked for, and nothing changes by being asked.

use lrfslam_core::geometry::Pose2;

use super::HighSlam;
use super::poses::SegmentPoses;
use crate::pose_f64::{PoseF64, wrap};

/// Where a stretch of path lies now.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stretch {
    /// Its start, map frame.
    pub map_from_start: PoseF64,
    /// What its end is moved by against its own poses, map frame; spread along its way.
    pub bend: PoseF64,
    /// Way, m, as [`SegmentPose::slack_m`](super::segment::SegmentPose::slack_m) counts it.
    pub slack_m: f32,
    /// The piece of map that it belongs to.
    pub piece: usize,
}

impl HighSlam<'_> {
    /// All stretches, the open one last.
    pub fn stretches(&self) -> impl Iterator<Item = Stretch> + '_ {
        let nodes = self.graph.nodes();
        self.segments.iter().chain([&self.open]).enumerate().map(move |(k, segment)| {
            let end = nodes[k].then(segment.start_from_end);
            let placed = nodes.get(k + 1).copied().unwrap_or(end);
            let bend = PoseF64::new(placed.x - end.x, placed.y - end.y, wrap(placed.heading - end.heading));
            let piece = self.pieces.of_index(k);
            Stretch { map_from_start: nodes[k], bend, slack_m: segment.slack_m, piece }
        })
    }

    /// Poses of stretch `k`, in order; none past the last stretch.
    pub fn stretch_poses(&self, k: usize) -> Option<&SegmentPoses> {
        let open = (k == self.segments.len()).then_some(&self.open);
        self.segments.get(k).or(open).map(|segment| &segment.poses)
    }

    /// Where the robot is by the last scan.
    pub fn map_from_robot(&self) -> Pose2 {
        let start = self.graph.nodes()[self.segments.len()];
        let start_from_robot = self.open.poses.last().map_or(Pose2::IDENTITY, |pose| pose.start_from_robot);
        start.then(PoseF64::from(start_from_robot)).to_f32()
    }

    /// Closures that are believed now: the starts of two stretches each.
    pub fn closures(&self) -> impl Iterator<Item = [usize; 2]> + '_ {
        self.graph.edges().iter().filter(|edge| edge.is_closure).map(|edge| [edge.from, edge.to])
    }

    /// The piece of map that is the map.
    pub fn map_piece(&self) -> usize {
        self.main_piece()
    }
}
