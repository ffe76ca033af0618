//! The speed at which a robot usually drives straight on, learned where the scene tells how far it goes.
//!
//! Over 0.08 s at least. From one scan to the next of a fast laser a robot drives a centimetre, and a match is off by as much.
//!
//! Between bare walls each match is drawn a little to where the last one was, and the more scans there are, the more that adds up, until the
//! robot creeps. What it sees does not change there, as if it stood. In most buildings nobody sees that while he drives. Where one does, who
//! has always driven at about one speed goes on at that; so does one that stops there.
//!
//! The heading is told where the way is not. A real robot wavers as it drives, by a degree in a second, and not while it stands.

use crate::geometry::Pose2;

/// A step takes so long at least, s. Chosen, as all that follow.
const STEP_S: f32 = 0.08;
/// A robot drives if a step is longer than this, m, …
const DRIVES_M: f32 = 0.02;
/// … and straight on if it turns by less than this, rad.
pub(super) const STRAIGHT_RAD: f32 = 0.03;
/// Its pace is known from so many steps on, …
const KNOWN_FROM: f32 = 5.0;
/// … and is the mean of so many at most.
const LEARNED_MAX: f32 = 50.0;
/// How even it is, is told by what is gone in half a second, …
const HALF_SECOND_S: f32 = 0.5;
/// … by so many scans at least: slower ones are not pulled back often …
const SCANS_MIN: f32 = 2.0;
/// … from so many half seconds on.
const EVEN_FROM: f32 = 20.0;
/// It is even if it is off by less than this share of it.
const UNEVEN: f32 = 0.1;
/// A view that does not change says nothing if so it was in this share of what was driven: more than on Intel and ACES, cut at 4 m, too, and
/// less than between the bare walls of our simulator. Else it says that the robot stands.
const UNCHANGED_FROM: f32 = 0.2;
/// That share is the mean of so many half seconds at most.
const UNCHANGED_MAX: f32 = 200.0;
/// A robot keeps its heading if in a second …
const SECOND_S: f32 = 1.0;
/// … it turns by less than this, rad, …
const KEPT_RAD: f32 = 0.007;
/// … and stands, as it seems, if it keeps it and has done so in less than this share of what it drove: a fifth with the robots of Intel and ACES,
/// which waver, also with ranges cut at 4 m or 3 % off. Simulated ones drive along straight lines, and keep it in nine of ten, a URG-04LX's noise too.
const KEPT_TELLS_BELOW: f32 = 0.5;
/// That is known from so many seconds on.
const KEPT_FROM: f32 = 5.0;
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

    fn keeps_heading(&self) -> bool {
        self.gone.heading.abs() < KEPT_RAD
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
    /// The last half second, and the one before: from scan to scan, m, if it was driven straight on. What lies between two such is learned from:
    /// nobody sets off or stops in it.
    last: [Option<f32>; 2],
    /// Share of the half seconds driven in which the view did not change.
    unchanged: f32,
    /// Learned from so many.
    driven: f32,
    second: Stretch,
    /// Share of the seconds driven in which the robot kept its heading …
    kept: f32,
    /// … of so many.
    headings: f32,
    /// What the robot has turned by in the last second, rad.
    turned_rad: f32,
    /// The robot drove when the scene last told.
    drove: bool,
}

impl Pace {
    /// Nothing is known of the motion any more.
    pub(super) fn rest(&mut self) {
        (self.step, self.half_second, self.second) = (Stretch::default(), Stretch::default(), Stretch::default());
        self.drove = false;
        self.last = [None; 2];
    }

    /// The robot has gone on by `step`.
    ///
    /// * `is_told` — the scene said how far
    /// * `changes` — so does the view, as of one that moves
    /// * `interval_s` — from scan to scan in the mean
    pub(super) fn advance(&mut self, step: Pose2, is_told: bool, changes: bool, interval_s: f32) {
        if let Some(step_m) = self.step.advance(step, is_told, interval_s, STEP_S).and_then(|gone| gone.step_m()) {
            self.steps = (self.steps + 1.0).min(LEARNED_MAX);
            self.usual_m += (step_m - self.usual_m) / self.steps;
        }
        if let Some(gone) = self.half_second.advance(step, is_told, interval_s, HALF_SECOND_S) {
            self.learn_how_even(&gone, changes, interval_s);
        }
        if let Some(gone) = self.second.advance(step, is_told, interval_s, SECOND_S) {
            self.turned_rad = gone.gone.heading;
            // Told or not: who is taken to drive while he stands is soon found out, and then no more.
            if gone.gone.x > DRIVES_M && gone.gone.heading.abs() < 2.0 * STRAIGHT_RAD {
                self.headings = (self.headings + 1.0).min(UNCHANGED_MAX);
                self.kept += (f32::from(gone.keeps_heading()) - self.kept) / self.headings;
            }
        }
    }

    fn learn_how_even(&mut self, gone: &Stretch, changes: bool, interval_s: f32) {
        let now = gone.step_m();
        let [before, last] = self.last;
        self.last = [last, now];
        if gone.scans >= SCANS_MIN
            && let (Some(_), Some(step_m), Some(_)) = (before, last, now)
        {
            self.half_seconds = (self.half_seconds + 1.0).min(LEARNED_MAX);
            self.even_m += (step_m - self.even_m) / self.half_seconds;
            let off_m = step_m - self.even_m;
            self.spread += (off_m * off_m - self.spread) / self.half_seconds;
        }
        if now.is_some() {
            self.drove = true;
            self.driven = (self.driven + 1.0).min(UNCHANGED_MAX);
            self.unchanged += (f32::from(!changes) - self.unchanged) / self.driven;
        } else if gone.is_told && gone.gone.position().norm() < STANDS_MPS * interval_s * gone.scans {
            self.drove = false;
        }
    }

    /// From scan to scan, m; `None` as long as it is not known.
    pub(super) fn step_m(&self) -> Option<f32> {
        (self.steps >= KNOWN_FROM).then_some(self.usual_m)
    }

    /// Its usual speed may be that of a few steps that were not usual.
    pub(super) fn is_new(&self) -> bool {
        self.even_step_m().is_none() && self.steps < LEARNED_MAX
    }

    /// True if what the robot sees has changed while it drove: where it does not, it stands.
    pub(super) fn view_tells(&self) -> bool {
        self.driven >= EVEN_FROM && self.unchanged < UNCHANGED_FROM
    }

    /// True if the robot has kept its heading for a second and more, and hardly ever does so while it drives.
    pub(super) fn keeps_heading_as_who_stands(&self) -> bool {
        let tells = self.headings >= KEPT_FROM && self.kept < KEPT_TELLS_BELOW;
        tells && self.turned_rad.abs() < KEPT_RAD && self.second.keeps_heading()
    }

    /// The same of a robot that drives on whatever it sees: it has always driven at about one speed, often with a view that did not change, and
    /// drove when the scene last told.
    pub(super) fn even_step_m(&self) -> Option<f32> {
        let uneven_m = UNEVEN * self.even_m;
        let is_even = self.half_seconds >= EVEN_FROM && self.spread < uneven_m * uneven_m;
        (self.drove && is_even && self.unchanged >= UNCHANGED_FROM).then_some(self.even_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Twenty seconds at half a metre a second, now faster, now slower by the share `uneven`; the match of each scan is off by 4 mm. The view
    /// `changes` or does not.
    fn after_a_drive(hertz: f32, uneven: f32, changes: bool) -> Pace {
        let mut pace = Pace::default();
        for scan in 0..(20.0 * hertz) as usize {
            let faster = if (scan as f32 / hertz) % 4.0 < 2.0 { uneven } else { -uneven };
            let off_m = if scan % 2 == 0 { 0.004 } else { -0.004 };
            pace.advance(Pose2::new(0.5 * (1.0 + faster) / hertz + off_m, 0.0, 0.0), true, changes, 1.0 / hertz);
        }
        pace
    }

    #[test]
    fn it_is_the_same_speed_however_fast_the_laser_is() {
        for hertz in [1.0, 5.0, 10.0, 37.5, 75.0] {
            let step_m = after_a_drive(hertz, 0.0, true).step_m().unwrap();
            assert!((step_m * hertz - 0.5).abs() < 0.01, "{hertz} scans a second: {} m/s", step_m * hertz);
        }
    }

    /// Drives for ten seconds at half a metre a second, wavering by so much from one second to the next, then keeps its heading for two. The scene tells,
    /// or not.
    fn after_wavering(rad: f32, is_told: bool) -> Pace {
        let mut pace = Pace::default();
        for scan in 0..50 {
            let turn = if scan / 5 % 2 == 0 { rad / 5.0 } else { -rad / 5.0 };
            pace.advance(Pose2::new(0.1, 0.0, turn), is_told, true, 0.2);
        }
        (0..11).for_each(|_| pace.advance(Pose2::new(0.1, 0.0, 0.0), false, false, 0.2));
        pace
    }

    #[test]
    fn who_wavers_as_he_drives_and_keeps_his_heading_stands() {
        assert!(after_wavering(0.02, true).keeps_heading_as_who_stands());
        assert!(after_wavering(0.02, false).keeps_heading_as_who_stands(), "it has driven wherever it was");
        assert!(!after_wavering(0.0, true).keeps_heading_as_who_stands(), "it always keeps it");
        let mut pace = after_wavering(0.02, true);
        (0..4).for_each(|_| pace.advance(Pose2::new(0.1, 0.0, 0.004), false, false, 0.2));
        assert!(!pace.keeps_heading_as_who_stands(), "it wavers again");
    }

    #[test]
    fn it_is_even_if_it_hardly_differs() {
        assert_eq!(after_a_drive(2.0, 0.0, false).even_step_m(), None, "of slow scans nothing is said");
        for hertz in [3.0, 5.0, 10.0, 37.5, 75.0] {
            let step_m = after_a_drive(hertz, 0.05, false).even_step_m().unwrap();
            assert!((step_m * hertz - 0.5).abs() < 0.02, "{hertz} scans a second: {} m/s", step_m * hertz);
            assert_eq!(after_a_drive(hertz, 0.2, false).even_step_m(), None, "{hertz}");
        }
    }

    #[test]
    fn a_view_that_stays_says_something_where_it_hardly_ever_does() {
        for hertz in [1.0, 5.0, 37.5] {
            assert!(
                after_a_drive(hertz, 0.0, true).view_tells() && !after_a_drive(hertz, 0.0, false).view_tells(),
                "{hertz}"
            );
        }
        assert!(!Pace::default().view_tells(), "nobody knows yet");
        let mut pace = after_a_drive(5.0, 0.0, true);
        assert_eq!(pace.even_step_m(), None);
        (0..50).for_each(|_| pace.advance(Pose2::new(0.1, 0.0, 0.0), true, false, 0.2));
        assert!(pace.even_step_m().is_some(), "a third of the way");
    }

    /// It stands for a second, sets off in half a second, drives for two, and stops in half a second: what it drives between is learned.
    #[test]
    fn who_sets_off_and_stops_is_even_all_the_same() {
        let mut pace = Pace::default();
        for scan in 0..600 {
            let step_m = match scan % 40 {
                0..10 => 0.0,
                10..15 | 35..40 => 0.02,
                _ => 0.05,
            };
            pace.advance(Pose2::new(step_m, 0.0, 0.0), true, false, 0.1);
        }
        assert!(pace.even_step_m().is_some_and(|step_m| (step_m - 0.05).abs() < 0.001), "{pace:?}");
    }

    #[test]
    fn who_is_told_to_stand_or_moved_unseen_does_not_drive_evenly() {
        let interval_s = 1.0 / 37.5;
        let mut pace = after_a_drive(37.5, 0.0, false);
        (0..60).for_each(|_| pace.advance(Pose2::new(0.013, 0.0, 0.0), false, false, interval_s));
        assert!(pace.even_step_m().is_some(), "nothing was told");
        (0..60).for_each(|_| pace.advance(Pose2::IDENTITY, true, false, interval_s));
        assert_eq!(pace.even_step_m(), None);
        let mut pace = after_a_drive(37.5, 0.0, false);
        pace.rest();
        assert_eq!(pace.even_step_m(), None);
    }

    #[test]
    fn nothing_is_learned_where_the_scene_does_not_tell_or_in_turns() {
        for (turned_rad, is_told) in [(0.0, false), (0.03, true)] {
            let mut pace = Pace::default();
            (0..100).for_each(|_| pace.advance(Pose2::new(0.1, 0.0, turned_rad), is_told, false, 0.2));
            assert_eq!((pace.step_m(), pace.even_step_m()), (None, None));
        }
    }
}
