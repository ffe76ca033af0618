//! New ground: what comes into view through a door that the robot has just passed, or round a corner, is not in the reference yet.
//!
//! There a scan fits badly though it is where it fits, and the more so the farther a robot goes from scan to scan. So what nothing is known of is
//! left out: hits where no cell is and no witness has seen anything or that nothing is, and that no wall stands before. The rest must fit well, as
//! a scan does that stands for few. A scan at a wrong place fits no better without them: its other hits lie where it is free, or behind walls.

use super::witnesses::{self, Outline, Testimony};
use super::{LaserOdometry, Reference};
use crate::geometry::Point2;
use crate::matcher::Match;

/// A scan is judged by no fewer hits than this. Chosen.
const KNOWN_MIN: usize = 16;
/// Nor by a smaller share of them. Chosen.
const KNOWN_SHARE_MIN: f32 = 0.2;

impl LaserOdometry<'_> {
    /// True if those of the first `count` points at `matched` that something is known about agree with it by `share` of the usual score at least.
    ///
    /// * `eye` — the laser, robot frame
    pub(super) fn fits_known_ground(&self, matched: &Match, eye: Point2, count: usize, share: f32) -> bool {
        if self.key_scans.is_empty() || self.config.odometry.reference != Reference::WholeMap {
            return false;
        }
        let at = matched.map_from_robot;
        let points = self.points.get(..count).unwrap_or_default();
        let outlines = witnesses::outlines(self.key_scans, self.key_points);
        let is_known = |point: &&Point2| self.is_known(at.transform(eye), at.transform(**point), &outlines);
        let known = points.iter().filter(is_known).count();
        let fits = matched.score >= share * self.score_per_point * known as f32;
        known >= KNOWN_MIN && known as f32 >= KNOWN_SHARE_MIN * count as f32 && fits
    }

    /// True if the reference or a witness says what is to be expected of a ray from `eye` to `hit` (map).
    fn is_known(&self, eye: Point2, hit: Point2, outlines: &[Outline<'_>]) -> bool {
        self.ndt.is_seen_at(hit)
            || self.ndt.stands_between(eye, hit)
            || witnesses::say(hit, outlines) != Testimony::None
    }
}
