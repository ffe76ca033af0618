//! What a step of the filter weighs and prints: one scan, or a stretch of the path with all its scans.

use crate::geometry::Pose2;
use crate::sweep::Sweep;

/// Scans along a stretch of the path whose poses are known relative to its start.
pub trait Stretch {
    /// Number of scans.
    fn len(&self) -> usize;

    /// Scan `index`, and where the robot was then, seen from the start; `None` past the last one.
    fn scan(&mut self, index: usize) -> Option<(Pose2, Sweep<'_>)>;

    /// True if there is no scan.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// The stretch of the low level: one scan, at its start.
pub(super) struct OneScan<'s>(pub(super) Sweep<'s>);

impl Stretch for OneScan<'_> {
    fn len(&self) -> usize {
        1
    }

    fn scan(&mut self, index: usize) -> Option<(Pose2, Sweep<'_>)> {
        (index == 0).then_some((Pose2::IDENTITY, self.0))
    }
}
