//! Fits the noise of the scan-matching motion model (thesis table 4.7) to measured errors.
//!
//! Matching against a whole map makes two kinds of error. One is there in every pose and does not add up: a later match corrects
//! it. The other one drifts: the map itself goes astray, step by step. Over n steps of the filter a displacement's error
//! has the variance a + b n. Particles need the second kind: √b a step is their noise; the first kind is in no map, and noise of
//! its size would only shake particles off the path that matching has found.
//!
//! Along an axis that the scene leaves undetermined the match is no more than the prediction. How wrong that is shows wherever the scene does determine
//! the motion.

use lrfslam_core::geometry::Pose2;
use lrfslam_core::motion::ScanMatchingMotionConfig;

use lrfslam_host::pose_f64::PoseF64;
use serde::Serialize;

/// Equal shares of the errors, by number of steps, from which the line is fitted.
const BINS: usize = 12;
/// Standard deviation of a normal distribution over the median of its absolute values.
const SIGMA_PER_MEDIAN: f64 = 1.4826;

/// Error of a displacement over a number of steps.
#[derive(Debug, Clone, Copy)]
pub struct DisplacementError {
    /// Steps of the filter between its ends.
    pub steps: f64,
    /// True displacement⁻¹ ⊕ displacement found.
    pub error: PoseF64,
}

/// Variance a + b n.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Growth {
    /// √a, of every displacement.
    pub constant: f64,
    /// √b, for one step.
    pub per_step: f64,
}

/// What was fitted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotionFit {
    /// Forward, m.
    pub forward_m: Growth,
    /// Lateral, m.
    pub lateral_m: Growth,
    /// Heading, degrees.
    pub heading_deg: Growth,
    /// Standard deviation of the prediction's error over one step, forward, m.
    pub prediction_m: f64,
}

impl MotionFit {
    /// Fits `errors` (at least two) and `predictions`: matched pose seen from the predicted one, scan by scan where the scene determined it.
    ///
    /// `scans_per_step` — of the filter, on average. `None` if there is too little to fit.
    pub fn new(errors: &[DisplacementError], predictions: &[Pose2], scans_per_step: f64) -> Option<Self> {
        if errors.len() < 2 || predictions.is_empty() {
            return None;
        }
        let growth = |part: fn(&PoseF64) -> f64| {
            let of = errors.iter().map(|e| (e.steps, part(&e.error))).collect();
            Growth::fit(of)
        };
        let forward = predictions.iter().map(|pose| f64::from(pose.x)).collect();
        Some(Self {
            forward_m: growth(|e| e.x),
            lateral_m: growth(|e| e.y),
            heading_deg: growth(|e| e.heading.to_degrees()),
            // Errors of one prediction after the other add up like steps of a random walk.
            prediction_m: robust_sigma(forward) * scans_per_step.max(1.0).sqrt(),
        })
    }

    /// The motion model with this noise.
    pub fn config(&self) -> ScanMatchingMotionConfig {
        ScanMatchingMotionConfig {
            forward_m: self.forward_m.per_step as f32,
            lateral_m: self.lateral_m.per_step as f32,
            heading_deg: self.heading_deg.per_step as f32,
            undetermined_m: self.prediction_m as f32,
        }
    }
}

impl Growth {
    /// Least squares through the variances of equal shares of `(steps, error)`, each weighted by the inverse square of its variance, since
    /// that is how uncertain it is; neither term is negative.
    fn fit(mut errors: Vec<(f64, f64)>) -> Self {
        errors.sort_by(|x, y| x.0.total_cmp(&y.0));
        let size = errors.len().div_ceil(BINS).max(1);
        let bins: Vec<(f64, f64)> = errors
            .chunks(size)
            .map(|bin| {
                let steps = bin.iter().map(|(steps, _)| steps).sum::<f64>() / bin.len() as f64;
                (steps, robust_sigma(bin.iter().map(|(_, error)| *error).collect()).powi(2).max(1e-18))
            })
            .collect();
        let sum = |of: &dyn Fn(f64, f64) -> f64| bins.iter().map(|&(n, v)| of(n, v) / (v * v)).sum::<f64>();
        let (w, wn, wnn) = (sum(&|_, _| 1.0), sum(&|n, _| n), sum(&|n, _| n * n));
        let (wv, wnv) = (sum(&|_, v| v), sum(&|n, v| n * v));
        let determinant = w * wnn - wn * wn;
        let b = if determinant > 1e-12 * w * wnn { (w * wnv - wn * wv) / determinant } else { 0.0 };
        let a = (wv - b * wn) / w;
        let (a, b) = if b <= 0.0 {
            (wv / w, 0.0)
        } else if a <= 0.0 {
            (0.0, wnv / wnn)
        } else {
            (a, b)
        };
        Self { constant: a.sqrt(), per_step: b.sqrt() }
    }
}

/// Standard deviation by the median of absolute values: blind to the few errors of another kind.
fn robust_sigma(errors: Vec<f64>) -> f64 {
    let mut sizes: Vec<f64> = errors.into_iter().map(f64::abs).collect();
    sizes.sort_by(f64::total_cmp);
    sizes.get(sizes.len() / 2).map_or(0.0, |median| SIGMA_PER_MEDIAN * median)
}

#[cfg(test)]
mod tests {
    use super::*;
    use lrfslam_core::math::normal;
    use lrfslam_core::random::RandomStream;

    /// Errors over 1 to 300 steps, of which `outliers` in a hundred are wild.
    fn errors(constant: f64, per_step: f64, outliers: u32) -> Vec<DisplacementError> {
        let mut rng = RandomStream::new(3, 0, 0);
        (0..6000)
            .map(|i| {
                let steps = f64::from(1 + i % 300);
                let sigma = (constant * constant + per_step * per_step * steps).sqrt();
                let mut draw = |scale: f64| sigma * scale * f64::from(normal(&mut rng));
                let mut error = PoseF64::new(draw(1.0), draw(0.5), draw(0.1));
                error.x += if (i as u32).wrapping_mul(2_654_435_761) % 100 < outliers { 50.0 } else { 0.0 };
                DisplacementError { steps, error }
            })
            .collect()
    }

    #[test]
    fn both_kinds_of_error_are_told_apart() {
        for outliers in [0, 5] {
            let fit = MotionFit::new(&errors(0.02, 0.003, outliers), &[Pose2::new(0.01, 0.0, 0.0)], 4.0).unwrap();
            let near = |growth: Growth, scale: f64| {
                assert!((growth.constant / (0.02 * scale) - 1.0).abs() < 0.2, "{growth:?}");
                assert!((growth.per_step / (0.003 * scale) - 1.0).abs() < 0.2, "{growth:?}");
            };
            near(fit.forward_m, 1.0);
            near(fit.lateral_m, 0.5);
            near(fit.heading_deg, 0.1_f64.to_degrees());
            assert!((fit.prediction_m - 2.0 * SIGMA_PER_MEDIAN * 0.01).abs() < 1e-6);
        }
    }

    #[test]
    fn errors_that_do_not_grow_have_no_drift_and_drift_alone_no_constant() {
        let still = MotionFit::new(&errors(0.02, 0.0, 0), &[Pose2::IDENTITY], 1.0).unwrap();
        assert!(still.forward_m.per_step < 3e-4, "{still:?}");
        let drift = MotionFit::new(&errors(0.0, 0.003, 0), &[Pose2::IDENTITY], 1.0).unwrap();
        assert!(drift.forward_m.constant < 3e-3 && (drift.forward_m.per_step / 0.003 - 1.0).abs() < 0.1, "{drift:?}");
        assert_eq!(MotionFit::new(&[], &[], 1.0), None);
    }
}
