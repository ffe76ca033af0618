//! Walls between the hits of a laser with few beams: where hits are farther apart than a cell needs, and lie on one line.

use crate::geometry::Point2;

/// Hits nearer to each other are dense enough, m.
const DENSE_M: f32 = 0.1;
/// Between hits farther apart than this nothing is supposed, m: a door is about as wide.
const APART_MAX_M: f32 = 0.7;
/// Three hits are on one line if the last one is so near to the line of the first two, m.
const STRAIGHT_M: f32 = 0.05;
/// Points between two hits, at most.
const POINTS_MAX: usize = 8;

/// Calls `add` with points on the line between each two of `hits` (in beam order) that are a wall's: with a third one beside them on their line.
pub(super) fn between(hits: &[Point2], mut add: impl FnMut(&[Point2])) {
    for index in 0..hits.len() {
        let at = |index: Option<usize>| index.and_then(|index| hits.get(index)).copied();
        let (Some(a), Some(b)) = (at(Some(index)), at(Some(index + 1))) else { continue };
        let line = b - a;
        let length = line.norm();
        if !(DENSE_M..=APART_MAX_M).contains(&length) {
            continue;
        }
        let is_straight = |c: Point2, from: Point2| {
            let to = c - from;
            to.norm() <= 1.5 * APART_MAX_M
                && (line.x * to.y - line.y * to.x).abs() <= STRAIGHT_M * length.max(to.norm())
        };
        let before = at(index.checked_sub(1)).is_some_and(|c| is_straight(c, a));
        let after = at(Some(index + 2)).is_some_and(|c| is_straight(c, b));
        if !(before || after) {
            continue;
        }
        let count = ((length / DENSE_M) as usize).min(POINTS_MAX);
        let mut points = [Point2::default(); POINTS_MAX];
        for (k, point) in points.iter_mut().take(count).enumerate() {
            *point = a + line * ((k + 1) as f32 / (count + 1) as f32);
        }
        add(points.get(..count).unwrap_or_default());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    fn filled(hits: &[(f32, f32)]) -> usize {
        let hits: Vec<Point2> = hits.iter().map(|(x, y)| Point2::new(*x, *y)).collect();
        let mut count = 0;
        between(&hits, |points| count += points.len());
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
}
