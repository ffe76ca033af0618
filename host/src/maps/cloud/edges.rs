//! Mixed pixels: at the edge of a near thing the beam lights up both it and what lies behind, and the laser reports a range
//! in between, a point in free air.

use lrfslam_core::geometry::Point2;
use lrfslam_core::scan::{Beam, Echo};

/// Tells mixed pixels from surfaces.
///
/// A hit is mixed if its range lies strictly between those of its two neighbours, farther than a jump from either, and the point
/// lies on neither surface continued: not on the line through the two hits before it, nor on that through the two
/// behind. A plane seen at a grazing angle jumps from beam to beam too, but it continues in a straight line and is kept.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EdgeFilter {
    /// Ranges that differ by less belong together, m.
    pub jump_m: f32,
    /// And by less than this share of the range.
    pub jump_share: f32,
    /// A hit this near to the surface continued lies on it, as a share of the jump to it.
    pub surface_share: f32,
}

impl Default for EdgeFilter {
    /// A jump of 10 cm or 2 %: five times the noise of the lasers known here, and what 0.5° shifts at 60° of incidence.
    fn default() -> Self {
        Self { jump_m: 0.1, jump_share: 0.02, surface_share: 0.3 }
    }
}

impl EdgeFilter {
    /// True if the hit of beam `index` is a mixed pixel. A beam without two neighbours that hit is never one.
    pub fn is_mixed(&self, beams: &[Beam], index: usize) -> bool {
        let range = |at: Option<usize>| range_at(beams, at);
        let (before, after) = (index.checked_sub(1), index.checked_add(1));
        let (Some(here), Some(prior), Some(next)) = (range(Some(index)), range(before), range(after)) else {
            return false;
        };
        let jump = self.jump_m.max(self.jump_share * here);
        let between = (here - prior) * (next - here) > 0.0;
        let apart = (here - prior).abs() > jump && (next - here).abs() > jump;
        between
            && apart
            && !self.continues(beams, index, before, index.checked_sub(2))
            && !self.continues(beams, index, after, index.checked_add(2))
    }

    /// True if beam `index` lies where the line through the hits of `near` and `far` meets it.
    fn continues(&self, beams: &[Beam], index: usize, near: Option<usize>, far: Option<usize>) -> bool {
        let point = |at: Option<usize>| at.and_then(|at| beams.get(at)).and_then(Point2::of_hit);
        let (Some(beam), Some(here), Some(a), Some(b)) =
            (beams.get(index), range_at(beams, Some(index)), point(near), point(far))
        else {
            return false;
        };
        let (sin, cos) = beam.bearing_rad.sin_cos();
        let along = b - a;
        let across = cos * along.y - sin * along.x;
        let expected = (a.x * along.y - a.y * along.x) / across;
        let Some(jump) = range_at(beams, near).map(|near| (here - near).abs()) else { return false };
        // A line along the beam meets it nowhere: the quotient is then not finite, and no comparison holds.
        (here - expected).abs() < self.surface_share * jump
    }
}

fn range_at(beams: &[Beam], at: Option<usize>) -> Option<f32> {
    match beams.get(at?)?.echo {
        Echo::Hit(range_m) => Some(range_m),
        Echo::Miss | Echo::Invalid => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lrfslam_core::time::Duration;

    fn mixed(ranges: &[f32]) -> Vec<usize> {
        let beam = |(index, &range): (usize, &f32)| Beam {
            bearing_rad: (0.5 * index as f32).to_radians(),
            offset: Duration::ZERO,
            echo: Echo::from_range(range, 30.0),
        };
        let beams: Vec<Beam> = ranges.iter().enumerate().map(beam).collect();
        (0..beams.len()).filter(|&index| EdgeFilter::default().is_mixed(&beams, index)).collect()
    }

    #[test]
    fn a_point_in_the_air_between_two_walls_goes_and_the_walls_stay() {
        assert_eq!(mixed(&[2.0, 2.0, 2.0, 2.9, 4.0, 4.0, 4.0]), [3]);
        assert_eq!(mixed(&[4.0, 4.0, 4.0, 3.1, 2.0, 2.0, 2.0]), [3]);
        assert_eq!(mixed(&[2.0, 2.0, 2.0, 4.0, 4.0, 4.0]), [] as [usize; 0], "a clean edge has nothing in between");
        assert_eq!(mixed(&[2.0, 2.0, 1.5, 2.0, 2.0]), [] as [usize; 0], "a thin pole is no mixture");
    }

    #[test]
    fn a_wall_at_a_grazing_angle_stays() {
        // A wall at 1 m to the side, seen under 1.5° to 6°: from 10 to 38 m, jumps of metres between beams.
        let ranges: Vec<f32> =
            (0..12).map(|i| 1.0 / (6.5_f32 - 0.5 * (i as f32 + 1.0) + 0.5).to_radians().sin()).collect();
        assert!(ranges.windows(2).filter(|pair| pair[1] - pair[0] > 0.7).count() > 8);
        assert_eq!(mixed(&ranges), [] as [usize; 0]);
    }

    #[test]
    fn missing_neighbours_prove_nothing() {
        assert_eq!(mixed(&[2.0, 31.0, 3.0, 4.0]), [] as [usize; 0]);
        assert_eq!(mixed(&[3.0]), [] as [usize; 0]);
    }
}
