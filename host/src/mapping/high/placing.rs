//! Where stored scans lie: for the submaps of a closure, for the low level to go on in, and for the final path and map.

use lrfslam_core::geometry::Pose2;
use lrfslam_core::sweep::Sweep;

use super::HighSlam;
use super::segment::{Segment, SegmentPose, TRAVEL_M};
use crate::places::closing::Closure;
use crate::places::correlation::SearchWindow;
use crate::places::submap::Submap;
use crate::places::{Reach, reach_from};
use crate::pose_f64::{PoseF64, wrap};
use crate::trajectory::TimedPose;

/// Scans of a submap are so far apart, m …
const SUBMAP_STEP_M: f32 = 0.2;
/// … or so far turned, rad.
const SUBMAP_STEP_RAD: f32 = 0.1;
/// Travel of the latest path that is searched for, m: more is told apart better. Chosen.
pub(super) const QUERY_TRAVEL_M: f32 = 8.0;
/// Travel, before and after an older pose, of the path that is searched in, m. Chosen.
pub(super) const PLACE_TRAVEL_M: f32 = 10.0;
/// Older path counts as older from so much travel on, m. Chosen.
pub(super) const GAP_TRAVEL_M: f32 = 20.0;
/// Older places searched after each segment. Chosen.
pub(super) const CANDIDATES: usize = 3;
/// The window reaches so many standard deviations of the drift to each side …
const WINDOW_SIGMAS: f32 = 3.0;
/// … and what a submap is off in itself, m …
const WINDOW_MORE_M: f32 = 0.3;
/// … and rad …
const WINDOW_MORE_RAD: f32 = 0.02;
/// … but no farther than this, m. Cost grows with its square …
const WINDOW_MAX_M: f32 = 15.0;
/// … and this, degrees. Both chosen.
const WINDOW_MAX_DEG: f32 = 25.0;
/// The low level's map holds what is this certain as seen from the robot, m (one standard deviation) …
pub(super) const REFERENCE_SIGMA_M: f32 = 0.2;
/// … and in any case the latest path of so much travel, m …
const REFERENCE_TRAVEL_M: f32 = 20.0;
/// … but nothing farther away than this, m …
const REFERENCE_DISTANCE_M: f64 = 50.0;
/// … and is made anew for what comes nearer than this share of that.
const REFERENCE_NEW_SHARE: f64 = 0.6;
/// Of the latest path, scans this far apart, m …
const REFERENCE_STEP_M: f32 = 0.05;
/// … or so far turned, degrees; …
const REFERENCE_STEP_DEG: f32 = 2.0;
/// … of older path, which visits have crossed more than once, m …
const REFERENCE_OLDER_STEP_M: f32 = 0.2;
/// … and degrees. All chosen.
const REFERENCE_OLDER_STEP_DEG: f32 = 8.0;
/// Two places farther apart than this share too little to be compared, besides the window, m.
const PLACES_APART_M: f64 = 8.0;
/// The low level's map is made anew if one of its segments has moved so far, m …
const MOVED_M: f64 = 0.01;
/// … or turned so far, rad.
const MOVED_RAD: f64 = 0.001;

/// What the low level's map is made of: segments, and where they start.
#[derive(Debug, Default)]
pub(super) struct ReferenceState {
    segments: Vec<Option<PoseF64>>,
}

impl ReferenceState {
    fn pose(&self, segment: usize) -> Option<PoseF64> {
        self.segments.get(segment).copied().flatten()
    }
}

impl HighSlam<'_> {
    /// The low level has put the last segment into its map by itself, where it found it.
    pub(super) fn note_in_reference(&mut self) {
        let last = self.segments.len() - 1;
        let before = last.checked_sub(1).and_then(|before| Some((self.reference.pose(before)?, before)));
        let start = before.map(|(start, before)| start.then(self.segments[before].start_from_end));
        self.reference.segments.resize(last, None);
        self.reference.segments.push(start.or(Some(self.graph.nodes()[last])));
    }

    /// Poses of segment `k` in the map: what the graph has moved its end by is spread along its way.
    pub(super) fn placed(&self, k: usize) -> impl Iterator<Item = (PoseF64, SegmentPose)> {
        let place = self.place_of(k);
        self.segment(k).poses.iter().map(move |pose| (place(&pose), pose))
    }

    fn segment(&self, k: usize) -> &Segment {
        self.segments.get(k).unwrap_or(&self.open)
    }

    /// Where a pose of segment `k` lies.
    fn place_of(&self, k: usize) -> impl Fn(&SegmentPose) -> PoseF64 + use<> {
        let segment = self.segment(k);
        let start = self.graph.nodes()[k];
        let open_end = start.then(segment.start_from_end);
        let end = self.graph.nodes().get(k + 1).copied().unwrap_or(open_end);
        let place = between_nodes(start, segment.start_from_end, end);
        let length = f64::from(segment.slack_m).max(1e-6);
        move |pose| place(PoseF64::from(pose.start_from_robot), f64::from(pose.slack_m) / length)
    }

    /// Number of the scans placed.
    pub fn poses(&self) -> usize {
        self.segments.iter().chain([&self.open]).map(|segment| segment.poses.len()).sum()
    }

    /// Every scan's pose, as it is known now.
    pub fn trajectory(&self) -> impl Iterator<Item = TimedPose> {
        self.trajectory_with_trust().map(|(pose, _)| pose)
    }

    /// The same, each with whether it is to be believed: the scan fits the map, and its piece is the map or joined to it.
    pub fn trajectory_with_trust(&self) -> impl Iterator<Item = (TimedPose, bool)> {
        let main = self.main_piece();
        let poses = (0..=self.segments.len()).flat_map(move |k| {
            let is_map = self.pieces.of_index(k) == main;
            self.placed(k).map(move |(pose, of)| (pose, of, is_map && !of.is_lost))
        });
        poses.map(|(map_from_robot, pose, is_trusted)| {
            (TimedPose { stamp: pose.stamp, map_from_robot: map_from_robot.to_f32() }, is_trusted)
        })
    }

    /// Segments of a piece, the open one with them.
    fn segments_of(&self, piece: usize) -> impl Iterator<Item = usize> {
        (0..=self.segments.len()).filter(move |k| self.pieces.of_index(*k) == piece)
    }

    /// Its scans, where they are known to be now: those so far apart.
    pub(super) fn scans_of_piece(
        &self,
        piece: usize,
        (step_m, step_rad): (f32, f32),
    ) -> impl Iterator<Item = (Pose2, u32)> {
        apart(self.segments_of(piece).flat_map(|k| self.scans_of(k)), step_m, step_rad)
    }

    /// Hands out the scans kept, and where the robot is known to have been, in the order of the way.
    pub fn each_scan(&self, take: &mut dyn FnMut(&Sweep<'_>, Pose2)) {
        let mut beams = Vec::new();
        for (map_from_robot, scan) in self.segments_of(self.main_piece()).flat_map(|k| self.scans_of(k)) {
            if let Some(sweep) = self.scans.sweep(scan as usize, &mut beams) {
                take(&sweep, map_from_robot);
            }
        }
    }

    /// The scans kept, where they are known to be now: those that are so far from, m, or so far turned to, rad, the one before.
    pub fn placed_scans(&self, apart: (f32, f32)) -> impl Iterator<Item = (Pose2, u32)> {
        self.scans_of_piece(self.main_piece(), apart)
    }

    pub(super) fn scans_of(&self, k: usize) -> impl Iterator<Item = (Pose2, u32)> {
        self.placed_scans_of(k).map(|(pose, scan)| (pose.to_f32(), scan))
    }

    pub(super) fn placed_scans_of(&self, k: usize) -> impl Iterator<Item = (PoseF64, u32)> {
        let place = self.place_of(k);
        self.segment(k).poses.with_scans().map(move |(pose, scan)| (place(&pose), scan))
    }

    /// The map of some segments about the node at the start of segment `node`, in that node's frame.
    pub(super) fn submap(&self, segments: std::ops::RangeInclusive<usize>, node: usize) -> Submap {
        let node_from_map = self.graph.nodes()[node];
        let scans = segments
            .flat_map(|k| self.placed_scans_of(k))
            .map(|(pose, scan)| (node_from_map.between(pose).to_f32(), scan));
        let apart = apart(scans, SUBMAP_STEP_M, SUBMAP_STEP_RAD);
        Submap::new(apart, &self.scans, self.config.closure.range_max_m)
    }

    /// Segments around `k`, of its piece, with so much travel in each direction.
    pub(super) fn segments_about(&self, k: usize, before_m: f32, after_m: f32) -> std::ops::RangeInclusive<usize> {
        let from = k;
        let going = |segments: &mut dyn Iterator<Item = usize>, travel_m: f32| {
            let mut left = travel_m;
            segments
                .take_while(|&k| {
                    let goes = left > 0.0 && self.pieces.of_index(k) == self.pieces.of_index(from);
                    left -= self.segments[k].travel_m;
                    goes
                })
                .last()
        };
        let first = going(&mut (0..k).rev(), before_m).unwrap_or(k);
        let last = going(&mut (k + 1..self.segments.len()), after_m).unwrap_or(k);
        first..=last
    }

    /// Older nodes to be searched for `newer`, the nearest first, each apart from the others.
    pub(super) fn candidates(&self, newer: usize, reached: &[Option<Reach>]) -> Vec<(usize, Reach)> {
        let nodes = self.graph.nodes();
        let hung = self.hung_nodes();
        let mut travel_m = 0.0;
        let mut near = Vec::new();
        for older in (0..newer).rev() {
            travel_m += self.segments[older].travel_m;
            let Some(reach) = reached[older]
                .filter(|_| travel_m >= GAP_TRAVEL_M && self.pieces.of_index(older) == self.pieces.of_index(newer))
                .filter(|_| !hung.contains(&older))
            else {
                continue;
            };
            let seen = nodes[older].between(nodes[newer]);
            let distance = seen.distance_m();
            if distance <= PLACES_APART_M + f64::from(self.window(seen.to_f32(), &reach).distance_m) {
                near.push((distance, older, reach));
            }
        }
        near.sort_by(|a, b| a.0.total_cmp(&b.0));
        let apart = (PLACE_TRAVEL_M / TRAVEL_M).ceil() as usize;
        let mut chosen: Vec<(usize, Reach)> = Vec::new();
        for (_, older, reach) in near {
            if chosen.len() < CANDIDATES && chosen.iter().all(|(other, _)| other.abs_diff(older) >= apart) {
                chosen.push((older, reach));
            }
        }
        chosen
    }

    /// Where the newer of two nodes is searched for, which the graph puts at `centre` as seen from the older.
    pub(super) fn window(&self, centre: Pose2, reach: &Reach) -> SearchWindow {
        let reach = reach.inflated(self.variance_factor.get());
        let distance_m = WINDOW_SIGMAS * reach.position_m() as f32 + WINDOW_MORE_M;
        let heading_rad = WINDOW_SIGMAS * reach.heading_rad() as f32 + WINDOW_MORE_RAD;
        SearchWindow {
            centre,
            distance_m: distance_m.min(WINDOW_MAX_M),
            heading_rad: heading_rad.min(WINDOW_MAX_DEG.to_radians()),
        }
    }

    /// The map of the latest path, which ends with segment `newer`, about where that begins; and its first segment.
    pub(super) fn latest_way(&self, newer: usize) -> (usize, Submap) {
        let segments = self.segments_about(newer, QUERY_TRAVEL_M - self.segments[newer].travel_m, 0.0);
        (*segments.start(), self.submap(segments, newer))
    }

    /// Searches the [latest path](Self::latest_way) in the path about `older`.
    pub(super) fn find_closure(
        &mut self,
        older: usize,
        newer: usize,
        reach: &Reach,
        (first, query): &(usize, Submap),
    ) -> Option<Closure> {
        let place = self.segments_about(older, PLACE_TRAVEL_M, PLACE_TRAVEL_M);
        let place = *place.start()..=(*place.end()).min(first.saturating_sub(1));
        let place = self.submap(place, older);
        let nodes = self.graph.nodes();
        let centre = nodes[older].between(nodes[newer]).to_f32();
        let window = self.window(centre, reach);
        let found = self.closer.find(query, &place, &window)?;
        let moves_m = (found.pose.position() - centre.position()).norm();
        self.variance_factor.observe(moves_m.into(), reach.position_m());
        let older_from_newer = PoseF64::from(found.pose);
        Some(Closure { older, newer, older_from_newer, moves_m, weak_axis: found.weak_axis })
    }

    /// What the low level is to be matched against from `node` on; `None` if that has hardly changed.
    pub(super) fn changed_reference(&mut self, node: usize) -> Option<Vec<(Pose2, u32)>> {
        let reached = reach_from(&self.graph, node);
        let nodes = self.graph.nodes();
        let last = self.segments.len() - 1;
        let mut wanted: Vec<Option<PoseF64>> = vec![None; self.segments.len()];
        let mut has_changed = false;
        let recent = *self.segments_about(last, REFERENCE_TRAVEL_M, 0.0).start();
        for k in 0..self.segments.len() {
            let used = self.reference.pose(k);
            let sigma_max = f64::from(REFERENCE_SIGMA_M);
            let is_sure = k >= recent || reached[k].is_some_and(|reach| reach.position_m() <= sigma_max);
            let distance = nodes[node].between(nodes[k]).distance_m();
            if is_sure && distance <= REFERENCE_DISTANCE_M {
                wanted[k] = Some(nodes[k]);
                let is_new = used.is_none() && k < last && distance <= REFERENCE_NEW_SHARE * REFERENCE_DISTANCE_M;
                has_changed |= is_new || used.is_some_and(|used| has_moved(used, nodes[k]));
            } else {
                has_changed |= used.is_some() && !is_sure;
            }
        }
        if !has_changed {
            // The low level has put the last segment into its reference by itself.
            self.reference.segments.resize(last, None);
            self.reference.segments.push(Some(nodes[last]));
            return None;
        }
        self.reference.segments = wanted;
        let (step_m, step_rad) = (REFERENCE_STEP_M, REFERENCE_STEP_DEG.to_radians());
        let used = |k: &usize| self.reference.pose(*k).is_some();
        let (older_m, older_rad) = (REFERENCE_OLDER_STEP_M, REFERENCE_OLDER_STEP_DEG.to_radians());
        let old = apart((0..recent).filter(used).flat_map(|k| self.scans_of(k)), older_m, older_rad);
        let new = apart((recent..=last).filter(used).flat_map(|k| self.scans_of(k)), step_m, step_rad);
        Some(old.chain(new).collect())
    }
}

/// Puts what lies between two nodes: takes a pose seen from the first one, and the share of what the second one has moved by that it takes.
///
/// * `start_from_end` — the second as the way to it told
pub(super) fn between_nodes(start: PoseF64, start_from_end: PoseF64, end: PoseF64) -> impl Fn(PoseF64, f64) -> PoseF64 {
    let told = start.then(start_from_end);
    let (dx, dy, turn) = (end.x - told.x, end.y - told.y, wrap(end.heading - told.heading));
    move |start_from_pose, share| {
        let rigid = start.then(start_from_pose);
        let heading = wrap(rigid.heading + share * turn);
        PoseF64::new(rigid.x + share * dx, rigid.y + share * dy, heading)
    }
}

fn has_moved(from: PoseF64, to: PoseF64) -> bool {
    let step = from.between(to);
    step.distance_m() > MOVED_M || step.heading.abs() > MOVED_RAD
}

/// Those of `scans` that are so far from, or so far turned to, the one before.
pub(super) fn apart(
    scans: impl Iterator<Item = (Pose2, u32)>,
    step_m: f32,
    step_rad: f32,
) -> impl Iterator<Item = (Pose2, u32)> {
    let mut last: Option<Pose2> = None;
    scans.filter(move |(pose, _)| {
        let is_apart = last.is_none_or(|last| {
            let step = last.between(*pose);
            step.position().norm() >= step_m || step.heading.abs() >= step_rad
        });
        if is_apart {
            last = Some(*pose);
        }
        is_apart
    })
}
