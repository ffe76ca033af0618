//! Paths of a robot's particles, of which only steps are kept that a particle of the newest one has come by.
//!
//! What the particles have in common is a pose a step, however many there are; so the tree grows by that alone.

use std::collections::VecDeque;

use lrfslam_core::geometry::Pose2;
use lrfslam_robot::wire::message::{PathNode, Segment};

/// The end of a segment.
#[derive(Debug, Clone)]
struct Step {
    number: u32,
    /// With the indices of their ancestors among those of the step before.
    nodes: Vec<PathNode>,
}

/// Paths of the particles, back to where segments are missing.
#[derive(Debug, Clone, Default)]
pub struct ParticlePaths {
    /// Number and pose of each step that all paths have in common, the oldest first.
    trunk: Vec<(u32, Pose2)>,
    /// The steps after these, the oldest first; the newest is among them.
    branches: VecDeque<Step>,
    /// Index of the most likely particle.
    best: usize,
    is_from_start: bool,
}

impl ParticlePaths {
    /// Goes on by a segment. One that does not begin where the last one ended begins anew: nothing leads back from it.
    pub fn take(&mut self, segment: &Segment) {
        if !self.leads_on_to(segment) {
            *self = Self { is_from_start: segment.since_step == 0, ..Self::default() };
        }
        self.best = usize::from(segment.best);
        self.branches.push_back(Step { number: segment.step, nodes: segment.particles.to_vec() });
        self.prune();
    }

    fn leads_on_to(&self, segment: &Segment) -> bool {
        self.branches.back().is_some_and(|last| {
            let is_known = |node: &PathNode| usize::from(node.parent) < last.nodes.len();
            last.number == segment.since_step && segment.particles.iter().all(is_known)
        })
    }

    /// Lets go of what no particle has come by, from the newest step back to where nothing more goes.
    fn prune(&mut self) {
        let mut steps = self.branches.iter_mut().rev();
        let mut children = steps.next();
        while let (Some(step), Some(before)) = (children.take(), steps.next()) {
            if keep_ancestors(&mut before.nodes, &mut step.nodes) {
                children = Some(before);
            }
        }
        while self.branches.len() > 1 {
            let Some(oldest) = self.branches.front() else { return };
            let [only] = oldest.nodes[..] else { return };
            self.trunk.push((oldest.number, only.map_from_robot));
            self.branches.pop_front();
        }
    }

    /// The particles of the newest step.
    pub fn particles(&self) -> &[PathNode] {
        self.branches.back().map_or(&[], |last| &last.nodes)
    }

    /// Number and pose of the most likely particle's steps, the last first.
    pub fn best_backwards(&self) -> impl Iterator<Item = (u32, Pose2)> + '_ {
        let mut index = self.best;
        let branches = self.branches.iter().rev().map_while(move |step| {
            let node = step.nodes.get(index)?;
            index = usize::from(node.parent);
            Some((step.number, node.map_from_robot))
        });
        branches.chain(self.trunk.iter().rev().copied())
    }

    /// True if the paths begin with the robot's first step.
    pub fn is_from_start(&self) -> bool {
        self.is_from_start
    }

    /// Poses kept.
    #[cfg(test)]
    fn poses(&self) -> usize {
        self.trunk.len() + self.branches.iter().map(|step| step.nodes.len()).sum::<usize>()
    }
}

/// Keeps those of `before` that one of `nodes` descends from; false if that is all of them.
fn keep_ancestors(before: &mut Vec<PathNode>, nodes: &mut [PathNode]) -> bool {
    let all = before.len();
    let mut new_index = vec![None; all];
    for node in nodes.iter() {
        if let Some(index) = new_index.get_mut(usize::from(node.parent)) {
            *index = Some(0);
        }
    }
    let mut indices = new_index.iter_mut();
    let mut kept = 0;
    before.retain(|_| {
        let Some(Some(index)) = indices.next() else { return false };
        *index = kept;
        kept += 1;
        true
    });
    for node in nodes {
        node.parent = new_index.get(usize::from(node.parent)).copied().flatten().unwrap_or(node.parent);
    }
    before.shrink_to_fit();
    before.len() < all
}

#[cfg(test)]
mod tests {
    use lrfslam_core::time::Instant;

    use super::*;

    const PARTICLES: u8 = 16;

    /// Steps whose particles descend from a few of the step before.
    fn segments(steps: u32) -> Vec<Segment> {
        let segment = |step: u32| {
            let node = |index: u8| PathNode {
                parent: index / 2 + (step * 5 % 8) as u8,
                map_from_robot: Pose2::new(step as f32, f32::from(index), 0.0),
            };
            let particles = (0..PARTICLES).map(node).collect();
            let best = (step % u32::from(PARTICLES)) as u8;
            Segment { step, since_step: step - 1, stamp: Instant::default(), best, particles }
        };
        (1..=steps).map(segment).collect()
    }

    /// The walk from particle to ancestor through all that was told.
    fn walked(told: &[Segment]) -> Vec<(u32, Pose2)> {
        let mut index = told.last().map_or(0, |last| usize::from(last.best));
        let step = |segment: &Segment| {
            let node = segment.particles[index];
            index = usize::from(node.parent);
            (segment.step, node.map_from_robot)
        };
        told.iter().rev().map(step).collect()
    }

    #[test]
    fn the_best_path_is_that_through_all_that_was_told_and_a_step_costs_a_pose() {
        let told = segments(500);
        let mut paths = ParticlePaths::default();
        for count in 1..=told.len() {
            paths.take(&told[count - 1]);
            assert_eq!(paths.best_backwards().collect::<Vec<_>>(), walked(&told[..count]));
        }
        assert_eq!(paths.particles().len(), usize::from(PARTICLES));
        assert!(paths.is_from_start() && paths.poses() < 560, "{} poses", paths.poses());
    }

    #[test]
    fn a_path_ends_where_segments_are_missing_or_ancestors_that_nobody_told_of() {
        let told = segments(30);
        let begins_after = |paths: &ParticlePaths| paths.best_backwards().last().map(|(step, _)| step);
        let mut paths = ParticlePaths::default();
        told.iter().filter(|segment| segment.step != 20).for_each(|segment| paths.take(segment));
        assert_eq!((begins_after(&paths), paths.is_from_start()), (Some(21), false));

        let mut damaged = told.clone();
        damaged[9].particles[3].parent = PARTICLES;
        let mut paths = ParticlePaths::default();
        damaged.iter().for_each(|segment| paths.take(segment));
        assert_eq!((begins_after(&paths), paths.is_from_start()), (Some(10), false));
    }
}
