//! Pieces of map: what the robot mapped before and after it was carried away, blind, or lost, until it knows where the one lies in the other.
//!
//! Scans that fit nowhere, one after the other → the robot is lost → it goes on in a new piece, with an empty map → after each segment the
//! piece's latest way is searched for in the other pieces, over all positions and headings, as strictly as loops are closed → two
//! searches that agree, however far apart, join the pieces. Until then neither is drawn over the other: the map is the first large piece.

use lrfslam_core::geometry::{Point2, Pose2};
use lrfslam_core::time::Instant;

use super::HighSlam;
use super::placing::{QUERY_TRAVEL_M, ReferenceState};
use super::segment::Segment;
use crate::mapping::{Correction, LowPose};
use crate::places::closing::{CONTRADICTING_MAX, Closure, Effort};
use crate::places::correlation::{CorrelationGrid, SearchWindow};
use crate::places::pose_graph::{Edge, PoseGraph};
use crate::places::submap::Submap;
use crate::pose_f64::PoseF64;

/// So many scans in a row fit nowhere, and the robot is lost: two seconds of most lasers …
const LOST_SCANS: usize = 10;
/// … or so few of slow ones …
const LOST_SLOW_SCANS: usize = 3;
/// … in so long a time, s: who drives half a metre a second has left the 2 m that a lost robot is searched within, and what fits there then is a place that
/// looks alike. All chosen.
const LOST_S: f32 = 4.0;
/// A piece of less travel is not searched in, m.
const PLACE_TRAVEL_MIN_M: f32 = 4.0;
/// Pieces that are searched in, the longest ones.
const PLACES_MAX: usize = 3;
/// The map is the first piece that is at least this share of the longest one.
const MAP_SHARE: f32 = 0.2;
/// Scans so far apart, m, or so far turned, rad, tell where the walls are.
const WALLS_APART: (f32, f32) = (0.2, 0.1);
/// Before two pieces are joined, so many times the latest way is held against the other one: places look alike over a few metres. Chosen …
const ASKED_TIMES: f32 = 2.0;
/// … if it has so many scans a metre: a way of scans farther apart is bent itself. Chosen.
const SCANS_PER_M_MIN: f32 = 2.0;
/// How a piece is searched for among others; as a robot is in a saved map.
const EFFORT: Effort = Effort { likelihood_min: 0.5, points: 200, second_share_max: 0.85, second_misfits_min: None };

/// Which piece every node belongs to, and whether the robot is about to begin another one.
#[derive(Debug, Default)]
pub(super) struct Pieces {
    of_node: Vec<usize>,
    /// Scans in a row that fit nowhere …
    lost_scans: usize,
    /// … and when the first of them was taken.
    lost_since: Option<Instant>,
    /// Scans in a row that fit nowhere or are frozen: of which nobody knows where they were taken, if the robot is lost after them.
    doubted: usize,
    /// What was searched last.
    drawn: Vec<PieceWalls>,
}

/// The walls of a piece, for the search in it. Drawing them takes longer than a search, and most pieces stay as they are.
#[derive(Debug)]
struct PieceWalls {
    /// What they are drawn from.
    scans: Vec<(Pose2, u32)>,
    walls: Submap,
    grid: CorrelationGrid,
}

impl Pieces {
    /// Those of a graph: breaks lead from one to the other.
    pub(super) fn of(graph: &PoseGraph) -> Self {
        let mut of_node: Vec<usize> = (0..graph.nodes().len()).collect();
        for edge in graph.edges().iter().filter(|edge| !edge.is_break()) {
            let (keep, go) = (of_node[edge.from].min(of_node[edge.to]), of_node[edge.from].max(of_node[edge.to]));
            of_node.iter_mut().filter(|piece| **piece == go).for_each(|piece| *piece = keep);
        }
        Self { of_node, ..Self::default() }
    }

    /// The piece that node or segment `index` belongs to.
    pub(super) fn of_index(&self, index: usize) -> usize {
        self.of_node[index]
    }

    /// True if both belong to one piece.
    pub(super) fn are_one(&self, a: usize, b: usize) -> bool {
        self.of_node[a] == self.of_node[b]
    }

    /// The next node belongs to the piece of node `like`.
    pub(super) fn goes_on(&mut self, like: usize) {
        self.of_node.push(self.of_node[like]);
    }

    fn begin(&mut self) {
        self.of_node.push(self.of_node.len());
        (self.lost_scans, self.lost_since, self.doubted) = (0, None, 0);
    }

    fn join(&mut self, a: usize, b: usize) {
        let (keep, go) = (a.min(b), a.max(b));
        self.of_node.iter_mut().filter(|piece| **piece == go).for_each(|piece| *piece = keep);
    }

    /// True if the scan, taken at `stamp`, is one too many that fits nowhere. Scans that show nothing do not count: what comes after them may fit.
    pub(super) fn is_away(&mut self, low: &LowPose, stamp: Instant) -> bool {
        self.doubted = if low.is_lost || low.is_frozen { self.doubted + 1 } else { 0 };
        if !low.is_lost {
            (self.lost_scans, self.lost_since) = (0, None);
        }
        if !low.is_lost || low.is_blind {
            return false;
        }
        self.lost_scans += 1;
        let lost_s = stamp.since(*self.lost_since.get_or_insert(stamp)).as_secs_f32();
        self.lost_scans >= LOST_SCANS || (self.lost_scans >= LOST_SLOW_SCANS && lost_s >= LOST_S)
    }
}

impl HighSlam<'_> {
    /// The robot may be anywhere: it goes on with an empty map.
    pub(super) fn begin_piece(&mut self) -> Correction {
        let known = self.open.poses.len().saturating_sub(self.pieces.doubted);
        self.open.poses.doubt_from(known);
        if !self.open.poses.is_empty() {
            self.close_segment();
        }
        let end = self.segments.len();
        let pose = self.graph.nodes()[end];
        let node = self.graph.add_node(pose);
        self.graph.add_edge(Edge::break_between(end, node));
        self.segments.push(Segment::empty());
        self.pieces.begin();
        self.kept = None;
        self.reference = ReferenceState::default();
        Correction { map_from_robot: pose.to_f32(), reference: Vec::new() }
    }

    /// Travel of every piece with any, the longest first.
    fn piece_lengths(&self) -> Vec<(usize, f32)> {
        let mut lengths = std::collections::BTreeMap::<usize, f32>::new();
        for (k, segment) in self.segments.iter().chain([&self.open]).enumerate() {
            *lengths.entry(self.pieces.of_index(k)).or_default() += segment.travel_m;
        }
        let mut lengths: Vec<_> = lengths.into_iter().collect();
        lengths.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        lengths
    }

    /// The piece that is the map.
    pub(super) fn main_piece(&self) -> usize {
        let lengths = self.piece_lengths();
        let longest = lengths.first().map_or(0.0, |(_, length)| *length);
        lengths.iter().filter(|(_, length)| *length >= MAP_SHARE * longest).map(|(piece, _)| *piece).min().unwrap_or(0)
    }

    /// Pieces that are not joined to the map.
    pub(super) fn pieces_apart(&self) -> u64 {
        self.piece_lengths().len() as u64 - 1
    }

    /// Searches the way that ends with segment `newer` in the other pieces; true if two of them are one now.
    pub(super) fn join_pieces(&mut self, newer: usize) -> bool {
        let own = self.pieces.of_index(newer);
        let lengths = self.piece_lengths();
        let others = lengths.iter().filter(|(piece, length)| *piece != own && *length >= PLACE_TRAVEL_MIN_M);
        let others: Vec<usize> = others.take(PLACES_MAX).map(|(piece, _)| *piece).collect();
        if others.is_empty() {
            self.pieces.drawn.clear();
            return false;
        }
        let (_, query) = self.latest_way(newer);
        let mut known = std::mem::take(&mut self.pieces.drawn);
        for other in others {
            let Some(place) = self.walls_of(other, &mut known) else { continue };
            let closure = self.find_piece(&query, newer, other, &place);
            self.pieces.drawn.push(place);
            let Some(closure) = closure else { continue };
            self.counts.closures_found += 1;
            let found = self.closer.confirmed(closure, self.graph.nodes());
            if !found.is_empty() {
                self.bring_together(&closure);
                // One that waited for long may name a node that is not solved for any more.
                let hung = self.hung_nodes();
                let solved =
                    found.iter().filter(|closure| !hung.contains(&closure.newer) && !hung.contains(&closure.older));
                solved.for_each(|closure| self.graph.add_edge(closure.edge()));
                self.pieces.join(own, other);
                return true;
            }
        }
        false
    }

    /// The walls of piece `other`: those `known` if they are still right, which are taken out of there.
    fn walls_of(&self, other: usize, known: &mut Vec<PieceWalls>) -> Option<PieceWalls> {
        let scans: Vec<_> = self.scans_of_piece(other, WALLS_APART).collect();
        if let Some(at) = known.iter().position(|place| place.scans == scans) {
            return Some(known.swap_remove(at));
        }
        let walls = Submap::new(scans.iter().copied(), &self.scans, self.config.closure.range_max_m);
        let grid = CorrelationGrid::new(walls.points())?;
        Some(PieceWalls { scans, walls, grid })
    }

    fn find_piece(&mut self, query: &Submap, newer: usize, other: usize, place: &PieceWalls) -> Option<Closure> {
        let window = SearchWindow::about(place.walls.points());
        let found = self.closer.find_on(&place.grid, query, &place.walls, &window, EFFORT)?;
        let there = PoseF64::from(found.pose);
        let nodes = self.graph.nodes();
        if self.is_contradicted(newer, found.pose, place) {
            return None;
        }
        let distance = |node: &usize| nodes[*node].between(there).distance_m();
        let hung = self.hung_nodes();
        let of_other = (0..nodes.len()).filter(|node| self.pieces.of_index(*node) == other && !hung.contains(node));
        let older = of_other.min_by(|a, b| distance(a).total_cmp(&distance(b)))?;
        let turned = Pose2::new(0.0, 0.0, -nodes[older].to_f32().heading);
        let weak_axis: Option<Point2> = found.weak_axis.map(|axis| turned.transform(axis));
        let moves_m = nodes[newer].between(there).distance_m() as f32;
        // However near it is: nothing tied the two before.
        let moves_m = moves_m.max(f32::from(u8::MAX));
        Some(Closure { older, newer, older_from_newer: nodes[older].between(there), moves_m, weak_axis })
    }

    /// True if too many of the walls along the way before segment `newer` stand where the other piece is free.
    ///
    /// * `pose` — of the segment, there
    fn is_contradicted(&self, newer: usize, pose: Pose2, other: &PieceWalls) -> bool {
        let before_m = ASKED_TIMES * QUERY_TRAVEL_M - self.segments[newer].travel_m;
        let asked = self.segments_about(newer, before_m, 0.0);
        let travel_m: f32 = self.segments[asked.clone()].iter().map(|segment| segment.travel_m).sum();
        let scans = asked.clone().flat_map(|k| self.scans_of(k)).count();
        scans as f32 >= SCANS_PER_M_MIN * travel_m
            && other.walls.agreement(self.submap(asked, newer).points(), pose).contradicting > CONTRADICTING_MAX
    }

    /// Puts the later one of the two pieces where the closure says.
    fn bring_together(&mut self, closure: &Closure) {
        let nodes = self.graph.nodes();
        let there = nodes[closure.older].then(closure.older_from_newer);
        let (here, own) = (nodes[closure.newer], self.pieces.of_index(closure.newer));
        let other = self.pieces.of_index(closure.older);
        // The first pose of the map stays.
        let (moving, from, to) = if own > other { (own, here, there) } else { (other, there, here) };
        for node in (0..nodes.len()).filter(|node| self.pieces.of_index(*node) == moving) {
            let pose = to.then(from.between(self.graph.nodes()[node]));
            self.graph.put(node, pose);
        }
    }
}
