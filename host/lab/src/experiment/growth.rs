//! Whether the cost of a scan grows with the map: the steps of a run, one after the other, as a figure.

use plotters::prelude::*;

use super::plots::PlotError;

/// Lines of the figure: name, columns of `steps.csv` that are added up, and what makes milliseconds or thousands of them.
const SERIES: [(&str, &[&str], f64); 3] = [
    ("weighing and printing, ms a step", &["weighing_us", "printing_us"], 1e-3),
    ("matching, ms a step", &["matching_us"], 1e-3),
    ("tiles of all particles' maps, thousands", &["tiles"], 1e-3),
];
const COLOURS: [RGBColor; 3] = [RGBColor(200, 60, 40), RGBColor(30, 90, 190), RGBColor(60, 140, 60)];
/// Steps that share a point: medians, since a busy machine makes outliers.
const STEPS_PER_POINT: usize = 50;

/// Table of the wrong form.
#[derive(Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum GrowthError {
    /// A column is missing.
    #[error("line 1: there is no column {0}; expected the steps.csv of lrfslam map")]
    Column(&'static str),
    /// A field is no number.
    #[error("line {line}: {column} is {found:?}, expected a number")]
    Field {
        /// Counted from 1.
        line: usize,
        /// Its column.
        column: &'static str,
        /// What stands there.
        found: String,
    },
}

/// Medians of groups of steps, series by series: (step, value).
pub type Growth = [Vec<(f64, f64)>; SERIES.len()];

/// Reads the text of a `steps.csv`.
///
/// # Errors
/// If a column is missing or a field is no number.
pub fn read_growth(text: &str) -> Result<Growth, GrowthError> {
    let mut lines = text.lines();
    let names: Vec<&str> = lines.next().unwrap_or_default().split(',').collect();
    let rows: Vec<Vec<&str>> = lines.map(|line| line.split(',').collect()).collect();
    let series = |(_, columns, scale): &(&str, &'static [&'static str], f64)| {
        let mut values = vec![0.0; rows.len()];
        for &column in *columns {
            let index = names.iter().position(|name| *name == column).ok_or(GrowthError::Column(column))?;
            for (at, (value, row)) in values.iter_mut().zip(&rows).enumerate() {
                let field = row.get(index).copied().unwrap_or_default();
                let wrong = || GrowthError::Field { line: at + 2, column, found: field.to_owned() };
                *value += scale * field.parse::<f64>().map_err(|_| wrong())?;
            }
        }
        Ok(medians(&values))
    };
    let [first, second, third] = &SERIES;
    Ok([series(first)?, series(second)?, series(third)?])
}

fn medians(values: &[f64]) -> Vec<(f64, f64)> {
    let median = |(index, group): (usize, &[f64])| {
        let mut sorted = group.to_vec();
        sorted.sort_by(f64::total_cmp);
        let middle = (index * STEPS_PER_POINT + group.len() / 2) as f64;
        (middle, sorted[sorted.len() / 2])
    };
    values.chunks(STEPS_PER_POINT).enumerate().map(median).collect()
}

/// The figure, as SVG.
///
/// # Errors
/// If drawing fails.
pub fn plot_growth(growth: &Growth) -> Result<String, PlotError> {
    let points = growth.iter().flatten();
    let (last, top) = points.fold((1.0_f64, 1.0_f64), |(x, y), point| (x.max(point.0), y.max(point.1)));
    let mut svg = String::new();
    {
        let root = SVGBackend::with_string(&mut svg, (760, 320)).into_drawing_area();
        root.fill(&WHITE)?;
        let mut chart = ChartBuilder::on(&root)
            .margin(8)
            .x_label_area_size(34)
            .y_label_area_size(40)
            .build_cartesian_2d(0.0..last, 0.0..1.1 * top)?;
        chart.configure_mesh().disable_mesh().x_desc("steps of the filter since the start").draw()?;
        for ((series, (name, ..)), colour) in growth.iter().zip(SERIES).zip(COLOURS) {
            chart
                .draw_series(LineSeries::new(series.iter().copied(), &colour))?
                .label(name)
                .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], colour));
        }
        chart.configure_series_labels().position(SeriesLabelPosition::UpperLeft).draw()?;
        root.present()?;
    }
    Ok(svg)
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEADER: &str = "scan,tiles,matching_us,weighing_us,printing_us\n";

    #[test]
    fn steps_are_read_in_groups_and_drawn() {
        let rows: String =
            (0..120).map(|i| format!("{i},{},1000,2000,{}\n", 100 * i, if i == 7 { 9e9 } else { 500.0 })).collect();
        let growth = read_growth(&format!("{HEADER}{rows}")).unwrap();
        assert_eq!(growth[0], [(25.0, 2.5), (75.0, 2.5), (110.0, 2.5)]);
        assert_eq!((growth[1][0].1, growth[2][2].1), (1.0, 11.0));
        let svg = plot_growth(&growth).unwrap();
        assert!(svg.starts_with("<svg") && svg.contains("matching, ms a step"));
    }

    #[test]
    fn wrong_tables_name_line_and_column() {
        assert_eq!(read_growth("scan,tiles\n"), Err(GrowthError::Column("weighing_us")));
        let error = read_growth(&format!("{HEADER}0,1,2,3,4\n1,many,2,3,4\n")).unwrap_err();
        assert_eq!(error.to_string(), "line 3: tiles is \"many\", expected a number");
        assert_eq!(read_growth(HEADER).unwrap(), [vec![], vec![], vec![]]);
    }
}
