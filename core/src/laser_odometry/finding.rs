//! Where a scan fits: near where the robot is expected, or, if not, farther away.
//!
//! What a scan is held against is the usual score per point of the last ones. The wider search is believed if it is clearly better, and the more
//! has to fit the less is known: rooms look alike from another side, and halls from their other end.

use super::LaserOdometry;
use super::course::Forecast;
use super::reference::Taken;
#[cfg(feature = "witnesses")]
use super::through;
use crate::geometry::{Point2, Pose2};
use crate::matcher::{Match, MatcherConfig, Prediction, PriorSpread, RecoveryConfig};
use crate::math::hypot;

/// A place found by a wider search is believed if its score per point is at least this share of the usual one, and a place on new ground if that of the
/// known part is: chosen …
const FOUND_SHARE: f32 = 0.6;
/// … and its score is so many times that of the place where the robot was expected.
const FOUND_BETTER: f32 = 1.2;
/// The wider search's prior is so many times as wide as the usual one: 0.5 m and 35° at five scans a second. Without it places far away are found that
/// look alike: along corridors, and where a robot has turned so far that it sees little of what it saw before. Chosen.
const FOUND_SPREAD: f32 = 3.5;
/// Where the robot may be anywhere, a place is believed if its score per point is at least this share of the usual one: chosen, as different
/// rooms reach two thirds.
const RETURN_SHARE: f32 = 0.8;
/// So is one where the robot has turned by more than this against what was expected, rad, farther where scans are slow. Chosen: robots that turn
/// faster at five scans a second are rare, and rooms look alike from another side.
const TURN_MAX_RAD: f32 = 0.8;

/// A scan that fits best where the robot is expected, of all places of the wider search, is believed if its score per point is at least this share of the
/// usual one: out of doors and in halls one scan sees much less of the reference than the one before. Chosen; a robot that is put down elsewhere
/// hardly ever reaches it there.
const EXPECTED_SHARE: f32 = 0.3;
/// That is for scans so far apart that the box is so many times as large, half a second: who is not believed then has gone on by the next one. With scans
/// close together that one is waited for. Chosen.
const FAR_SPREAD: f32 = 1.4;
/// With slow scans witnesses, and the wider search, are asked about a place that a scan fits by less than this share of the usual score. Chosen: different
/// rooms reach so much.
const REFUTED_SHARE: f32 = 2.0 / 3.0;
/// A scan that fits elsewhere than expected has to reach so much more of the usual score for each deviation of the forecast, up to [`RETURN_SHARE`]
/// where nobody else finds a robot that may be anywhere; who does finds one that has leapt, too. Chosen. Robots that drive move farther and fit well, or
/// fit badly and move as expected; who fits badly elsewhere has been carried off. Only with scans nearer to each other than [`FAR_SPREAD`] says: slower
/// ones see so much that is new that they do both.
const ELSEWHERE_SHARE: f32 = 0.1;
/// So does one that looks through walls that stood a moment ago, by so many times the share of them that it looks through: people stand before walls, and
/// nobody takes them away. The less, the nearer to where it was expected it is, within a deviation: a door that is opened before the robot leaves all else
/// as it was. Chosen.
const THROUGH_SHARE: f32 = 1.5;
/// A turn counts this much of its deviations in what is expected, and in what departs from it: robots turn at once, but do not leap. Chosen.
const TURN_WEIGHT: f32 = 0.5;
/// A place so many deviations of the forecast away was not reached by driving, but by a push or a wrong match. Chosen: with scans 0.2 s apart no robot
/// is faster by 2 m/s than the last one said.
const LEAP: f32 = 3.0;
/// Standard error of a share of the usual score, of a single point: the most that one between 0 and 1 can have.
const SHARE_ERROR: f32 = 0.5;
/// Two searches have found the same place if these are nearer than this, m …
const SAME_M: f32 = 0.15;
/// … and this, rad. Both chosen.
const SAME_RAD: f32 = 0.07;

/// Where the current scan was found.
pub(super) struct Found {
    pub(super) matched: Match,
    /// False if it agrees too little with the reference to be believed.
    pub(super) fits: bool,
    /// True if it is so far from where the scan was expected that the robot has not driven there: that is no speed.
    pub(super) leaps: bool,
}

impl LaserOdometry<'_> {
    /// Somebody else finds a robot that may be anywhere, by more than one scan: after 5 s without sight none alone says that it
    /// is elsewhere. Without that the wider search is believed then, too.
    pub fn leave_returns(&mut self) {
        self.is_told = true;
    }

    /// Matches the current points, with a wider search if the robot is not where it was expected.
    ///
    /// * `expected` — the scan, at the place where the robot is expected
    pub(super) fn find(&mut self, expected: &Taken, (points, hits): (usize, usize), forecast: &Forecast) -> Found {
        let walking = self.part_walking(expected, (points, hits));
        let (matched, fits) = self.find_points((points, walking), expected, forecast);
        let [position, heading] = self.departure(expected.map_from_robot.between(matched.map_from_robot), forecast);
        let is_soon = forecast.spread < FAR_SPREAD;
        let leaps = is_soon && position > LEAP;
        let taken = Taken { map_from_robot: matched.map_from_robot, ..*expected };
        let through = || self.looked_through(&taken, hits);
        let departure = hypot(position, TURN_WEIGHT * heading);
        let is_carried_off = fits && is_soon && self.is_carried_off(&matched, departure, points, through);
        let fits = fits && !is_carried_off;
        self.doubts |= is_carried_off;
        let is_refuted = || self.is_refuted(&matched, expected.map_from_robot, points, forecast);
        let is_elsewhere = !fits && self.is_told && ((is_carried_off && leaps) || is_refuted());
        self.is_held = !fits && (self.is_held || is_elsewhere);
        if walking > 0 {
            self.put_in_order(hits);
        }
        Found { matched, fits, leaps }
    }

    /// The match, and true if it fits.
    ///
    /// * `walking` — the last so many points are of what may walk
    fn find_points(
        &mut self,
        (count, walking): (usize, usize),
        expected: &Taken,
        forecast: &Forecast,
    ) -> (Match, bool) {
        let predicted = expected.map_from_robot;
        let prediction = Prediction {
            map_from_robot: predicted,
            score_expected: self.score_per_point * count as f32,
            spread: forecast.spread,
            prior: forecast.prior,
            walking,
        };
        let points = self.points.get(..count).unwrap_or_default();
        let matched = self.matcher.align(&self.ndt, points, &prediction, &mut self.rng);
        let fits = self.fits(&matched, expected.eye, count) && !self.is_refuted(&matched, predicted, count, forecast);
        // Between slow scans a robot may have gone farther than the usual box reaches, and what is left of two rooms fits half in it.
        let is_usual = !self.is_slow() || matched.score_per_point >= REFUTED_SHARE * self.score_per_point;
        // What is left beside somebody who stands against the laser fits in too many places.
        if (fits && is_usual) || (self.doubts && self.is_told) || self.sight.is_half_covered {
            return (matched, fits);
        }
        self.find_wider(&matched, fits, expected, (count, &prediction), forecast)
    }

    /// Where a scan fits that does so badly at `matched`, or less well than usual.
    fn find_wider(
        &mut self,
        matched: &Match,
        fits: bool,
        expected: &Taken,
        (count, prediction): (usize, &Prediction),
        forecast: &Forecast,
    ) -> (Match, bool) {
        let predicted = expected.map_from_robot;
        let wider = FOUND_SPREAD * forecast.spread;
        let prediction = Prediction { prior: PriorSpread { position: wider, heading: wider }, ..*prediction };
        let points = self.points.get(..count).unwrap_or_default();
        let wide = self.matcher.align_anywhere(&self.ndt, points, &prediction, &self.config.recovery, &mut self.rng);
        let turned = predicted.between(wide.map_from_robot).heading.abs();
        let share = if turned > forecast.spread * TURN_MAX_RAD { RETURN_SHARE } else { FOUND_SHARE };
        let is_found = wide.score_per_point >= share * self.score_per_point;
        let is_better = wide.score > FOUND_BETTER * matched.score;
        if is_found && is_better {
            let fits = self.fits(&wide, expected.eye, count) && !self.is_refuted(&wide, predicted, count, forecast);
            return (wide, fits || self.is_confirmed(&wide, predicted, count, forecast));
        }
        if fits {
            return (*matched, true);
        }
        let is_same = is_same(matched, &wide);
        let best = if is_better { &wide } else { matched };
        if (is_better || is_same) && self.is_confirmed(best, predicted, count, forecast) {
            return (*best, true);
        }
        let fits = forecast.spread >= FAR_SPREAD
            && self.is_where_expected(predicted.between(matched.map_from_robot), forecast)
            && is_same
            && matched.score_per_point >= EXPECTED_SHARE * self.score_per_point;
        (*matched, fits)
    }

    /// True if scans are slow, and the robot cannot have driven to where one fits, or it fits there less well than usual and witnesses contradict it.
    fn is_refuted(&self, matched: &Match, predicted: Pose2, count: usize, forecast: &Forecast) -> bool {
        // Without a share nothing is lost.
        if !self.is_slow() || self.config.recovery.lost_share <= 0.0 {
            return false;
        }
        let is_usual = matched.score_per_point >= REFUTED_SHARE * self.score_per_point;
        self.is_too_far(matched, predicted, forecast)
            || (!is_usual && self.agreement(matched.map_from_robot, count).refutes())
    }

    /// True if scans are slow, and one is where witnesses say that it is, and the robot can have driven there.
    fn is_confirmed(&self, matched: &Match, predicted: Pose2, count: usize, forecast: &Forecast) -> bool {
        // Who may be anywhere may be where it looks alike.
        let is_asked = self.is_slow() && !self.doubts;
        is_asked
            && !self.is_too_far(matched, predicted, forecast)
            && self.agreement(matched.map_from_robot, count).confirms()
    }

    /// True if no robot drives from where it was expected to where a scan fits, between slow scans: a speed changes as [`LEAP`] says, in proportion to the
    /// time, and deviations grow as its root.
    fn is_too_far(&self, matched: &Match, predicted: Pose2, forecast: &Forecast) -> bool {
        let [position, heading] = self.departure(predicted.between(matched.map_from_robot), forecast);
        hypot(position, heading) > LEAP * forecast.spread
    }

    /// True if a step from where the robot is expected is no farther than it usually is off, and that place is known.
    fn is_where_expected(&self, off: Pose2, forecast: &Forecast) -> bool {
        let [position, heading] = self.deviations(off, &forecast.prior);
        // After a lost scan, or a while without sight, nobody knows.
        let is_told = forecast.is_told || !self.is_slow();
        self.lost_scans == 0 && !self.doubts && is_told && hypot(position, TURN_WEIGHT * heading) <= 1.0
    }

    /// True if a scan that fits does so too badly for departing so far from what was expected, or for the walls it looks through: from there on the
    /// robot may be anywhere.
    ///
    /// * `through` — share of the walls that it looks through
    fn is_carried_off(&self, matched: &Match, departure: f32, points: usize, through: impl FnOnce() -> f32) -> bool {
        let RecoveryConfig { lost_share, .. } = self.config.recovery;
        let share = matched.score_per_point / self.score_per_point;
        // What fits by less is on new ground.
        if lost_share <= 0.0 || share < lost_share || (self.doubts && !self.is_held) {
            return false;
        }
        let share = share + SHARE_ERROR / libm::sqrtf(points as f32);
        let far = lost_share + ELSEWHERE_SHARE * if departure > 1.0 { departure } else { 0.0 };
        // Who has seen nothing, or been lost, may have driven meanwhile.
        let was_there = self.is_held || self.fitted_at == self.last_stamp;
        let wanted = if self.is_told && was_there { far } else { far.min(RETURN_SHARE) };
        share < wanted || (share < RETURN_SHARE && share < far + THROUGH_SHARE * departure.min(1.0) * through())
    }

    /// Share of the walls of the last few metres that the current scan looks through, 0 to 1.
    #[cfg(feature = "witnesses")]
    fn looked_through(&self, taken: &Taken, hits: usize) -> f32 {
        let hits = self.hits.get(..hits).unwrap_or_default();
        through::looked_through(hits, taken, self.key_scans, self.key_points)
    }

    /// Without witnesses nobody can tell.
    #[cfg(not(feature = "witnesses"))]
    fn looked_through(&self, _: &Taken, _: usize) -> f32 {
        0.0
    }

    /// How far a step from where the robot is expected goes and turns, in deviations of a forecast without odometry. 0 where the matcher has no
    /// prior: nobody says what is far then.
    fn departure(&self, off: Pose2, forecast: &Forecast) -> [f32; 2] {
        let usual = PriorSpread { position: forecast.spread, heading: forecast.spread };
        self.deviations(off, &usual).map(|deviations| if deviations.is_finite() { deviations } else { 0.0 })
    }

    /// A step in deviations of `prior`: how far it goes, and how far it turns; not finite without a prior.
    fn deviations(&self, off: Pose2, prior: &PriorSpread) -> [f32; 2] {
        let MatcherConfig { prior_position_m, prior_heading_deg, .. } = self.config.matcher;
        let position = off.position().norm() / (prior.position * prior_position_m);
        [position, off.heading.abs() / (prior.heading * prior_heading_deg.to_radians())]
    }

    /// True if the first `count` points fit where they are matched: as well as usual about, or what is known of does, and the rest is new.
    fn fits(&self, matched: &Match, eye: Point2, count: usize) -> bool {
        // Who may be anywhere may not be on new ground.
        matched.score_per_point >= self.lost_below() || (!self.doubts && self.is_on_new_ground(matched, eye, count))
    }

    #[cfg(feature = "witnesses")]
    fn is_on_new_ground(&self, matched: &Match, eye: Point2, count: usize) -> bool {
        // The next one after a lost one is expected where nobody knows.
        let share = if self.lost_scans == 0 { FOUND_SHARE } else { RETURN_SHARE };
        self.fits_known_ground(matched, eye, count, share)
    }

    /// Without witnesses nobody can tell.
    #[cfg(not(feature = "witnesses"))]
    fn is_on_new_ground(&self, _: &Match, _: Point2, _: usize) -> bool {
        false
    }

    /// Score per point below which a scan is lost: after a while without sight the robot may be anywhere, and half a fit is none.
    fn lost_below(&self) -> f32 {
        let RecoveryConfig { lost_share, .. } = self.config.recovery;
        let share = if self.doubts && lost_share > 0.0 { lost_share.max(RETURN_SHARE) } else { lost_share };
        share * self.score_per_point
    }
}

fn is_same(a: &Match, b: &Match) -> bool {
    let apart = a.map_from_robot.between(b.map_from_robot);
    apart.position().norm() <= SAME_M && apart.heading.abs() <= SAME_RAD
}

#[cfg(test)]
mod tests;
