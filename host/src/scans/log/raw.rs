//! A scan as a log line says it, before the log as a whole gives it its maximum range and mounting.

use lrfslam_core::geometry::Pose2;
use lrfslam_core::scan::{Beam, Echo};
use lrfslam_core::time::{Duration, Instant};

use super::range_limit::TOLERANCE_M;
use crate::input::text::{FieldFault, Line, Words, fault};
use crate::pose_f64::PoseF64;

/// More beams than any planar laser range finder has.
pub(super) const BEAMS_MAX: usize = 20_000;

/// Directions of a scan's beams: beam i points at `first_rad + i · step_rad`, counter-clockwise from forward.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Bearings {
    pub first_rad: f32,
    pub step_rad: f32,
}

impl Bearings {
    /// By the number of beams alone, as logs without angles are read.
    ///
    /// The usual devices by their counts: SICK LMS (180 or 181 beams over 180°, 360 or 361, 720 or 721; 101 and 401
    /// over 100°), Hokuyo UTM (541, 1081 over 270°) and URG-04LX (682 of 1024 to the turn, forward is 340). Any other
    /// count is spread over 180°. An even count starts at −90° as if the last beam were missing (CARMEN's convention).
    pub fn usual(beams: usize) -> Self {
        match beams {
            682 => {
                Self { first_rad: -340.0 * std::f32::consts::TAU / 1024.0, step_rad: std::f32::consts::TAU / 1024.0 }
            }
            541 | 1081 => Self::over(270.0_f32.to_radians(), beams),
            101 | 401 => Self::over(100.0_f32.to_radians(), beams),
            _ => Self::over(180.0_f32.to_radians(), beams),
        }
    }

    /// True if [`usual`](Self::usual) knows a device by this number of beams.
    pub fn is_usual(beams: usize) -> bool {
        matches!(beams, 101 | 180 | 181 | 360 | 361 | 401 | 541 | 682 | 720 | 721 | 1081)
    }

    /// `beams` beams over `field_of_view_rad`, from its right edge; an even count lacks the beam on its left edge.
    pub fn over(field_of_view_rad: f32, beams: usize) -> Self {
        let steps = if beams.is_multiple_of(2) { beams } else { beams - 1 }.max(1);
        Self { first_rad: -field_of_view_rad / 2.0, step_rad: field_of_view_rad / steps as f32 }
    }

    /// Bearing of beam `index`, rad.
    pub fn of(self, index: usize) -> f32 {
        self.first_rad + index as f32 * self.step_rad
    }
}

/// One scan of a log, ranges in m as they stand there.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct RawScan {
    pub line: u64,
    /// `None` in a log without times.
    pub stamp: Option<Instant>,
    pub ranges_m: Vec<f32>,
    /// `None` if the log does not tell.
    pub bearings: Option<Bearings>,
    /// As declared by the log, in this line or before.
    pub range_max_m: Option<f32>,
    /// Of the first beam after the stamp.
    pub first_offset: Duration,
    pub beam_interval: Duration,
    /// The beams to the bit, with `range_max_m`; the rest then only says what they are like.
    pub exact: Option<Vec<Beam>>,
    pub odometry_from_robot: Option<PoseF64>,
    pub odometry_from_lrf: Option<PoseF64>,
    /// Known from the format.
    pub robot_from_lrf: Option<Pose2>,
}

impl RawScan {
    /// Only ranges, of the line `line`.
    pub fn new(line: u64, ranges_m: Vec<f32>) -> Self {
        Self {
            line,
            stamp: None,
            ranges_m,
            bearings: None,
            range_max_m: None,
            first_offset: Duration::ZERO,
            beam_interval: Duration::ZERO,
            exact: None,
            odometry_from_robot: None,
            odometry_from_lrf: None,
            robot_from_lrf: None,
        }
    }

    /// Its beams, in order of bearing; ranges from `range_max_m` on saw nothing.
    pub fn beams(&self, bearings: Bearings, range_max_m: f32) -> Vec<Beam> {
        let beam = |(index, &range_m): (usize, &f32)| Beam {
            bearing_rad: bearings.of(index),
            offset: Duration::from_micros(self.first_offset.micros + self.beam_interval.micros * index as i64),
            echo: echo(range_m, range_max_m),
        };
        self.exact.clone().unwrap_or_else(|| self.ranges_m.iter().enumerate().map(beam).collect())
    }
}

/// A miss from half of the log's finest unit below the maximum on.
fn echo(range_m: f32, range_max_m: f32) -> Echo {
    if range_m >= range_max_m - TOLERANCE_M { Echo::Miss } else { Echo::from_range(range_m, range_max_m) }
}

/// What a line turned out to be.
#[derive(Debug)]
pub(super) enum Content {
    Scan(Box<RawScan>),
    /// Understood, but no scan: odometry, a parameter.
    Other,
    /// Of no known kind.
    Unknown,
}

/// Reader of one format's lines.
pub(super) trait LineReader: Send {
    /// Understands one line that is neither blank nor a comment.
    fn read(&mut self, line: &Line<'_>) -> Result<Content, FieldFault>;
}

/// The next field as a number of beams.
pub(super) fn beam_count(words: &mut Words<'_>) -> Result<usize, FieldFault> {
    const EXPECTED: &str = "a number of beams, 1 to 20000";
    let word = words.word();
    let count = word.and_then(|w| w.parse().ok()).filter(|n| (1..=BEAMS_MAX).contains(n));
    count.ok_or_else(|| fault("number of beams".to_owned(), EXPECTED, word))
}

/// The next `count` fields as ranges, m; NaN, infinite and negative ones are allowed.
pub(super) fn ranges(words: &mut Words<'_>, count: usize) -> Result<Vec<f32>, FieldFault> {
    let expected = "a number (m)";
    (1..=count).map(|i| words.parse(|| format!("range {i} of {count}"), expected)).collect()
}

/// The next three fields as a pose, m and rad; `None` if one is NaN or infinite: the odometry was not known.
pub(super) fn pose(words: &mut Words<'_>, whose: &str) -> Result<Option<PoseF64>, FieldFault> {
    let mut number = |axis: &str| words.parse(|| format!("{whose} {axis}"), "a number");
    let pose = PoseF64::new(number("x")?, number("y")?, number("heading")?);
    Ok(pose.is_finite().then_some(pose))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn usual_bearings_are_those_of_the_devices() {
        let degrees = |beams: usize, index: usize| Bearings::usual(beams).of(index).to_degrees();
        for (beams, first, last) in [(180, -90.0, 89.0), (181, -90.0, 90.0), (360, -90.0, 89.5), (361, -90.0, 90.0)] {
            assert!((degrees(beams, 0) - first).abs() < 1e-3, "{beams}");
            assert!((degrees(beams, beams - 1) - last).abs() < 1e-3, "{beams}");
        }
        assert!((degrees(1081, 540)).abs() < 1e-3 && (degrees(1081, 1080) - 135.0).abs() < 1e-3);
        assert!((degrees(682, 340)).abs() < 1e-3 && (degrees(682, 681) - 119.88).abs() < 0.01);
        assert!((degrees(1, 0) + 90.0).abs() < 1e-3);
    }
}
