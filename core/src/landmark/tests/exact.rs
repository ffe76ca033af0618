//! The update against a full matrix in the textbook's form, and what must hold whatever is seen.

use nalgebra::{Matrix2, SMatrix, SVector, Vector2};

use super::super::belief::{Belief, SightJacobian};
use super::super::covariance::{Symmetric, packed_len};
use super::super::sight::Place;
use super::super::*;

const COUNT: usize = 3;
const ORDER: usize = ROBOT + 2 * COUNT;

struct Memory {
    mean: Vec<f64>,
    covariance: Vec<f64>,
    work: Vec<[f64; 4]>,
}

impl Memory {
    fn new() -> Self {
        Self { mean: vec![0.0; ORDER], covariance: vec![0.0; packed_len(ORDER)], work: vec![[0.0; 4]; ORDER] }
    }

    /// A belief with any positive covariance and three landmarks.
    fn belief(&mut self) -> Belief<'_> {
        let root = RobotCovariance::from_fn(|r, c| 0.1 * ((r * 7 + c * 3) % 5) as f64 + if r == c { 0.5 } else { 0.0 });
        let start = root * root.transpose() * 0.1;
        let mut belief = Belief::new(&mut self.mean, &mut self.covariance, &mut self.work, &start).unwrap();
        belief.set_robot(&RobotState::new(0.3, -0.2, 0.4, 1.1, 0.9));
        for index in 0..COUNT {
            let place = Place {
                at: Vector2::new(2.0 + index as f64, 1.0 - index as f64),
                by_robot: nalgebra::Matrix2x3::new(1.0, 0.0, -1.0, 0.0, 1.0, 2.0 + index as f64),
                by_sighting: Matrix2::new(0.8, -0.6, 0.6, 0.8),
            };
            assert!(belief.add(&place, &Matrix2::new(0.04, 0.0, 0.0, 0.01)));
        }
        belief
    }
}

/// Mean and covariance; zeros where there is nothing.
fn dense(belief: &Belief<'_>) -> (SVector<f64, ORDER>, SMatrix<f64, ORDER, ORDER>) {
    let mut mean: Vec<f64> = belief.robot().iter().copied().collect();
    for landmark in 0..belief.landmarks() {
        mean.extend(belief.landmark(landmark).iter());
    }
    mean.resize(ORDER, 0.0);
    (SVector::from_column_slice(&mean), SMatrix::from_fn(|r, c| belief.covariance().at(r, c)))
}

/// A linear sighting with Gaussian noise: the filter's answer is the posterior itself, x + P Hᵀ S⁻¹ ν and P − P Hᵀ S⁻¹ H P.
#[test]
fn linear_updates_give_the_exact_posterior() {
    let mut memory = Memory::new();
    let mut belief = memory.belief();
    for round in 0..30 {
        let landmark = round % COUNT;
        let jacobian = SightJacobian::from_fn(|r, c| 0.3 * ((r + 2 * c + round) % 4) as f64 - 0.4);
        let (noise, off) = (Matrix2::new(0.02, 0.005, 0.005, 0.03), Vector2::new(0.03, -0.02) * (round as f64 - 14.0));
        let (mean, covariance) = dense(&belief);
        let mut h = SMatrix::<f64, 2, ORDER>::zeros();
        for (column, place) in [0, 1, 2, ROBOT + 2 * landmark, ROBOT + 2 * landmark + 1].into_iter().enumerate() {
            h.set_column(place, &jacobian.column(column));
        }
        let s = h * covariance * h.transpose() + noise;
        let gain = covariance * h.transpose() * s.try_inverse().unwrap();
        let exact_mean = mean + gain * off;
        let exact_covariance = covariance - gain * s * gain.transpose();
        assert!(belief.correct(landmark, &jacobian, off, &noise, false));
        let (mean, covariance) = dense(&belief);
        assert!((mean - exact_mean).abs().max() < 1e-9 && (covariance - exact_covariance).abs().max() < 1e-9);
    }
}

/// The invariant update ends within second order of the plain one, for covariance and mean.
#[test]
fn small_corrections_are_the_same_in_both_forms() {
    let (mut first, mut second) = (Memory::new(), Memory::new());
    let (mut plain, mut invariant) = (first.belief(), second.belief());
    let jacobian = SightJacobian::new(-0.9, 0.1, 0.4, 0.9, -0.1, 0.1, -0.5, -1.2, -0.1, 0.5);
    let (off, noise) = (Vector2::new(1e-4, -2e-4), Matrix2::new(0.01, 0.0, 0.0, 0.01));
    assert!(plain.correct(1, &jacobian, off, &noise, false) && invariant.correct(1, &jacobian, off, &noise, true));
    let ((a, p), (b, q)) = (dense(&plain), dense(&invariant));
    assert!((a - b).abs().max() < 1e-6 && (p - q).abs().max() < 1e-3);
}

/// What nearly knows itself: ten thousand sightings without much noise leave a covariance that still has a root.
#[test]
fn covariance_stays_positive() {
    for invariant in [false, true] {
        let mut memory = Memory::new();
        let mut belief = memory.belief();
        for round in 0..10_000_usize {
            let jacobian = SightJacobian::from_fn(|r, c| ((r * 3 + c * 5 + round * 7) % 11) as f64 - 5.0);
            belief.correct(round % COUNT, &jacobian, Vector2::zeros(), &(Matrix2::identity() * 1e-10), invariant);
        }
        let mut triangle = vec![0.0; packed_len(ORDER)];
        let mut factor = Symmetric::new(&mut triangle);
        assert!(factor.order_max() == ORDER && factor.grow(ORDER));
        for row in 0..ORDER {
            for (column, element) in belief.covariance().row(row).iter().enumerate() {
                factor.set(row, column, *element);
            }
        }
        assert!(factor.is_positive(1e-6), "invariant {invariant}");
    }
}

#[test]
fn removing_a_landmark_leaves_the_others_as_they_are() {
    let mut memory = Memory::new();
    let mut belief = memory.belief();
    let (mean, covariance) = dense(&belief);
    belief.remove(0);
    let (after, left) = dense(&belief);
    // The last has taken the first one's place.
    let places: Vec<usize> = (0..ROBOT).chain([ROBOT + 4, ROBOT + 5, ROBOT + 2, ROBOT + 3]).collect();
    for (row, from) in places.iter().enumerate() {
        assert_eq!(after[row], mean[*from]);
        for (column, other) in places.iter().enumerate() {
            assert_eq!(left[(row, column)], covariance[(*from, *other)]);
        }
    }
}
