//! What motion does to a scan: the speeds a laser's rate allows, and the correction of each beam for the motion during
//! the sweep.

use serde::{Deserialize, Serialize};

use crate::geometry::{Point2, Pose2};
use crate::scan::{Beam, Echo, RangeScan};
use crate::time::Duration;

/// Fastest motion at which a scan may be taken as a snapshot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpeedLimits {
    /// m/s.
    pub linear_mps: f32,
    /// rad/s.
    pub angular_radps: f32,
}

impl SpeedLimits {
    /// Limits for scans that take `period` each, with at most `error_m` and `error_rad` of motion within one.
    ///
    /// * `period` — of one mirror turn, or of a whole interlaced scan if its turns are used together; not positive gives no limit
    ///
    /// Source: thesis, eq. (4.44) v = εt·f and (4.45) ω = εr·f. Its example: 75 Hz, 5 mm and 0.25° give 0.375 m/s and 0.327 rad/s.
    pub fn new(period: Duration, error_m: f32, error_rad: f32) -> Self {
        let seconds = period.as_secs_f32();
        if seconds <= 0.0 {
            return Self { linear_mps: f32::INFINITY, angular_radps: f32::INFINITY };
        }
        Self { linear_mps: error_m / seconds, angular_radps: error_rad / seconds }
    }

    /// True if the motion `displacement` *of the laser* in `dt` exceeds the limits; never if `dt` is not positive.
    pub fn are_exceeded_by(&self, displacement: Pose2, dt: Duration) -> bool {
        let seconds = dt.as_secs_f32();
        let linear = displacement.position().norm() / seconds / self.linear_mps;
        let angular = displacement.heading.abs() / seconds / self.angular_radps;
        seconds > 0.0 && (linear > 1.0 || angular > 1.0)
    }
}

/// A displacement of the robot and the time it takes, at constant velocity.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct SweepMotion {
    /// Of the robot.
    pub displacement: Pose2,
    /// The time it takes; zero if it is not known, which stands for no motion during the sweep.
    pub duration: Duration,
}

/// A scan and how the robot carried the laser while it was taken: what is needed to place its beams.
///
/// Beams are placed where they lie in the middle of the sweep, not at its start: an error of the motion would then turn the whole
/// scan, its match would have the opposite error, and the next motion again the opposite, without end.
#[derive(Debug, Clone, Copy)]
pub struct Sweep<'a> {
    /// The beams.
    pub scan: RangeScan<'a>,
    /// Where the laser sits on the robot.
    pub robot_from_lrf: Pose2,
    /// How the robot moves meanwhile.
    pub motion: SweepMotion,
}

impl<'a> Sweep<'a> {
    /// A scan taken by a robot that stands still, or that is taken for a snapshot.
    pub fn at_rest(scan: RangeScan<'a>, robot_from_lrf: Pose2) -> Self {
        Self { scan, robot_from_lrf, motion: SweepMotion::default() }
    }

    /// Tells for each beam the laser's pose at that beam's time, seen from its pose in the middle of the sweep.
    ///
    /// The motion is scaled: position and heading each linear in time, which within one sweep differs from the arc by less
    /// than v·ω·t²/2 (0.3 mm at 1 m/s, 1 rad/s, 25 ms). Without motion it is the identity.
    pub fn middle_from_beam(&self) -> impl Fn(&Beam) -> Pose2 + use<> {
        let Pose2 { x, y, heading } = self.robot_from_lrf.inverse() * self.motion.displacement * self.robot_from_lrf;
        let middle = self.scan.middle();
        let seconds = self.motion.duration.as_secs_f32();
        let scale = if seconds > 0.0 { 1.0 / seconds } else { 0.0 };
        move |beam| {
            let part = (beam.offset.as_secs_f32() - middle.as_secs_f32()) * scale;
            Pose2::new(x * part, y * part, heading * part)
        }
    }

    /// Tells for each beam what it would be if it were taken in the middle of the sweep, at time zero.
    pub fn middle_beam(&self) -> impl Fn(&Beam) -> Beam + use<> {
        let (middle_from_beam, range_max_m) = (self.middle_from_beam(), self.scan.range_max_m);
        move |beam| {
            let end = |range_m| middle_from_beam(beam).transform(Point2::from_polar(range_m, beam.bearing_rad));
            let (bearing_rad, echo) = match beam.echo {
                Echo::Hit(range_m) => (end(range_m).bearing_rad(), Echo::Hit(end(range_m).norm())),
                Echo::Miss => (end(range_max_m).bearing_rad(), Echo::Miss),
                Echo::Invalid => (beam.bearing_rad, Echo::Invalid),
            };
            Beam { bearing_rad, offset: Duration::ZERO, echo }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::time::Instant;
    use std::vec::Vec;

    #[test]
    fn limits_are_those_of_the_thesis() {
        let limits = SpeedLimits::new(Duration::from_micros(13_333), 0.005, 0.25_f32.to_radians());
        assert!((limits.linear_mps - 0.375).abs() < 1e-3 && (limits.angular_radps - 0.327).abs() < 1e-3);
        let second = Duration::from_millis(1000);
        assert!(!limits.are_exceeded_by(Pose2::new(0.3, 0.0, 0.3), second));
        assert!(limits.are_exceeded_by(Pose2::new(0.4, 0.0, 0.0), second));
        assert!(limits.are_exceeded_by(Pose2::new(0.0, 0.0, 0.35), second));
        assert!(!limits.are_exceeded_by(Pose2::new(9.0, 0.0, 0.0), Duration::ZERO));
    }

    /// A laser that drives along a straight wall 2 m to its left, and turns: the wall comes out straight.
    #[test]
    fn wall_seen_on_the_move_comes_out_straight() {
        let dt = Duration::from_millis(100);
        let motion = Pose2::new(0.1, 0.0, 0.2);
        let beams: Vec<Beam> = (0..60)
            .map(|index| {
                let offset = Duration::from_micros(index * 1500);
                // The middle of the sweep is 29.5 beams after its start.
                let part = (offset.as_secs_f32() - 29.5 * 0.0015) / dt.as_secs_f32();
                let (bearing_rad, heading) = (0.8 + 0.02 * index as f32, motion.heading * part);
                let range = 2.0 / libm::sinf(bearing_rad + heading);
                Beam { bearing_rad, offset, echo: Echo::Hit(range) }
            })
            .collect();
        let scan = RangeScan { stamp: Instant::default(), range_max_m: 30.0, beams: &beams };
        let worst = |displacement| {
            let mut worst = 0.0_f32;
            let motion = SweepMotion { displacement, duration: dt };
            let middle_from_beam = Sweep { scan, robot_from_lrf: Pose2::IDENTITY, motion }.middle_from_beam();
            for beam in &beams {
                let point = middle_from_beam(beam).transform(Point2::of_hit(beam).unwrap());
                worst = worst.max((point.y - 2.0).abs());
            }
            worst
        };
        assert!(worst(motion) < 1e-4, "{}", worst(motion));
        assert!(worst(Pose2::IDENTITY) > 0.1);
    }
}
