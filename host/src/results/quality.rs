//! How far a map is to be trusted: what the run noticed of itself, for `run.json` and in one plain sentence.

use lrfslam_core::geometry::Point2;
use serde::Serialize;

use crate::mapping::LowPose;
use crate::mapping::high::HighCounts;
use crate::maps::contradictions::RevisitedWalls;
use crate::plural;
use crate::trajectory::TimedPose;

/// A path is measured from point to point so far apart, m: a robot that stands does not travel.
const POINTS_APART_M: f32 = 0.1;
/// Stretches with no more good scans than this between them are one.
const GOOD_BETWEEN: usize = 5;
/// A map of a shorter path has nothing to close, m.
const LOOP_PATH_M: f64 = 30.0;
/// A length is a guess if the robot drove farther than this while an axis was undetermined, m.
const GUESSED_M: f64 = 1.0;
/// What loops put right is worth a word if it is at least this, m: two cells of the map.
const MOVED_M: f64 = 0.1;
/// A drift is as expected below this ratio.
const DRIFT_RATIO_TOLD: f64 = 1.05;
/// A map is not to be trusted if so many places that were recognised contradict the rest of it, …
const REFUTED_MIN: u64 = 3;
/// … and they are this share of all. Closures are verified strictly: on logs with nothing wrong hardly one in fifty is refuted. Both chosen.
const REFUTED_SHARE: f64 = 0.1;
/// A map is not to be trusted if so much wall is contradicted, m: less can be what somebody moved; …
const CONTRADICTED_MIN_M: f64 = 5.0;
/// … and it is this share of the walls that the robot came back to. Chosen: docs/accuracy.md has maps on both sides of it.
const CONTRADICTED_SHARE: f64 = 1.0 / 6.0;
/// From this share on those walls are not to be trusted: twice what maps with nothing wrong have at most.
const CONTRADICTED_PARTLY: f64 = 1.0 / 12.0;
/// So many scans in a row that fit nowhere, and the robot may have been carried away meanwhile.
const LOST_SCANS: usize = 5;

/// How a scan agreed with the map.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fit {
    /// It does, along every axis.
    Well,
    /// The scene said nothing about an axis.
    Undetermined,
    /// Too little to be believed.
    Lost,
}

impl From<&LowPose> for Fit {
    fn from(low: &LowPose) -> Self {
        match (low.is_lost, low.undetermined) {
            (true, _) => Self::Lost,
            (false, Some(_)) => Self::Undetermined,
            (false, None) => Self::Well,
        }
    }
}

/// How each scan of a run agreed, in their order. Most agree as the one before does, and take no memory.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Fits {
    /// So many scans in a row, and how they agreed.
    runs: Vec<(usize, Fit)>,
    scans: usize,
}

impl Fits {
    /// Adds that of one more scan.
    pub fn push(&mut self, fit: Fit) {
        self.scans += 1;
        match self.runs.last_mut() {
            Some((scans, like)) if *like == fit => *scans += 1,
            _ => self.runs.push((1, fit)),
        }
    }

    /// Scans so far.
    pub fn scans(&self) -> usize {
        self.scans
    }

    /// Of the last scan.
    pub fn last(&self) -> Option<Fit> {
        self.runs.last().map(|(_, fit)| *fit)
    }

    /// Of all scans.
    pub fn iter(&self) -> impl Iterator<Item = Fit> {
        self.runs.iter().flat_map(|(scans, fit)| std::iter::repeat_n(*fit, *scans))
    }
}

/// Scans in a row with the same trouble.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Stretch {
    /// From the first scan of the run to the first of these, s.
    pub from_s: f64,
    /// And to the last of these.
    pub to_s: f64,
    /// Scans in trouble.
    pub scans: usize,
    /// Way of the robot meanwhile, as far as the path knows it, m.
    pub path_m: f64,
}

impl Stretch {
    /// Its times in words, to the second: `35 to 40 s`, or `35 s`.
    pub fn in_words(&self) -> String {
        let [from, to] = [self.from_s, self.to_s].map(|seconds| format!("{seconds:.0}"));
        if from == to { format!("{from} s") } else { format!("{from} to {to} s") }
    }
}

/// What a run noticed of itself.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Quality {
    /// Length of the path, m.
    pub path_m: f64,
    /// Width and height of the known part of the map, m; none if nothing is known.
    pub map_size_m: Option<[f64; 2]>,
    /// Loops closed; none at a level that closes none.
    pub loops_closed: Option<u64>,
    /// Farthest that the robot was from where one put it, m: [`HighCounts::largest_move_m`]. None if none was closed.
    pub loops_moved_m: Option<f64>,
    /// How far the robot drifts over what was expected: [`HighCounts::drift_ratio`]. None at a level that closes no loops.
    pub drift_ratio: Option<f64>,
    /// Places recognised: [`HighCounts::closures_found`].
    pub loops_found: u64,
    /// How many of these contradict the rest of the path: [`HighCounts::closures_refuted`].
    pub loops_refuted: u64,
    /// Length of the walls that the robot came back to, m: [`RevisitedWalls`].
    pub walls_revisited_m: f64,
    /// Length of those that stand where another visit saw through, m: parts of the map are drawn twice, or something was moved.
    pub walls_contradicted_m: f64,
    /// Pieces of map that are not joined to it, and not in it.
    pub pieces_apart: u64,
    /// Share of the scans that fit the map and determine every axis.
    pub matched_well: f64,
    /// Where scans agreed too little with the map to be believed.
    pub lost: Vec<Stretch>,
    /// Where the scene left an axis undetermined, such as the one along a bare corridor.
    pub undetermined: Vec<Stretch>,
    /// In one sentence, how far to trust the map.
    pub trust: String,
}

impl Quality {
    /// What a run noticed whose scans agreed with the map like this, in their order.
    ///
    /// * `trajectory` — the poses of these scans, after those of a map made before
    /// * `high` — what the level that closes loops did, if there is one; `walls` — of the map that is drawn of all
    pub fn of(
        fits: &Fits,
        trajectory: &[TimedPose],
        map_size_m: Option<[f64; 2]>,
        (high, walls): (Option<&HighCounts>, &RevisitedWalls),
    ) -> Self {
        let well = fits.iter().filter(|fit| *fit == Fit::Well).count();
        let own = &trajectory[trajectory.len().saturating_sub(fits.scans())..];
        let mut quality = Self {
            path_m: path_length_m(trajectory),
            map_size_m,
            loops_closed: high.map(|high| high.closures),
            loops_moved_m: high.filter(|high| high.closures > 0).map(|high| f64::from(high.largest_move_m)),
            drift_ratio: high.map(|high| high.drift_ratio),
            loops_found: high.map_or(0, |high| high.closures_found),
            loops_refuted: high.map_or(0, |high| high.closures_refuted),
            walls_revisited_m: walls.length_m(),
            walls_contradicted_m: walls.contradicted_m(),
            pieces_apart: high.map_or(0, |high| high.pieces_apart),
            matched_well: well as f64 / fits.scans().max(1) as f64,
            lost: stretches(fits, own, Fit::Lost),
            undetermined: stretches(fits, own, Fit::Undetermined),
            trust: String::new(),
        };
        quality.trust = trust(&quality);
        quality
    }

    /// So many walls are contradicted that parts of the map must be drawn twice.
    pub fn is_drawn_twice(&self) -> bool {
        self.is_contradicted_to(CONTRADICTED_PARTLY)
    }

    fn is_contradicted_to(&self, share: f64) -> bool {
        self.walls_contradicted_m >= CONTRADICTED_MIN_M && self.contradicted_share() >= share
    }

    /// Share of the walls that the robot came back to which are contradicted, 0 to 1.
    pub fn contradicted_share(&self) -> f64 {
        self.walls_contradicted_m / self.walls_revisited_m.max(f64::EPSILON)
    }
}

fn path_length_m(path: &[TimedPose]) -> f64 {
    let mut last: Option<Point2> = None;
    let mut length_m = 0.0;
    for point in path.iter().map(|pose| pose.map_from_robot.position()) {
        let step_m = last.map_or(f32::MAX, |last| (point - last).norm());
        if step_m >= POINTS_APART_M {
            length_m += if last.is_some() { f64::from(step_m) } else { 0.0 };
            last = Some(point);
        }
    }
    length_m
}

/// Runs of scans that are `fit`, longest first.
fn stretches(fits: &Fits, path: &[TimedPose], fit: Fit) -> Vec<Stretch> {
    let mut found: Vec<[usize; 3]> = Vec::new();
    for (index, _) in fits.iter().enumerate().filter(|(_, scan)| *scan == fit) {
        match found.last_mut() {
            Some([_, last, count]) if index - *last <= GOOD_BETWEEN + 1 => (*last, *count) = (index, *count + 1),
            _ => found.push([index, index, 1]),
        }
    }
    let start = path.first().map(|pose| pose.stamp).unwrap_or_default();
    let seconds = |index: usize| path.get(index).map_or(0.0, |pose| pose.stamp.since(start).micros as f64 / 1e6);
    let stretch = |[first, last, scans]: [usize; 3]| Stretch {
        from_s: seconds(first),
        to_s: seconds(last),
        scans,
        path_m: path.get(first..=last).map_or(0.0, path_length_m),
    };
    let mut stretches: Vec<Stretch> = found.into_iter().map(stretch).collect();
    stretches.sort_by(|a, b| b.scans.cmp(&a.scans).then(a.from_s.total_cmp(&b.from_s)));
    stretches
}

/// What may be off still, from what loops have put right.
fn unchecked(quality: &Quality) -> String {
    let drifts = quality.drift_ratio.filter(|ratio| *ratio >= DRIFT_RATIO_TOLD);
    let drifts = drifts.map_or_else(String::new, |ratio| format!("; it drifts {ratio:.1} times as far as expected"));
    let moved_m = quality.loops_moved_m.filter(|m| *m >= MOVED_M);
    moved_m.map_or_else(String::new, |m| {
        format!(
            "; before loops closed the robot was up to {m:.1} m off, and what none of them checks may still be{drifts}"
        )
    })
}

/// One plain sentence.
fn trust(quality: &Quality) -> String {
    let Quality { path_m, map_size_m, loops_closed, lost, undetermined, .. } = quality;
    let loops_refuted = quality.loops_refuted;
    let lost = lost.iter().find(|stretch| stretch.scans >= LOST_SCANS);
    let unchecked = unchecked(quality);
    let contradicted = format!(
        "{:.0} of {:.0} m of wall that the robot came back to stand where it saw through on another visit",
        quality.walls_contradicted_m, quality.walls_revisited_m
    );
    let guessed_m: f64 = undetermined.iter().map(|stretch| stretch.path_m).filter(|m| *m > GUESSED_M).sum();
    if map_size_m.is_none() {
        "there is no map".to_owned()
    } else if quality.is_contradicted_to(CONTRADICTED_SHARE) {
        format!("do not trust it: {contradicted}; parts of the map are drawn twice")
    } else if loops_refuted >= REFUTED_MIN && loops_refuted as f64 >= REFUTED_SHARE * quality.loops_found as f64 {
        format!(
            "do not trust it: {loops_refuted} of {} places that the robot recognised contradict the rest of the map",
            quality.loops_found
        )
    } else if quality.pieces_apart > 0 {
        format!(
            "the map lacks {}: the robot was lost there, and has not come back to a place that it knows{unchecked}",
            plural::count(quality.pieces_apart, "piece")
        )
    } else if let Some(lost) = lost {
        let (across, scans) = (lost.in_words(), lost.scans);
        format!(
            "do not trust lengths across {across}: {scans} scans fit nowhere, and what was mapped before and after may lie displaced"
        )
    } else if quality.is_drawn_twice() {
        format!("trust it but where map.png shows walls that are drawn twice: {contradicted}")
    } else if guessed_m > 0.0 {
        format!(
            "trust it but along {guessed_m:.0} m of way that looked the same all along: lengths there are a guess{unchecked}"
        )
    } else if *path_m > LOOP_PATH_M && loops_closed.unwrap_or(0) == 0 {
        "trust what lies near together; no loop was closed, so nothing checks places far apart along the path"
            .to_owned()
    } else {
        format!("every part fits the rest: trust it{unchecked}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lrfslam_core::geometry::Pose2;
    use lrfslam_core::time::Instant;

    fn drive(of: &[Fit]) -> (Fits, Vec<TimedPose>) {
        let stamp = |i: usize| Instant::from_micros(7_000_000 + 500_000 * i as i64);
        let pose = |i: usize| TimedPose { stamp: stamp(i), map_from_robot: Pose2::new(0.25 * i as f32, 0.0, 0.0) };
        let mut fits = Fits::default();
        of.iter().for_each(|fit| fits.push(*fit));
        assert!(fits.iter().eq(of.iter().copied()) && fits.scans() == of.len() && fits.last() == of.last().copied());
        (fits, (0..of.len()).map(pose).collect())
    }

    #[test]
    fn scans_in_the_same_trouble_are_one_stretch() {
        let mut fits = vec![Fit::Well; 60];
        fits[10] = Fit::Lost;
        fits[14] = Fit::Lost;
        fits[30..50].fill(Fit::Undetermined);
        fits[59] = Fit::Lost;
        let (fits, path) = drive(&fits);
        let lost = stretches(&fits, &path, Fit::Lost);
        let expected = Stretch { from_s: 5.0, to_s: 7.0, scans: 2, path_m: 1.0 };
        assert_eq!((lost.len(), lost[0]), (2, expected));
        let corridor = Stretch { from_s: 15.0, to_s: 24.5, scans: 20, path_m: 4.75 };
        assert_eq!(stretches(&fits, &path, Fit::Undetermined), [corridor]);
        assert_eq!(path_length_m(&path), 14.75);
    }

    #[test]
    fn a_map_made_before_is_not_in_trouble() {
        let (fits, path) = drive(&[Fit::Well, Fit::Lost, Fit::Lost, Fit::Well]);
        let before = (0..9).map(|i| TimedPose {
            stamp: Instant::from_micros(i),
            map_from_robot: Pose2::new(100.0 * i as f32, 0.0, 0.0),
        });
        let path: Vec<_> = before.chain(path).collect();
        let quality = Quality::of(&fits, &path, Some([5.0, 5.0]), (None, &RevisitedWalls::default()));
        assert_eq!(quality.lost, [Stretch { from_s: 0.5, to_s: 1.0, scans: 2, path_m: 0.25 }]);
        let lasting = |to_s| Stretch { from_s: 35.1, to_s, scans: 20, path_m: 0.0 }.in_words();
        assert_eq!([lasting(39.6), lasting(35.4)], ["35 to 40 s", "35 s"]);
        assert_eq!(quality.matched_well, 0.5);
    }

    #[test]
    fn a_standing_robot_does_not_travel() {
        let at = |i: i32| TimedPose {
            stamp: Instant::from_micros(i64::from(i)),
            map_from_robot: Pose2::new(0.02 * (i % 3) as f32, 0.0, 0.0),
        };
        assert_eq!(path_length_m(&(0..1000).map(at).collect::<Vec<_>>()), 0.0);
    }

    #[test]
    fn the_worst_is_what_is_said() {
        let good =
            Quality { path_m: 100.0, map_size_m: Some([10.0, 10.0]), loops_closed: Some(2), ..Quality::default() };
        let stretch = |scans, path_m| Stretch { from_s: 10.0, to_s: 20.0, scans, path_m };
        assert!(trust(&Quality::default()).contains("no map"));
        assert!(trust(&good).contains("trust it"));
        let moved = |m| trust(&Quality { loops_moved_m: Some(m), ..good.clone() });
        assert_eq!(moved(0.05), trust(&good), "that is no more than anybody would expect");
        assert!(moved(1.33).contains("trust it; ") && moved(1.33).contains("up to 1.3 m off"), "{}", moved(1.33));
        let drifts = |drift_ratio| trust(&Quality { loops_moved_m: Some(1.3), drift_ratio, ..good.clone() });
        assert_eq!([drifts(None), drifts(Some(1.0))], [moved(1.3), moved(1.3)]);
        assert!(drifts(Some(1.84)).ends_with("; it drifts 1.8 times as far as expected"), "{}", drifts(Some(1.84)));
        let lacks = trust(&Quality { pieces_apart: 1, loops_moved_m: Some(8.2), ..good.clone() });
        assert!(lacks.contains("lacks 1 piece") && lacks.contains("up to 8.2 m off"), "{lacks}");
        assert!(trust(&Quality { loops_closed: Some(0), ..good.clone() }).contains("no loop was closed"));
        let refuted = |loops_refuted, loops_found| trust(&Quality { loops_refuted, loops_found, ..good.clone() });
        assert_eq!([refuted(2, 4), refuted(4, 131)], [trust(&good), trust(&good)]);
        assert!(refuted(14, 97).contains("do not trust it: 14 of 97 places"), "{}", refuted(14, 97));
        let drawn_twice = |walls_contradicted_m, walls_revisited_m| {
            trust(&Quality { walls_contradicted_m, walls_revisited_m, ..good.clone() })
        };
        assert_eq!([drawn_twice(4.9, 5.0), drawn_twice(33.0, 400.0)], [trust(&good), trust(&good)]);
        assert!(drawn_twice(66.0, 400.0).contains("trust it but where map.png"), "{}", drawn_twice(66.0, 400.0));
        let widely = drawn_twice(67.0, 400.0);
        assert!(widely.contains("do not trust it: 67 of 400 m of wall") && widely.ends_with("drawn twice"), "{widely}");
        let corridor = Quality { undetermined: vec![stretch(50, 12.0)], ..good.clone() };
        assert!(trust(&corridor).contains("12 m of way"));
        let lost = Quality { lost: vec![stretch(50, 1.0)], ..corridor };
        assert!(trust(&lost).contains("10 to 20 s"));
        assert!(
            trust(&Quality { lost: vec![stretch(1, 0.1)], ..good }).contains("trust it"),
            "a single scan is no harm"
        );
    }
}
