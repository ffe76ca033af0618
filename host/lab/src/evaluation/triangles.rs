//! What relations are worth themselves: three that join the same three poses contradict each other by their own errors alone.

use std::collections::BTreeMap;

use lrfslam_core::time::Instant;
use serde::Serialize;

use super::Relation;
use lrfslam_host::pose_f64::PoseF64;

/// The error of the relations themselves, below which the metric cannot tell one path from a better one.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct OwnNoise {
    /// Threes of relations that join the same three poses.
    pub triangles: usize,
    /// Mean error of one relation, m: what a triangle fails to close by, over √3, as three independent errors make it up.
    pub translation_m: f64,
    /// The same of the rotation, degrees.
    pub rotation_deg: f64,
}

impl OwnNoise {
    /// Of `relations`; `None` if no three of them make a triangle. Of two relations between the same times the first counts.
    pub fn of(relations: &[Relation]) -> Option<Self> {
        let mut from: BTreeMap<Instant, BTreeMap<Instant, PoseF64>> = BTreeMap::new();
        for Relation { start, end, start_from_end } in relations {
            let end_from_start = start_from_end.between(PoseF64::new(0.0, 0.0, 0.0));
            from.entry(*start).or_default().entry(*end).or_insert(*start_from_end);
            from.entry(*end).or_default().entry(*start).or_insert(end_from_start);
        }
        let mut errors = Vec::new();
        for (first, to) in &from {
            for (second, first_from_second) in to.range(*first..).filter(|(second, _)| *second > first) {
                for (third, second_from_third) in from[second].range(*second..).filter(|(third, _)| *third > second) {
                    let Some(first_from_third) = to.get(third) else { continue };
                    errors.push(first_from_third.between(first_from_second.then(*second_from_third)));
                }
            }
        }
        let of_one = |error: fn(&PoseF64) -> f64| {
            let sum: f64 = errors.iter().map(error).sum();
            sum / errors.len() as f64 / 3_f64.sqrt()
        };
        let (translation_m, rotation_deg) =
            (of_one(|error| error.distance_m()), of_one(|error| error.heading.abs().to_degrees()));
        (!errors.is_empty()).then_some(Self { triangles: errors.len(), translation_m, rotation_deg })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn relation(start: i64, end: i64, x: f64, heading: f64) -> Relation {
        let at = Instant::from_micros;
        Relation { start: at(start), end: at(end), start_from_end: PoseF64::new(x, 0.0, heading) }
    }

    #[test]
    fn a_triangle_that_does_not_close_tells_the_error_of_one_relation() {
        // Told in any order and in either direction; the fourth relation is in no triangle.
        let off =
            [relation(3, 1, -3.0, 0.0), relation(1, 2, 1.0, 0.0), relation(2, 3, 1.7, 0.0), relation(3, 9, 5.0, 0.0)];
        let noise = OwnNoise::of(&off).unwrap();
        assert_eq!(noise.triangles, 1);
        assert!((noise.translation_m - 0.3 / 3_f64.sqrt()).abs() < 1e-12 && noise.rotation_deg.abs() < 1e-12);
        let turned = [relation(1, 2, 0.0, 0.5), relation(2, 3, 0.0, 0.5), relation(1, 3, 0.0, 1.1)];
        let noise = OwnNoise::of(&turned).unwrap();
        assert!((noise.rotation_deg - 0.1_f64.to_degrees() / 3_f64.sqrt()).abs() < 1e-9);
    }

    #[test]
    fn relations_without_a_triangle_tell_nothing() {
        assert_eq!(OwnNoise::of(&[relation(1, 2, 1.0, 0.0), relation(2, 3, 1.0, 0.0), relation(1, 2, 1.0, 0.0)]), None);
    }
}
