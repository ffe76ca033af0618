//! Does a scan agree with what earlier ones saw? Asked where scans come so far apart that how well they fit says little.
//!
//! A robot that goes a metre from scan to scan has seen most of what it sees once before, and not closely: few cells of the reference count yet, and a scan
//! at its place fits by a fifth of what others do, or by half as well at another. But each hit is on a wall that a witness saw, or where
//! one saw that nothing is, or on new ground. In rooms and out of doors, nineteen of twenty agree where the robot is. Where it is not, one of ten or more
//! contradicts, or most of them are on new ground.

use super::LaserOdometry;
#[cfg(feature = "witnesses")]
use super::{
    Reference,
    witnesses::{self, Testimony},
};
use crate::geometry::Pose2;

/// Witnesses must have seen the places of so many hits to say anything. Chosen.
const SEEN_MIN: usize = 16;
/// A scan is at its place if they have seen those of two thirds of its hits: others fit in many places …
const SEEN_SHARE_MIN: f32 = 2.0 / 3.0;
/// … and of those so many agree. Both chosen.
const AGREE_SHARE: f32 = 0.95;
/// It is not if fewer do. Chosen: what moves contradicts too, but a scan that fits is not asked.
const AGREE_SHARE_MIN: f32 = 0.9;

/// What the witnesses say of a scan at a place.
#[derive(Debug, Clone, Copy)]
pub(super) struct Agreement {
    /// Points of the scan.
    points: usize,
    /// Points near what one of them saw …
    agree: usize,
    /// … and where they saw that nothing is.
    contradict: usize,
}

impl Agreement {
    /// True if the scan is at its place.
    pub(super) fn confirms(&self) -> bool {
        let seen = self.agree + self.contradict;
        let is_seen = seen >= SEEN_MIN && seen as f32 >= SEEN_SHARE_MIN * self.points as f32;
        is_seen && self.agree as f32 >= AGREE_SHARE * seen as f32
    }

    /// True if it is not.
    pub(super) fn refutes(&self) -> bool {
        let seen = self.agree + self.contradict;
        seen >= SEEN_MIN && (self.agree as f32) < AGREE_SHARE_MIN * seen as f32
    }
}

impl LaserOdometry<'_> {
    /// What the witnesses say of the first `count` points of a robot at `map_from_robot`.
    #[cfg(feature = "witnesses")]
    pub(super) fn agreement(&self, map_from_robot: Pose2, count: usize) -> Agreement {
        let mut says = Agreement { points: count, agree: 0, contradict: 0 };
        if self.config.odometry.reference != Reference::WholeMap {
            return says;
        }
        let outlines = witnesses::outlines(self.key_scans, self.key_points);
        for point in self.points.get(..count).unwrap_or_default() {
            match witnesses::say(map_from_robot.transform(*point), &outlines) {
                Testimony::Near => says.agree += 1,
                Testimony::Free => says.contradict += 1,
                Testimony::None => {}
            }
        }
        says
    }

    /// Without witnesses nobody can tell.
    #[cfg(not(feature = "witnesses"))]
    pub(super) fn agreement(&self, _: Pose2, count: usize) -> Agreement {
        Agreement { points: count, agree: 0, contradict: 0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scan_is_confirmed_by_much_that_agrees_and_refuted_by_little_that_does_not() {
        let says = |points, agree, contradict| {
            let agreement = Agreement { points, agree, contradict };
            (agreement.confirms(), agreement.refutes())
        };
        assert_eq!(says(100, 95, 5), (true, false));
        assert_eq!(says(100, 92, 8), (false, false));
        assert_eq!(says(100, 89, 11), (false, true));
        assert_eq!(says(100, 60, 0), (false, false), "the rest is new");
        assert_eq!((says(15, 15, 0), says(15, 0, 15)), ((false, false), (false, false)), "too few to say anything");
    }
}
