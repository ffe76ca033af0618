//! Mean, spread and worst of a list of errors.

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
        let mut sorted = errors.to_vec();
        sorted.sort_by(f64::total_cmp);
        Self {
            count: errors.len(),
            mean,
            std: variance.sqrt(),
            rmse: (errors.iter().map(|e| e * e).sum::<f64>() / n).sqrt(),
            median: (sorted[(sorted.len() - 1) / 2] + sorted[sorted.len() / 2]) / 2.0,
            max: sorted[sorted.len() - 1],
        }
    }
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
}
