//! Walls between the hits of a laser: where hits are farther apart than a cell needs, and lie on one line.
//!
//! A hit alone is drawn as a spot, which tells its place in every direction, as a pillar would. Those of a bare wall are where the beams meet it:
//! they go with the robot, so that the next scan fits best where the last one was.

use core::ops::RangeInclusive;

use crate::geometry::Point2;

/// Hits nearer to each other are dense enough, m.
const DENSE_M: f32 = 0.1;
/// Between hits farther apart than this nothing is supposed, m: a door is about as wide.
const APART_MAX_M: f32 = 0.7;
/// Beside hits farther apart than this neither, m. Chosen, as the next one.
const BESIDE_MAX_M: f32 = 6.0;
/// Points on one side of a hit.
const BESIDE: usize = 3;
/// Three hits are on one line if the last one is so near to the line of the first two, m.
const STRAIGHT_M: f32 = 0.05;
/// Points between two hits, at most.
const POINTS_MAX: usize = 8;

/// Calls `add` with points on the line between each two of `hits` (in beam order) that are a wall's: with a third one beside them on their line.
pub(super) fn between(hits: &[Point2], mut add: impl FnMut(&[Point2])) {
    for index in 0..hits.len() {
        let Some(Gap { a, b, .. }) = Gap::after(hits, index, DENSE_M..=APART_MAX_M) else { continue };
        let line = b - a;
        let count = ((line.norm() / DENSE_M) as usize).min(POINTS_MAX);
        let mut points = [Point2::default(); POINTS_MAX];
        for (k, point) in points.iter_mut().take(count).enumerate() {
            *point = a + line * ((k + 1) as f32 / (count + 1) as f32);
        }
        add(points.get(..count).unwrap_or_default());
    }
}

/// The same beside those of `hits` that are too far apart for that: `add` gets the points next to one, on one side of it. What is between may be a
/// door; a hit on a wall is no spot.
pub(super) fn beside(hits: &[Point2], mut add: impl FnMut(&[Point2])) {
    for_each_far(hits, |index, ways| {
        let Some(hit) = hits.get(index) else { return };
        for way in ways.into_iter().flatten() {
            let mut points = [Point2::default(); BESIDE];
            for (k, point) in points.iter_mut().enumerate() {
                *point = *hit + way * (DENSE_M * (k + 1) as f32);
            }
            add(&points);
        }
    });
}

/// Calls `add` with those of `hits` that have no points [beside] them, in parts that follow one another.
pub(super) fn near(hits: &[Point2], mut add: impl FnMut(&[Point2])) {
    let mut start = 0;
    for_each_far(hits, |index, _| {
        add(hits.get(start..index).unwrap_or_default());
        start = index + 1;
    });
    add(hits.get(start..).unwrap_or_default());
}

/// Calls `see` with the index of each of `hits` that is a wall's, and too far from one beside it, and with the ways towards those before and after
/// it that are so, of length 1.
fn for_each_far(hits: &[Point2], mut see: impl FnMut(usize, [Option<Point2>; 2])) {
    let mut to_before = None;
    for index in 0..hits.len() {
        let gap = Gap::after(hits, index, APART_MAX_M..=BESIDE_MAX_M);
        let to_after = gap.map(|gap| gap.along * (1.0 / gap.along.norm()));
        if to_before.is_some() || to_after.is_some() {
            see(index, [to_before, to_after]);
        }
        to_before = to_after.map(|way| way * -1.0);
    }
}

/// Between two hits on a wall.
#[derive(Debug, Clone, Copy)]
struct Gap {
    a: Point2,
    b: Point2,
    /// Between the first and the last of the three or four hits that are on one line.
    along: Point2,
}

impl Gap {
    /// Between a hit and the next one, if they are so far apart and a wall's.
    fn after(hits: &[Point2], index: usize, apart_m: RangeInclusive<f32>) -> Option<Self> {
        let at = |index: Option<usize>| index.and_then(|index| hits.get(index)).copied();
        let (a, b) = (at(Some(index))?, at(Some(index + 1))?);
        let line = b - a;
        let length = line.norm();
        if !apart_m.contains(&length) {
            return None;
        }
        let is_straight = |c: Point2, from: Point2| {
            let to = c - from;
            to.norm() <= 1.5 * length.max(APART_MAX_M)
                && (line.x * to.y - line.y * to.x).abs() <= STRAIGHT_M * length.max(to.norm())
        };
        let before = at(index.checked_sub(1)).filter(|c| is_straight(*c, a));
        let after = at(Some(index + 2)).filter(|c| is_straight(*c, b));
        (before.is_some() || after.is_some()).then(|| Self { a, b, along: after.unwrap_or(b) - before.unwrap_or(a) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    fn points(hits: &[(f32, f32)]) -> Vec<Point2> {
        hits.iter().map(|(x, y)| Point2::new(*x, *y)).collect()
    }

    fn filled(hits: &[(f32, f32)]) -> usize {
        let mut count = 0;
        between(&points(hits), |points| count += points.len());
        count
    }

    #[test]
    fn three_on_a_line_are_a_wall_and_a_corner_a_door_or_dense_hits_are_not() {
        assert_eq!(filled(&[(0.0, 1.0), (0.45, 1.0), (0.9, 1.0)]), 8);
        assert_eq!(filled(&[(0.0, 1.0), (0.4, 1.0)]), 0, "two are on any line");
        assert_eq!(filled(&[(0.0, 1.0), (0.4, 1.0), (0.4, 1.4)]), 0);
        assert_eq!(filled(&[(0.0, 1.0), (0.9, 1.0), (1.8, 1.0)]), 0);
        assert_eq!(filled(&[(0.0, 1.0), (0.05, 1.0), (0.1, 1.0)]), 0);
    }

    #[test]
    fn hits_too_far_apart_have_points_beside_them() {
        let beside_of = |hits: &[(f32, f32)]| {
            let mut all = Vec::new();
            beside(&points(hits), |points| all.extend_from_slice(points));
            all
        };
        let found = beside_of(&[(0.0, 1.0), (0.5, 1.0), (2.5, 1.0)]);
        assert_eq!(found.len(), 2 * BESIDE);
        for (found, x) in found.iter().zip([0.6, 0.7, 0.8, 2.4, 2.3, 2.2]) {
            assert!((found.x - x).abs() < 1e-5 && found.y == 1.0, "{found:?}, not at {x}");
        }
        assert!(beside_of(&[(0.0, 1.0), (2.0, 1.0)]).is_empty(), "two are on any line");
        assert!(beside_of(&[(0.0, 1.0), (2.0, 1.0), (2.0, 3.0)]).is_empty());
        assert!(beside_of(&[(0.0, 1.0), (0.4, 1.0), (0.8, 1.0)]).is_empty());
        assert!(beside_of(&[(0.0, 1.0), (7.0, 1.0), (14.0, 1.0)]).is_empty());
    }

    #[test]
    fn hits_are_near_or_have_points_beside_them() {
        let all = points(&[(0.0, 1.0), (0.4, 1.0), (0.8, 1.0), (1.8, 1.0), (2.8, 1.0), (3.3, 1.0)]);
        let mut seen = Vec::new();
        near(&all, |part| seen.extend_from_slice(part));
        assert_eq!(seen, [all[0], all[1], all[5]]);
        seen.clear();
        near(&all[..3], |part| seen.extend_from_slice(part));
        assert_eq!(seen, all[..3]);
    }
}
