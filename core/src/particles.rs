//! Particles and samples: log weights, how many of them count, and which survive.
//!
//! A **particle** has a map: it is a leaf of the ancestry tree. A **sample** is a pose that one of them tries for the next
//! scan. samples → weigh → [`normalise`] → [`resample`] → those drawn become the particles. One drawn
//! several times becomes one particle with that many `draws`: its copies would have printed the same scan at the same pose, so
//! they share one map until they are moved apart; a draw is a place in the next round of samples.
//!
//! Samples stand in the order of the particles they come from, particles in the order of the tree's leaves.

use rand_core::Rng;

use crate::ancestry::NodeId;
use crate::geometry::Pose2;
use crate::math::{exp_neg, uniform};

/// A pose with a map. All zero when unused.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Particle {
    /// Where the robot was when the last scan was taken.
    pub map_from_robot: Pose2,
    /// Whose map it reads and writes.
    pub node: NodeId,
    /// How many times it was drawn: it gets so many shares of the next samples.
    pub draws: u16,
    /// Index that its parent had among the particles of the step before. Who keeps these has the path of every particle.
    pub parent: u16,
    /// Its share of the posterior at the last step, before resampling.
    pub weight: f32,
    /// Logarithm of the weight that it carries on, 0 after resampling.
    pub log_weight: f32,
    /// How far off the speed is that it carries on, standard deviations; 0 where the speed is told.
    pub(crate) speed: f32,
    /// Its samples of this step: the first, and one past the last.
    pub(crate) samples: [u32; 2],
}

impl Particle {
    /// A particle of an all-zero pool.
    pub const UNUSED: Self = Self {
        map_from_robot: Pose2::IDENTITY,
        node: NodeId::NONE,
        draws: 0,
        parent: 0,
        weight: 0.0,
        log_weight: 0.0,
        speed: 0.0,
        samples: [0, 0],
    };
}

/// A pose being tried. All zero when unused.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Sample {
    /// Where the robot may be.
    pub map_from_robot: Pose2,
    /// Logarithm of its weight, not normalised.
    pub log_weight: f32,
    /// Its weight; all add up to 1.
    pub weight: f32,
    /// Index of the particle whose map it is tried in.
    pub parent: u16,
    /// How many times it was drawn.
    pub draws: u16,
    /// See [`Particle`].
    pub(crate) speed: f32,
    /// Leaf that it will have.
    pub(crate) node: NodeId,
}

impl Sample {
    /// A sample of an all-zero pool.
    pub const UNUSED: Self = Self {
        map_from_robot: Pose2::IDENTITY,
        log_weight: 0.0,
        weight: 0.0,
        parent: 0,
        draws: 0,
        speed: 0.0,
        node: NodeId::NONE,
    };
}

/// What the weights say.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Weights {
    /// 1 / Σ w²: from 1 (one sample has it all) to the number of samples.
    pub effective_sample_size: f32,
    /// Index of the heaviest sample.
    pub best: usize,
    /// Its log weight.
    pub best_log_weight: f32,
}

/// Turns log weights into weights that add up to 1 (all equal if no log weight is finite); `None` without samples.
pub fn normalise(samples: &mut [Sample]) -> Option<Weights> {
    let mut weights = Weights { best_log_weight: f32::NEG_INFINITY, ..Weights::default() };
    for (index, sample) in samples.iter().enumerate() {
        if sample.log_weight > weights.best_log_weight {
            weights = Weights { best: index, best_log_weight: sample.log_weight, ..weights };
        }
    }
    let known = weights.best_log_weight.is_finite();
    let mut sum = 0.0;
    for sample in samples.iter_mut() {
        sample.weight = if known { exp_neg(sample.log_weight - weights.best_log_weight) } else { 1.0 };
        sum += sample.weight;
    }
    let mut squares = 0.0;
    for sample in samples.iter_mut() {
        sample.weight /= sum;
        squares += sample.weight * sample.weight;
    }
    weights.effective_sample_size = 1.0 / squares;
    (!samples.is_empty()).then_some(weights)
}

/// Draws `draws` times among the samples by weight, and writes down how often each was drawn (thesis §4.2, step 4).
///
/// Departure: in equal steps, where the thesis makes every draw on its own, which adds noise for nothing.
/// Weights must have been [normalised](normalise); no more than `draws` different samples survive.
pub fn resample(samples: &mut [Sample], draws: u16, rng: &mut impl Rng) {
    samples.iter_mut().for_each(|sample| sample.draws = 0);
    let left = draw_in_steps(samples, draws, rng);
    // Weights may add up to a little less than 1.
    let heaviest = samples.iter_mut().max_by(|a, b| a.weight.total_cmp(&b.weight));
    if let Some(sample) = heaviest.filter(|_| left > 0) {
        sample.draws += left;
    }
}

/// Low-variance resampling (Thrun, Burgard & Fox table 4.4); returns the draws that rounding left over.
fn draw_in_steps(samples: &mut [Sample], draws: u16, rng: &mut impl Rng) -> u16 {
    let first = uniform(rng);
    let (mut drawn, mut cumulative) = (0_u16, 0.0);
    for sample in samples {
        cumulative += sample.weight * f32::from(draws);
        while drawn < draws && f32::from(drawn) + first < cumulative {
            sample.draws += 1;
            drawn += 1;
        }
    }
    draws - drawn
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::RandomStream;
    use proptest::prelude::*;

    fn samples<const N: usize>(log_weights: [f32; N]) -> [Sample; N] {
        log_weights.map(|log_weight| Sample { log_weight, ..Sample::default() })
    }

    #[test]
    fn weights_add_up_and_know_their_best() {
        let mut four = samples([-1000.0, -1001.0, f32::NEG_INFINITY, -1000.5]);
        let weights = normalise(&mut four).unwrap();
        assert_eq!((weights.best, weights.best_log_weight, four[2].weight), (0, -1000.0, 0.0));
        assert!((four.iter().map(|s| s.weight).sum::<f32>() - 1.0).abs() < 1e-6);
        assert!((four[1].weight / four[0].weight - libm::expf(-1.0)).abs() < 1e-6);
    }

    #[test]
    fn effective_sample_size_counts() {
        assert!((normalise(&mut samples([3.0; 8])).unwrap().effective_sample_size - 8.0).abs() < 1e-5);
        assert!((normalise(&mut samples([0.0, -90.0])).unwrap().effective_sample_size - 1.0).abs() < 1e-5);
        assert_eq!(normalise(&mut []), None);
    }

    #[test]
    fn without_any_chance_all_are_equal() {
        for hopeless in [f32::NEG_INFINITY, f32::NAN] {
            let mut four = samples([hopeless; 4]);
            assert_eq!(normalise(&mut four).unwrap().effective_sample_size, 4.0);
            assert!(four.iter().all(|sample| sample.weight == 0.25));
        }
    }

    proptest! {
        #[test]
        fn systematic_draws_differ_from_their_expectation_by_less_than_one(
            log_weights in prop::array::uniform9(-6.0..0.0_f32), draws in 1..200_u16, seed in any::<u64>(),
        ) {
            let mut nine = samples(log_weights);
            normalise(&mut nine);
            resample(&mut nine, draws, &mut RandomStream::new(seed, 0, 0));
            prop_assert_eq!(nine.iter().map(|s| s.draws).sum::<u16>(), draws);
            for sample in nine {
                prop_assert!((f32::from(sample.draws) - sample.weight * f32::from(draws)).abs() < 1.01);
            }
        }
    }
}
