//! Which way walls face: a wall that is seen from one side is not its other side.
//!
//! hits in the order of their beams → which way the wall at each of them runs, from its neighbours' means to both sides → the planes of cells where it
//! is drawn, and the one where it is looked up ([`NdtGrid`](crate::ndt::NdtGrid)).
//!
//! Walls between rooms are 0.1 m thick. Who comes in from a corridor has seen them from outside, and what he sees of them now would be drawn to that,
//! through the wall.

use core::f32::consts::TAU;

use crate::geometry::Point2;
use crate::math::floor;

/// Parts of a turn at most that have a plane each: thirds, so that two sides of a wall are never in the same one, and one side is in one of them however noisy it is.
pub const FACINGS_MAX: u16 = 3;
/// Planes at most: one for each part, and one for all points, where those are looked up whose wall nobody has seen the direction of.
pub const PLANES_MAX: usize = FACINGS_MAX as usize + 1;
/// A wall that may as well be in the next third is drawn in both, rad: chosen, the noise of its direction.
const MARGIN_RAD: f32 = 0.35;
/// Neighbours on the same wall are as near as this, m …
const NEAR_M: f32 = 0.12;
/// … and so much more for each metre of range: noise of lasers grows with it.
const NEAR_SHARE: f32 = 0.05;
/// Neighbours farther apart than this, m, are of two walls …
const APART_M: f32 = 0.7;
/// … as are those that are not near, one behind the other: sine of the angle between the line of sight and that from one to the other.
const BEHIND_SIN: f32 = 0.15;
/// So many hits of something else may stand between those of a wall: leaves, a net. All chosen.
const BETWEEN: u32 = 3;

/// Units of a whole turn. Whole numbers, so that loops over points vectorise and every processor agrees about borders.
const TURN: i32 = 1 << 16;

/// Which way the wall runs that a point lies on, with who saw it on its left.
///
/// An angle in 1/65536 turn in the point's own frame, and bit 16; 0 where nobody has seen it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Facing(i32);

impl Facing {
    /// Nobody has seen it: what stands alone, and a wall that is seen so flat that hits are far apart.
    pub const UNKNOWN: Self = Self(0);

    /// Of a wall that runs along `direction`.
    fn seen(direction: Point2) -> Self {
        Self(TURN | in_turns(direction.bearing_rad()))
    }

    /// True if the wall was seen to run so.
    pub fn is_seen(self) -> bool {
        self != Self::UNKNOWN
    }

    /// The same in a frame where the point's own one has the `heading`, rad in (−π, π].
    #[must_use]
    pub fn turned(self, heading: f32) -> Self {
        if self.is_seen() { Self(TURN | self.angle(heading)) } else { self }
    }

    /// The angle in a frame where its own one has the `heading`, 1/65536 turn.
    #[inline(always)]
    fn angle(self, heading: f32) -> i32 {
        (self.0 + in_turns(heading)) & (TURN - 1)
    }
}

/// An angle, rad, less than some turns from 0, in 1/65536 turn, 0 to 65535.
#[inline(always)]
fn in_turns(angle: f32) -> i32 {
    floor(angle * (TURN as f32 / TAU) + 0.5) & (TURN - 1)
}

/// The planes of cells that points are drawn in: one for each part of a turn that walls may face, and a last one for all points.
#[derive(Debug, Clone, Copy)]
pub struct Planes {
    /// Where the second and the third part begin, 1/65536 turn.
    borders: [i32; FACINGS_MAX as usize - 1],
    all: u32,
}

impl Planes {
    /// For so many parts of a turn, 1 to [`FACINGS_MAX`]; with 1 there is one plane.
    pub fn new(facings: u16) -> Self {
        match facings {
            ..=1 => Self { borders: [TURN, TURN], all: 0 },
            // The third plane stays empty: a place's planes stand side by side, and a power of two is found faster.
            2 => Self { borders: [TURN / 2, TURN], all: 3 },
            _ => Self { borders: [TURN / 3, TURN * 2 / 3], all: 3 },
        }
    }

    /// Planes: one, or [`PLANES_MAX`].
    pub fn count(self) -> u32 {
        self.all + 1
    }

    /// Binary logarithm of their number.
    #[inline(always)]
    pub(crate) fn shift(self) -> u32 {
        if self.all == 0 { 0 } else { PLANES_MAX.ilog2() }
    }

    /// The plane where a point is looked up: of the part of a turn that its wall faces, or that of all points if nobody has seen it.
    ///
    /// * `heading` — of the point's frame, rad in (−π, π]
    #[inline(always)]
    pub fn of(self, facing: Facing, heading: f32) -> u32 {
        let angle = facing.angle(heading);
        let part = self.borders.map(|border| u32::from(angle >= border));
        if facing.is_seen() { part[0] + part[1] } else { self.all }
    }

    /// The planes where a point is drawn, as bits: those of its wall, and that of all points. All of them, if nobody has seen which way its wall runs.
    pub(crate) fn drawn(self, facing: Facing, heading: f32) -> u32 {
        let all = 1 << self.all;
        if !facing.is_seen() {
            return 2 * all - 1;
        }
        let near = [-MARGIN_RAD, 0.0, MARGIN_RAD].map(|by| 1 << self.of(facing, heading + by));
        near.into_iter().fold(all, |planes, plane| planes | plane)
    }
}

/// Tells of hits in the order of their beams which way their walls face.
///
/// * `eye` — where the laser is, in the frame of the hits
pub fn face(hits: &mut [Point2], eye: Point2) {
    for index in 0..hits.len() {
        let facing = facing(hits, index, eye);
        if let Some(hit) = hits.get_mut(index) {
            hit.facing = facing;
        }
    }
}

fn facing(hits: &[Point2], index: usize, eye: Point2) -> Facing {
    let Some((before, [hit, after @ ..])) = hits.split_at_checked(index) else { return Facing::UNKNOWN };
    let sight = *hit - eye;
    let (behind, ahead) = (mean_beside(before.iter().rev(), *hit, sight), mean_beside(after.iter(), *hit, sight));
    if behind.is_none() && ahead.is_none() {
        return Facing::UNKNOWN;
    }
    let along = ahead.unwrap_or(*hit) - behind.unwrap_or(*hit);
    let is_left = along.y * sight.x >= along.x * sight.y;
    Facing::seen(if is_left { along } else { along * -1.0 })
}

/// Mean of the neighbours of `hit` to one side that are on its wall, the nearest ones first; `None` without any.
fn mean_beside<'a>(neighbours: impl Iterator<Item = &'a Point2>, hit: Point2, sight: Point2) -> Option<Point2> {
    let range2 = sight.norm_squared();
    let near_m = NEAR_M + NEAR_SHARE * libm::sqrtf(range2);
    let near2 = near_m * near_m;
    let (mut last, mut sum, mut count, mut between) = (hit, Point2::default(), 0.0, 0);
    for next in neighbours {
        let step = *next - last;
        let apart2 = step.norm_squared();
        let across = sight.x * step.y - sight.y * step.x;
        let is_behind = across * across < BEHIND_SIN * BEHIND_SIN * range2 * apart2;
        if apart2 > APART_M * APART_M || (apart2 > near2 && is_behind) {
            between += 1;
            if between > BETWEEN {
                break;
            }
            continue;
        }
        if count > 0.0 && (*next - hit).norm_squared() > near2 {
            break;
        }
        (last, sum, count, between) = (*next, sum + *next, count + 1.0, 0);
    }
    (count > 0.0).then(|| sum * (1.0 / count))
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f32::consts::PI;
    use std::vec::Vec;

    const ALL: u32 = 3;

    fn three() -> Planes {
        Planes::new(FACINGS_MAX)
    }

    /// Hits of a wall along x, seen from the origin, at y.
    fn wall(y: f32) -> Vec<Point2> {
        let mut hits: Vec<Point2> = (-20..=20).map(|i| Point2::new(0.05 * i as f32, y)).collect();
        if y > 0.0 {
            hits.reverse(); // beams go counter-clockwise
        }
        face(&mut hits, Point2::default());
        hits
    }

    #[test]
    fn two_sides_of_a_wall_are_never_in_the_same_plane() {
        for heading in (-31..=31).map(|i| 0.1 * i as f32) {
            for (above, below) in wall(2.0).into_iter().zip(wall(-2.0)) {
                let drawn = |point: Point2, plane| three().drawn(point.facing, heading) >> plane & 1 != 0;
                assert!((0..ALL).all(|plane| !(drawn(above, plane) && drawn(below, plane))), "{above:?} {below:?}");
                assert!(drawn(above, three().of(above.facing, heading)), "drawn where it is looked up");
            }
        }
    }

    #[test]
    fn the_order_of_beams_does_not_matter() {
        let faced = wall(2.0);
        let mut clockwise: Vec<Point2> = faced.iter().rev().copied().collect();
        face(&mut clockwise, Point2::default());
        let turned = faced.iter().zip(clockwise.iter().rev()).map(|(a, b)| (a.facing.0 - b.facing.0).abs());
        assert!(turned.max() <= Some(1));
    }

    #[test]
    fn a_wall_seen_again_askew_and_noisily_is_found_where_it_was_drawn() {
        for (direction, off) in (0..63).flat_map(|i| [-0.3_f32, 0.3].map(|off| (0.1 * i as f32 - PI, off))) {
            let of = |angle: f32| Facing::seen(Point2::from_polar(1.0, angle));
            let plane = three().of(of(direction + off), 0.0);
            assert!(three().drawn(of(direction), 0.0) >> plane & 1 != 0, "{direction} {off}");
        }
    }

    #[test]
    fn a_turned_frame_changes_nothing() {
        for heading in (-31..=31).map(|i| 0.1 * i as f32) {
            for facing in wall(2.0).iter().map(|point| point.facing) {
                assert_eq!(three().of(facing.turned(heading), 0.0), three().of(facing, heading), "{heading}");
                assert_eq!(facing.turned(heading).turned(-heading), facing);
            }
        }
    }

    #[test]
    fn what_stands_alone_is_drawn_in_all_planes_and_looked_up_in_that_of_all_points() {
        let mut hits = [Point2::new(2.0, 0.0), Point2::new(2.0, 3.0)];
        face(&mut hits, Point2::default());
        for hit in hits {
            assert!(
                hit.facing == Facing::UNKNOWN
                    && (0..=ALL).all(|plane| three().drawn(hit.facing, 0.0) >> plane & 1 != 0)
            );
        }
        assert_eq!((three().of(Facing::UNKNOWN, 1.0), Planes::new(1).of(Facing::UNKNOWN, 1.0)), (ALL, 0));
        assert!(wall(2.0).iter().all(|point| three().drawn(point.facing, 1.0) >> ALL & 1 != 0));
        assert_eq!(Facing::UNKNOWN.turned(1.0), Facing::UNKNOWN);
    }

    #[test]
    fn numbers_without_meaning_have_a_plane() {
        let mut hits = [Point2::new(f32::NAN, 0.0), Point2::new(f32::INFINITY, 3.0), Point2::default()];
        face(&mut hits, Point2::default());
        assert!(hits.iter().all(|hit| three().of(hit.facing, f32::NAN) <= ALL));
        face(&mut [], Point2::default());
    }
}
