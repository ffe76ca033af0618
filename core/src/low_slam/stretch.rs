//! What a step of the filter weighs and prints: one scan, or a stretch of the path with all its scans.

use crate::geometry::Pose2;
use crate::rays::{self, RayCapacityError};
use crate::sweep::Sweep;

use super::{FilterReport, LowSlam};

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

impl<const SIDE: usize> LowSlam<'_, SIDE> {
    /// Makes a scan the current one.
    pub(super) fn take(&mut self, stretch: &mut impl Stretch, index: usize) -> Result<(), RayCapacityError> {
        if let Some((start_from_robot, sweep)) = stretch.scan(index) {
            self.ray_count = rays::rays_of(&self.config.rays, &sweep, self.rays)?;
            self.particle_from_lrf = start_from_robot * sweep.robot_from_lrf;
            self.scan_index = index;
        }
        Ok(())
    }

    /// The same, unless it is the current one already.
    pub(super) fn take_again(&mut self, stretch: &mut impl Stretch, index: usize) -> Result<(), RayCapacityError> {
        if self.scan_index == index { Ok(()) } else { self.take(stretch, index) }
    }

    pub(super) fn print_all(
        &mut self,
        stretch: &mut impl Stretch,
        report: &mut FilterReport,
    ) -> Result<(), RayCapacityError> {
        for index in 0..stretch.len() {
            self.take_again(stretch, index)?;
            let frame = self.frame();
            self.print(frame, report);
        }
        Ok(())
    }

    /// At the end of a stretch: the particles, and what is reported of them.
    pub(super) fn moved_by(&mut self, start_from_end: Pose2, report: FilterReport) -> FilterReport {
        if start_from_end == Pose2::IDENTITY {
            return report;
        }
        for particle in self.particles.iter_mut().take(self.particle_count) {
            particle.map_from_robot = particle.map_from_robot * start_from_end;
        }
        FilterReport {
            map_from_robot: report.map_from_robot * start_from_end,
            mean_map_from_robot: report.mean_map_from_robot * start_from_end,
            ..report
        }
    }
}
