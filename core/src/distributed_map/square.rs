//! What is remembered of one square: rays stopped in it and distance travelled in it, in two bytes.

/// Distance units per square side: a chord is kept to 1/8 of a square.
pub const DISTANCE_UNITS: f32 = 8.0;
/// Shift from [`chords`](crate::chords) units (2¹⁶ per square) to distance units (2³).
const CHORD_SHIFT: u32 = 13;

/// Hits and travelled distance of one square; all zero if never seen.
///
/// When one of the two would leave its byte both are halved, rounding down: their ratio, which is all that matters, stays
/// (to 1 %), the weight of old evidence fades, and a lone hit vanishes after enough rays have passed. A square remembers
/// the last 16 to 32 squares' lengths of ray through it. Hits never exceed distance units.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Square {
    hits: u8,
    distance: u8,
}

impl Square {
    /// A square never seen.
    pub const UNSEEN: Self = Self { hits: 0, distance: 0 };

    /// Rays stopped in it.
    pub const fn hits(self) -> u8 {
        self.hits
    }

    /// Distance travelled in it by rays, in 1/8 of its side.
    pub const fn distance(self) -> u8 {
        self.distance
    }

    /// A ray passed it on a chord of `length` chord units.
    #[inline]
    pub fn pass(&mut self, length: i32) {
        self.add(0, round_to_units(length));
    }

    /// A ray ended in it after `length` chord units.
    #[inline]
    pub fn hit(&mut self, length: i32) {
        self.add(1, round_to_units(length).max(1));
    }

    fn add(&mut self, hits: u16, distance: u16) {
        let (hits, distance) = (u16::from(self.hits) + hits, u16::from(self.distance) + distance);
        let halved = u32::from(distance > 255);
        *self = Self { hits: (hits >> halved) as u8, distance: (distance >> halved).min(255) as u8 };
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
        square.pass(65_536);
        square.pass(4_095);
        square.pass(4_096);
        square.hit(0);
        assert_eq!((square.hits(), square.distance()), (1, 10));
    }

    #[test]
    fn full_square_is_halved_and_keeps_its_ratio() {
        let mut square = Square::UNSEEN;
        for _ in 0..1000 {
            square.hit(32_768);
            assert!(square.hits() <= square.distance());
        }
        let ratio = f32::from(square.hits()) / f32::from(square.distance());
        assert!((ratio - 0.25).abs() < 0.01, "{square:?}");
    }

    #[test]
    fn a_lone_hit_fades_when_rays_pass() {
        let mut square = Square::UNSEEN;
        square.hit(32_768);
        (0..40).for_each(|_| square.pass(65_536));
        assert_eq!(square.hits(), 0);
    }
}
