//! Is a covariance honest? Errors over what it says, against the normal distribution that it claims.
//!
//! Of an honest covariance Σ the square dᵀ Σ⁻¹ d of the errors d is 3 on average (χ² with three degrees of freedom; Bar-Shalom, Li &
//! Kirubarajan 2001, 5.4: NEES), and 68.3, 95.4 and 99.7 % of the errors along an axis lie within 1, 2 and 3 standard deviations.

use std::fmt::Write as _;

use lrfslam_core::geometry::Pose2;
use lrfslam_core::math::wrap_angle;
use nalgebra::{Matrix2, Matrix3, SymmetricEigen, Vector2, Vector3};
use plotters::prelude::*;
use serde::Serialize;

use super::plots::{Area, OURS, PlotError, THESIS, draw_distribution, tick};
use crate::evaluation::Distribution;

/// The axes of a covariance: of its position the wider and the narrower one, and the heading.
const AXES: [&str; 3] = ["wide axis", "narrow axis", "heading"];
/// A panel's size, pixels.
const PANEL: (u32, u32) = (300, 220);
/// Squares shown.
const SQUARE_MAX: f64 = 15.0;

/// One match's error over its own standard deviations.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct NormalisedError {
    /// dᵀ Σ⁻¹ d over (x, y, heading).
    pub square: f64,
    /// Errors over standard deviations: along the wider and the narrower axis of the position, and of the heading.
    pub axes: [f64; 3],
    /// These standard deviations: m, m, rad.
    pub sigmas: [f64; 3],
}

impl NormalisedError {
    /// Of a match at `found`; `None` if the covariance is not positive definite.
    pub fn of(found: Pose2, truth: Pose2, covariance: &Matrix3<f32>) -> Option<Self> {
        let heading = f64::from(wrap_angle(found.heading - truth.heading));
        let error = Vector3::new(f64::from(found.x - truth.x), f64::from(found.y - truth.y), heading);
        let covariance = covariance.cast::<f64>();
        let covariance = 0.5 * (covariance + covariance.transpose());
        let square = error.dot(&covariance.cholesky()?.solve(&error));
        let position: Matrix2<f64> = covariance.fixed_view::<2, 2>(0, 0).into();
        let eigen = SymmetricEigen::new(position);
        let (wide, narrow) = if eigen.eigenvalues[0] >= eigen.eigenvalues[1] { (0, 1) } else { (1, 0) };
        let variances = [eigen.eigenvalues[wide], eigen.eigenvalues[narrow], covariance[(2, 2)]];
        let sigmas = variances.map(|variance| variance.max(1e-18).sqrt());
        let along = |axis: usize| eigen.eigenvectors.column(axis).dot(&Vector2::new(error.x, error.y));
        let axes = [along(wide) / sigmas[0], along(narrow) / sigmas[1], heading / sigmas[2]];
        Some(Self { square, axes, sigmas })
    }
}

/// Along one axis.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct AxisShares {
    /// Which.
    pub axis: &'static str,
    /// Share of the errors within 1, 2 and 3 standard deviations, 0 to 1; honest: 0.683, 0.954, 0.997.
    pub within: [f64; 3],
    /// Median standard deviation that was told: m, or rad for the heading.
    pub median_sigma: f64,
}

/// Of many errors.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct NormalisedSummary {
    /// How many.
    pub count: usize,
    /// Mean of the squares; honest: 3.
    pub mean_square: f64,
    /// Their median; honest: 2.37.
    pub median_square: f64,
    /// Axis by axis.
    pub axes: Vec<AxisShares>,
}

impl NormalisedSummary {
    /// Of `errors`; all zero if there are none.
    pub fn of(errors: &[NormalisedError]) -> Self {
        let count = errors.len();
        let share = |number: usize| number as f64 / count.max(1) as f64;
        let within = |axis: usize, sigmas: f64| share(errors.iter().filter(|e| e.axes[axis].abs() <= sigmas).count());
        let axis = |(axis, name): (usize, &'static str)| AxisShares {
            axis: name,
            within: [1.0, 2.0, 3.0].map(|sigmas| within(axis, sigmas)),
            median_sigma: middle(errors.iter().map(|error| error.sigmas[axis]).collect()),
        };
        Self {
            count,
            mean_square: errors.iter().map(|error| error.square).sum::<f64>() / count.max(1) as f64,
            median_square: middle(errors.iter().map(|error| error.square).collect()),
            axes: AXES.into_iter().enumerate().map(axis).collect(),
        }
    }
}

fn middle(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or_default()
}

/// The errors as CSV, a line each.
pub fn normalised_csv(errors: &[NormalisedError]) -> String {
    let mut text = String::from("square,wide,narrow,heading,sigma_wide_m,sigma_narrow_m,sigma_heading_rad\n");
    for NormalisedError { square, axes: [wide, narrow, heading], sigmas: [a, b, c] } in errors {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{square:.4},{wide:.4},{narrow:.4},{heading:.4},{a:.6},{b:.6},{c:.7}");
    }
    text
}

/// Histograms of the errors along each axis with the normal distribution (red), and the share of squares below a value with that of χ².
///
/// # Errors
/// If drawing fails.
pub fn plot_normalised(errors: &[NormalisedError]) -> Result<String, PlotError> {
    let mut svg = String::new();
    {
        let root = SVGBackend::with_string(&mut svg, (PANEL.0 * 4, PANEL.1)).into_drawing_area();
        root.fill(&WHITE)?;
        let panels = root.split_evenly((1, 4));
        let claimed = Distribution { std: 1.0, robust_std: 1.0, ..Distribution::default() };
        for (axis, (name, panel)) in AXES.iter().zip(&panels).enumerate() {
            let values: Vec<f64> = errors.iter().map(|error| error.axes[axis]).collect();
            draw_distribution(panel, &format!("{name}: error / σ"), &values, &claimed)?;
        }
        if let Some(panel) = panels.last() {
            draw_squares(panel, errors)?;
        }
        root.present()?;
    }
    Ok(svg)
}

fn draw_squares(area: &Area<'_>, errors: &[NormalisedError]) -> Result<(), PlotError> {
    let mut chart = ChartBuilder::on(area)
        .margin(6)
        .caption("share of dᵀ Σ⁻¹ d below", ("sans-serif", 13))
        .x_label_area_size(18)
        .y_label_area_size(30)
        .build_cartesian_2d(0.0..SQUARE_MAX, 0.0..1.0)?;
    chart
        .configure_mesh()
        .disable_mesh()
        .x_labels(6)
        .y_labels(5)
        .y_label_formatter(&tick)
        .label_style(("sans-serif", 10))
        .draw()?;
    let mut squares: Vec<f64> = errors.iter().map(|error| error.square).collect();
    squares.sort_by(f64::total_cmp);
    let count = squares.len().max(1) as f64;
    let measured = squares.into_iter().enumerate().map(|(rank, square)| (square, (rank + 1) as f64 / count));
    chart.draw_series(LineSeries::new(measured.take_while(|point| point.0 <= SQUARE_MAX), OURS.stroke_width(2)))?;
    chart.draw_series(LineSeries::new(chi_squared(), THESIS.stroke_width(2)))?;
    Ok(())
}

/// Points of the distribution function of χ² with three degrees of freedom, its density √x e^(−x/2) / √(2π) added up in small steps.
fn chi_squared() -> impl Iterator<Item = (f64, f64)> {
    let step = SQUARE_MAX / 1500.0;
    (0..1500).scan(0.0, move |below, i| {
        let x = (f64::from(i) + 0.5) * step;
        *below += step * x.sqrt() * (-0.5 * x).exp() / std::f64::consts::TAU.sqrt();
        Some((x + 0.5 * step, *below))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_measured_along_the_axes_of_the_covariance() {
        // 3 cm along the diagonal, 1 cm across, 0.1 rad.
        let (wide, narrow) = (9e-4_f32, 1e-4_f32);
        let (mean, half) = (0.5 * (wide + narrow), 0.5 * (wide - narrow));
        let covariance = Matrix3::new(mean, half, 0.0, half, mean, 0.0, 0.0, 0.0, 0.01);
        let truth = Pose2::new(5.0, 2.0, 3.1);
        let along = 0.045 * std::f32::consts::FRAC_1_SQRT_2;
        let found = Pose2::new(5.0 + along, 2.0 + along, -3.1 + 0.1 - (std::f32::consts::TAU - 6.2));
        let error = NormalisedError::of(found, truth, &covariance).unwrap();
        let [wide, narrow, heading] = error.axes;
        assert!((wide.abs() - 1.5).abs() < 1e-3 && narrow.abs() < 1e-3 && (heading - 1.0).abs() < 1e-3, "{error:?}");
        assert!((error.square - 3.25).abs() < 1e-2, "{error:?}");
        assert!(NormalisedError::of(found, truth, &-covariance).is_none());
        let summary = NormalisedSummary::of(&[error]);
        assert_eq!(summary.axes[0].within, [0.0, 1.0, 1.0]);
        assert!(plot_normalised(&[error]).unwrap().contains("narrow axis"));
    }

    #[test]
    fn the_curve_drawn_is_that_of_three_degrees_of_freedom() {
        let at = |x: f64| chi_squared().find(|point| point.0 >= x).unwrap().1;
        assert!((at(2.366) - 0.5).abs() < 0.005 && (at(7.815) - 0.95).abs() < 0.002);
    }
}
