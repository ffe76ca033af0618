//! Figures as the thesis draws them, as SVG.

use plotters::coord::Shift;
use plotters::prelude::*;

use super::motion_model::MotionModel;
use super::sweep::{Method, PairError, SweepCase, of_case};
use crate::evaluation::Distribution;

/// A panel's size, pixels.
const PANEL: (u32, u32) = (300, 170);
const LEGEND: u32 = 24;
pub(super) const THESIS: RGBColor = RGBColor(200, 60, 40);
pub(super) const OURS: RGBColor = RGBColor(30, 90, 190);
/// Bars of a histogram.
const BINS: usize = 41;

/// One number of the displacement: its name and its value.
type Axis = (&'static str, fn(&PairError) -> f64);

const AXES: [Axis; 3] =
    [("Δy, forward, m", |e| e.forward_m), ("Δx, lateral, m", |e| e.lateral_m), ("Δθ, degrees", |e| e.heading_deg)];

/// Drawing failed.
#[derive(Debug, thiserror::Error)]
#[error("the figure cannot be drawn: {0}")]
pub struct PlotError(String);

impl<E: std::error::Error + Send + Sync> From<DrawingAreaErrorKind<E>> for PlotError {
    fn from(error: DrawingAreaErrorKind<E>) -> Self {
        Self(error.to_string())
    }
}

pub(super) type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

/// Errors of the first seed over the number of the pose, a column for each case, as figures 5.1 to 5.6.
///
/// # Errors
/// If drawing fails.
pub fn plot_errors(cases: &[SweepCase], errors: &[PairError]) -> Result<String, PlotError> {
    let Some(first) = errors.first().map(|error| error.seed) else { return Ok(String::new()) };
    let errors: Vec<PairError> = errors.iter().filter(|error| error.seed == first).copied().collect();
    let mut svg = String::new();
    {
        let size = (PANEL.0 * cases.len() as u32, PANEL.1 * AXES.len() as u32 + LEGEND);
        let root = SVGBackend::with_string(&mut svg, size).into_drawing_area();
        root.fill(&WHITE)?;
        let (legend, panels) = root.split_vertically(LEGEND);
        draw_legend(&legend)?;
        let panels = panels.split_evenly((AXES.len(), cases.len()));
        for (row, axis) in AXES.iter().enumerate() {
            let limit = errors.iter().map(|error| axis.1(error).abs()).fold(1e-3, f64::max);
            for (case, panel) in panels.iter().skip(row * cases.len()).take(cases.len()).enumerate() {
                let of = |method| of_case(&errors, case, method);
                draw_errors(panel, &cases[case].label, axis, limit, [of(Method::Thesis), of(Method::Ours)])?;
            }
        }
        root.present()?;
    }
    Ok(svg)
}

/// The number on a tick, without the sign that rounding leaves on a zero.
pub(super) fn tick(value: &f64) -> String {
    let rounded = (value * 1e4).round() / 1e4;
    format!("{}", if rounded == 0.0 { 0.0 } else { rounded })
}

fn draw_legend(area: &Area<'_>) -> Result<(), PlotError> {
    for (x, colour, text) in [(40, THESIS, "thesis: DE alone"), (240, OURS, "ours: DE, then Newton steps")] {
        area.draw(&PathElement::new([(x, 12), (x + 30, 12)], colour.stroke_width(2)))?;
        area.draw(&Text::new(text, (x + 38, 6), ("sans-serif", 13)))?;
    }
    Ok(())
}

fn draw_errors(
    area: &Area<'_>,
    case: &str,
    axis: &Axis,
    limit: f64,
    methods: [Vec<PairError>; 2],
) -> Result<(), PlotError> {
    let last = methods.iter().flatten().map(|error| error.pose).max().unwrap_or(1).max(1);
    let mut chart = ChartBuilder::on(area)
        .margin(6)
        .caption(format!("{case}: {}", axis.0), ("sans-serif", 13))
        .x_label_area_size(18)
        .y_label_area_size(40)
        .build_cartesian_2d(0..last, -limit..limit)?;
    chart
        .configure_mesh()
        .disable_mesh()
        .x_labels(4)
        .y_labels(5)
        .y_label_formatter(&tick)
        .label_style(("sans-serif", 10))
        .draw()?;
    for (errors, colour) in methods.iter().zip([THESIS, OURS]) {
        chart.draw_series(LineSeries::new(errors.iter().map(|error| (error.pose, axis.1(error))), &colour))?;
    }
    Ok(())
}

/// How the errors of found matches are distributed, with the Gaussian of the model (robust standard deviation).
///
/// # Errors
/// If drawing fails.
pub fn plot_distributions(errors: &[PairError], model: &MotionModel) -> Result<String, PlotError> {
    let found: Vec<PairError> = errors.iter().filter(|error| error.found).copied().collect();
    let mut svg = String::new();
    {
        let root = SVGBackend::with_string(&mut svg, (PANEL.0 * AXES.len() as u32, 220)).into_drawing_area();
        root.fill(&WHITE)?;
        let models = [model.forward_m, model.lateral_m, model.heading_deg];
        for ((axis, model), panel) in AXES.iter().zip(models).zip(root.split_evenly((1, AXES.len()))) {
            let values: Vec<f64> = found.iter().map(axis.1).collect();
            draw_distribution(&panel, axis.0, &values, &model.all)?;
        }
        root.present()?;
    }
    Ok(svg)
}

pub(super) fn draw_distribution(
    area: &Area<'_>,
    name: &str,
    values: &[f64],
    of: &Distribution,
) -> Result<(), PlotError> {
    let reach = (5.0 * of.robust_std).max(1e-6);
    let width = 2.0 * reach / BINS as f64;
    let mut counts = [0_usize; BINS];
    for value in values {
        let bin = ((value + reach) / width).floor();
        if (0.0..BINS as f64).contains(&bin) {
            counts[bin as usize] += 1;
        }
    }
    let density = |count: usize| count as f64 / (values.len().max(1) as f64 * width);
    let gaussian = |x: f64| {
        let z = (x - of.mean) / of.robust_std.max(1e-9);
        (-0.5 * z * z).exp() / (of.robust_std.max(1e-9) * std::f64::consts::TAU.sqrt())
    };
    let top = counts.iter().map(|&count| density(count)).fold(gaussian(of.mean), f64::max) * 1.05;
    let mut chart = ChartBuilder::on(area)
        .margin(6)
        .caption(name, ("sans-serif", 13))
        .x_label_area_size(18)
        .y_label_area_size(10)
        .build_cartesian_2d(-reach..reach, 0.0..top)?;
    chart
        .configure_mesh()
        .disable_mesh()
        .x_labels(5)
        .y_labels(0)
        .x_label_formatter(&tick)
        .label_style(("sans-serif", 10))
        .draw()?;
    let bar = |(bin, &count): (usize, &usize)| {
        let left = -reach + bin as f64 * width;
        Rectangle::new([(left, 0.0), (left + width, density(count))], OURS.mix(0.5).filled())
    };
    chart.draw_series(counts.iter().enumerate().map(bar))?;
    let curve = (0..=200).map(|i| -reach + 2.0 * reach * f64::from(i) / 200.0).map(|x| (x, gaussian(x)));
    chart.draw_series(LineSeries::new(curve, THESIS.stroke_width(2)))?;
    Ok(())
}
