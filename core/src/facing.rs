//! Which way walls face: a wall that is seen from one side is not its other side.
//!
//! hits in the order of their beams → which way the wall at each of them runs, from its neighbours' means to both sides → the planes of cells where it
//! is drawn, and the one where it is looked up ([`NdtGrid`](crate::ndt::NdtGrid)).
//!
//! Walls between rooms are 0.1 m thick. Who comes in from a corridor has seen them from outside, and what he sees of them now would be drawn to that,
//! through the wall.

use core::f32::consts::TAU;

use crate::geometry::Point2;

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

/// Planes of a plane of cells for so many parts of a turn.
pub(crate) fn planes(facings: u32) -> u32 {
    if facings == 1 { 1 } else { facings + 1 }
}

/// Which way the wall runs that a point lies on, with who saw it on its left.
///
/// An angle + 2π, rad, in the point's own frame; 0 where nobody has seen it.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Facing(f32);

impl Facing {
    /// Nobody has seen it: what stands alone, and a wall that is seen so flat that hits are far apart.
    pub const UNKNOWN: Self = Self(0.0);

    /// Of a wall that runs along `direction`.
    fn seen(direction: Point2) -> Self {
        Self(direction.bearing_rad() + TAU)
    }

    /// True if the wall was seen to run so.
    pub fn is_seen(self) -> bool {
        self.0 > 0.0
    }

    /// The same in a frame where the point's own one has the `heading`, rad in (−π, π].
    #[must_use]
    pub fn turned(self, heading: f32) -> Self {
        if self == Self::UNKNOWN {
            return self;
        }
        let angle = self.0 + heading;
        Self(if angle > 1.5 * TAU {
            angle - TAU
        } else if angle < 0.5 * TAU {
            angle + TAU
        } else {
            angle
        })
    }

    /// The plane where the point is looked up: of the part of a turn that its wall faces, or that of all points, the last one, if nobody has seen it.
    ///
    /// * `heading` — of its frame, rad in (−π, π]
    /// * `facings` — parts of a turn; with 1 there is one plane
    #[inline(always)]
    pub fn plane(self, heading: f32, facings: u32) -> u32 {
        if facings == 1 {
            return 0;
        }
        if !self.is_seen() {
            return facings;
        }
        let parts = (self.0 + heading) * (facings as f32 / TAU);
        (parts as u32).checked_rem(facings).unwrap_or_default()
    }

    /// True if the point is drawn in this plane: in those of its wall, and in that of all points. In each of them, if nobody has seen which way its wall runs.
    pub(crate) fn is_drawn_in(self, plane: u32, heading: f32, facings: u32) -> bool {
        let beside = |by: f32| Self(self.0 + by).plane(heading, facings) == plane;
        plane == facings || facings == 1 || !self.is_seen() || [-MARGIN_RAD, 0.0, MARGIN_RAD].into_iter().any(beside)
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
    let range_m = sight.norm();
    let near_m = NEAR_M + NEAR_SHARE * range_m;
    let (mut last, mut sum, mut count, mut between) = (hit, Point2::default(), 0.0, 0);
    for next in neighbours {
        let step = *next - last;
        let apart_m = step.norm();
        let is_behind = (sight.x * step.y - sight.y * step.x).abs() < BEHIND_SIN * range_m * apart_m;
        if apart_m > APART_M || (apart_m > near_m && is_behind) {
            between += 1;
            if between > BETWEEN {
                break;
            }
            continue;
        }
        if count > 0.0 && (*next - hit).norm() > near_m {
            break;
        }
        (last, sum, count, between) = (*next, sum + *next, count + 1.0, 0);
    }
    (count > 0.0).then(|| sum * (1.0 / count))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::wrap_angle;
    use core::f32::consts::PI;
    use std::vec::Vec;

    const THREE: u32 = 3;

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
                let drawn = |point: Point2, plane| point.facing.is_drawn_in(plane, heading, THREE);
                assert!((0..THREE).all(|plane| !(drawn(above, plane) && drawn(below, plane))), "{above:?} {below:?}");
                assert!(drawn(above, above.facing.plane(heading, THREE)), "drawn where it is looked up");
            }
        }
    }

    #[test]
    fn the_order_of_beams_does_not_matter() {
        let faced = wall(2.0);
        let mut clockwise: Vec<Point2> = faced.iter().rev().copied().collect();
        face(&mut clockwise, Point2::default());
        let turned = faced.iter().zip(clockwise.iter().rev()).map(|(a, b)| wrap_angle(a.facing.0 - b.facing.0).abs());
        assert!(turned.fold(0.0, f32::max) < 1e-5);
    }

    #[test]
    fn a_wall_seen_again_askew_and_noisily_is_found_where_it_was_drawn() {
        for (direction, off) in (0..63).flat_map(|i| [-0.3_f32, 0.3].map(|off| (0.1 * i as f32 - PI, off))) {
            let of = |angle: f32| Facing::seen(Point2::from_polar(1.0, angle));
            let plane = of(direction + off).plane(0.0, THREE);
            assert!(of(direction).is_drawn_in(plane, 0.0, THREE), "{direction} {off}");
        }
    }

    #[test]
    fn a_turned_frame_changes_nothing() {
        for heading in (-31..=31).map(|i| 0.1 * i as f32) {
            for facing in wall(2.0).iter().map(|point| point.facing) {
                assert_eq!(facing.turned(heading).plane(0.0, THREE), facing.plane(heading, THREE), "{heading}");
                assert!(wrap_angle(facing.turned(heading).turned(-heading).0 - facing.0).abs() < 1e-5);
            }
        }
    }

    #[test]
    fn what_stands_alone_is_drawn_in_all_planes_and_looked_up_in_that_of_all_points() {
        let mut hits = [Point2::new(2.0, 0.0), Point2::new(2.0, 3.0)];
        face(&mut hits, Point2::default());
        for hit in hits {
            assert!(
                hit.facing == Facing::UNKNOWN && (0..=THREE).all(|plane| hit.facing.is_drawn_in(plane, 0.0, THREE))
            );
        }
        assert_eq!((Facing::UNKNOWN.plane(1.0, THREE), Facing::UNKNOWN.plane(1.0, 1)), (THREE, 0));
        assert!(wall(2.0).iter().all(|point| point.facing.is_drawn_in(THREE, 1.0, THREE)));
        assert_eq!(Facing::UNKNOWN.turned(1.0), Facing::UNKNOWN);
    }

    #[test]
    fn numbers_without_meaning_have_a_plane() {
        let mut hits = [Point2::new(f32::NAN, 0.0), Point2::new(f32::INFINITY, 3.0), Point2::default()];
        face(&mut hits, Point2::default());
        assert!(hits.iter().all(|hit| hit.facing.plane(f32::NAN, THREE) <= THREE));
        face(&mut [], Point2::default());
    }
}
