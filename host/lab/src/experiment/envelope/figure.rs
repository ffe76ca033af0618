//! Error over degradation, drawn.

use plotters::prelude::*;

use super::{EnvelopeRun, rows, spread};
use crate::experiment::plots::{OURS, PlotError, THESIS};

/// Height of a row, and of the axis below, pixels.
const ROW: u32 = 24;
const AXIS: u32 = 60;
const WIDTH: u32 = 760;
/// From here on a map is of no use, m.
const USELESS_M: f64 = 0.5;

/// A row for each degradation: the mean error over the seeds on a logarithmic axis, and from the least to the largest. As SVG.
///
/// # Errors
/// If drawing fails.
pub fn plot_envelope(runs: &[EnvelopeRun]) -> Result<String, PlotError> {
    let names: Vec<&str> = rows(runs).map(|of| of[0].row).collect();
    let errors: Vec<(f64, f64, f64)> = rows(runs).map(|of| spread(of, |run| run.mean_m.max(1e-4))).collect();
    let least = errors.iter().map(|error| error.1).fold(0.1, f64::min) / 2.0;
    let largest = errors.iter().map(|error| error.2).fold(USELESS_M, f64::max) * 2.0;
    let mut svg = String::new();
    {
        let count = names.len() as i32;
        let root = SVGBackend::with_string(&mut svg, (WIDTH, ROW * names.len() as u32 + AXIS)).into_drawing_area();
        root.fill(&WHITE)?;
        let label = |at: &SegmentValue<i32>| match at {
            SegmentValue::CenterOf(row) => {
                names.get((count - 1 - row).max(0) as usize).map_or(String::new(), ToString::to_string)
            }
            _ => String::new(),
        };
        let mut chart = ChartBuilder::on(&root)
            .margin(8)
            .x_label_area_size(34)
            .y_label_area_size(140)
            .build_cartesian_2d((least..largest).log_scale(), (0..count - 1).into_segmented())?;
        chart
            .configure_mesh()
            .disable_y_mesh()
            .light_line_style(WHITE)
            .x_desc("mean error of the relations, m; from the least to the largest of the seeds")
            .y_labels(names.len())
            .y_label_formatter(&label)
            .draw()?;
        let at = |row: usize| SegmentValue::CenterOf(count - 1 - row as i32);
        for (row, (mean, low, high)) in errors.iter().enumerate() {
            let colour = if *mean < USELESS_M { OURS } else { THESIS };
            let line = PathElement::new([(*low, at(row)), (*high, at(row))], colour.stroke_width(3));
            chart.draw_series([line])?;
            chart.draw_series([Circle::new((*mean, at(row)), 5, colour.filled())])?;
        }
        root.present()?;
    }
    Ok(svg)
}
