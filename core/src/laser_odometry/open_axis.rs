//! What is expected of the robot along an axis that the scene says little about, as in a bare corridor.
//!
//! The last step again would be what is left of an error: who set off or stopped where nothing told would stand, or go on, until the corridor
//! ends. So the speed goes towards that at which the robot usually drives, while it goes straight on and what it sees changes, or while
//! [`Pace`] says that it goes on evenly. If nothing changes, where something does whenever the robot drives, or if the robot keeps its heading too, and
//! else wavers, it stands.

use super::change::Change;
use super::course::SLOW_S;
use super::pace::{Pace, STRAIGHT_RAD};
use crate::geometry::{Point2, Pose2};
use crate::matcher::Match;
use crate::scan::RangeScan;

/// The scene says little about an axis if the constraint is less than this. Chosen, as all that follow.
const OPEN_BELOW: f32 = 0.05;
/// The robot's usual speed is learned from matches that count at least so much along their weakest axis.
const GAIN_MIN: f32 = 0.3;
/// A robot goes backwards if a step is longer than this, m.
const BACKWARDS_M: f32 = 0.02;
/// The usual speed until the robot has driven, m/s: a walk.
const WALK_MPS: f32 = 0.3;
/// Share of the way from the last step to the usual one that is gone in a step.
const TOWARDS_USUAL: f32 = 0.2;
/// Cosine of the angle to the robot's heading below which it drives along an axis …
const ALONG: f32 = 0.85;
/// … and above which it would go sideways, …
const ACROSS: f32 = 0.5;
/// … which robots hardly do: share of the last step that is left.
const SIDEWAYS_LEFT: f32 = 0.7;
/// The same of who stands, as its view says: it has been compared with one of a second ago.
const STANDING_LEFT: f32 = 0.3;

/// Of what puts the robot right on the axis, no more than this is how it has driven since the last scan, m: 0.75 m/s more at five scans a second.
const CORRECTED_MAX_M: f32 = 0.15;

/// See the [module](self).
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct OpenAxis {
    /// Unit vector, robot frame, that points ahead.
    axis: Option<Point2>,
    change: Change,
    pace: Pace,
    /// From scan to scan in the mean.
    interval_s: f32,
}

impl OpenAxis {
    /// Takes the scan that is to be matched next.
    ///
    /// * `interval_s` — from scan to scan in the mean
    pub(super) fn look(&mut self, scan: &RangeScan<'_>, interval_s: f32) {
        self.interval_s = interval_s;
        self.change.look(scan);
    }

    /// Nothing is known of the motion any more.
    pub(super) fn rest(&mut self) {
        self.axis = None;
        self.pace.rest();
    }

    /// `step` with what is to be expected along the open axis, if there is one, after the step `last`.
    pub(super) fn expected(&self, step: Pose2, last: Pose2) -> Pose2 {
        let Some(axis) = self.axis else { return step };
        let along = |step: Pose2| axis.x * step.x + axis.y * step.y;
        let before = along(last);
        let moves = self.change.says_that_it_moves() || self.pace.even_step_m().is_some();
        let is_driving = step.heading.abs() < STRAIGHT_RAD && moves;
        let expected = if axis.x > ALONG && is_driving {
            // Who goes backwards by a wrong match does not go on so.
            let usual = if before < -BACKWARDS_M { 0.0 } else { self.usual_m(before) };
            before + TOWARDS_USUAL * (usual - before)
        } else if self.stands() {
            STANDING_LEFT * before
        } else if axis.x < ACROSS {
            SIDEWAYS_LEFT * before
        } else {
            before
        };
        let more = expected - along(step);
        Pose2 { x: step.x + more * axis.x, y: step.y + more * axis.y, ..step }
    }

    /// True if what the robot sees is as it was a second ago, and that tells. With fast scans it does not tell alone: it is asked often, and bare
    /// walls may be alike for longer than from one slow scan to the next.
    fn stands(&self) -> bool {
        let is_told =
            if self.interval_s >= SLOW_S { self.pace.view_tells() } else { self.pace.keeps_heading_as_who_stands() };
        is_told && self.change.says_that_it_stands()
    }

    /// The usual step; as long as it is not known, that of a walk. Who is hardly known, and faster, goes on so.
    fn usual_m(&self, before: f32) -> f32 {
        let known = self.pace.even_step_m().or_else(|| self.pace.step_m());
        let usual = known.unwrap_or(WALK_MPS * self.interval_s);
        if self.pace.is_new() { usual.max(before) } else { usual }
    }

    /// How the robot has driven, if it was expected to go on by `forecast` and is `step` away now: what tells the place on an axis at last may say
    /// that it was wrong long ago, and nobody has driven all that since the last scan.
    pub(super) fn driven(&self, step: Pose2, forecast: Pose2) -> Pose2 {
        let Some(axis) = self.axis else { return step };
        let corrected = axis.x * (step.x - forecast.x) + axis.y * (step.y - forecast.y);
        let back = corrected.clamp(-CORRECTED_MAX_M, CORRECTED_MAX_M) - corrected;
        Pose2 { x: step.x + back * axis.x, y: step.y + back * axis.y, ..step }
    }

    /// The robot has gone on by `step`, as `matched` says.
    pub(super) fn advance(&mut self, step: Pose2, matched: &Match) {
        self.pace.advance(step, matched.gain >= GAIN_MIN, self.change.says_that_it_moves(), self.interval_s);
        self.axis = (matched.constraint < OPEN_BELOW).then(|| {
            let turned = Pose2::new(0.0, 0.0, -matched.map_from_robot.heading);
            let axis = turned.transform(matched.weakest_axis);
            if axis.x < 0.0 { axis * -1.0 } else { axis }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scan::{Beam, Echo};
    use crate::time::{Duration, Instant};

    const AHEAD: Point2 = Point2::new(1.0, 0.0);

    /// A robot that has driven 0.1 m a scan where the scene told, and is where it says little about `axis` now; `changes` if its view does.
    fn after_a_drive(axis: Point2, changes: bool) -> OpenAxis {
        let mut open = OpenAxis::default();
        let matched = |constraint, gain| Match { constraint, gain, weakest_axis: axis, ..Match::none(Pose2::IDENTITY) };
        for scan in 0..20 {
            look(&mut open, scan, 0.2, 2.0 + if changes { 0.1 * (scan % 2) as f32 } else { 0.0 });
        }
        (0..60).for_each(|_| open.advance(Pose2::new(0.1, 0.0, 0.0), &matched(0.3, 1.0)));
        open.advance(Pose2::IDENTITY, &matched(0.01, 0.0));
        open
    }

    fn look(open: &mut OpenAxis, scan: i64, interval_s: f32, range_m: f32) {
        let beams = [Beam { bearing_rad: 0.0, offset: Duration::ZERO, echo: Echo::Hit(range_m) }; 32];
        let stamp = Instant::from_micros((f64::from(interval_s) * 1e6) as i64 * scan);
        open.look(&RangeScan { stamp, range_max_m: 8.0, beams: &beams }, interval_s);
    }

    fn drives(open: &OpenAxis, mut step: Pose2, scans: usize) -> Pose2 {
        (0..scans).for_each(|_| step = open.expected(step, step));
        step
    }

    #[test]
    fn who_sets_off_in_a_corridor_goes_as_usual() {
        let step = drives(&after_a_drive(AHEAD, true), Pose2::IDENTITY, 30);
        assert!((step.x - 0.1).abs() < 0.002 && step.y == 0.0, "{step:?}");
        let step = drives(&after_a_drive(AHEAD * -1.0, true), Pose2::new(0.3, 0.01, 0.001), 30);
        assert!((step.x - 0.1).abs() < 0.002 && step.y == 0.01 && step.heading == 0.001, "{step:?}");
    }

    #[test]
    fn who_sees_nothing_change_or_turns_goes_on_as_before() {
        let slow = Pose2::new(0.03, 0.0, 0.0);
        assert_eq!(drives(&after_a_drive(AHEAD, false), slow, 30), slow);
        let turning = Pose2::new(0.0, 0.0, 0.1);
        assert_eq!(drives(&after_a_drive(AHEAD, true), turning, 30), turning);
    }

    /// Matches say nothing, so it would go on until one does.
    #[test]
    fn who_sees_nothing_change_where_driving_changes_it_stands() {
        for (interval_s, slow) in [(1.0, 10), (1.5, 10)] {
            let told = Match { constraint: 0.3, gain: 1.0, weakest_axis: AHEAD, ..Match::none(Pose2::IDENTITY) };
            let step = Pose2::new(0.5 * interval_s, 0.0, 0.0);
            let mut open = OpenAxis::default();
            for scan in 0..100 {
                look(&mut open, scan, interval_s, 2.0 + 0.1 * (scan % 2) as f32);
                open.advance(step, &told);
            }
            open.advance(step, &Match { constraint: 0.01, gain: 0.0, ..told });
            assert!(drives(&open, step, 5).x > 0.9 * step.x);
            (100..100 + slow).for_each(|scan| look(&mut open, scan, interval_s, 2.0));
            assert!(drives(&open, step, 5).x < 0.01 * step.x, "a scan each {interval_s} s");
        }
    }

    /// The same with five scans a second, where the view does not tell alone: of two robots that drive as fast one wavers, by a degree in a second.
    #[test]
    fn who_keeps_his_heading_with_fast_scans_stands_if_he_wavers_else() {
        for (waver_rad, stands) in [(0.02, true), (0.0, false)] {
            let told = Match { constraint: 0.3, gain: 1.0, weakest_axis: AHEAD, ..Match::none(Pose2::IDENTITY) };
            let untold = Match { constraint: 0.01, gain: 0.0, ..told };
            let step = Pose2::new(0.1, 0.0, 0.0);
            let mut open = OpenAxis::default();
            for scan in 0..100 {
                look(&mut open, scan, 0.2, 2.0 + 0.1 * (scan % 2) as f32);
                let turn = if scan / 5 % 2 == 0 { waver_rad } else { -waver_rad };
                open.advance(Pose2 { heading: 0.2 * turn, ..step }, &told);
            }
            for scan in 100..115 {
                look(&mut open, scan, 0.2, 2.0);
                open.advance(step, &untold);
            }
            assert_eq!(drives(&open, step, 5).x < 0.01 * step.x, stands, "it wavers by {waver_rad}");
        }
    }

    /// Half a metre a second with a view that never changes, then bare walls for ten seconds, where matches take off a third of it in a second.
    #[test]
    fn matches_between_bare_walls_do_not_bring_an_even_robot_to_a_stand() {
        for (hertz, off_mps) in [(5_u16, 0.15), (37, 0.05)] {
            let matched =
                |constraint, gain| Match { constraint, gain, weakest_axis: AHEAD, ..Match::none(Pose2::IDENTITY) };
            let interval_s = 1.0 / f32::from(hertz);
            let (mut open, mut step) = (OpenAxis::default(), Pose2::new(0.5 * interval_s, 0.0, 0.0));
            for scan in 0..30 * i64::from(hertz) {
                look(&mut open, scan, interval_s, 2.0);
                let is_told = scan < 20 * i64::from(hertz);
                let (constraint, gain) = if is_told { (0.3, 1.0) } else { (0.01, 0.0) };
                let forecast = open.expected(step, step);
                step.x = if is_told { forecast.x } else { (1.0 - 0.37 * interval_s) * forecast.x };
                step = open.driven(step, forecast);
                open.advance(step, &matched(constraint, gain));
            }
            let mps = step.x / interval_s;
            assert!(
                (mps - 0.5).abs() < off_mps,
                "{hertz} scans a second: {mps} m/s, 0.01 if the last step is all that is known"
            );
        }
    }

    #[test]
    fn who_has_never_driven_sets_off_at_a_walk() {
        let open = OpenAxis { pace: Pace::default(), ..after_a_drive(AHEAD, true) };
        let step = drives(&open, Pose2::IDENTITY, 30);
        assert!((step.x - 0.06).abs() < 0.002, "0.3 m/s, five scans a second: {step:?}");
        let fast = Pose2::new(0.2, 0.0, 0.0);
        assert_eq!(drives(&open, fast, 30), fast);
    }

    /// It has set off slowly where the scene told, then driven faster between bare walls.
    #[test]
    fn who_is_hardly_known_does_not_slow_down_to_what_is_known() {
        let mut open = OpenAxis { pace: Pace::default(), ..after_a_drive(AHEAD, true) };
        for (scans, usual_m) in [(10, 0.2), (60, 0.05)] {
            let told = Match { constraint: 0.3, gain: 1.0, weakest_axis: AHEAD, ..Match::none(Pose2::IDENTITY) };
            (0..scans).for_each(|_| open.advance(Pose2::new(0.05, 0.0, 0.0), &told));
            open.advance(Pose2::IDENTITY, &Match { constraint: 0.01, gain: 0.0, ..told });
            let step = drives(&open, Pose2::new(0.2, 0.0, 0.0), 30);
            assert!((step.x - usual_m).abs() < 0.002, "after {scans} scans: {step:?}");
        }
    }

    #[test]
    fn nobody_goes_on_sideways_or_backwards() {
        let step = drives(&after_a_drive(Point2::new(0.0, 1.0), true), Pose2::new(0.0, 0.2, 0.0), 20);
        assert!(step.y.abs() < 0.001, "{step:?}");
        let step = drives(&after_a_drive(AHEAD, true), Pose2::new(-0.2, 0.0, 0.0), 5);
        assert!(step.x > -0.1, "{step:?}");
    }

    #[test]
    fn who_is_put_right_on_the_axis_does_not_go_on_so() {
        let open = after_a_drive(AHEAD, true);
        let forecast = Pose2::new(0.1, 0.0, 0.0);
        let driven = |x| open.driven(Pose2::new(x, 0.02, 0.01), forecast);
        assert_eq!(driven(0.2), Pose2::new(0.2, 0.02, 0.01));
        assert!((driven(1.5).x - 0.25).abs() < 1e-6 && (driven(-1.5).x + 0.05).abs() < 1e-6);
        assert_eq!(
            OpenAxis::default().driven(Pose2::new(1.5, 0.0, 0.0), forecast).x,
            1.5,
            "where the scene tells, he did"
        );
    }

    #[test]
    fn where_the_scene_tells_the_last_step_stays() {
        let mut open = after_a_drive(AHEAD, true);
        let step = Pose2::new(0.02, 0.05, 0.0);
        open.advance(step, &Match { constraint: 0.2, gain: 1.0, ..Match::none(Pose2::IDENTITY) });
        assert_eq!(open.expected(step, step), step);
    }
}
