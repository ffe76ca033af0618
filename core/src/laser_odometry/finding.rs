//! Where a scan fits: near where the robot is expected, or, if not, farther away.
//!
//! What a scan is held against is the usual score per point of the last ones. The wider search is believed if it is clearly better, and the more
//! has to fit the less is known: rooms look alike from another side, and halls from their other end.

use super::LaserOdometry;
use super::course::Forecast;
use super::reference::Taken;
use crate::geometry::Pose2;
use crate::matcher::{Match, Prediction, RecoveryConfig};

/// A place found by a wider search is believed if its score per point is at least this share of the usual one: chosen …
const FOUND_SHARE: f32 = 0.6;
/// … and its score is so many times that of the place where the robot was expected.
const FOUND_BETTER: f32 = 1.2;
/// Where the robot may be anywhere, a place is believed if its score per point is at least this share of the usual one: chosen, as different
/// rooms reach two thirds.
const RETURN_SHARE: f32 = 0.8;
/// So is one where the robot has turned by more than this against what was expected, rad, farther where scans are slow. Chosen: robots that turn
/// faster at five scans a second are rare, and rooms look alike from another side.
const TURN_MAX_RAD: f32 = 0.8;

impl LaserOdometry<'_> {
    /// Somebody else finds a robot that may be anywhere, by more than one scan: after 5 s without sight none alone says that it
    /// is elsewhere. Without that the wider search is believed then, too.
    pub fn leave_returns(&mut self) {
        self.is_told = true;
    }

    /// Matches the current points, with a wider search if the robot is not where it was expected.
    ///
    /// * `expected` — the scan, at the place where the robot is expected
    pub(super) fn find(&mut self, expected: &Taken, (points, hits): (usize, usize), forecast: &Forecast) -> Match {
        let walking = self.part_walking(expected, (points, hits));
        let matched = self.find_points((points, walking), expected.map_from_robot, forecast);
        if walking > 0 {
            self.put_in_order(hits);
        }
        matched
    }

    /// * `walking` — the last so many points are of what may walk
    fn find_points(&mut self, (count, walking): (usize, usize), predicted: Pose2, forecast: &Forecast) -> Match {
        let score_expected = self.score_per_point * count as f32;
        let prediction = &Prediction {
            map_from_robot: predicted,
            score_expected,
            spread: forecast.spread,
            prior: forecast.prior,
            walking,
        };
        let points = self.points.get(..count).unwrap_or_default();
        let matched = self.matcher.align(&self.ndt, points, prediction, &mut self.rng);
        let is_fit = matched.score_per_point >= self.lost_below();
        // What is left beside somebody who stands against the laser fits in too many places.
        if is_fit || (self.doubts && self.is_told) || self.sight.is_half_covered {
            return matched;
        }
        let wide = self.matcher.align_anywhere(&self.ndt, points, prediction, &self.config.recovery, &mut self.rng);
        let turned = predicted.between(wide.map_from_robot).heading.abs();
        let share = if turned > forecast.spread * TURN_MAX_RAD { RETURN_SHARE } else { FOUND_SHARE };
        let is_found = wide.score_per_point >= share * self.score_per_point;
        if is_found && wide.score > FOUND_BETTER * matched.score { wide } else { matched }
    }

    /// Score per point below which a scan is lost: after a while without sight the robot may be anywhere, and half a fit is none.
    pub(super) fn lost_below(&self) -> f32 {
        let RecoveryConfig { lost_share, .. } = self.config.recovery;
        let share = if self.doubts && lost_share > 0.0 { lost_share.max(RETURN_SHARE) } else { lost_share };
        share * self.score_per_point
    }
}
