//! The path made better within its segments, once a run is over.
//!
//! A closure puts one stretch of eight metres into another one as a whole. Where little tells the way, as along a corridor for a laser that does not see its
//! end, a stretch is too long or too short in itself by decimetres, and only doors tell where. So once all loops are closed:
//!
//! stops, a metre apart → the scans about each, matched against every earlier visit → a graph of stops, solved → poses between them.
//!
//! Between stops the low level's steps count, with the drift that segments have. A visit counts only if the graph is as sure of where it lies as what the low
//! level is matched against. Each is matched in the other's way, near where it is thought to be, and both must agree. A door that lies half a metre off in
//! one of them is met by its own edge then, or by another, or by none: the best place along the way is searched for as well. If it is another one, it counts
//! if both ways say so, and else neither does. A closure that several stops say in more detail does not count then.

mod places;

use std::collections::BTreeMap;

use lrfslam_core::geometry::Pose2;
use nalgebra::Matrix3;

pub(super) use self::places::{Places, is_along};
use super::HighSlam;
use super::placing::{
    CANDIDATES, GAP_TRAVEL_M, PLACE_TRAVEL_M, QUERY_TRAVEL_M, REFERENCE_SIGMA_M, apart, between_nodes,
};
use super::segment::{LowStep, Segment, SegmentPose, TRAVEL_M};
use crate::places::closing::{Closure, Place};
use crate::places::correlation::SearchWindow;
use crate::places::pose_graph::{Edge, PoseGraph};
use crate::places::reach_from;
use crate::places::submap::Submap;
use crate::pose_f64::{PoseF64, wrap};

/// From stop to stop, m of way …
const STOP_TRAVEL_M: f32 = 1.0;
/// … or so much rotation, both ways added up, rad.
const STOP_ROTATION_RAD: f32 = 0.7;
/// Scans of the same stretch that were taken so near to a stop are matched with it, m.
const STOP_REACH_M: f32 = 0.75;
/// These scans are so far apart, m …
const STOP_STEP_M: f32 = 0.1;
/// … or so far turned, rad.
const STOP_STEP_RAD: f32 = 0.05;
/// A stop of an earlier visit is as near as this, m.
const NEAR_M: f64 = 3.0;
/// Way of that visit that is matched against, before and behind its segment's start, m.
const VISIT_TRAVEL_M: f32 = 5.0;
/// The best place is searched for within this, to each side, m …
const SEARCH_M: f32 = 0.8;
/// … and rad.
const SEARCH_RAD: f32 = 0.05;
/// A closure does not count where so many stops say it in more detail: half of those of a stretch.
const STOPS_INSTEAD: usize = (QUERY_TRAVEL_M / STOP_TRAVEL_M) as usize / 2;
/// The few scans of a stop tell its heading less surely than a stretch: its standard deviation is so many times that of a closure.
const STOP_HEADING: f64 = 2.0;
/// Stops are matched so many times, each time from where they were put last. All chosen.
const ROUNDS: usize = 3;

/// A segment whose poses are refined.
struct Refined {
    segment: usize,
    /// Its poses as they are now, seen from its start.
    poses: Vec<(PoseF64, SegmentPose)>,
    /// Its stops, but for its start and end: indices of their poses, and way from the start, m.
    stops: Vec<(usize, f32)>,
    /// What the low level says of the way from stop to stop, from its start to its end.
    steps: Vec<(PoseF64, Matrix3<f64>)>,
    /// Node of its first stop.
    node: usize,
}

/// A place of the path that is matched, or matched against.
#[derive(Clone, Copy)]
struct Stop {
    segment: usize,
    node: usize,
    place: PoseF64,
    /// From the beginning of the path, m.
    way_m: f32,
}

/// Submaps that were made for the stops of this segment and of the one before: most are met again.
#[derive(Default)]
struct Recent {
    now: BTreeMap<usize, Submap>,
    before: BTreeMap<usize, Submap>,
}

impl Recent {
    fn of(&mut self, key: usize, make: impl FnOnce() -> Submap) -> &Submap {
        let Self { now, before } = self;
        now.entry(key).or_insert_with(|| before.remove(&key).unwrap_or_else(make))
    }

    /// To the next segment.
    fn go_on(&mut self) {
        self.before = std::mem::take(&mut self.now);
    }
}

/// What is matched: the scans about stops, by node, and the way about them, by segment.
#[derive(Default)]
struct Matched {
    stops: Recent,
    ways: Recent,
}

impl HighSlam<'_> {
    /// Moves poses within their segments to where earlier visits say (`refining.rs`). For a run that is over: it takes as long as
    /// some thousands of scans do for an hour in one building.
    pub fn refine(&mut self) {
        if self.particles.is_some() || !self.config.closure.enabled {
            return;
        }
        let mut refined = self.refined_segments();
        for _ in 0..ROUNDS {
            if !self.refine_once(&mut refined) {
                return;
            }
        }
    }

    /// Segments that hold scans, and whose way the graph has as the low level told it.
    fn refined_segments(&self) -> Vec<Refined> {
        let hung = self.hung_nodes();
        let mut node = self.graph.nodes().len();
        let edges = self.graph.edges().iter();
        let of_way = edges.filter(|edge| !edge.is_closure && !edge.is_break() && edge.to == edge.from + 1);
        let mut has_way = vec![false; self.segments.len()];
        of_way.for_each(|edge| has_way[edge.from] = true);
        let is_refined = |k: &usize| {
            has_way[*k] && ![*k, k + 1].iter().any(|node| hung.contains(node)) && self.segments[*k].poses.have_scans()
        };
        let segments = (0..self.segments.len()).filter(is_refined);
        segments
            .map(|k| {
                let start = self.graph.nodes()[k];
                let poses = self.placed(k).map(|(placed, of)| (start.between(placed), of)).collect();
                let refined = Refined::new(k, &self.segments[k], poses, node);
                node += refined.stops.len();
                refined
            })
            .collect()
    }

    /// True if there was something to be matched.
    fn refine_once(&mut self, refined: &mut [Refined]) -> bool {
        let stops = self.stops(refined);
        let found = self.matched_stops(&stops);
        if found.is_empty() {
            return false;
        }
        let graph = self.graph_of_stops(refined, &stops, &found);
        for refined in refined {
            refined.go_to(graph.nodes());
            let [start, end] = [refined.segment, refined.segment + 1].map(|node| graph.nodes()[node]);
            let poses = refined.poses.iter().map(|(pose, of)| SegmentPose { start_from_robot: pose.to_f32(), ..*of });
            self.segments[refined.segment].put(poses.collect(), start.between(end));
        }
        (0..self.graph.nodes().len()).for_each(|node| self.graph.put(node, graph.nodes()[node]));
        true
    }

    /// All stops in the order of the way, the starts of segments with them.
    fn stops(&self, refined: &[Refined]) -> Vec<Stop> {
        let nodes = self.graph.nodes();
        let mut ways = vec![0.0; self.segments.len()];
        for k in 1..ways.len() {
            ways[k] = ways[k - 1] + self.segments[k - 1].travel_m;
        }
        let of = |refined: &Refined| {
            let (segment, start) = (refined.segment, nodes[refined.segment]);
            let first = Stop { segment, node: segment, place: start, way_m: ways[segment] };
            let inside = refined.stops.iter().enumerate().map(|(number, (pose, way_m))| {
                let (node, place) = (refined.node + number, start.then(refined.poses[*pose].0));
                Stop { segment, node, place, way_m: ways[segment] + way_m }
            });
            [first].into_iter().chain(inside).collect::<Vec<_>>()
        };
        refined.iter().flat_map(of).collect()
    }

    /// What earlier visits say of each stop: pairs of stops, the earlier one first, and their closure.
    ///
    /// Few scans in a longer way are drawn a centimetre or two towards where more walls are seen of it. So they are matched both ways: what is seen of the earlier
    /// stop in the newer way is drawn as far to the other side.
    fn matched_stops(&mut self, stops: &[Stop]) -> Vec<(Stop, Stop, Edge)> {
        let mut found = Vec::new();
        let mut submaps = Matched::default();
        let mut reached = (usize::MAX, Vec::new());
        for (index, stop) in stops.iter().enumerate() {
            if reached.0 != stop.segment {
                reached = (stop.segment, reach_from(&self.graph, stop.segment));
                submaps.stops.go_on();
                submaps.ways.go_on();
            }
            let sigma_max = f64::from(REFERENCE_SIGMA_M);
            let is_sure = |earlier: &Stop| {
                reached.1[earlier.segment].is_some_and(|reach| reach.position_m() <= sigma_max)
                    && self.pieces.of_index(earlier.segment) == self.pieces.of_index(stop.segment)
            };
            for earlier in nearest_visits(stop, &stops[..index], is_sure) {
                let there = self.matched(stop, &earlier, &mut submaps);
                if there.near.or(there.best).is_none() {
                    continue;
                }
                let back = self.matched(&earlier, stop, &mut submaps);
                let Some(closure) = there.and_back(back) else { continue };
                let mut edge = closure.edge();
                edge.information[(2, 2)] /= STOP_HEADING * STOP_HEADING;
                found.push((earlier, *stop, edge));
            }
        }
        found
    }

    /// Where the scans about `stop` lie in the way about `visit`, as closures between these two.
    fn matched(&mut self, stop: &Stop, visit: &Stop, submaps: &mut Matched) -> Places {
        let query = submaps.stops.of(stop.node, || self.scans_about(stop));
        let about = || self.segments_about(visit.segment, VISIT_TRAVEL_M, VISIT_TRAVEL_M);
        let way = submaps.ways.of(visit.segment, || self.submap(about(), visit.segment));
        let start = self.graph.nodes()[visit.segment];
        let centre = start.between(stop.place).to_f32();
        let window = SearchWindow { centre, distance_m: SEARCH_M, heading_rad: SEARCH_RAD };
        let turned = Pose2::new(0.0, 0.0, wrap(start.heading - visit.place.heading) as f32);
        let closure = |found: Place| Closure {
            older: visit.node,
            newer: stop.node,
            older_from_newer: visit.place.between(start.then(PoseF64::from(found.pose))),
            moves_m: (found.pose.position() - centre.position()).norm(),
            weak_axis: found.weak_axis.map(|axis| turned.transform(axis)),
        };
        let near = self.closer.find_near(query, way, centre);
        let thought = near.map_or(centre, |near| near.pose);
        let best = self.closer.find(query, way, &window).filter(|best| is_along(best.pose, thought));
        Places { near: near.map(closure), best: best.map(closure) }
    }

    /// The scans about a stop, of the same stretch, in its frame.
    fn scans_about(&self, stop: &Stop) -> Submap {
        let about = self.segments_about(stop.segment, STOP_REACH_M, STOP_REACH_M);
        let scans = about.flat_map(|k| self.placed_scans_of(k));
        let near = scans
            .map(|(pose, scan)| (stop.place.between(pose).to_f32(), scan))
            .filter(|(pose, _)| pose.position().norm() <= STOP_REACH_M);
        Submap::new(apart(near, STOP_STEP_M, STOP_STEP_RAD), &self.scans, self.config.closure.range_max_m)
    }

    /// The graph with a node for each stop, solved.
    fn graph_of_stops(&self, refined: &[Refined], stops: &[Stop], found: &[(Stop, Stop, Edge)]) -> PoseGraph {
        let mut graph = self.graph.clone();
        let is_refined: BTreeMap<usize, &Refined> = refined.iter().map(|refined| (refined.segment, refined)).collect();
        let is_way = |edge: &Edge| !edge.is_closure && edge.to == edge.from + 1 && is_refined.contains_key(&edge.from);
        let is_told = |edge: &Edge| edge.is_closure && stops_between(edge, found) >= STOPS_INSTEAD;
        let replaced: Vec<usize> = graph
            .edges()
            .iter()
            .enumerate()
            .filter(|(_, edge)| is_way(edge) || is_told(edge))
            .map(|(index, _)| index)
            .collect();
        graph.remove_edges(&replaced);
        let inside = stops.iter().filter(|stop| stop.node >= self.graph.nodes().len());
        inside.for_each(|stop| _ = graph.add_node(stop.place));
        refined.iter().flat_map(Refined::edges).for_each(|edge| graph.add_edge(edge));
        found.iter().for_each(|(_, _, edge)| graph.add_edge(*edge));
        let doubted = graph.solve();
        if !doubted.is_empty() {
            graph.remove_edges(&doubted);
            graph.solve();
        }
        graph
    }
}

/// Stops of earlier visits near `stop`, the nearest of each.
fn nearest_visits(stop: &Stop, earlier: &[Stop], is_sure: impl Fn(&Stop) -> bool) -> Vec<Stop> {
    let distance = |other: &Stop| other.place.between(stop.place).distance_m();
    let is_visit = |other: &&Stop| stop.way_m - other.way_m >= GAP_TRAVEL_M && distance(other) <= NEAR_M;
    let mut near: Vec<Stop> = earlier.iter().filter(is_visit).filter(|other| is_sure(other)).copied().collect();
    near.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
    let mut chosen: Vec<Stop> = Vec::new();
    for other in near {
        let is_another = chosen.iter().all(|of: &Stop| (of.way_m - other.way_m).abs() >= PLACE_TRAVEL_M);
        if chosen.len() < CANDIDATES && is_another {
            chosen.push(other);
        }
    }
    chosen
}

/// Stops that say where the stretch that `closure` was found for lies in the one in which it was found.
fn stops_between(closure: &Edge, found: &[(Stop, Stop, Edge)]) -> usize {
    let reach = |travel_m: f32| (travel_m / TRAVEL_M).ceil() as usize;
    let is_newer = |stop: &Stop| stop.segment <= closure.to && stop.segment + reach(QUERY_TRAVEL_M) > closure.to;
    let is_older = |stop: &Stop| stop.segment.abs_diff(closure.from) <= reach(PLACE_TRAVEL_M);
    found.iter().filter(|(older, newer, _)| is_newer(newer) && is_older(older)).count()
}

impl Refined {
    /// * `poses` — as they are now, seen from its start
    /// * `node` — of its first stop
    fn new(number: usize, segment: &Segment, poses: Vec<(PoseF64, SegmentPose)>, node: usize) -> Self {
        let (mut stops, mut steps) = (Vec::new(), Vec::new());
        let (mut stretch, mut before, mut slack_m, mut travel_m) = (Segment::empty(), PoseF64::default(), 0.0, 0.0);
        for (index, (_, of)) in poses.iter().enumerate() {
            let pose = PoseF64::from(of.start_from_robot);
            let previous_from_robot = before.between(pose).to_f32();
            let way = previous_from_robot.position();
            let is_undetermined = of.slack_m - slack_m > 2.0 * way.norm();
            // The way that nothing tells is that along which the robot drives.
            let undetermined = is_undetermined.then(|| way * (1.0 / way.norm().max(f32::MIN_POSITIVE)));
            let SegmentPose { stamp, is_lost, scan, .. } = *of;
            stretch.push(&LowStep { stamp, previous_from_robot, undetermined, is_lost, scan });
            (before, slack_m, travel_m) = (pose, of.slack_m, travel_m + way.norm());
            let is_far = stretch.travel_m >= STOP_TRAVEL_M || stretch.rotation_rad >= STOP_ROTATION_RAD;
            if is_far && segment.travel_m - travel_m >= 0.5 * STOP_TRAVEL_M {
                stops.push((index, travel_m));
                steps.push(std::mem::replace(&mut stretch, Segment::empty()).told());
            }
        }
        steps.push(stretch.told());
        // What is guessed wrong along the way adds up from stop to stop: together they are as unsure as the segment.
        let plane = |covariance: &Matrix3<f64>| covariance[(0, 0)] + covariance[(1, 1)];
        let of_steps: f64 = steps.iter().filter_map(|(_, told)| told.try_inverse()).map(|step| plane(&step)).sum();
        let more = (plane(&segment.covariance) / of_steps.max(f64::MIN_POSITIVE)).max(1.0);
        steps.iter_mut().for_each(|(_, information)| *information /= more);
        Self { segment: number, poses, stops, steps, node }
    }

    /// Nodes of its start, its stops and its end.
    fn nodes(&self) -> impl Iterator<Item = usize> + Clone {
        let inside = self.node..self.node + self.stops.len();
        [self.segment].into_iter().chain(inside).chain([self.segment + 1])
    }

    /// From stop to stop.
    fn edges(&self) -> impl Iterator<Item = Edge> {
        let pairs = self.nodes().zip(self.nodes().skip(1)).zip(&self.steps);
        pairs.map(|((from, to), &(from_to, information))| {
            let edge = Edge { from, to, from_to, information, is_closure: false };
            // One back to an older node would hang there.
            if to < from { edge.reversed() } else { edge }
        })
    }

    /// Puts its poses between where its nodes are now: what a stop has moved by is spread along the way to it.
    fn go_to(&mut self, nodes: &[PoseF64]) {
        let places: Vec<PoseF64> = self.nodes().map(|node| nodes[node]).collect();
        let end = self.poses.len().saturating_sub(1);
        let (mut first, mut before, mut slack_before_m) = (0, PoseF64::default(), 0.0);
        for (pair, last) in places.windows(2).zip(self.stops.iter().map(|stop| stop.0).chain([end])) {
            let (until, SegmentPose { slack_m, .. }) = self.poses[last];
            let place = between_nodes(pair[0], before.between(until), pair[1]);
            for (pose, of) in &mut self.poses[first..=last] {
                let share = (of.slack_m - slack_before_m) / (slack_m - slack_before_m).max(1e-6);
                *pose = places[0].between(place(before.between(*pose), share.into()));
            }
            (first, before, slack_before_m) = (last + 1, until, slack_m);
        }
    }
}
