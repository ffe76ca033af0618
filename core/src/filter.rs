//! The scan filter (thesis §4.4.3): dense nearby walls must not outvote the distant ones.
//!
//! A circular window slides over the scan's points in beam order; the points inside it are replaced by their centre
//! of gravity. The result has points about a window radius apart.

use crate::geometry::{Point2, Pose2};
use crate::scan::RangeScan;

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

/// Centres of gravity of the scan's hits, robot frame, in beam order; written to the front of `memory`.
///
/// * `robot_from_lrf` — where the laser sits on the robot
/// * a window is closed by the first hit farther than `radius_m` from its first hit
///
/// Source: thesis §4.4.3.
///
/// # Errors
/// [`PointCapacityError`] if `memory` is too short; nothing is returned then.
pub fn filter<'m>(
    config: &FilterConfig,
    scan: &RangeScan<'_>,
    robot_from_lrf: Pose2,
    memory: &'m mut [Point2],
) -> Result<&'m [Point2], PointCapacityError> {
    let capacity = memory.len();
    let mut written = 0;
    let mut window: Option<Window> = None;
    for hit in scan.beams.iter().filter_map(|beam| beam.hit_in_lrf()) {
        match &mut window {
            Some(open) if (hit - open.first).norm() <= config.radius_m => open.add(hit),
            _ => {
                if let Some(closed) = window.replace(Window::new(hit)) {
                    *memory.get_mut(written).ok_or(PointCapacityError { capacity })? = closed.centre();
                    written += 1;
                }
            }
        }
    }
    if let Some(closed) = window {
        *memory.get_mut(written).ok_or(PointCapacityError { capacity })? = closed.centre();
        written += 1;
    }
    let points = memory.get_mut(..written).unwrap_or_default();
    for point in points.iter_mut() {
        *point = robot_from_lrf.transform(*point);
    }
    Ok(points)
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
        self.sum * (1.0 / self.count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scan::{Beam, Echo};
    use crate::time::{Duration, Instant};

    /// A wall 0.5 m to the right of the robot, one beam a degree over 180°.
    fn beside_a_wall() -> [Beam; 181] {
        core::array::from_fn(|i| {
            let bearing_rad = (i as f32 - 90.0).to_radians();
            let range = -0.5 / libm::sinf(bearing_rad);
            Beam { bearing_rad, offset: Duration::ZERO, echo: Echo::from_range(range, 8.0) }
        })
    }

    #[test]
    fn dense_near_wall_is_thinned_to_the_window_radius() {
        let beams = beside_a_wall();
        let scan = RangeScan { stamp: Instant::default(), range_max_m: 8.0, beams: &beams };
        let mut memory = [Point2::default(); 181];
        let points = filter(&FilterConfig::default(), &scan, Pose2::IDENTITY, &mut memory).unwrap();
        let hits = beams.iter().filter(|b| b.hit_in_lrf().is_some()).count();
        assert!(hits > 80 && points.len() < 40, "{hits} hits became {} points", points.len());
        assert!(points.iter().all(|p| (p.y + 0.5).abs() < 1e-3), "the wall stays where it is");
        assert!(points.windows(2).all(|w| (w[1] - w[0]).norm() > 0.07));
    }

    #[test]
    fn mounting_carries_points_into_the_robot_frame() {
        let beams = [Beam { bearing_rad: 0.0, offset: Duration::ZERO, echo: Echo::Hit(2.0) }];
        let scan = RangeScan { stamp: Instant::default(), range_max_m: 8.0, beams: &beams };
        let mut memory = [Point2::default(); 1];
        let mounting = Pose2::new(0.2, 0.0, core::f32::consts::FRAC_PI_2);
        let points = filter(&FilterConfig::default(), &scan, mounting, &mut memory).unwrap();
        assert!((points[0] - Point2::new(0.2, 2.0)).norm() < 1e-6);
    }

    #[test]
    fn too_little_memory_is_an_error_and_an_empty_scan_is_not() {
        let beams = beside_a_wall();
        let scan = RangeScan { stamp: Instant::default(), range_max_m: 8.0, beams: &beams };
        let mut memory = [Point2::default(); 3];
        let config = FilterConfig::default();
        assert_eq!(filter(&config, &scan, Pose2::IDENTITY, &mut memory), Err(PointCapacityError { capacity: 3 }));
        let nothing = RangeScan { beams: &[], ..scan };
        assert_eq!(filter(&config, &nothing, Pose2::IDENTITY, &mut []), Ok(&[][..]));
    }
}
