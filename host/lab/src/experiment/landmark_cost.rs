//! What a step of landmark SLAM costs, against the number of landmarks and of particles.
//!
//! A step is one control and [`SEEN`] sightings of landmarks whose identities are known, once all are in the map. Cases take turns, round after
//! round. Each round does the same, so the least time of each step counts: what else the computer does makes it slower, never faster. All
//! are compared with one case, measured in the same rounds.

use std::fmt::Write as _;
use std::time::Instant;

use lrfslam_core::landmark::ekf::{EkfMemory, EkfSlam, Landmark};
use lrfslam_core::landmark::fast::{FastLandmark, FastMemory, FastParticle, FastSlam};
use lrfslam_core::landmark::{Control, LandmarkConfig, Sighting};
use plotters::prelude::*;

use super::plots::{OURS, PlotError, THESIS};

/// Landmarks seen in a step.
pub const SEEN: usize = 4;
/// Steps of a case: FastSLAM's resample in some of them.
const STEPS: usize = 20;
const LANDMARKS: [usize; 7] = [10, 20, 50, 100, 200, 350, 500];
const PARTICLES: [u16; 7] = [10, 20, 50, 100, 200, 500, 1000];
/// FastSLAM's landmarks where particles vary, and the EKF's that all are compared with.
const USUAL_LANDMARKS: usize = 50;
const USUAL_PARTICLES: u16 = 100;

/// One case, and what it took.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CostRow {
    /// Of FastSLAM; none for the EKF.
    pub particles: Option<u16>,
    /// In the map.
    pub landmarks: usize,
    /// Mean over steps of the least time of each, µs.
    pub step_us: f64,
    /// The same over that of an EKF with 50 landmarks.
    pub ratio: f64,
}

/// Measures all cases, in so many rounds.
pub fn landmark_cost(rounds: u32) -> Vec<CostRow> {
    let ekf = LANDMARKS.iter().map(|landmarks| (None, *landmarks));
    let fast = LANDMARKS.iter().map(|landmarks| (Some(USUAL_PARTICLES), *landmarks));
    let of_particles = PARTICLES.iter().filter(|particles| **particles != USUAL_PARTICLES);
    let of_particles = of_particles.map(|particles| (Some(*particles), USUAL_LANDMARKS));
    let cases = ekf.chain(fast).chain(of_particles);
    let mut rows: Vec<CostRow> = cases
        .map(|(particles, landmarks)| CostRow { particles, landmarks, step_us: f64::INFINITY, ratio: 0.0 })
        .collect();
    let mut least = vec![[f64::INFINITY; STEPS]; rows.len()];
    for _ in 0..rounds {
        for (row, least) in rows.iter().zip(&mut least) {
            let taken = steps_us(row.particles, row.landmarks);
            least.iter_mut().zip(taken).for_each(|(least, taken)| *least = least.min(taken));
        }
    }
    for (row, least) in rows.iter_mut().zip(&least) {
        row.step_us = least.iter().sum::<f64>() / STEPS as f64;
    }
    let usual = rows.iter().find(|row| row.particles.is_none() && row.landmarks == USUAL_LANDMARKS);
    let usual = usual.map_or(f64::NAN, |row| row.step_us);
    rows.iter_mut().for_each(|row| row.ratio = row.step_us / usual);
    rows
}

/// Landmarks on a ring round the robot, which turns on the spot.
fn sighting(index: usize, landmarks: usize, heading: f64) -> Sighting {
    let angle = index as f64 / landmarks as f64 * std::f64::consts::TAU - heading;
    let identity = u16::try_from(index).ok();
    Sighting { range_m: 5.0, bearing_rad: lrfslam_core::landmark::wrap_angle(angle), identity, noise: None }
}

fn steps_us(particles: Option<u16>, landmarks: usize) -> [f64; STEPS] {
    let config = LandmarkConfig::default();
    let all: Vec<Sighting> = (0..landmarks).map(|index| sighting(index, landmarks, 0.0)).collect();
    match particles {
        None => {
            let [order, triangle, records] = EkfMemory::lengths(landmarks);
            let (mut mean, mut covariance) = (vec![0.0; order], vec![0.0; triangle]);
            let (mut work, mut records) = (vec![[0.0; 4]; order], vec![Landmark::UNUSED; records]);
            let (mean, covariance, work, landmarks) = (&mut mean, &mut covariance, &mut work, &mut records);
            let slam = EkfSlam::new(&config, EkfMemory { mean, covariance, work, landmarks });
            slam.map_or([f64::INFINITY; STEPS], |mut slam| {
                slam.observe(&all, &mut []);
                timed(all.len(), |control, seen| {
                    slam.predict(control);
                    slam.observe(seen, &mut []);
                })
            })
        }
        Some(count) => {
            let mut particles = vec![FastParticle::UNUSED; usize::from(count)];
            let mut maps = vec![FastLandmark::default(); usize::from(count) * landmarks];
            let memory = FastMemory { particles: &mut particles, landmarks: &mut maps };
            FastSlam::new(&config, 1, memory).map_or([f64::INFINITY; STEPS], |mut slam| {
                slam.observe(&all);
                timed(all.len(), |control, seen| {
                    slam.predict(control);
                    slam.observe(seen);
                })
            })
        }
    }
}

/// Time of each step, µs.
fn timed(landmarks: usize, mut step: impl FnMut(&Control, &[Sighting])) -> [f64; STEPS] {
    let turn_rad = 0.1;
    std::array::from_fn(|number| {
        let heading = (number + 1) as f64 * turn_rad;
        let first = number * landmarks / STEPS;
        let seen: [Sighting; SEEN] =
            std::array::from_fn(|ahead| sighting((first + ahead) % landmarks, landmarks, heading));
        let begun = Instant::now();
        step(&Control::Odometry { distance_m: 0.0, turn_rad, seconds: 0.1 }, &seen);
        begun.elapsed().as_secs_f64() * 1e6
    })
}

/// A line for each case: filter, particles, landmarks, step_us, ratio.
pub fn cost_csv(rows: &[CostRow]) -> String {
    let mut text = String::from("filter,particles,landmarks,step_us,ratio\n");
    for CostRow { particles, landmarks, step_us, ratio } in rows {
        let (filter, count) = particles.map_or(("ekf", String::new()), |count| ("fastslam", count.to_string()));
        let _ = writeln!(text, "{filter},{count},{landmarks},{step_us:.2},{ratio:.3}");
    }
    text
}

/// Cost over landmarks and over particles, both logarithmic: a straight line of slope 2 is quadratic.
///
/// # Errors
/// If drawing fails.
pub fn plot_cost(rows: &[CostRow]) -> Result<String, PlotError> {
    let points = |of: &dyn Fn(&CostRow) -> Option<f64>| -> Vec<(f64, f64)> {
        let mut points: Vec<(f64, f64)> = rows.iter().filter_map(|row| Some((of(row)?, row.ratio))).collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        points
    };
    let landmarks = |row: &CostRow| row.landmarks as f64;
    let ekf = points(&|row| row.particles.is_none().then(|| landmarks(row)));
    let fast = points(&|row| (row.particles == Some(USUAL_PARTICLES)).then(|| landmarks(row)));
    let by_particles = points(&|row| row.particles.filter(|_| row.landmarks == USUAL_LANDMARKS).map(f64::from));
    let mut svg = String::new();
    {
        let root = SVGBackend::with_string(&mut svg, (760, 320)).into_drawing_area();
        root.fill(&WHITE)?;
        let (left, right) = root.split_horizontally(400);
        let lines = [("EKF", ekf, OURS), ("FastSLAM, 100 particles", fast, THESIS)];
        draw(&left, "landmarks", &lines)?;
        draw(&right, "particles, each with 50 landmarks", &[("FastSLAM", by_particles, THESIS)])?;
        root.present()?;
    }
    Ok(svg)
}

/// Landmarks or particles of the figure.
const ACROSS: std::ops::Range<f64> = 10.0..1000.0;

type Line<'a> = (&'a str, Vec<(f64, f64)>, RGBColor);

fn draw(area: &super::plots::Area<'_>, name: &str, lines: &[Line<'_>]) -> Result<(), PlotError> {
    let ratios = lines.iter().flat_map(|line| &line.1).map(|point| point.1).filter(|ratio| *ratio > 0.0);
    let (low, high) = ratios.fold((f64::INFINITY, 1.0), |(low, high), ratio| (low.min(ratio), f64::max(high, ratio)));
    let low = if low.is_finite() { 0.7 * low } else { 0.1 };
    let mut chart = ChartBuilder::on(area)
        .margin(8)
        .margin_right(24)
        .x_label_area_size(34)
        .y_label_area_size(54)
        .build_cartesian_2d(ACROSS.log_scale(), (low..1.5 * high).log_scale())?;
    let tick = |value: &f64| format!("{value}");
    let mut mesh = chart.configure_mesh();
    mesh.light_line_style(WHITE).x_label_formatter(&tick).y_label_formatter(&tick);
    mesh.x_desc(name).y_desc("step, over an EKF's with 50").draw()?;
    for (name, points, colour) in lines {
        let colour = *colour;
        chart
            .draw_series(LineSeries::new(points.iter().copied(), &colour))?
            .label(*name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], colour));
        chart.draw_series(points.iter().map(|point| Circle::new(*point, 3, colour.filled())))?;
    }
    chart.configure_series_labels().position(SeriesLabelPosition::UpperLeft).draw()?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_cases_are_measured_and_drawn() {
        let rows = landmark_cost(3);
        assert_eq!(rows.len(), 2 * LANDMARKS.len() + PARTICLES.len() - 1);
        assert!(rows.iter().all(|row| row.step_us > 0.0 && row.ratio.is_finite()), "{rows:?}");
        // An EKF of ten times the landmarks costs much more than ten times as much: quadratic, by a wide margin.
        let ekf = |landmarks| rows.iter().find(|row| row.particles.is_none() && row.landmarks == landmarks).unwrap();
        assert!(ekf(500).step_us > 20.0 * ekf(50).step_us, "{rows:?}");
        assert_eq!(cost_csv(&rows).lines().count(), rows.len() + 1);
        assert!(plot_cost(&rows).unwrap().contains("FastSLAM, 100 particles"));
    }
}
