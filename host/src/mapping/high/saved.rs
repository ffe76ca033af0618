//! The high level's state as it is saved: the path cut into segments, and the graph that holds them together.

use lrfslam_core::geometry::Pose2;
use lrfslam_core::rays::RayCapacityError;
use lrfslam_core::time::Instant;
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize, Serializer};

use super::pieces::Pieces;
use super::placing::ReferenceState;
use super::segment::{LowStep, Segment, SegmentPose};
use super::{HighConfigs, HighSlam};
use crate::mapping::Correction;
use crate::places::pose_graph::{Edge, PoseGraph};
use crate::pose_f64::PoseF64;
use crate::scans::store::ScanStore;
use crate::trajectory::TimedPose;

/// How well the start of another drive is known, m …
const START_SIGMA_M: f64 = 0.1;
/// … and rad.
const START_SIGMA_RAD: f64 = 0.035;
/// Nothing of a map is farther away, m: a day's drive straight on.
const FAR_M: f64 = 1e5;

/// A path with its graph, as it is saved.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SavedPath<S = Vec<SavedSegment>, N = Vec<[f64; 3]>, E = Vec<SavedEdge>> {
    /// Complete segments, and the open one last.
    segments: S,
    /// Where they start.
    nodes: N,
    edges: E,
}

/// A sequence that is made while it is written.
#[derive(Debug, Clone)]
struct Each<I>(I);

impl<I: Iterator<Item: Serialize> + Clone> Serialize for Each<I> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(self.0.clone())
    }
}

/// A stretch of it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SavedSegment {
    poses: Vec<SavedPose>,
    end: [f64; 3],
    covariance: [f64; 9],
    travel_m: f32,
    rotation_rad: f32,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct SavedPose {
    stamp: Instant,
    start_from_robot: Pose2,
    slack_m: f32,
    scan: Option<u32>,
    is_lost: bool,
}

/// What is known between two nodes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SavedEdge {
    from: u32,
    to: u32,
    from_to: [f64; 3],
    information: [f64; 9],
    is_closure: bool,
}

/// What is wrong with a saved path.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SavedPathError {
    /// Every segment starts at a node.
    #[error(
        "it has {segments} stretches of path and {nodes} starts of such, expected as many of both and at least one"
    )]
    Nodes {
        /// Segments, the open one with them.
        segments: usize,
        /// Nodes.
        nodes: usize,
    },
    /// An edge joins two different nodes.
    #[error("edge {0} of its graph does not join two of the nodes")]
    Edge(usize),
    /// A pose names a scan that is not there.
    #[error("its path names scan {0}, of {1} scans")]
    Scan(u32, usize),
    /// Every number is finite.
    #[error("a number in it is not finite")]
    NotFinite,
    /// Places, and lasers on their robot, lie where a robot can come to.
    #[error("a place in it is more than {} km away", FAR_M / 1e3)]
    Far,
    /// A pose takes a share of what its stretch of path was moved by.
    #[error("a pose in it takes more than all that its stretch of path was moved by, or less than nothing")]
    Slack,
}

impl HighSlam<'_> {
    /// Its state, but for the scans: a [`SavedPath`] that is made while it is written, as that of a day takes 20 MB.
    pub(crate) fn saved(&self) -> impl Serialize {
        let edge = |edge: &Edge| SavedEdge {
            from: edge.from as u32,
            to: edge.to as u32,
            from_to: numbers(edge.from_to),
            information: elements(&edge.information),
            is_closure: edge.is_closure,
        };
        SavedPath {
            segments: Each(self.segments.iter().chain([&self.open]).map(SavedSegment::from)),
            nodes: Each(self.graph.nodes().iter().copied().map(numbers)),
            edges: Each(self.graph.edges().iter().map(edge)),
        }
    }

    /// Goes on where another one was saved; `scans` are those that it had kept.
    ///
    /// # Errors
    /// If the parts do not fit together.
    pub fn restored(config: &HighConfigs, saved: &SavedPath, scans: ScanStore) -> Result<Self, SavedPathError> {
        saved.check(&scans)?;
        let mut high = Self::new(config, None);
        high.scans = scans;
        high.graph = PoseGraph::default();
        for node in &saved.nodes {
            high.graph.add_node(pose(*node));
        }
        for edge in &saved.edges {
            let information = Matrix3::from_column_slice(&edge.information);
            let (from, to) = (edge.from as usize, edge.to as usize);
            high.graph.add_edge(Edge {
                from,
                to,
                from_to: pose(edge.from_to),
                information,
                is_closure: edge.is_closure,
            });
        }
        high.pieces = Pieces::of(&high.graph);
        high.segments = saved.segments.iter().map(Segment::from).collect();
        high.open = high.segments.pop().unwrap_or_else(Segment::empty);
        high.counts.segments = high.segments.len() as u64;
        high.counts.closures_found = saved.edges.iter().filter(|edge| edge.is_closure).count() as u64;
        Ok(high)
    }

    /// Begins another drive in the same map, at `map_from_robot` or where the last one ended; says what the low level is to go on with.
    ///
    /// The start hangs on the nearest place of the path.
    pub fn drive_on_from(&mut self, map_from_robot: Option<Pose2>) -> Option<Correction> {
        if !self.open.poses.is_empty() {
            self.close_segment();
        }
        let end = self.graph.nodes()[self.segments.len()];
        let start = map_from_robot.map_or(end, PoseF64::from);
        let node = self.graph.add_node(start);
        let places = &self.graph.nodes()[..node];
        let distance = |place: &PoseF64| place.between(start).distance_m();
        let from = (0..node).min_by(|a, b| distance(&places[*a]).total_cmp(&distance(&places[*b])))?;
        let from_to = places[from].between(start);
        let (position, heading) = (START_SIGMA_M.powi(-2), START_SIGMA_RAD.powi(-2));
        let information = Matrix3::from_diagonal(&Vector3::new(position, position, heading));
        self.graph.add_edge(Edge { from, to: node, from_to, information, is_closure: false });
        self.pieces.goes_on(from);
        self.segments.push(Segment { start_from_end: end.between(start), ..Segment::empty() });
        self.kept = None;
        self.reference = ReferenceState::default();
        self.correction()
    }

    /// One that holds a finished path as it is: poses, and which of `scans` were taken there.
    ///
    /// # Errors
    /// As [`add_scan`](Self::add_scan).
    pub fn of_path(
        config: &HighConfigs,
        path: impl Iterator<Item = (TimedPose, Option<u32>)>,
        scans: ScanStore,
    ) -> Result<Self, RayCapacityError> {
        let mut high = Self::new(config, None);
        high.config.closure.enabled = false;
        high.scans = scans;
        let mut before: Option<Pose2> = None;
        for (TimedPose { stamp, map_from_robot }, scan) in path {
            let previous_from_robot = before.unwrap_or_default().between(map_from_robot);
            before = Some(map_from_robot);
            let step = LowStep { stamp, previous_from_robot, undetermined: None, is_lost: false, scan };
            high.open.push(&step);
            if high.open.is_complete() {
                high.complete_segment()?;
            }
        }
        Ok(high)
    }
}

#[cfg(test)]
impl SavedPath {
    /// One with everything that can be in it, every number another one.
    pub(crate) fn example() -> Self {
        let pose = |number: i16, scan| SavedPose {
            stamp: Instant::from_micros(1000 * i64::from(number)),
            start_from_robot: Pose2::new(f32::from(number), 0.5, -0.25),
            slack_m: 0.125 + f32::from(number),
            scan,
            is_lost: scan.is_none(),
        };
        let segment = |number: i16, poses| SavedSegment {
            poses,
            end: [f64::from(number), 1.5, -1.25],
            covariance: std::array::from_fn(|k| f64::from(number) + 0.0625 * k as f64),
            travel_m: 7.5,
            rotation_rad: 2.75,
        };
        let edge = |from, to, is_closure| SavedEdge {
            from,
            to,
            from_to: [3.5, 4.5, 0.75],
            information: std::array::from_fn(|k| 100.0 + k as f64),
            is_closure,
        };
        let segments = vec![segment(10, vec![pose(1, Some(0)), pose(2, None)]), segment(20, vec![pose(3, Some(1))])];
        let edges = vec![edge(0, 1, false), edge(1, 0, true)];
        Self { segments, nodes: vec![[0.5, 0.25, 0.125], [8.5, 9.5, 1.5]], edges }
    }
}

impl SavedPath {
    fn check(&self, scans: &ScanStore) -> Result<(), SavedPathError> {
        let (segments, nodes, scans_held) = (self.segments.len(), self.nodes.len(), scans.len());
        if segments == 0 || segments != nodes {
            return Err(SavedPathError::Nodes { segments, nodes });
        }
        let is_edge = |edge: &SavedEdge| edge.from != edge.to && (edge.from.max(edge.to) as usize) < nodes;
        if let Some(index) = self.edges.iter().position(|edge| !is_edge(edge)) {
            return Err(SavedPathError::Edge(index));
        }
        let mut named = self.segments.iter().flat_map(|segment| &segment.poses).filter_map(|pose| pose.scan);
        if let Some(scan) = named.find(|scan| *scan as usize >= scans_held) {
            return Err(SavedPathError::Scan(scan, scans_held));
        }
        let of_edges = self.edges.iter().flat_map(|edge| edge.information);
        if !of_edges.chain(self.segments.iter().flat_map(SavedSegment::numbers)).all(f64::is_finite) {
            return Err(SavedPathError::NotFinite);
        }
        if !self.segments.iter().all(SavedSegment::has_shares) {
            return Err(SavedPathError::Slack);
        }
        let lasers = (0..scans_held).map(|scan| scans.robot_from_lrf(scan)).map(PoseF64::from).map(numbers);
        let steps = self.edges.iter().map(|edge| edge.from_to);
        let places = self.nodes.iter().copied().chain(steps).chain(self.segments.iter().flat_map(SavedSegment::places));
        for number in places.chain(lasers).flatten().map(f64::abs) {
            match number {
                _ if !number.is_finite() => return Err(SavedPathError::NotFinite),
                _ if number > FAR_M => return Err(SavedPathError::Far),
                _ => {}
            }
        }
        Ok(())
    }
}

impl SavedSegment {
    /// All that are no places.
    fn numbers(&self) -> impl Iterator<Item = f64> {
        let slack_m = self.poses.iter().map(|pose| pose.slack_m);
        let of_way = slack_m.chain([self.travel_m, self.rotation_rad]).map(f64::from);
        self.covariance.into_iter().chain(of_way)
    }

    /// True if no pose has more slack than the last one.
    fn has_shares(&self) -> bool {
        let all_m = self.poses.last().map_or(0.0, |last| last.slack_m);
        self.poses.iter().all(|pose| (0.0..=all_m).contains(&pose.slack_m))
    }

    fn places(&self) -> impl Iterator<Item = [f64; 3]> {
        let poses = self.poses.iter().map(|pose| numbers(PoseF64::from(pose.start_from_robot)));
        poses.chain([self.end])
    }
}

impl From<&Segment> for SavedSegment {
    fn from(segment: &Segment) -> Self {
        let pose = |pose: SegmentPose| {
            let SegmentPose { stamp, start_from_robot, slack_m, scan, is_lost } = pose;
            SavedPose { stamp, start_from_robot, slack_m, scan, is_lost }
        };
        Self {
            poses: segment.poses.iter().map(pose).collect(),
            end: numbers(segment.start_from_end),
            covariance: elements(&segment.covariance),
            travel_m: segment.travel_m,
            rotation_rad: segment.rotation_rad,
        }
    }
}

impl From<&SavedSegment> for Segment {
    fn from(saved: &SavedSegment) -> Self {
        let pose_of = |of: &SavedPose| {
            let SavedPose { stamp, start_from_robot, slack_m, scan, is_lost } = *of;
            SegmentPose { stamp, start_from_robot, slack_m, scan, is_lost }
        };
        Self {
            poses: saved.poses.iter().map(pose_of).collect(),
            start_from_end: pose(saved.end),
            covariance: Matrix3::from_column_slice(&saved.covariance),
            travel_m: saved.travel_m,
            slack_m: saved.poses.last().map_or(0.0, |pose| pose.slack_m),
            rotation_rad: saved.rotation_rad,
        }
    }
}

fn numbers(pose: PoseF64) -> [f64; 3] {
    [pose.x, pose.y, pose.heading]
}

fn pose([x, y, heading]: [f64; 3]) -> PoseF64 {
    PoseF64::new(x, y, heading)
}

fn elements(matrix: &Matrix3<f64>) -> [f64; 9] {
    std::array::from_fn(|index| matrix[index])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_cannot_be_is_refused() {
        let refused = |spoil: &dyn Fn(&mut SavedPath)| {
            let mut path = SavedPath::example();
            path.segments.iter_mut().flat_map(|segment| &mut segment.poses).for_each(|pose| pose.scan = None);
            spoil(&mut path);
            HighSlam::restored(&HighConfigs::default(), &path, ScanStore::default()).err()
        };
        assert_eq!(refused(&|_| {}), None);
        let far = Some(SavedPathError::Far);
        assert_eq!(refused(&|path| path.nodes[1][0] = 1.1e5), far);
        assert_eq!(refused(&|path| path.segments[0].poses[0].start_from_robot.y = -3e38), far);
        assert_eq!(refused(&|path| path.edges[0].from_to[1] = 1e300), far);
        let not_finite = Some(SavedPathError::NotFinite);
        assert_eq!(refused(&|path| path.segments[1].end[2] = f64::NAN), not_finite);
        assert_eq!(refused(&|path| path.edges[1].information[4] = f64::INFINITY), not_finite);
        assert_eq!(refused(&|path| path.segments[0].travel_m = f32::NAN), not_finite);
        assert_eq!(refused(&|path| path.segments[0].poses[0].slack_m = 3e38), Some(SavedPathError::Slack));
        assert_eq!(refused(&|path| path.segments[0].poses[0].slack_m = -0.1), Some(SavedPathError::Slack));
        assert_eq!(refused(&|path| path.edges[1].to = 2), Some(SavedPathError::Edge(1)));
        assert_eq!(refused(&|path| path.segments[1].poses[0].scan = Some(0)), Some(SavedPathError::Scan(0, 0)));
        assert_eq!(refused(&|path| path.nodes.truncate(1)), Some(SavedPathError::Nodes { segments: 2, nodes: 1 }));
    }
}
