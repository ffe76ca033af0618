//! Where the robot is expected at the next scan, how far from there it may be, and how it moves while the scan is taken.

use super::LaserOdometry;
use super::course::{Forecast, SLOW_S};
use crate::geometry::Pose2;
use crate::matcher::MatcherConfig;
use crate::scan::RangeScan;
use crate::sweep::SweepMotion;
use crate::time::{Duration, Instant};

/// A step is stretched by the time that has passed, from so many …
const STRETCH_MIN: f32 = 0.2;
/// … to so many times.
const STRETCH_MAX: f32 = 4.0;
/// Score per point by which a stretched step must agree better than the last one again.
const STRETCH_BETTER: f32 = 0.1;
/// The search box and the prior are those of scans so far apart, s; with the time between scans they grow as a random walk does.
pub(super) const INTERVAL_S: f32 = 0.25;
/// Longer gaps count as this long, s.
const INTERVAL_MAX_S: f32 = 4.0;
/// Share of an interval in the mean of the last ones.
const INTERVAL_SHARE: f32 = 0.05;

impl LaserOdometry<'_> {
    /// What is expected of the step to `scan`, whose first `count` points are there.
    pub(super) fn forecast(&mut self, scan: &RangeScan<'_>, count: usize, odometry: Option<Pose2>) -> Forecast {
        let steady = self.expected_step(scan, count);
        let spread = self.spread(scan.stamp);
        let MatcherConfig { prior_position_m, prior_heading_deg, .. } = self.config.matcher;
        let usual = (prior_position_m, prior_heading_deg.to_radians());
        self.course.forecast(steady, odometry, (spread, self.usual_interval_s), usual)
    }

    /// The last step again, unless the scan agrees clearly better with a step in proportion to the time that has passed.
    ///
    /// Scans come at a steady rate while their stamps may be wrong (logs written in bursts), or scans are missing and the stamps
    /// are right. Only the scene can tell.
    pub(super) fn expected_step(&self, scan: &RangeScan<'_>, count: usize) -> Pose2 {
        let points = self.points.get(..count).unwrap_or_default();
        let elapsed = self.last_stamp.map_or(0.0, |last| scan.stamp.since(last).as_secs_f32());
        let usual = self.last_interval.as_secs_f32();
        if elapsed <= 0.0 || usual <= 0.0 {
            return self.course.step();
        }
        let factor = (elapsed / usual).clamp(STRETCH_MIN, STRETCH_MAX);
        let Pose2 { x, y, heading } = self.course.step();
        let in_proportion = Pose2::new(factor * x, factor * y, factor * heading);
        let score = |step| self.ndt.search_score(points, self.map_from_robot * step, 0.0);
        if score(in_proportion) > score(self.course.step()) + STRETCH_BETTER * count as f32 {
            in_proportion
        } else {
            self.course.step()
        }
    }

    /// How much farther than usual the robot may be from where it is expected at `stamp`: the slower the scans, the farther. Stamps may
    /// come in bursts, so their mean distance counts as well.
    pub(super) fn spread(&mut self, stamp: Instant) -> f32 {
        let Some(last) = self.seen_at else { return 1.0 };
        let interval_s = stamp.since(last).as_secs_f32().clamp(0.0, INTERVAL_MAX_S);
        let share = INTERVAL_SHARE.max(1.0 / self.scans.max(1) as f32);
        self.usual_interval_s += share * (interval_s - self.usual_interval_s);
        libm::sqrtf((interval_s.max(self.usual_interval_s) / INTERVAL_S).max(1.0))
    }

    /// True if scans come so far apart that a robot sees another scene in each. A gap among others does not count.
    pub(super) fn is_slow(&self) -> bool {
        self.usual_interval_s >= SLOW_S
    }

    /// How the robot is expected to move while `scan` is taken: at the speed of the last step.
    ///
    /// Stamps may jitter, but a step cannot have taken less time than a sweep.
    pub(super) fn motion_during(&self, scan: &RangeScan<'_>, displacement: Option<Pose2>) -> SweepMotion {
        let Some(last) = self.last_stamp.filter(|_| self.config.odometry.deskew) else {
            return SweepMotion::default();
        };
        let sweep = match (scan.beams.first(), scan.beams.last()) {
            (Some(first), Some(last)) => last.offset.micros.abs_diff(first.offset.micros) as i64,
            _ => 0,
        };
        let (displacement, taken) = match displacement {
            Some(displacement) => (displacement, scan.stamp.since(last)),
            None => (self.course.step(), self.last_interval),
        };
        SweepMotion { displacement, duration: taken.max(Duration::from_micros(sweep)) }
    }
}
