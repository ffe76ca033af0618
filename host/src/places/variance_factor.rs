//! How many times larger the variances of the path are than it says itself: told by how far closures move the robot.
//!
//! The drift of a path is a model. Where matching is worse than that (a laser of few beams along a bare wall), the path is surer than it may
//! be: places that it came back to lie outside what is searched, and closures that are right do not agree with it. So the
//! displacement of each closure is compared with what was expected, and all variances of the path are multiplied by the ratio.
//!
//! Source: variance of unit weight, estimated a posteriori (Förstner & Wrobel, *Photogrammetric Computer Vision*, 2016, chapter 4), from the
//! innovations of a filter (Mehra, *On the identification of variances and adaptive Kalman filtering*, IEEE TAC 1970).

/// So many closures of a long drift weigh as much as what is known before the first one: that the factor is 1. Chosen.
const PRIOR: f64 = 1.0;
/// So many standard deviations are left to chance.
const CHANCE_SIGMAS: f64 = 2.0;
/// What a closure may be off in itself, m, standard deviation along each axis: beside it a short drift tells little. Chosen, the margin of
/// a search.
const CLOSURE_M: f64 = 0.3;

/// The factor, by weighted least squares over the closures that were found so far.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct VarianceFactor {
    /// Weighed squares of the displacements.
    found: f64,
    /// The same as the path expects them.
    expected: f64,
}

impl VarianceFactor {
    /// Takes a closure, whether it is believed or not.
    ///
    /// * `moved_m` — how far it moves the robot, m
    /// * `sigma_m` — how far it was expected to along each axis, by the path alone: one standard deviation, m
    pub fn observe(&mut self, moved_m: f64, sigma_m: f64) {
        let path = 2.0 * sigma_m * sigma_m;
        let weight = path / (path + 2.0 * CLOSURE_M * CLOSURE_M).powi(2);
        self.found += weight * moved_m * moved_m;
        self.expected += weight * path;
    }

    /// The least that is likely, so that chance alone changes nothing; at least 1, for a path that drifts less than expected may have been
    /// lucky.
    pub fn get(&self) -> f64 {
        let weight = self.expected + PRIOR;
        // Half the sum of two squared standard normal deviates has a standard deviation of 1.
        let chance = CHANCE_SIGMAS * weight.sqrt();
        ((self.found + PRIOR - chance) / weight).max(1.0)
    }
}

#[cfg(test)]
mod tests {
    use lrfslam_core::math::normal;
    use lrfslam_core::random::RandomStream;

    use super::*;

    /// After a hundred closures of a path whose drift is so many times what is expected.
    fn factor(times: f64, sigma_m: f64) -> f64 {
        let mut rng = RandomStream::new(1, 0, 0);
        let mut factor = VarianceFactor::default();
        for _ in 0..100 {
            let mut off = || times * sigma_m * f64::from(normal(&mut rng));
            factor.observe(off().hypot(off()), sigma_m);
        }
        factor.get()
    }

    #[test]
    fn the_variance_of_a_path_that_drifts_more_is_found() {
        assert!((factor(3.0, 2.0) / 9.0 - 1.0).abs() < 0.15, "{}", factor(3.0, 2.0));
        assert!((factor(1.0, 2.0) - 1.0).abs() < 0.15, "{}", factor(1.0, 2.0));
    }

    #[test]
    fn no_less_than_one_and_nothing_from_what_closures_are_off() {
        assert_eq!((VarianceFactor::default().get(), factor(0.2, 2.0)), (1.0, 1.0));
        assert!(factor(5.0, 0.02) < 1.1, "10 cm are nothing beside what a closure is off: {}", factor(5.0, 0.02));
    }
}
