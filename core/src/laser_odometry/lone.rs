//! What stands alone in a scan: a few hits at one place, with nothing beside them at their distance, as of a person or a post.

use super::reference::Taken;
use crate::geometry::{Point2, Pose2};
use crate::math::wrap_angle;
use crate::scan::RangeScan;

/// Fewer hits than this are no object: legs of chairs and noise. Chosen.
const HITS_MIN: usize = 3;
/// With beams farther apart than this, rad, nobody can tell what stands alone within the few metres in which it is more than a hit or two: 2°, chosen.
const BEAM_MAX_RAD: f32 = 0.035;
/// Where beams are farther apart than this, m, nobody can tell what stands alone: parts of walls look so too. Chosen: a person is three beams.
const SPACING_M: f32 = 0.15;
/// What is wider is part of the building, m: two people side by side are not.
const WIDTH_M: f32 = 1.0;
/// Neighbouring hits are of one object if they are nearer to each other than this, m: the side of a round one falls away steeply …
const APART_M: f32 = 0.35;
/// … or than so many beams at their distance, for lasers of few beams.
const APART_BEAMS: f32 = 4.0;
/// … or are on a wall seen at a flat angle: ranges of a straight line are so near to what the hits to both sides say, a share of them.
const STRAIGHT_SHARE: f32 = 0.03;
/// Between hits farther apart than so many beams, some returned nothing.
const GAP_BEAMS: f32 = 2.5;
/// What is beside a hit is at another distance if it is so much farther away or nearer, m.
const LEVEL_M: f32 = 0.3;

/// What is beside an object.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Beside {
    /// Something farther away, or nothing that returns a beam.
    Behind,
    /// Something at its distance.
    Level,
    /// Nothing that returns a beam, at the end of the range.
    Nothing,
    /// Something nearer, which may hide more of it, or the end of the scan.
    Unknown,
}

/// Moves those of `hits` that do not stand alone to the front, in order; returns how many these are: all, where beams are too sparse to tell.
///
/// * `hits` — of `scan`, robot frame, m, in beam order
/// * `robot_from_lrf` — where the laser sits on the robot
pub fn part_lone(hits: &mut [Point2], scan: &RangeScan<'_>, robot_from_lrf: Pose2) -> usize {
    let taken = Taken::new(scan, robot_from_lrf, Pose2::IDENTITY);
    let Some(mut objects) = Objects::new(&taken) else { return hits.len() };
    let mut kept = 0;
    for index in 0..hits.len() {
        // What is in front of `index` is not looked at any more.
        if !objects.is_alone(hits, index) {
            hits.swap(kept, index);
            kept += 1;
        }
    }
    kept
}

/// Goes through the hits of a scan, object by object.
#[derive(Debug)]
pub(super) struct Objects<'a> {
    taken: &'a Taken,
    /// Of the object at hand: the index behind its last hit.
    end: usize,
    is_alone: bool,
    /// Last hit of the object before.
    before: Option<Point2>,
}

impl<'a> Objects<'a> {
    /// `None` for a laser whose beams are too sparse to tell.
    pub(super) fn new(taken: &'a Taken) -> Option<Self> {
        let is_dense = taken.beam_rad <= BEAM_MAX_RAD;
        is_dense.then_some(Self { taken, end: 0, is_alone: false, before: None })
    }

    /// True if hit `index` is of an object that stands alone.
    ///
    /// * `hits` — of the scan, robot frame, in beam order; those before `index` are not looked at
    /// * `index` — one more than the last time
    pub(super) fn is_alone(&mut self, hits: &[Point2], index: usize) -> bool {
        if index >= self.end {
            let count = self.count(hits.get(index..).unwrap_or_default());
            self.end = index + count.max(1);
            let object = hits.get(index..self.end).unwrap_or_default();
            self.is_alone = self.stands_alone(object, hits.get(self.end).copied());
            self.before = object.last().copied();
        }
        self.is_alone
    }

    /// Index behind the last hit of the object that was asked about.
    pub(super) fn end(&self) -> usize {
        self.end
    }

    /// Hits of the first object of `hits`.
    fn count(&self, hits: &[Point2]) -> usize {
        let is_apart = |index: &usize| {
            let at = |index: Option<usize>| index.and_then(|index| hits.get(index)).copied();
            let (Some(a), Some(b)) = (at(Some(*index)), at(Some(index + 1))) else { return true };
            let near_m = APART_M.max(APART_BEAMS * self.taken.beam_rad * self.range(a).min(self.range(b)));
            let is_apart = (b - a).norm() > near_m;
            // One hit halfway to what is behind its edge, as many lasers measure there, lies on a line with either, but not with both.
            let is_wall = || {
                let (before, after) = (at(index.checked_sub(1)), at(Some(index + 2)));
                let ends = before.zip(after);
                ends.is_some_and(|(before, after)| self.is_straight([before, a, b]) && self.is_straight([a, b, after]))
            };
            is_apart && !is_wall()
        };
        (0..hits.len()).find(is_apart).map_or(hits.len(), |last| last + 1)
    }

    fn stands_alone(&self, object: &[Point2], after: Option<Point2>) -> bool {
        let (Some(first), Some(last)) = (object.first(), object.last()) else { return false };
        let spacing_m = self.taken.beam_rad * self.range(*first).min(self.range(*last));
        if spacing_m > SPACING_M || object.len() < HITS_MIN || object.iter().any(|hit| (*hit - *first).norm() > WIDTH_M)
        {
            return false;
        }
        let sides = [self.beside(*first, self.before), self.beside(*last, after)];
        sides == [Beside::Nothing; 2] || sides.contains(&Beside::Behind) && !sides.contains(&Beside::Level)
    }

    /// What is beside `edge`, an object's first or last hit, if `next` is the hit there.
    fn beside(&self, edge: Point2, next: Option<Point2>) -> Beside {
        let Some(next) = next else { return Beside::Unknown };
        let eye = self.taken.eye;
        let apart = wrap_angle((next - eye).bearing_rad() - (edge - eye).bearing_rad()).abs();
        let has_gap = apart > GAP_BEAMS * self.taken.beam_rad;
        let beyond_m = if has_gap { self.taken.farthest_m } else { self.range(next) } - self.range(edge);
        match beyond_m {
            beyond_m if beyond_m > LEVEL_M => Beside::Behind,
            _ if has_gap => Beside::Nothing,
            beyond_m if beyond_m < -LEVEL_M => Beside::Unknown,
            _ => Beside::Level,
        }
    }

    /// True if three hits, of beams beside each other, are on one line: then 1 / range is linear in the angle.
    fn is_straight(&self, hits: [Point2; 3]) -> bool {
        let [before, middle, after] = hits.map(|hit| 1.0 / self.range(hit).max(1e-3));
        let [a, b, c] = hits.map(|hit| (hit - self.taken.eye).bearing_rad());
        let (to_before, to_after) = (wrap_angle(b - a).abs(), wrap_angle(c - b).abs());
        let expected = (before * to_after + after * to_before) / (to_before + to_after).max(1e-6);
        to_before.max(to_after) <= GAP_BEAMS * self.taken.beam_rad
            && (middle - expected).abs() <= STRAIGHT_SHARE * middle
    }

    fn range(&self, hit: Point2) -> f32 {
        (hit - self.taken.eye).norm()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Pose2;
    use crate::scan::{Beam, Echo};
    use crate::time::{Duration, Instant};
    use std::vec::Vec;

    const DEG: f32 = core::f32::consts::PI / 180.0;

    /// Bearings in degrees of the hits that stand alone. Beams are a degree apart, ranges up to 8 m.
    fn alone(range: impl Fn(f32) -> f32) -> Vec<i32> {
        let seen = (-90..=90).map(|degree| (degree, range(degree as f32 * DEG))).filter(|(_, range)| *range < 8.0);
        let (degrees, hits): (Vec<i32>, Vec<Point2>) =
            seen.map(|(degree, range)| (degree, Point2::from_polar(range, degree as f32 * DEG))).unzip();
        let taken = Taken {
            at: Instant::default(),
            map_from_robot: Pose2::IDENTITY,
            eye: Point2::default(),
            farthest_m: hits.iter().map(|hit| hit.norm()).fold(0.0, f32::max),
            beam_rad: DEG,
        };
        let mut objects = Objects::new(&taken).unwrap();
        degrees.iter().enumerate().filter(|(index, _)| objects.is_alone(&hits, *index)).map(|(_, at)| *at).collect()
    }

    /// A corridor 2 m wide that ends nowhere.
    fn corridor(bearing: f32) -> f32 {
        1.0 / libm::fabsf(libm::sinf(bearing)).max(1e-3)
    }

    /// Distance to somebody 0.5 m wide at `(x, y)`.
    fn person(x: f32, y: f32, bearing: f32) -> f32 {
        let (sin, cos) = (libm::sinf(bearing), libm::cosf(bearing));
        let (along, across) = (x * cos + y * sin, y * cos - x * sin);
        let inside = 0.0625 - across * across;
        if inside > 0.0 { along - libm::sqrtf(inside) } else { f32::MAX }
    }

    #[test]
    fn somebody_in_a_corridor_stands_alone_and_its_walls_do_not() {
        assert_eq!(alone(corridor), []);
        // The last one stands where the laser's reach ends, and nothing is seen beside him.
        for x in [1.0, 2.0, 3.0, 4.5, 8.0] {
            let found = alone(|bearing| corridor(bearing).min(person(x, 0.1, bearing)));
            let his = alone(|bearing| person(x, 0.1, bearing));
            assert!(found.len() >= HITS_MIN && found.len() < 40, "{x} m away: {found:?}");
            assert!(his.is_empty(), "nothing but him: the end of the scan on both sides says nothing");
        }
    }

    /// The beam that is half on his edge measures something between him and the wall behind.
    #[test]
    fn a_hit_between_him_and_the_wall_does_not_make_him_one() {
        let bearings = [-14.0, -15.0, -13.0].map(|degree: f32| degree * DEG);
        let veiled = |bearing: f32| {
            let range = corridor(bearing).min(person(2.0, -0.25, bearing));
            if bearings.iter().any(|at| (at - bearing).abs() < 0.5 * DEG) && range > 3.0 { 2.9 } else { range }
        };
        assert!(!alone(veiled).is_empty());
    }

    #[test]
    fn a_wide_thing_and_one_before_a_wall_are_the_building() {
        let board = |bearing: f32| if bearing.abs() < 0.3 { 3.0 / libm::cosf(bearing) } else { f32::MAX };
        assert_eq!(alone(|bearing| corridor(bearing).min(board(bearing))), [], "1.9 m wide");
        let wall = |bearing: f32| 3.1 / libm::cosf(bearing).max(1e-3);
        assert_eq!(alone(|bearing| wall(bearing).min(person(3.0, 0.0, bearing))), [], "he leans on it");
    }

    #[test]
    fn hits_that_stand_alone_go_behind_the_others_which_stay_in_order() {
        let hit = |degree: i32| {
            let bearing_rad = degree as f32 * DEG;
            let range_m = corridor(bearing_rad).min(person(3.0, 0.1, bearing_rad));
            Beam {
                bearing_rad,
                offset: Duration::ZERO,
                echo: if range_m < 8.0 { Echo::Hit(range_m) } else { Echo::Miss },
            }
        };
        let beams: Vec<Beam> = (-90..=90).map(hit).collect();
        let scan = RangeScan { stamp: Instant::default(), range_max_m: 8.0, beams: &beams };
        let seen = beams.iter().filter_map(|beam| match beam.echo {
            Echo::Hit(range_m) => Some(Point2::from_polar(range_m, beam.bearing_rad)),
            _ => None,
        });
        let seen: Vec<Point2> = seen.collect();
        let his = alone(|bearing| corridor(bearing).min(person(3.0, 0.1, bearing))).len();
        let mut parted = seen.clone();
        let count = part_lone(&mut parted, &scan, Pose2::IDENTITY);
        assert_eq!(count, seen.len() - his);
        assert!(his >= HITS_MIN && parted[count..].iter().all(|hit| (*hit - Point2::new(3.0, 0.1)).norm() < 0.3));
        let rest: Vec<Point2> = seen.iter().filter(|hit| !parted[count..].contains(*hit)).copied().collect();
        assert_eq!(parted[..count], rest);
        // With beams 3° apart nobody can tell.
        let sparse: Vec<Beam> = beams.iter().step_by(3).copied().collect();
        assert_eq!(part_lone(&mut parted, &RangeScan { beams: &sparse, ..scan }, Pose2::IDENTITY), parted.len());
    }
}
