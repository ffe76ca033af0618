//! What is remembered of one square: rays stopped in it and distance travelled in it, in two bytes.

use crate::grid::Occupancy;

/// Distance units per square side: a chord is kept to 1/8 of a square.
pub const DISTANCE_UNITS: f32 = 8.0;
/// Shift from [`chords`](crate::chords) units (2¹⁶ per square) to distance units (2³).
const CHORD_SHIFT: u32 = 13;
/// What a square without hits remembers, distance units: half of what a byte holds, so that a first hit is not halved away.
const FREE_DISTANCE_MAX: u8 = 128;

/// A square is occupied from so many hits on for each of its sides' lengths that rays ran in it: one of four that cross it ends there.
/// Source: the share of rays that GMapping draws with.
const OCCUPIED_HITS_PER_SIDE: f32 = 0.25;

/// Hits and travelled distance of one square; all zero if never seen.
///
/// When one of the two would leave its byte both are halved, rounding down: their ratio, which is all that matters, stays
/// (to 1 %), the weight of old evidence fades, and a lone hit vanishes after enough rays have passed. Without hits the distance stops at half of the byte. A square remembers
/// the last 16 to 32 squares' lengths of ray through it. Hits never exceed distance units.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Square {
    hits: u8,
    distance: u8,
}

impl Square {
    /// A square never seen.
    pub const UNSEEN: Self = Self { hits: 0, distance: 0 };

    /// That many hits, no more than the distance.
    pub(super) fn of(hits: u8, distance: u8) -> Self {
        Self { hits: hits.min(distance), distance }
    }

    /// Rays stopped in it.
    pub const fn hits(self) -> u8 {
        self.hits
    }

    /// Distance travelled in it by rays, in 1/8 of its side.
    pub const fn distance(self) -> u8 {
        self.distance
    }

    /// What that says of the place.
    pub fn occupancy(self) -> Occupancy {
        let sides = f32::from(self.distance) / DISTANCE_UNITS;
        match self {
            Self::UNSEEN => Occupancy::Unknown,
            _ if f32::from(self.hits) >= OCCUPIED_HITS_PER_SIDE * sides => Occupancy::Occupied,
            _ => Occupancy::Free,
        }
    }

    /// After a ray passed it on a chord of `length` chord units. Free squares come to rest: passing them once more changes nothing.
    #[inline]
    #[must_use]
    pub fn passed(self, length: i32) -> Self {
        let added = self.plus(0, round_to_units(length));
        if self.hits == 0 { Self { distance: added.distance.min(FREE_DISTANCE_MAX), ..added } } else { added }
    }

    /// After a ray ended in it after `length` chord units.
    #[inline]
    #[must_use]
    pub fn stopped(self, length: i32) -> Self {
        self.plus(1, round_to_units(length).max(1))
    }

    fn plus(self, hits: u16, distance: u16) -> Self {
        let (hits, distance) = (u16::from(self.hits) + hits, u16::from(self.distance) + distance);
        let halved = u32::from(distance > 255);
        Self { hits: (hits >> halved) as u8, distance: (distance >> halved).min(255) as u8 }
    }
}

/// To the nearest distance unit; a chord is at most √2 squares.
fn round_to_units(length: i32) -> u16 {
    ((length + (1 << (CHORD_SHIFT - 1))) >> CHORD_SHIFT).clamp(0, 255) as u16
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chords_add_up_in_eighths() {
        let mut square = Square::UNSEEN;
        square = square.passed(65_536).passed(4_095).passed(4_096).stopped(0);
        assert_eq!((square.hits(), square.distance()), (1, 10));
    }

    #[test]
    fn full_square_is_halved_and_keeps_its_ratio() {
        let mut square = Square::UNSEEN;
        for _ in 0..1000 {
            square = square.stopped(32_768);
            assert!(square.hits() <= square.distance());
        }
        let ratio = f32::from(square.hits()) / f32::from(square.distance());
        assert!((ratio - 0.25).abs() < 0.01, "{square:?}");
    }

    #[test]
    fn one_ray_of_four_that_ends_there_occupies_a_square() {
        assert_eq!(Square::UNSEEN.occupancy(), Occupancy::Unknown);
        assert_eq!(Square::of(0, 1).occupancy(), Occupancy::Free);
        // 4 sides' lengths of ray with one hit, and a little more.
        assert_eq!(Square::of(1, 32).occupancy(), Occupancy::Occupied);
        assert_eq!(Square::of(1, 33).occupancy(), Occupancy::Free);
    }

    #[test]
    fn a_lone_hit_fades_when_rays_pass() {
        let mut square = Square::UNSEEN;
        square = square.stopped(32_768);
        (0..40).for_each(|_| square = square.passed(65_536));
        assert_eq!(square.hits(), 0);
    }

    #[test]
    fn free_squares_come_to_rest_and_still_notice_a_new_wall() {
        let free = (0..40).fold(Square::UNSEEN, |square, _| square.passed(65_536));
        assert_eq!(free.passed(65_536), free);
        assert_eq!(free.stopped(32_768).hits(), 1);
    }
}
