//! The scan filter (thesis §4.4.3): dense nearby walls must not outvote the distant ones.
//!
//! A circular window slides over the scan's points in beam order; the points inside it are replaced by their centre
//! of gravity. The result has points about a window radius apart.

use crate::geometry::Point2;
use crate::sweep::Sweep;

crate::config! {
    /// Scan filter (thesis 4.4.3).
    pub struct FilterConfig {
        /// Radius of the sliding window, m; larger is faster and coarser. Thesis 4.4.3: 0.10. Zero keeps every point.
        radius_m: f32 = 0.10, in 0.0..=1.0;
    }
}

/// More points than the memory lent for them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("room for {capacity} points, the scan has more")]
pub struct PointCapacityError {
    /// Points that fit.
    pub capacity: usize,
}

/// The scan's hits, robot frame, in beam order, where they lie in the middle of the sweep; written to the front of `memory`.
///
/// # Errors
/// [`PointCapacityError`] if `memory` is too short; nothing is returned then.
pub fn hits<'m>(sweep: &Sweep<'_>, memory: &'m mut [Point2]) -> Result<&'m [Point2], PointCapacityError> {
    let capacity = memory.len();
    let middle_from_beam = sweep.middle_from_beam();
    let mut count = 0;
    for beam in sweep.scan.beams {
        let Some(hit_in_lrf) = Point2::of_hit(beam) else { continue };
        if let Some(place) = memory.get_mut(count) {
            *place = sweep.robot_from_lrf.transform(middle_from_beam(beam).transform(hit_in_lrf));
        }
        count += 1;
    }
    memory.get(..count).ok_or(PointCapacityError { capacity })
}

/// Centres of gravity of `points`, in order; written to the front of `memory`.
///
/// A window is closed by the first point farther than `radius_m` from its first point.
///
/// Source: thesis §4.4.3.
///
/// # Errors
/// [`PointCapacityError`] if `memory` is too short; nothing is returned then.
pub fn thin<'m>(
    config: &FilterConfig,
    points: &[Point2],
    memory: &'m mut [Point2],
) -> Result<&'m [Point2], PointCapacityError> {
    let capacity = memory.len();
    let mut written = 0;
    let mut keep = |window: &Window| {
        *memory.get_mut(written).ok_or(PointCapacityError { capacity })? = window.centre();
        written += 1;
        Ok(())
    };
    let mut window: Option<Window> = None;
    for point in points {
        match &mut window {
            Some(open) if (*point - open.first).norm() <= config.radius_m => open.add(*point),
            _ => {
                if let Some(closed) = window.replace(Window::new(*point)) {
                    keep(&closed)?;
                }
            }
        }
    }
    if let Some(closed) = window {
        keep(&closed)?;
    }
    memory.get(..written).ok_or(PointCapacityError { capacity })
}

/// The points gathered in the window so far.
struct Window {
    first: Point2,
    sum: Point2,
    count: f32,
}

impl Window {
    fn new(first: Point2) -> Self {
        Self { first, sum: first, count: 1.0 }
    }

    fn add(&mut self, point: Point2) {
        self.sum = self.sum + point;
        self.count += 1.0;
    }

    fn centre(&self) -> Point2 {
        Point2 { facing: self.first.facing, ..self.sum * (1.0 / self.count) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Pose2;
    use crate::scan::{Beam, Echo, RangeScan};
    use crate::sweep::SweepMotion;
    use crate::time::{Duration, Instant};

    /// A wall 0.5 m to the right of the robot, one beam a degree over 180°.
    fn beside_a_wall() -> [Beam; 181] {
        core::array::from_fn(|i| {
            let bearing_rad = (i as f32 - 90.0).to_radians();
            let range = -0.5 / libm::sinf(bearing_rad);
            Beam { bearing_rad, offset: Duration::ZERO, echo: Echo::from_range(range, 8.0) }
        })
    }

    fn hits_of<'m>(
        beams: &[Beam],
        mounting: Pose2,
        memory: &'m mut [Point2],
    ) -> Result<&'m [Point2], PointCapacityError> {
        let scan = RangeScan { stamp: Instant::default(), range_max_m: 8.0, beams };
        hits(&Sweep::at_rest(scan, mounting), memory)
    }

    #[test]
    fn dense_near_wall_is_thinned_to_the_window_radius() {
        let beams = beside_a_wall();
        let (mut raw, mut memory) = ([Point2::default(); 181], [Point2::default(); 181]);
        let hits = hits_of(&beams, Pose2::IDENTITY, &mut raw).unwrap();
        let points = thin(&FilterConfig::default(), hits, &mut memory).unwrap();
        assert!(hits.len() > 80 && points.len() < 40, "{} hits became {} points", hits.len(), points.len());
        assert!(points.iter().all(|p| (p.y + 0.5).abs() < 1e-3), "the wall stays where it is");
        assert!(points.windows(2).all(|w| (w[1] - w[0]).norm() > 0.07));
    }

    #[test]
    fn no_radius_keeps_every_point() {
        let points = [Point2::new(1.0, 0.0), Point2::new(1.0, 0.001), Point2::new(1.0, 0.002)];
        let mut memory = [Point2::default(); 3];
        assert_eq!(thin(&FilterConfig { radius_m: 0.0 }, &points, &mut memory), Ok(&points[..]));
    }

    #[test]
    fn mounting_carries_points_into_the_robot_frame() {
        let beams = [Beam { bearing_rad: 0.0, offset: Duration::ZERO, echo: Echo::Hit(2.0) }];
        let mounting = Pose2::new(0.2, 0.0, core::f32::consts::FRAC_PI_2);
        let mut memory = [Point2::default(); 1];
        let points = hits_of(&beams, mounting, &mut memory).unwrap();
        assert!((points[0] - Point2::new(0.2, 2.0)).norm() < 1e-6);
    }

    #[test]
    fn motion_during_the_sweep_is_taken_out() {
        // The robot drives 1 m/s towards a wall; the two beams are 0.1 s apart, and so are the walls they see by 0.1 m.
        let beam =
            |millis, range| Beam { bearing_rad: 0.0, offset: Duration::from_millis(millis), echo: Echo::Hit(range) };
        let beams = [beam(0, 2.05), beam(100, 1.95)];
        let scan = RangeScan { stamp: Instant::default(), range_max_m: 8.0, beams: &beams };
        let motion = SweepMotion { displacement: Pose2::new(0.2, 0.0, 0.0), duration: Duration::from_millis(200) };
        let mut memory = [Point2::default(); 2];
        let points = hits(&Sweep { scan, robot_from_lrf: Pose2::IDENTITY, motion }, &mut memory).unwrap();
        assert!(points.iter().all(|p| (*p - Point2::new(2.0, 0.0)).norm() < 1e-6), "{points:?}");
    }

    #[test]
    fn too_little_memory_is_an_error_and_an_empty_scan_is_not() {
        let beams = beside_a_wall();
        let mut memory = [Point2::default(); 3];
        let error = PointCapacityError { capacity: 3 };
        assert_eq!(hits_of(&beams, Pose2::IDENTITY, &mut memory), Err(error));
        let apart: Vec<_> = (0..4).map(|i| Point2::new(i as f32, 0.0)).collect();
        assert_eq!(thin(&FilterConfig::default(), &apart, &mut memory), Err(error));
        assert_eq!(hits_of(&[], Pose2::IDENTITY, &mut []), Ok(&[][..]));
    }
}
