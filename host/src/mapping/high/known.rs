//! Known ground: where the robot drives through what it has mapped before, it does not map it again, so that time and memory are those of
//! the area and not of the way.
//!
//! # Criterion
//! A scan tells nothing new if it was taken within [`NEAR_M`] and [`NEAR_DEG`] of scans of [`VISITS`] earlier visits, whose places the graph
//! is as sure of as the low level's map asks; of a node that is judged again, as what is near asks ([`AGAIN_SIGMA_M`]): in the middle of a
//! bare corridor nothing makes it surer. A segment all of whose scans are such is known. Once it is a few segments old, the nodes between
//! known segments that closures tie to older ground, or the hanging node before or after them, leave the graph and
//! [hang](crate::places::pose_graph::PoseGraph::hang) on the nearest node of an earlier visit.
//! A place of a plane and a direction holds no more than that many visits, so the graph is bounded by the area.
//!
//! # What changes in a building
//! Known segments keep their scans until [`NEWER_VISITS`] later ones have come by: what is drawn is the first visits and the latest ones, and
//! these have the majority.

use std::collections::BTreeSet;

use lrfslam_core::geometry::Pose2;
use nalgebra::{Matrix3, Vector3};

use super::placing::{REFERENCE_SIGMA_M, apart};
use super::{HighSlam, WAITING_SEGMENTS};
use crate::places::pose_graph::Edge;
use crate::places::{Reach, reach_from};

/// Two scans this near each other, m …
const NEAR_M: f32 = 1.0;
/// … and with headings so near, degrees, see the same: beams of a laser that looks to one side only. Both chosen.
const NEAR_DEG: f32 = 45.0;
/// Earlier visits that make a place known: one may have met a passer-by. Chosen.
const VISITS: usize = 2;
/// Later visits after which the scans of a known segment go: more than [`VISITS`], so that what stands now has the majority.
const NEWER_VISITS: usize = 3;
/// Nodes that are judged again after each segment. Chosen.
const AGAIN: usize = 4;
/// Their places are as sure, m (one standard deviation): seven in eight lie within [`NEAR_M`] along the axis that is least known.
pub(super) const AGAIN_SIGMA_M: f64 = 2.0 / 3.0;
/// Segments this far apart along the way are different visits.
const VISIT_SEGMENTS: usize = 3;
/// Scans so far apart, m, or so far turned, rad, are asked about.
const ASKED_APART: (f32, f32) = (0.25, 0.2);
/// Segments whose starts are farther apart, m, share no place: each goes 4 m at most.
const SEGMENTS_APART_M: f64 = 10.0;
/// How surely a node lies where it hangs, m, unless it is reached less surely than the low level's map asks …
const HANGING_SIGMA_M: f64 = 0.05;
/// … and degrees: as a closure.
const HANGING_SIGMA_DEG: f64 = 0.3;

impl HighSlam<'_> {
    /// After a segment was added: the one that has just become a few segments old goes from the graph if it is known, and so do some of
    /// those that were not then. A robot that was lost, or held up by people, knows only later where it was.
    pub(super) fn let_known_ground_go(&mut self) {
        // Closures that wait for a second one name the segments after that.
        let Some(segment) = self.segments.len().checked_sub(WAITING_SEGMENTS + 2).filter(|segment| *segment > 0) else {
            return;
        };
        self.let_go_if_known(segment, f64::from(REFERENCE_SIGMA_M));
        let hung = self.hung_nodes();
        let left: Vec<usize> = (1..segment).filter(|node| !hung.contains(node)).collect();
        // In turns, for the first visits stay for good.
        let turn = AGAIN * segment % left.len().max(1);
        let again = left.iter().cycle().skip(turn).take(AGAIN.min(left.len()));
        again.for_each(|&segment| self.let_go_if_known(segment, AGAIN_SIGMA_M));
    }

    /// * `sigma_m` — places less certain than that, as seen from the segment, are not counted, m
    pub(super) fn let_go_if_known(&mut self, segment: usize, sigma_m: f64) {
        let reached = reach_from(&self.graph, segment);
        let mapped = self.mapped_segments(segment, &reached, sigma_m);
        if self.is_known(segment, &mapped, VISITS) && self.is_known(segment - 1, &mapped, VISITS) {
            self.hang(segment, &mapped, &reached);
            self.forget_scans(segment);
        }
    }

    /// Older segments of the graph whose places are sure as seen from node `of`.
    fn mapped_segments(&self, of: usize, reached: &[Option<Reach>], sigma_m: f64) -> Vec<usize> {
        let hung = self.hung_nodes();
        let is_mapped = |k: usize| !hung.contains(&k) && !hung.contains(&(k + 1));
        let is_sure = |k: usize| reached[k].is_some_and(|reach: Reach| reach.position_m() <= sigma_m);
        (0..of.saturating_sub(VISIT_SEGMENTS)).filter(|&k| is_mapped(k) && is_sure(k)).collect()
    }

    /// Nodes that are not solved for.
    pub(super) fn hung_nodes(&self) -> BTreeSet<usize> {
        self.graph.edges().iter().filter(|edge| edge.is_hanging()).map(|edge| edge.from).collect()
    }

    /// True if every scan of the segment was taken where `visits` of `others` came by.
    fn is_known(&self, segment: usize, others: &[usize], visits: usize) -> bool {
        let nodes = self.graph.nodes();
        let is_near = |k: usize| nodes[k].between(nodes[segment]).distance_m() <= SEGMENTS_APART_M;
        let near: Vec<(usize, Vec<Pose2>)> = others
            .iter()
            .filter(|&&k| k.abs_diff(segment) >= VISIT_SEGMENTS && is_near(k))
            .map(|&k| (k, self.asked(k)))
            .collect();
        self.asked(segment).iter().all(|scan| visits_of(scan, &near) >= visits)
    }

    /// Where some of a segment's scans were taken.
    fn asked(&self, segment: usize) -> Vec<Pose2> {
        let (step_m, step_rad) = ASKED_APART;
        apart(self.scans_of(segment), step_m, step_rad).map(|(pose, _)| pose).collect()
    }

    fn hang(&mut self, node: usize, mapped: &[usize], reached: &[Option<Reach>]) {
        // By a closure of its own, or by what comes before or after it, which hangs.
        let is_tied = |edge: &Edge| {
            let is_held = edge.to == node && edge.from + 1 != node;
            is_held || edge.is_closure && edge.from == node
        };
        if !self.graph.edges().iter().any(is_tied) {
            return;
        }
        let Some(on) = self.nearest_first_visit(node, mapped) else { return };
        let reach_m = reached[on].map_or(0.0, |reach| reach.position_m());
        let sigma_m = if reach_m > f64::from(REFERENCE_SIGMA_M) { reach_m } else { HANGING_SIGMA_M };
        let (position, heading) = (sigma_m.powi(-2), HANGING_SIGMA_DEG.to_radians().powi(-2));
        self.graph.hang(node, on, Matrix3::from_diagonal(&Vector3::new(position, position, heading)));
    }

    /// The nearest of the `mapped` nodes that are not known themselves, if there are such: what others hang on can no longer hang.
    fn nearest_first_visit(&self, node: usize, mapped: &[usize]) -> Option<usize> {
        let nodes = self.graph.nodes();
        let distance = |k: usize| nodes[k].between(nodes[node]).distance_m();
        let mut nearest = mapped.to_vec();
        nearest.sort_by(|a, b| distance(*a).total_cmp(&distance(*b)));
        let is_first = |k: &usize| {
            let before: Vec<usize> = mapped.iter().copied().filter(|other| other + VISIT_SEGMENTS <= *k).collect();
            *k == 0 || !self.is_known(*k, &before, VISITS) || !self.is_known(*k - 1, &before, VISITS)
        };
        nearest.iter().copied().find(is_first).or(nearest.first().copied())
    }

    /// Scans of older known segments go where newer visits than them have come by since.
    fn forget_scans(&mut self, newer: usize) {
        let hung = self.hung_nodes();
        let nodes = self.graph.nodes();
        let is_near = |k: &usize| nodes[*k].between(nodes[newer]).distance_m() <= SEGMENTS_APART_M;
        let known = |k: &usize| hung.contains(k) && hung.contains(&(k + 1));
        let has_scans = |k: &usize| self.segments[*k].poses.have_scans();
        let seen: Vec<usize> = (0..newer).filter(|k| is_near(k) && known(k) && has_scans(k)).collect();
        for segment in seen {
            let later: Vec<usize> = (segment + 1..=newer).collect();
            if self.is_known(segment, &later, NEWER_VISITS) {
                let poses = &mut self.segments[segment].poses;
                self.forgotten.extend(poses.take_scans());
                poses.put_aside(&self.aside);
            }
        }
        self.forget_unless_drawn();
    }
}

/// Visits that came by a scan.
///
/// * `others` — segments in order, and where their scans were taken
fn visits_of(scan: &Pose2, others: &[(usize, Vec<Pose2>)]) -> usize {
    let is_near = |other: &Pose2| {
        let step = scan.between(*other);
        step.position().norm() <= NEAR_M && step.heading.abs() <= NEAR_DEG.to_radians()
    };
    let mut last: Option<usize> = None;
    let mut visits = 0;
    for (segment, poses) in others {
        let is_another = last.is_none_or(|last| segment - last >= VISIT_SEGMENTS);
        if is_another && poses.iter().any(is_near) {
            last = Some(*segment);
            visits += 1;
        }
    }
    visits
}
