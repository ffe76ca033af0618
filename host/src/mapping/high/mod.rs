//! The high level: whole segments of the low level's path, put where they agree with one another (thesis §3.2.3.3–3.2.3.4).
//!
//! Scan and pose of the low level → segment → node and edge of a pose graph → closing: has the robot been here before? →
//! the graph is solved, and all segments move → the low level goes on in the corrected map ([`Correction`]).
//!
//! # What the low level goes on in
//! Only what lies surely where it is thought to be, as seen from the robot: the recent path, and the older path that closures tie
//! it to (`reach`). A robot that comes back from a long loop with a drift of a metre does not meet its own old walls a
//! metre off, until they have been recognised and the loop is closed.
//!
//! # Frames
//! `map` is the first pose. The low level's poses are taken relative to one another.

mod known;
mod particles;
mod pieces;
mod placing;
mod poses;
mod refining;
mod saved;
mod segment;
mod watched;

use lrfslam_core::geometry::Pose2;
use lrfslam_core::ndt::NdtConfig;
use lrfslam_core::rays::RayCapacityError;
use lrfslam_core::sweep::Sweep;
use serde::Serialize;

pub use particles::{HighParticles, filter_config};
pub use poses::SegmentPoses;
pub use saved::{SavedPath, SavedPathError};
pub use segment::SegmentPose;
pub(crate) use segment::drift_variances;
pub use watched::Stretch;

use self::pieces::Pieces;
use self::placing::ReferenceState;
use self::segment::{LowStep, Segment};
use super::{Correction, LowPose};
use crate::output::Aside;
use crate::places::closing::{Closer, Closure, ClosureConfig};
use crate::places::pose_graph::{Edge, PoseGraph};
use crate::places::{VarianceFactor, reach_from};
use crate::pose_f64::PoseF64;
use crate::scans::store::ScanStore;

lrfslam_core::config! {
    /// High level.
    pub struct HighConfig {
        /// The low level goes on in the corrected map. Without, the high level only watches.
        feedback: bool = true;
    }
}

/// A scan is kept for drawing and matching if the robot has moved so far since the last one kept, m …
const KEEP_DISTANCE_M: f32 = 0.02;
/// … or turned so far, degrees. 12 bytes a beam of a scan kept. Both chosen.
const KEEP_ROTATION_DEG: f32 = 1.0;
/// A closure waits for a second one for so many segments.
const WAITING_SEGMENTS: usize = 5;
/// So many closures that were refuted are asked again, the latest.
const REFUTED_MAX: usize = 200;

/// The configuration of the high level with all its parts.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct HighConfigs {
    /// What is kept, and what the low level goes on in.
    pub high: HighConfig,
    /// Closures.
    pub closure: ClosureConfig,
    /// Cells in which closures are refined.
    pub ndt: NdtConfig,
}

/// What the high level did.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct HighCounts {
    /// Segments.
    pub segments: u64,
    /// Closures found.
    pub closures_found: u64,
    /// Closures in the graph: believed, and not of known ground that was let go.
    pub closures: u64,
    /// Closures found that contradict the rest: the graph refuted them, or they would move the robot by more than a metre, and no
    /// second one has said so.
    pub closures_refuted: u64,
    /// Pieces of map that are not joined to it: where the robot was lost, and what it saw then has not been found again.
    pub pieces_apart: u64,
    /// Farthest that the robot was from where a closure put it, m; also one that the rest of the path refuted.
    pub largest_move_m: f32,
    /// The robot's drift over what the path says of it, 1 at least: [`VarianceFactor`], its square root.
    pub drift_ratio: f64,
    /// Scans kept.
    pub scans_kept: u64,
    /// Bytes of these.
    pub scan_bytes: u64,
}

/// Places segments; see the [module](self).
#[derive(Debug)]
pub struct HighSlam<'m> {
    config: HighConfigs,
    scans: ScanStore,
    /// Complete segments; segment k starts at node k of the graph and ends at node k + 1.
    segments: Vec<Segment>,
    open: Segment,
    graph: PoseGraph,
    pieces: Pieces,
    closer: Closer,
    /// If these close loops, and not the graph.
    particles: Option<HighParticles<'m>>,
    low: Option<Pose2>,
    /// Where the robot was when a scan was last kept, seen from the start of the open segment.
    kept: Option<Pose2>,
    reference: ReferenceState,
    /// The low level has been given a correction and not taken it yet.
    low_is_drawing: bool,
    /// Scans to be forgotten when it has: they are being drawn.
    forgotten: Vec<u32>,
    /// Where poses go that have no scan any more.
    aside: Aside,
    /// Closures that did not agree with the rest when it was last solved: what comes may speak for them.
    refuted: Vec<Edge>,
    /// By how much the path is surer of itself than it may be.
    variance_factor: VarianceFactor,
    counts: HighCounts,
}

impl<'m> HighSlam<'m> {
    /// One that has seen nothing yet; loops are closed by `particles` if there are any, else by closures in the graph.
    pub fn new(config: &HighConfigs, particles: Option<HighParticles<'m>>) -> Self {
        let mut graph = PoseGraph::default();
        graph.add_node(PoseF64::default());
        let pieces = Pieces::of(&graph);
        Self {
            config: *config,
            scans: ScanStore::default(),
            segments: Vec::new(),
            open: Segment::empty(),
            graph,
            pieces,
            closer: Closer::new(&config.ndt),
            particles,
            low: None,
            kept: None,
            reference: ReferenceState::default(),
            low_is_drawing: false,
            forgotten: Vec::new(),
            aside: Aside::default(),
            refuted: Vec::new(),
            variance_factor: VarianceFactor::default(),
            counts: HighCounts::default(),
        }
    }

    /// Where no scan is kept any more, the path goes there.
    pub fn put_aside(&mut self, aside: &Aside) {
        self.aside = aside.clone();
        self.segments.iter_mut().for_each(|segment| segment.poses.put_aside(aside));
    }

    /// Takes a scan and where the low level believes it was taken; at the end of a segment, says how the low level is to go on if its
    /// map is to change.
    ///
    /// # Errors
    /// If the high level's particles have no memory for that many beams.
    pub fn add_scan(&mut self, sweep: &Sweep<'_>, low: &LowPose) -> Result<Option<Correction>, RayCapacityError> {
        let before = self.low.replace(low.map_from_robot).unwrap_or(low.map_from_robot);
        let previous_from_robot = before.between(low.map_from_robot);
        let turned = Pose2::new(0.0, 0.0, -before.heading);
        let start_from_robot = self.open.start_from_end.to_f32() * previous_from_robot;
        let step = LowStep {
            stamp: sweep.scan.stamp,
            previous_from_robot,
            undetermined: low.undetermined.map(|axis| turned.transform(axis)),
            is_lost: low.is_lost,
            scan: self.keep(sweep, start_from_robot, low.is_lost),
        };
        self.open.push(&step);
        if self.has_pieces() && self.pieces.is_away(low, sweep.scan.stamp) {
            return Ok(Some(self.begin_piece()));
        }
        if !self.open.is_complete() {
            return Ok(None);
        }
        self.complete_segment()?;
        Ok(if self.config.high.feedback { self.correction() } else { None })
    }

    /// True if a lost robot begins a new piece of map.
    pub fn has_pieces(&self) -> bool {
        self.config.high.feedback && self.config.closure.enabled && self.particles.is_none()
    }

    fn correction(&mut self) -> Option<Correction> {
        if self.low_is_drawing {
            // One that the graph has changed since is noticed after the segment with which it is in use.
            self.note_in_reference();
            return None;
        }
        let node = self.segments.len();
        let reference = self.changed_reference(node)?;
        self.low_is_drawing = true;
        Some(Correction { map_from_robot: self.graph.nodes()[node].to_f32(), reference })
    }

    /// The low level has taken the correction, and where it was at the last scan is this from now on.
    pub fn low_goes_on_from(&mut self, low_pose: Pose2) {
        self.low = Some(low_pose);
        self.low_is_drawing = false;
        self.forget_unless_drawn();
    }

    /// Scans that nobody needs any more go, once the low level has drawn what it was given: these may be among them.
    fn forget_unless_drawn(&mut self) {
        if !self.low_is_drawing {
            self.forgotten.drain(..).for_each(|scan| self.scans.forget(scan));
        }
    }

    /// Place among the stored scans of the one that was added last, if it is stored.
    pub fn newest_scan(&self) -> Option<u32> {
        let segments = self.segments.last().into_iter().chain([&self.open]);
        segments.filter_map(|segment| segment.poses.last()).next_back().and_then(|pose| pose.scan)
    }

    /// The stored scans.
    pub fn scans(&self) -> &ScanStore {
        &self.scans
    }

    /// Stores the scan if the robot has moved; returns its place. One that is not believed, or without beams, is not stored.
    fn keep(&mut self, sweep: &Sweep<'_>, start_from_robot: Pose2, is_lost: bool) -> Option<u32> {
        let has_moved = self.kept.is_none_or(|kept| {
            let step = kept.between(start_from_robot);
            step.position().norm() >= KEEP_DISTANCE_M || step.heading.abs() >= KEEP_ROTATION_DEG.to_radians()
        });
        if is_lost || !has_moved || sweep.scan.beams.is_empty() {
            return None;
        }
        self.kept = Some(start_from_robot);
        Some(self.scans.add(sweep))
    }

    /// Makes the open segment a node of the graph, and closes loops.
    fn complete_segment(&mut self) -> Result<(), RayCapacityError> {
        let start = self.segments.len();
        self.close_segment();
        if let Some(particles) = &mut self.particles {
            self.graph.move_nodes(&particles.add(&self.segments[start], &self.scans)?);
        } else if self.config.closure.enabled {
            let is_joined = self.has_pieces() && self.join_pieces(start);
            if self.close_loops(start) || is_joined {
                self.solve();
            }
            self.let_known_ground_go();
        }
        Ok(())
    }

    /// Makes the open segment a node of the graph.
    fn close_segment(&mut self) {
        let mut segment = std::mem::replace(&mut self.open, Segment::empty());
        segment.poses.close();
        segment.poses.put_aside(&self.aside);
        let (end, information) = segment.told();
        self.kept = self.kept.map(|kept| end.to_f32().between(kept));
        let start = self.segments.len();
        let node = self.graph.add_node(self.graph.nodes()[start].then(end));
        self.graph.add_edge(Edge { from: start, to: node, from_to: end, information, is_closure: false });
        self.segments.push(segment);
        self.pieces.goes_on(start);
        self.counts.segments += 1;
    }

    /// Looks for older places that the segment that starts at node `newer` came back to; true if the graph has new closures.
    fn close_loops(&mut self, newer: usize) -> bool {
        let (oldest, pieces) = (newer.saturating_sub(WAITING_SEGMENTS), &self.pieces);
        let worth = |closure: &Closure| closure.newer >= oldest || !pieces.are_one(closure.older, closure.newer);
        let (dropped, nodes) = (self.closer.keep_waiting(worth), self.graph.nodes());
        self.counts.closures_refuted += dropped.iter().filter(|closure| closure.contradicts(nodes)).count() as u64;
        let candidates = self.candidates(newer, &reach_from(&self.graph, newer));
        if candidates.is_empty() {
            return false;
        }
        let latest = self.latest_way(newer);
        let mut found = Vec::new();
        for (older, reach) in candidates {
            let Some(closure) = self.find_closure(older, newer, &reach, &latest) else { continue };
            self.counts.closures_found += 1;
            let confirmed = self.closer.confirmed(closure, self.graph.nodes());
            if !confirmed.is_empty() {
                // Not that of one that waited: it may have been found between pieces, which nothing tied then.
                self.counts.largest_move_m = self.counts.largest_move_m.max(closure.moves_m);
            }
            found.extend(confirmed);
        }
        found.iter().for_each(|closure: &Closure| self.graph.add_edge(closure.edge()));
        !found.is_empty()
    }

    /// Solves the graph with all closures that were found, and once more without those that do not agree with the rest. What was refuted
    /// is asked again each time: a wrong closure that comes first refutes the right ones one by one, and not all of them together.
    fn solve(&mut self) {
        self.graph.set_variance_factor(self.variance_factor.get());
        let hung = self.hung_nodes();
        let mut asked = std::mem::take(&mut self.refuted);
        asked.drain(..asked.len().saturating_sub(REFUTED_MAX));
        asked.retain(|edge| ![edge.from, edge.to].iter().any(|node| hung.contains(node)));
        asked.iter().for_each(|edge| self.graph.add_edge(*edge));
        let doubted = if asked.is_empty() { self.graph.solve() } else { self.graph.solve_anew() };
        self.counts.closures_refuted += doubted.len() as u64;
        self.counts.closures_refuted -= asked.len() as u64;
        if !doubted.is_empty() {
            self.refuted = doubted.iter().map(|index| self.graph.edges()[*index]).collect();
            self.graph.remove_edges(&doubted);
            self.graph.solve();
        }
    }

    /// What was done so far.
    pub fn counts(&self) -> HighCounts {
        let closures = self.graph.edges().iter().filter(|edge| edge.is_closure).count() as u64;
        let (scans_kept, scan_bytes) = (self.scans.kept() as u64, self.scans.memory_bytes() as u64);
        let (pieces_apart, drift_ratio) = (self.pieces_apart(), self.variance_factor.get().sqrt());
        HighCounts { closures, scans_kept, scan_bytes, pieces_apart, drift_ratio, ..self.counts }
    }
}

#[cfg(test)]
pub(crate) mod test_world;
#[cfg(test)]
mod tests;
