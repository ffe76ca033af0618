//! What particles are for: the path of each of them, before and after a loop closes, as a figure.

use std::collections::BTreeSet;

use lrfslam_core::geometry::{Point2, Pose2};
use lrfslam_core::scan::Beam;
use lrfslam_core::sweep::Sweep;
use plotters::prelude::*;

use super::plots::{Area, OURS, PlotError, THESIS};
use lrfslam_host::mapping::MappingConfig;
use lrfslam_host::mapping::mapper::Mapper;
use lrfslam_host::scans::log::LogScan;

/// Walls are drawn as dots so far apart, m.
const DOT_M: f32 = 0.2;
/// Paths are drawn from point to point so far apart, m.
const STRIDE_M: f32 = 1.0;
/// A panel is so wide, pixels.
const WIDTH: u32 = 420;

/// The particles after so many scans.
#[derive(Debug, Clone, PartialEq)]
pub struct ParticlePaths {
    /// Scans so far.
    pub scans: usize,
    /// The path of each particle alive, map frame, m.
    pub paths: Vec<Vec<Pose2>>,
    /// Index of the best one.
    pub best: usize,
    /// What it has seen, map frame, m.
    pub walls: Vec<Point2>,
}

/// Maps `scans` by one level, and tells the particles' paths after so many scans as `after` says, in the order of the scans.
///
/// * `config` — of mapping, and where the laser sits if the log does not say
///
/// # Errors
/// If there are no particles, or a scan is too large.
pub fn particle_paths(
    (config, robot_from_lrf): (&MappingConfig, Pose2),
    seed: u64,
    scans: &[LogScan],
    after: &[usize],
) -> anyhow::Result<Vec<ParticlePaths>> {
    anyhow::ensure!(config.hierarchy.levels > 0, "hierarchy.levels = 0: matching alone has no particles");
    let mut config = *config;
    config.hierarchy.levels = 1;
    let mut memory = config.mapper_memory(1);
    let mut mapper = Mapper::new(&config.slam, seed, &mut memory)?;
    let (mut seen, mut told) = (Vec::new(), Vec::new());
    for (index, scan) in scans.iter().enumerate() {
        let robot_from_lrf = scan.robot_from_lrf.unwrap_or(robot_from_lrf);
        let (step, _) = mapper.add_scan(&scan.scan(), robot_from_lrf, None)?;
        if step.filter.is_some() {
            seen.push(hits(&Sweep { scan: scan.scan(), robot_from_lrf, motion: step.odometry.motion }));
        }
        if after.contains(&(index + 1)) {
            let (best, paths) = mapper.particle_paths();
            let walls = paths.get(best).map_or_else(Vec::new, |path| dots(path, &seen));
            told.push(ParticlePaths { scans: index + 1, paths, best, walls });
        }
    }
    Ok(told)
}

/// What a scan has hit, robot frame, m.
fn hits(sweep: &Sweep<'_>) -> Vec<Point2> {
    let hit = |beam: Beam| Some(sweep.robot_from_lrf.transform(Point2::of_hit(&beam)?));
    sweep.scan.beams.iter().map(sweep.middle_beam()).filter_map(hit).collect()
}

/// The squares that were hit, seen from a path: one point each.
fn dots(path: &[Pose2], seen: &[Vec<Point2>]) -> Vec<Point2> {
    let square = |metres: f32| (metres / DOT_M).floor() as i32;
    let each = path.iter().zip(seen).flat_map(|(pose, hits)| hits.iter().map(move |hit| pose.transform(*hit)));
    let squares: BTreeSet<(i32, i32)> = each.map(|point| (square(point.x), square(point.y))).collect();
    let middle = |square: i32| (square as f32 + 0.5) * DOT_M;
    squares.into_iter().map(|(x, y)| Point2::new(middle(x), middle(y))).collect()
}

/// The figure, as SVG: a panel for each, all of the same piece of the map.
///
/// # Errors
/// If drawing fails.
pub fn plot_particle_paths(told: &[ParticlePaths]) -> Result<String, PlotError> {
    let points = || told.iter().flat_map(|paths| &paths.walls).map(|point| [f64::from(point.x), f64::from(point.y)]);
    let bounds = |axis: usize| {
        let fold = points().map(|point| point[axis]);
        let (least, most) = fold.fold((f64::MAX, f64::MIN), |(least, most), at| (least.min(at), most.max(at)));
        if least < most { least - 0.5..most + 0.5 } else { -1.0..1.0 }
    };
    let (x, y) = (bounds(0), bounds(1));
    let height = (f64::from(WIDTH) * (y.end - y.start) / (x.end - x.start)).clamp(100.0, 2000.0) as u32;
    let mut svg = String::new();
    {
        let size = (WIDTH * told.len().max(1) as u32, height + 24);
        let root = SVGBackend::with_string(&mut svg, size).into_drawing_area();
        root.fill(&WHITE)?;
        for (paths, panel) in told.iter().zip(root.split_evenly((1, told.len().max(1)))) {
            draw(&panel, paths, (x.clone(), y.clone()))?;
        }
        root.present()?;
    }
    Ok(svg)
}

type Range = std::ops::Range<f64>;

fn draw(area: &Area<'_>, told: &ParticlePaths, (x, y): (Range, Range)) -> Result<(), PlotError> {
    let caption = format!("after {} scans", told.scans);
    let mut chart = ChartBuilder::on(area).caption(caption, ("sans-serif", 14)).margin(2).build_cartesian_2d(x, y)?;
    let dot =
        |point: &Point2| Circle::new((f64::from(point.x), f64::from(point.y)), 1, RGBColor(150, 150, 150).filled());
    chart.draw_series(told.walls.iter().map(dot))?;
    for path in &told.paths {
        chart.draw_series(LineSeries::new(thin(path), OURS.mix(0.35)))?;
    }
    let best = told.paths.get(told.best).map_or_else(Vec::new, |path| thin(path));
    chart.draw_series(LineSeries::new(best, THESIS.stroke_width(2)))?;
    Ok(())
}

/// Points of a path some way apart, and its last one.
fn thin(path: &[Pose2]) -> Vec<(f64, f64)> {
    let mut kept: Vec<Point2> = Vec::new();
    for point in path.iter().map(|pose| pose.position()) {
        if kept.last().is_none_or(|last| (point - *last).norm() >= STRIDE_M) {
            kept.push(point);
        }
    }
    kept.extend(path.last().map(|pose| pose.position()));
    kept.into_iter().map(|point| (f64::from(point.x), f64::from(point.y))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_are_thinned_and_walls_are_dots() {
        let path: Vec<Pose2> = (0..21).map(|i| Pose2::new(0.1 * i as f32, 0.0, 0.0)).collect();
        assert_eq!(thin(&path).len(), 4, "0, 1, 2 and the last");
        let seen = vec![vec![Point2::new(1.0, 0.02)]; 2];
        assert_eq!(dots(&[Pose2::IDENTITY, Pose2::new(0.01, 0.0, 0.0)], &seen).len(), 1, "seen twice, one square");
        let told = ParticlePaths {
            scans: 7,
            paths: vec![path.clone(), path],
            best: 1,
            walls: vec![Point2::new(1.0, 0.0), Point2::new(3.0, 2.0)],
        };
        let svg = plot_particle_paths(&[told.clone(), told]).unwrap();
        assert_eq!(svg.matches("after 7 scans").count(), 2);
        assert_eq!(svg.matches("<polyline").count(), 6, "two particles and the best one, in two panels: {svg}");
        assert!(plot_particle_paths(&[]).unwrap().starts_with("<svg"));
    }
}
