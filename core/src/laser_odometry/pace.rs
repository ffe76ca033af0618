//! The speed at which a robot usually drives straight on, learned where the scene tells how far it goes.
//!
//! Over 0.08 s at least. From one scan to the next of a fast laser a robot drives a centimetre, and a match is off by as much.
//!
//! Between bare walls each match is drawn a little to where the last one was, and the more scans there are, the more that adds up, until the
//! robot creeps. So one that has always driven at about one speed goes on at that, if its laser is fast; so does one that stops there.

use crate::geometry::Pose2;

/// A step takes so long at least, s; a laser is fast if its scans are closer together. Chosen, as all that follow.
const STEP_S: f32 = 0.08;
/// A robot drives if a step is longer than this, m, …
const DRIVES_M: f32 = 0.02;
/// … and turns by less than this, rad.
const STRAIGHT_RAD: f32 = 0.03;
/// Its pace is known from so many steps on, …
const KNOWN_FROM: f32 = 5.0;
/// … and is the mean of so many at most.
const LEARNED_MAX: f32 = 50.0;
/// How even it is, is told by what is gone in half a second, …
const HALF_SECOND_S: f32 = 0.5;
/// … from so many on.
const EVEN_FROM: f32 = 20.0;
/// It is even if it is off by less than this share of it.
const UNEVEN: f32 = 0.15;
/// Who goes more slowly than this for half a second stands, m/s.
const STANDS_MPS: f32 = 0.03;

/// What has been gone by some scans.
#[derive(Debug, Clone, Copy, Default)]
struct Stretch {
    gone: Pose2,
    scans: f32,
    /// The scene told all of it.
    is_told: bool,
}

impl Stretch {
    /// All of it, once it has taken so long; each scan, as long as nobody knows how far they are apart.
    fn advance(&mut self, step: Pose2, is_told: bool, interval_s: f32, long_s: f32) -> Option<Self> {
        self.is_told = is_told && (self.is_told || self.scans == 0.0);
        self.gone = self.gone * step;
        self.scans += 1.0;
        (interval_s <= 0.0 || self.scans * interval_s >= long_s).then(|| core::mem::take(self))
    }

    /// From scan to scan, m, of who drives straight on; `None` of others, or if the scene did not tell.
    fn step_m(&self) -> Option<f32> {
        let drives = self.gone.x > DRIVES_M && self.gone.heading.abs() < STRAIGHT_RAD;
        (self.is_told && drives).then_some(self.gone.x / self.scans)
    }
}

/// See the [module](self).
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Pace {
    step: Stretch,
    half_second: Stretch,
    /// From scan to scan, of who drives straight on, m.
    usual_m: f32,
    /// Learned from so many steps.
    steps: f32,
    /// The same as `usual_m`, of half seconds …
    even_m: f32,
    /// … and the mean square by which it is off, m².
    spread: f32,
    /// Learned from so many half seconds.
    half_seconds: f32,
    /// The robot drove when the scene last told.
    drove: bool,
}

impl Pace {
    /// Nothing is known of the motion any more.
    pub(super) fn rest(&mut self) {
        (self.step, self.half_second, self.drove) = (Stretch::default(), Stretch::default(), false);
    }

    /// The robot has gone on by `step`; `is_told`: the scene said how far.
    ///
    /// * `interval_s` — from scan to scan in the mean
    pub(super) fn advance(&mut self, step: Pose2, is_told: bool, interval_s: f32) {
        if let Some(step_m) = self.step.advance(step, is_told, interval_s, STEP_S).and_then(|gone| gone.step_m()) {
            self.steps = (self.steps + 1.0).min(LEARNED_MAX);
            self.usual_m += (step_m - self.usual_m) / self.steps;
        }
        if let Some(gone) = self.half_second.advance(step, is_told, interval_s, HALF_SECOND_S) {
            self.learn_how_even(&gone, interval_s);
        }
    }

    fn learn_how_even(&mut self, gone: &Stretch, interval_s: f32) {
        if let Some(step_m) = gone.step_m() {
            self.drove = true;
            self.half_seconds = (self.half_seconds + 1.0).min(LEARNED_MAX);
            self.even_m += (step_m - self.even_m) / self.half_seconds;
            let off_m = step_m - self.even_m;
            self.spread += (off_m * off_m - self.spread) / self.half_seconds;
        } else if gone.is_told && gone.gone.position().norm() < STANDS_MPS * interval_s * gone.scans {
            self.drove = false;
        }
    }

    /// From scan to scan, m; `None` as long as it is not known.
    pub(super) fn step_m(&self) -> Option<f32> {
        (self.steps >= KNOWN_FROM).then_some(self.usual_m)
    }

    /// The laser is fast; the robot has always driven at about one speed, and did so when the scene last told.
    ///
    /// * `interval_s` — from scan to scan in the mean
    pub(super) fn is_even(&self, interval_s: f32) -> bool {
        let uneven_m = UNEVEN * self.even_m;
        self.drove && interval_s < STEP_S && self.half_seconds >= EVEN_FROM && self.spread < uneven_m * uneven_m
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Twenty seconds at half a metre a second, now faster, now slower by the share `uneven`; the match of each scan is off by 4 mm.
    fn after_a_drive(hertz: f32, uneven: f32) -> Pace {
        let mut pace = Pace::default();
        for scan in 0..(20.0 * hertz) as usize {
            let faster = if (scan as f32 / hertz) % 4.0 < 2.0 { uneven } else { -uneven };
            let off_m = if scan % 2 == 0 { 0.004 } else { -0.004 };
            pace.advance(Pose2::new(0.5 * (1.0 + faster) / hertz + off_m, 0.0, 0.0), true, 1.0 / hertz);
        }
        pace
    }

    #[test]
    fn it_is_the_same_speed_however_fast_the_laser_is() {
        for hertz in [1.0, 5.0, 10.0, 37.5, 75.0] {
            let step_m = after_a_drive(hertz, 0.0).step_m().unwrap();
            assert!((step_m * hertz - 0.5).abs() < 0.01, "{hertz} scans a second: {} m/s", step_m * hertz);
        }
    }

    #[test]
    fn it_is_even_if_it_hardly_differs() {
        for hertz in [15.0, 37.5, 75.0] {
            assert!(after_a_drive(hertz, 0.05).is_even(1.0 / hertz), "{hertz}");
            assert!(!after_a_drive(hertz, 0.3).is_even(1.0 / hertz), "{hertz}");
        }
        assert!(!after_a_drive(10.0, 0.0).is_even(0.1), "of a slow laser nothing is said");
    }

    #[test]
    fn who_is_told_to_stand_or_moved_unseen_does_not_drive_evenly() {
        let interval_s = 1.0 / 37.5;
        let mut pace = after_a_drive(37.5, 0.0);
        (0..60).for_each(|_| pace.advance(Pose2::new(0.013, 0.0, 0.0), false, interval_s));
        assert!(pace.is_even(interval_s), "nothing was told");
        (0..60).for_each(|_| pace.advance(Pose2::IDENTITY, true, interval_s));
        assert!(!pace.is_even(interval_s));
        let mut pace = after_a_drive(37.5, 0.0);
        pace.rest();
        assert!(!pace.is_even(interval_s));
    }

    #[test]
    fn nothing_is_learned_where_the_scene_does_not_tell_or_in_turns() {
        for (turned_rad, is_told) in [(0.0, false), (0.03, true)] {
            let mut pace = Pace::default();
            (0..100).for_each(|_| pace.advance(Pose2::new(0.1, 0.0, turned_rad), is_told, 0.2));
            assert_eq!(pace.step_m(), None);
        }
    }
}
