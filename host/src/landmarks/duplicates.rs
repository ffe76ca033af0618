//! Landmarks that are one: found among those of a fit by their joint covariance, several at once.
//!
//! Codes may stand as near to one another as a drive drifts, so that the nearest pair alone proves nothing. As in joint compatibility (Neira &
//! Tardós 2001) the largest set of pairs wins that can all be true together. From each pair the search goes on greedily: it takes the pair
//! for one, which moves all other landmarks by their covariance with it, and looks for the next nearest.

use std::collections::HashSet;

use lrfslam_core::landmark::sight::inverse;
use lrfslam_core::landmark::{Fate, LandmarkConfig, chi_squared};
use nalgebra::{DMatrix, DVector, Matrix2, Vector2};

use super::MapLandmark;

/// Sets are grown from so many pairs, the nearest.
const SEEDS_MAX: usize = 100;
/// Variance of the difference of two landmarks that are one, m²: nothing but for the numbers' sake.
const SAME_M2: f64 = 1e-6;

/// Numbers of landmarks that were seen at one moment, the lower first: they are two.
pub type Together = HashSet<(u16, u16)>;

/// Which landmarks were seen together.
pub fn together(fates: &[Vec<Fate>]) -> Together {
    let mut seen = Together::new();
    for batch in fates {
        let numbers: Vec<u16> = batch.iter().filter_map(number).collect();
        for (place, a) in numbers.iter().enumerate() {
            seen.extend(numbers.iter().skip(place + 1).map(|b| (*a.min(b), *a.max(b))));
        }
    }
    seen
}

/// Number of the landmark that a sighting was taken for.
pub fn number(fate: &Fate) -> Option<u16> {
    match fate {
        Fate::Matched(number) | Fate::Began(number) => Some(*number),
        Fate::Refused | Fate::Full => None,
    }
}

/// Pairs of landmarks that are one, by index, the first of which was seen more often; no landmark is in two.
///
/// * `covariance` — of all their x and y, m²
pub fn duplicates(
    config: &LandmarkConfig,
    landmarks: &[MapLandmark],
    covariance: &DMatrix<f64>,
    together: &Together,
) -> Vec<(usize, usize)> {
    let deviations = f64::from(config.gate_deviations);
    let map = Gaussian {
        mean: DVector::from_iterator(2 * landmarks.len(), landmarks.iter().flat_map(|l| [l.at.x, l.at.y])),
        covariance: covariance.clone(),
    };
    let gate = chi_squared(2, deviations);
    let mut seeds: Vec<(f64, (usize, usize))> = Vec::new();
    for (a, one) in landmarks.iter().enumerate() {
        for (b, other) in landmarks.iter().enumerate().skip(a + 1) {
            let numbers = (one.number.min(other.number), one.number.max(other.number));
            let squared = map.squared(a, b).filter(|squared| *squared <= gate && !together.contains(&numbers));
            let pair = if one.sightings >= other.sightings { (a, b) } else { (b, a) };
            seeds.extend(squared.map(|squared| (squared, pair)));
        }
    }
    seeds.sort_by(|a, b| a.0.total_cmp(&b.0));
    let pairs: Vec<(usize, usize)> = seeds.iter().map(|seed| seed.1).collect();
    let sets = pairs.iter().take(SEEDS_MAX).map(|seed| map.grown(*seed, &pairs, deviations));
    // Of as many pairs, those that fit better.
    sets.max_by(|a, b| a.0.len().cmp(&b.0.len()).then(b.1.total_cmp(&a.1))).map(|set| set.0).unwrap_or_default()
}

/// Positions of all landmarks.
#[derive(Clone)]
struct Gaussian {
    mean: DVector<f64>,
    covariance: DMatrix<f64>,
}

impl Gaussian {
    /// Difference of two landmarks, and its covariance.
    fn difference(&self, a: usize, b: usize) -> (Vector2<f64>, Matrix2<f64>) {
        let block = |row: usize, column: usize| self.covariance.fixed_view::<2, 2>(2 * row, 2 * column).into_owned();
        let off = self.mean.fixed_rows::<2>(2 * a) - self.mean.fixed_rows::<2>(2 * b);
        (off, block(a, a) + block(b, b) - block(a, b) - block(b, a) + Matrix2::identity() * SAME_M2)
    }

    /// Squared Mahalanobis distance between two landmarks.
    fn squared(&self, a: usize, b: usize) -> Option<f64> {
        let (off, s) = self.difference(a, b);
        inverse(&s).map(|inverse| off.dot(&(inverse * off)))
    }

    /// Takes two landmarks for one: an update by their difference, which is nought (thesis eq. 3.22–3.24).
    fn join(&mut self, a: usize, b: usize) {
        let (off, s) = self.difference(a, b);
        let Some(inverse) = inverse(&s) else { return };
        let cross = self.covariance.fixed_columns::<2>(2 * a) - self.covariance.fixed_columns::<2>(2 * b);
        let gain = &cross * inverse;
        self.mean -= &gain * off;
        self.covariance -= gain * cross.transpose();
    }

    /// The pair `seed` and those of `pairs` that can be true with it and with one another; their squared distance in all.
    fn grown(&self, seed: (usize, usize), pairs: &[(usize, usize)], deviations: f64) -> (Vec<(usize, usize)>, f64) {
        let (mut map, mut set, mut next, mut sum) = (self.clone(), Vec::new(), Some(seed), 0.0);
        while let Some(pair) = next.take() {
            let squared = map.squared(pair.0, pair.1).unwrap_or(f64::INFINITY);
            if sum + squared > chi_squared(2 * (set.len() + 1), deviations) {
                break;
            }
            map.join(pair.0, pair.1);
            sum += squared;
            set.push(pair);
            let is_free = |(a, b): &(usize, usize)| !set.iter().any(|(c, d)| a == c || a == d || b == c || b == d);
            let left = pairs.iter().filter(|pair| is_free(pair));
            let near = left.filter_map(|pair| Some((map.squared(pair.0, pair.1)?, *pair)));
            let near = near.filter(|near| near.0 <= chi_squared(2, deviations));
            next = near.min_by(|a, b| a.0.total_cmp(&b.0)).map(|near| near.1);
        }
        (set, sum)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn landmark(number: u16, x: f64, y: f64) -> MapLandmark {
        let at = Vector2::new(x, y);
        MapLandmark { number, identity: None, sightings: 20 - number, at, covariance: Matrix2::identity() }
    }

    /// Three codes 0.2 m apart, mapped again 0.2 m beside: each is nearest to a wrong one, and only three pairs at once say which is which.
    #[test]
    fn a_row_of_codes_mapped_twice_is_one_row() {
        let first = [0.0, 0.2, 0.4].map(|x| (x, 0.0));
        let again = [0.19, 0.39, 0.59].map(|x| (x, 0.01));
        let places = first.into_iter().chain(again).chain([(5.0, 0.0)]);
        let landmarks: Vec<MapLandmark> = (0..).zip(places).map(|(n, (x, y))| landmark(n, x, y)).collect();
        // The second row drifted as a whole by 0.15 m, each code by 0.02 m.
        let of = |row: usize, column: usize| {
            let is_drifted = [row, column].iter().all(|index| (6..12).contains(index)) && row % 2 == column % 2;
            f64::from(u8::from(is_drifted)) * 0.15 * 0.15 + f64::from(u8::from(row == column)) * 0.02 * 0.02
        };
        let covariance = DMatrix::from_fn(14, 14, of);
        let config = LandmarkConfig::default();
        let mut found = duplicates(&config, &landmarks, &covariance, &Together::new());
        found.sort_unstable();
        assert_eq!(found, [(0, 3), (1, 4), (2, 5)]);
        let seen = together(&[vec![Fate::Matched(3), Fate::Refused, Fate::Began(0)]]);
        assert_eq!(seen, Together::from([(0, 3)]));
        let found = duplicates(&config, &landmarks, &covariance, &seen);
        assert!(!found.contains(&(0, 3)), "seen together, they are two: {found:?}");
    }
}
