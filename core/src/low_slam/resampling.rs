//! When survivors are drawn, and how many: few where all particles agree, many where they are at different places.
//!
//! KLD-sampling (Fox, *Adapting the sample size in particle filters through KLD-sampling*, IJRR 2003): the bins that the particles fill say how
//! many of them it takes for their distribution to be within ε of the true one, with probability 1 − δ. Bins are as fine as the maps: particles less than a square
//! apart draw the same one.
//!
//! Departure: drawing stops at a number that the samples of the step give, instead of counting bins draw by draw, so that survivors can be drawn
//! in equal steps.

use super::{LowSlam, LowSlamConfigs};
use crate::geometry::Pose2;
use crate::math::wrap_angle;
use crate::particles::{self, Sample, Weights};
use crate::random::RandomStream;

/// Resampling waits until the effective sample size falls to this share of those drawn the last time. Between, weights add up: particles are compared by
/// several scans and fewer good ones die of chance, which is what closing a loop lives on. The thesis: 1, after every scan. Not looked
/// at with more samples than particles, where only resampling chooses who is kept.
const RESAMPLE_SHARE: f32 = 0.5;
/// ε. Chosen: two places ask for 22 particles, five for 44.
const ERROR: f32 = 0.15;
/// Quantile of the normal distribution at 1 − δ = 0.99.
const QUANTILE: f32 = 2.326;
/// A sample whose weight is less than this share of the mean one is hardly drawn, and fills no bin. Chosen.
const WEIGHT_MIN: f32 = 0.1;
/// Headings are of one bin if a wall so far away is drawn in the same squares, m. Chosen.
const WALL_M: f32 = 10.0;
/// Bins are told apart by so many bits of a hash. All of them ask for some 3,700 particles, the most that spread can ask for.
const BINS: usize = 1024;

impl<const SIDE: usize> LowSlam<'_, SIDE> {
    /// Draws survivors if the weights have become too unequal, or there are too many samples for the memory or too few; else all go on: those that are too many
    /// go when weights tell which.
    pub(super) fn resample(&mut self, weights: &Weights, is_open: bool) -> bool {
        let draws = self.needed(is_open);
        let enough = RESAMPLE_SHARE * f32::from(self.draws);
        let has_room = self.sample_count <= self.particles_max() && draws <= self.draws;
        let drawn = !has_room || weights.effective_sample_size <= enough;
        if drawn {
            self.draws = draws;
            let mut rng = RandomStream::new(self.seed, self.steps, u32::MAX);
            particles::resample(self.samples_mut(), draws, &mut rng);
        }
        for sample in self.samples_mut() {
            if drawn {
                sample.log_weight = 0.0;
            } else {
                sample.draws = 1;
                sample.log_weight -= weights.best_log_weight;
            }
        }
        drawn
    }

    /// Draws that the samples ask for.
    fn needed(&self, is_open: bool) -> u16 {
        let most = self.particles_max;
        let least = self.config.draws_at_one_place(most);
        if is_open || least == most {
            return most;
        }
        particles_for(bins(self.samples(), self.config.map.square_size_m)).clamp(least, most)
    }
}

impl LowSlamConfigs {
    /// Draws of a particle that stands for all, with room for `most`.
    pub(super) fn draws_at_one_place(&self, most: u16) -> u16 {
        if self.closes_loops { most } else { self.filter.particles_min.min(most) }
    }
}

/// n = (k − 1) / 2ε (1 − 2 / (9 (k − 1)) + √(2 / (9 (k − 1))) z)³ for k bins.
fn particles_for(bins: usize) -> u16 {
    let Some(more) = bins.checked_sub(1).filter(|more| *more > 0) else { return 1 };
    let more = more as f32;
    let part = 2.0 / (9.0 * more);
    let root = 1.0 - part + libm::sqrtf(part) * QUANTILE;
    // A cast saturates.
    (more / (2.0 * ERROR) * root * root * root) as u16
}

/// Bins that samples fill, about the heaviest one: a small cloud about it fills one bin and not the eight that meet at a corner.
fn bins(samples: &[Sample], square_m: f32) -> usize {
    let Some(centre) = samples.iter().max_by(|a, b| a.weight.total_cmp(&b.weight)) else { return 0 };
    let least = WEIGHT_MIN / samples.len() as f32;
    let mut filled = [0_u32; BINS / 32];
    for sample in samples.iter().filter(|sample| sample.weight >= least && sample.map_from_robot.is_finite()) {
        let bin = bin(centre.map_from_robot, sample.map_from_robot, square_m);
        if let Some(word) = filled.get_mut(bin / 32) {
            *word |= 1 << (bin % 32);
        }
    }
    filled.iter().map(|word| word.count_ones() as usize).sum()
}

fn bin(centre: Pose2, pose: Pose2, square_m: f32) -> usize {
    let index = |apart: f32, size: f32| libm::roundf(apart / size) as i32 as u32;
    let heading = wrap_angle(pose.heading - centre.heading);
    let parts =
        [index(pose.x - centre.x, square_m), index(pose.y - centre.y, square_m), index(heading, square_m / WALL_M)];
    // FNV-1a, a word at a time; its high bits depend on all of what went in.
    let hash = parts.iter().fold(0x811c_9dc5_u32, |hash, part| (hash ^ part).wrapping_mul(0x0100_0193));
    (hash ^ (hash >> 16)) as usize % BINS
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    fn at(places: impl Iterator<Item = (f32, f32)>) -> Vec<Sample> {
        let mut samples: Vec<Sample> = places
            .map(|(x, heading)| Sample { map_from_robot: Pose2::new(x, 3.0, heading), ..Sample::default() })
            .collect();
        let weight = 1.0 / samples.len() as f32;
        samples.iter_mut().for_each(|sample| sample.weight = weight);
        samples
    }

    #[test]
    fn bins_are_squares_and_headings_about_the_heaviest() {
        // At the border of two squares, were they those of the map.
        assert_eq!(bins(&at((0..50).map(|i| (0.05 + 1e-4 * i as f32, 0.0))), 0.1), 1);
        assert_eq!(bins(&at((0..50).map(|i| (0.1 * (i % 5) as f32, 0.0))), 0.1), 5);
        assert_eq!(bins(&at((0..50).map(|i| (0.0, 0.01 * (i % 3) as f32))), 0.1), 3);
        let mut samples = at((0..50).map(|i| (0.1 * i as f32, 0.0)));
        samples.iter_mut().skip(2).for_each(|sample| sample.weight = 1e-6);
        assert_eq!(bins(&samples, 0.1), 2, "what will not be drawn is no place");
        assert_eq!(bins(&[], 0.1), 0);
    }

    /// Table values of the χ² distribution: n = χ²(k − 1, 0.99) / 2ε.
    #[test]
    fn numbers_are_those_of_the_chi_square_distribution() {
        for (bins, chi2) in [(2, 6.635), (3, 9.210), (6, 15.086), (11, 23.209), (101, 135.807)] {
            let expected = chi2 / (2.0 * ERROR);
            assert!((f32::from(particles_for(bins)) - expected).abs() < 0.02 * expected + 1.0, "{bins} bins");
        }
        assert_eq!((particles_for(0), particles_for(1)), (1, 1));
        assert_eq!(particles_for(usize::MAX), u16::MAX);
    }
}
