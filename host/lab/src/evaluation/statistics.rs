//! Mean, spread and worst of a list of errors; the distribution of signed ones.

use serde::Serialize;

/// Of absolute errors.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Statistics {
    /// How many.
    pub count: usize,
    /// Mean.
    pub mean: f64,
    /// Standard deviation (divided by the count).
    pub std: f64,
    /// Root of the mean square.
    pub rmse: f64,
    /// Half lie below.
    pub median: f64,
    /// The largest.
    pub max: f64,
}

impl Statistics {
    /// Of `errors`; all zero if there are none.
    pub fn of(errors: &[f64]) -> Self {
        if errors.is_empty() {
            return Self::default();
        }
        let n = errors.len() as f64;
        let mean = errors.iter().sum::<f64>() / n;
        let variance = errors.iter().map(|e| (e - mean) * (e - mean)).sum::<f64>() / n;
        Self {
            count: errors.len(),
            mean,
            std: variance.sqrt(),
            rmse: (errors.iter().map(|e| e * e).sum::<f64>() / n).sqrt(),
            median: median(errors.to_vec()),
            max: errors.iter().copied().fold(f64::NEG_INFINITY, f64::max),
        }
    }
}

/// Of signed errors: what a Gaussian noise model needs, and how far it is from one.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Distribution {
    /// How many.
    pub count: usize,
    /// Mean.
    pub mean: f64,
    /// Standard deviation (divided by the count): every outlier counts.
    pub std: f64,
    /// 1.4826 times the median distance from the median: the same for a Gaussian, and blind to a few outliers.
    pub robust_std: f64,
    /// Share farther than three times that from the median, 0 to 1; 0.0027 for a Gaussian.
    pub beyond_three: f64,
}

impl Distribution {
    /// Of `errors`; all zero if there are none.
    pub fn of(errors: &[f64]) -> Self {
        if errors.is_empty() {
            return Self::default();
        }
        let n = errors.len() as f64;
        let mean = errors.iter().sum::<f64>() / n;
        let centre = median(errors.to_vec());
        let robust_std = 1.4826 * median(errors.iter().map(|e| (e - centre).abs()).collect());
        Self {
            count: errors.len(),
            mean,
            std: (errors.iter().map(|e| (e - mean) * (e - mean)).sum::<f64>() / n).sqrt(),
            robust_std,
            beyond_three: errors.iter().filter(|&e| (e - centre).abs() > 3.0 * robust_std).count() as f64 / n,
        }
    }
}

/// Half lie below; `values` has at least one.
fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    (values[(values.len() - 1) / 2] + values[values.len() / 2]) / 2.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn four_errors_have_known_statistics() {
        let of = Statistics::of(&[1.0, 3.0, 2.0, 6.0]);
        assert_eq!((of.count, of.mean, of.median, of.max), (4, 3.0, 2.5, 6.0));
        assert_eq!(of.std, 3.5_f64.sqrt());
        assert_eq!(of.rmse, 12.5_f64.sqrt());
        assert_eq!(Statistics::of(&[]), Statistics::default());
    }

    #[test]
    fn one_outlier_moves_the_standard_deviation_but_not_the_robust_one() {
        let mut errors: Vec<f64> = (-50..=50).map(f64::from).collect();
        let clean = Distribution::of(&errors);
        assert_eq!((clean.mean, clean.beyond_three), (0.0, 0.0));
        assert!((clean.std - 850_f64.sqrt()).abs() < 1e-9 && (clean.robust_std - 1.4826 * 25.0).abs() < 1e-9);
        errors.push(10_000.0);
        let spoilt = Distribution::of(&errors);
        assert!(spoilt.std > 900.0 && spoilt.robust_std < 40.0 && (spoilt.beyond_three - 1.0 / 102.0).abs() < 1e-9);
        assert_eq!(Distribution::of(&[]), Distribution::default());
    }
}
