//! The robot's course: its step from scan to scan, and which prediction of the next one has agreed best with the matches so far.
//!
//! The last step again, or the robot's odometry: what was nearer to the matches so far predicts, position and heading each for
//! themselves. So odometry that is good helps, and what is frozen, flipped, slipping or of another clock is left out.

use super::expectation::INTERVAL_S;
use super::open_axis::OpenAxis;
use crate::geometry::Pose2;
use crate::matcher::{Match, PriorSpread};
use crate::scan::RangeScan;

/// Predictions are remembered for about so many matches. Chosen.
const MEMORY: f32 = 50.0;
/// The first of them count as if there had been so many before. Chosen.
const FIRST_COUNT: f32 = 4.0;
/// Before, predictions are taken to be off by this, m …
const FIRST_M: f32 = 0.02;
/// … and rad. Chosen.
const FIRST_RAD: f32 = 0.02;
/// A prediction that is wrong by more than this says no more, m …
const ERROR_MAX_M: f32 = 1.0;
/// … and rad.
const ERROR_MAX_RAD: f32 = 0.5;
/// Predictions are judged by matches with at least this constraint. Chosen.
const JUDGED_FROM: f32 = 0.1;
/// The prior is so many times as wide as odometry has been off …
const CAUTION: f32 = 3.0;
/// … and at least this share of the configured one. Chosen.
const PRIOR_MIN: f32 = 0.2;
/// After a step that turns more than this, rad, the robot is expected to stand …
const STEADY_RAD: f32 = 0.5;
/// … or, if scans come so far apart in the mean, s, to go straight on: who drives turns so much from one to the next in every bend, and only a wrong
/// match, or one after a gap, does so with others. Chosen.
pub(super) const SLOW_S: f32 = 0.5;
/// A robot that sees nothing loses its speed in about so long, s: who walks past a laser covers it for less. Chosen.
const COAST_S: f32 = 2.0;

/// How far predictions have been off, mean squares: m², rad².
#[derive(Debug, Clone, Copy)]
struct Errors {
    position: f32,
    heading: f32,
}

impl Errors {
    const FIRST: Self = Self { position: FIRST_M * FIRST_M, heading: FIRST_RAD * FIRST_RAD };

    fn learn(&mut self, predicted: Pose2, matched: Pose2, share: f32) {
        let off = predicted.between(matched);
        let (position, heading) = (off.position().norm().min(ERROR_MAX_M), off.heading.abs().min(ERROR_MAX_RAD));
        self.position += share * (position * position - self.position);
        self.heading += share * (heading * heading - self.heading);
    }
}

/// What the last step says of the next one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Says {
    /// The robot goes on so.
    Much,
    /// It has turned so far that it may do so or not.
    Little,
    /// It may go at any speed.
    Nothing,
}

/// What is expected of the next step.
#[derive(Debug, Clone, Copy)]
pub(super) struct Forecast {
    /// In the robot's frame.
    pub(super) step: Pose2,
    /// So many times as far as usual the robot may depart from it.
    pub(super) spread: f32,
    /// How wide the prior is.
    pub(super) prior: PriorSpread,
    /// False if nobody says how fast the robot goes: then it is expected to stand, for want of anything better.
    pub(super) is_told: bool,
    /// The same step again, perhaps stretched.
    steady: Pose2,
    odometry: Option<Pose2>,
}

/// See the [module](self).
#[derive(Debug, Clone, Copy)]
pub(super) struct Course {
    /// The last step, in the frame of the robot before it.
    step: Pose2,
    says: Says,
    steady: Errors,
    odometry: Errors,
    /// Matches learned from, up to [`MEMORY`].
    learned: f32,
    open_axis: OpenAxis,
}

impl Default for Course {
    fn default() -> Self {
        Self {
            step: Pose2::IDENTITY,
            says: Says::Nothing,
            steady: Errors::FIRST,
            odometry: Errors::FIRST,
            learned: FIRST_COUNT,
            open_axis: OpenAxis::default(),
        }
    }
}

impl Course {
    /// The last step.
    pub(super) fn step(&self) -> Pose2 {
        self.step
    }

    /// Takes the scan that is to be matched next.
    ///
    /// * `interval_s` — from scan to scan in the mean
    pub(super) fn look(&mut self, scan: &RangeScan<'_>, interval_s: f32) {
        self.open_axis.look(scan, interval_s);
    }

    /// Nothing is known of the motion any more.
    pub(super) fn rest(&mut self) {
        self.step = Pose2::IDENTITY;
        self.says = Says::Nothing;
        self.open_axis.rest();
    }

    /// The next step of a robot that sees nothing: it goes on as it went, ever slower.
    ///
    /// * `interval_s` — from scan to scan in the mean
    pub(super) fn coast(&mut self, interval_s: f32) -> Pose2 {
        let left = (1.0 - interval_s / COAST_S).max(0.0);
        let Pose2 { x, y, heading } = self.step;
        self.step = Pose2 { x: left * x, y: left * y, heading: left * heading };
        self.open_axis.rest();
        self.step
    }

    /// `odometry`, if it has agreed better with the matches so far than steady motion: where scans say nothing, the robot goes on by it.
    pub(super) fn trusted(&self, odometry: Option<Pose2>) -> Option<Pose2> {
        odometry
            .filter(|_| self.odometry.position <= self.steady.position && self.odometry.heading <= self.steady.heading)
    }

    /// What to expect.
    ///
    /// * `steady` — the last step again, perhaps stretched; along an open axis what [`OpenAxis`] says takes its place
    /// * `odometry` — displacement since the last scan, if there is any
    /// * `spread` — so many times as far as usual the robot may depart from a steady motion
    /// * `interval_s` — from scan to scan in the mean
    /// * `prior_m`, `prior_rad` — how far that is usually; 0: no prior
    pub(super) fn forecast(
        &self,
        steady: Pose2,
        odometry: Option<Pose2>,
        (spread, interval_s): (f32, f32),
        (prior_m, prior_rad): (f32, f32),
    ) -> Forecast {
        let steady = self.open_axis.expected(steady, self.step);
        let mut step = steady;
        // A speed that changes takes the robot as far away as the root of the time; one that nobody knows, as the time. Between close scans that is
        // no more than a prior allows.
        let is_guess = self.says != Says::Much && interval_s >= SLOW_S;
        let usual = if is_guess { spread.max(interval_s / INTERVAL_S) } else { spread };
        let mut prior = PriorSpread { position: usual, heading: usual };
        if let Some(told) = odometry {
            let width = |square: f32, usual: f32| {
                (CAUTION * libm::sqrtf(square) / usual.max(f32::MIN_POSITIVE)).clamp(PRIOR_MIN, spread)
            };
            if self.odometry.position <= self.steady.position {
                step = Pose2 { heading: step.heading, ..told };
                prior.position = width(self.odometry.position, prior_m);
            }
            if self.odometry.heading <= self.steady.heading {
                step.heading = told.heading;
                prior.heading = width(self.odometry.heading, prior_rad);
            }
        }
        let is_told = self.says != Says::Nothing || self.trusted(odometry).is_some();
        Forecast { step, spread, prior, is_told, steady, odometry }
    }

    /// The robot has gone on by `step`, as `matched` says.
    ///
    /// * `interval_s` — from scan to scan in the mean
    pub(super) fn advance(&mut self, forecast: &Forecast, step: Pose2, matched: &Match, interval_s: f32) {
        self.judge(forecast, step, matched);
        let driven = self.open_axis.driven(step, forecast.step);
        self.open_axis.advance(step, matched);
        if step.heading.abs() <= STEADY_RAD {
            (self.step, self.says) = (driven, Says::Much);
            return;
        }
        self.rest();
        if interval_s >= SLOW_S {
            let step = Pose2::new(libm::copysignf(driven.position().norm(), driven.x), 0.0, 0.0);
            (self.step, self.says) = (step, Says::Little);
        }
    }

    /// The robot is `step` on, as `matched` says, but has not driven there: who forecast otherwise was wrong, and no speed is known.
    pub(super) fn leap(&mut self, forecast: &Forecast, step: Pose2, matched: &Match) {
        self.judge(forecast, step, matched);
        self.rest();
    }

    /// Learns how far steady motion and odometry were off.
    fn judge(&mut self, forecast: &Forecast, step: Pose2, matched: &Match) {
        if matched.constraint >= JUDGED_FROM {
            self.learned = (self.learned + 1.0).min(MEMORY);
            let share = 1.0 / self.learned;
            self.steady.learn(forecast.steady, step, share);
            if let Some(odometry) = forecast.odometry {
                self.odometry.learn(odometry, step, share);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const USUAL: (f32, f32) = (0.15, 0.17);

    fn sharp() -> Match {
        Match { constraint: 0.4, ..Match::none(Pose2::IDENTITY) }
    }

    /// A robot that drives, stands and turns; what its odometry says of each step.
    fn told(says: impl Fn(usize, Pose2) -> Pose2) -> (Course, Forecast) {
        let mut course = Course::default();
        let mut forecast = course.forecast(Pose2::IDENTITY, None, (1.0, 0.2), USUAL);
        for k in 0..200 {
            let step = match k / 10 % 3 {
                0 => Pose2::new(0.1, 0.0, 0.0),
                1 => Pose2::IDENTITY,
                _ => Pose2::new(0.02, 0.0, 0.1),
            };
            forecast = course.forecast(course.step(), Some(says(k, step)), (1.0, 0.2), USUAL);
            course.advance(&forecast, step, &sharp(), 0.2);
        }
        (course, forecast)
    }

    #[test]
    fn who_sees_nothing_goes_on_ever_slower() {
        let mut course = Course { step: Pose2::new(0.1, 0.0, 0.02), ..Course::default() };
        let way: f32 = (0..5).map(|_| course.coast(0.2).x).sum();
        assert!((0.3..0.5).contains(&way), "{way} m in a second, half a metre at full speed");
        (0..100).for_each(|_| _ = course.coast(0.2));
        assert!(course.step().x < 1e-3);
        assert_eq!(course.coast(3.0), Pose2::IDENTITY, "slower scans than that: at once");
    }

    #[test]
    fn who_has_turned_far_is_expected_to_stand_and_between_slow_scans_to_go_straight_on() {
        let after = |step: Pose2, interval_s: f32| {
            let mut course = Course::default();
            // There was a gap, whatever the pace.
            let forecast = course.forecast(Pose2::IDENTITY, None, (2.0, interval_s), USUAL);
            course.advance(&forecast, Pose2::new(1.0, 0.0, 0.1), &sharp(), interval_s);
            course.advance(&forecast, step, &sharp(), interval_s);
            course.step()
        };
        let bend = Pose2::new(0.8, 0.3, 0.6);
        assert_eq!(after(bend, 0.2), Pose2::IDENTITY);
        let chord_m = 0.73_f32.sqrt();
        let on = after(bend, 1.0);
        assert!((on.x - chord_m).abs() < 1e-6 && (on.y, on.heading) == (0.0, 0.0), "{on:?}");
        assert!((after(Pose2::new(-0.8, 0.3, -0.6), 1.0).x + chord_m).abs() < 1e-6, "backwards");
        assert_eq!(after(Pose2::new(0.0, 0.0, 0.6), 1.0), Pose2::IDENTITY, "on the spot");
        assert_eq!(after(Pose2::new(0.8, 0.3, 0.4), 1.0), Pose2::new(0.8, 0.3, 0.4), "a bend like others");
    }

    #[test]
    fn between_slow_scans_the_prior_is_wider_as_long_as_nobody_knows_how_the_robot_goes_on() {
        let forecast = |steps: &[Pose2], interval_s: f32| {
            let mut course = Course::default();
            let next = |course: &Course| course.forecast(course.step(), None, (2.0, interval_s), USUAL);
            for step in steps {
                let expected = next(&course);
                course.advance(&expected, *step, &sharp(), interval_s);
            }
            let Forecast { prior, is_told, .. } = next(&course);
            (prior.position, prior.heading, is_told)
        };
        let (straight, bend) = (Pose2::new(1.0, 0.0, 0.1), Pose2::new(0.8, 0.3, 0.6));
        assert_eq!(forecast(&[], 1.0), (4.0, 4.0, false), "under way or not");
        assert_eq!(forecast(&[straight], 1.0), (2.0, 2.0, true));
        assert_eq!(forecast(&[straight, bend], 1.0), (4.0, 4.0, true), "it may turn on or not");
        assert_eq!(forecast(&[], 0.4), (2.0, 2.0, false), "scans close together, and a gap");
    }

    #[test]
    fn good_odometry_predicts_and_narrows_the_prior() {
        let (course, forecast) = told(|_, step| Pose2::new(1.03 * step.x, step.y, 0.97 * step.heading));
        assert!(course.trusted(Some(Pose2::IDENTITY)).is_some());
        assert!(forecast.prior.position < 0.5 && forecast.prior.heading < 0.5, "{:?}", forecast.prior);
    }

    #[test]
    fn frozen_flipped_late_and_wild_odometry_is_left_out() {
        let wild = |k: usize, step: Pose2| {
            Pose2::new(step.x + if k.is_multiple_of(5) { 0.5 } else { 0.0 }, step.y, step.heading)
        };
        let says: [&dyn Fn(usize, Pose2) -> Pose2; 3] =
            [&|_, _| Pose2::IDENTITY, &|_, step| Pose2::new(-step.x, step.y, -step.heading), &wild];
        for (index, says) in says.iter().enumerate() {
            let (course, forecast) = told(says);
            assert!(course.trusted(Some(Pose2::IDENTITY)).is_none(), "case {index}");
            assert!((forecast.prior.position - 1.0).abs() < 1e-6, "the prior is as wide as without: case {index}");
        }
    }

    #[test]
    fn odometry_that_was_wrong_about_a_leap_is_trusted_less() {
        let (mut course, _) = told(|_, step| step);
        let wrong = Some(Pose2::new(-0.25, 0.0, 0.0));
        assert!(course.trusted(wrong).is_some());
        for _ in 0..20 {
            let forecast = course.forecast(course.step(), wrong, (1.0, 0.2), USUAL);
            course.leap(&forecast, Pose2::new(0.25, 0.0, 0.0), &sharp());
        }
        assert!(course.trusted(wrong).is_none() && course.step() == Pose2::IDENTITY);
    }
}
