//! The tables at the end of `lrfslam cloud`.

use std::fmt::Write as _;

use super::cloud::CloudReport;
use lrfslam_host::maps::cloud::{Nearness, RegistrationReport, StopReport};

/// Of a cloud along a path.
pub(super) fn log_summary(report: &CloudReport) -> String {
    let counts = &report.counts;
    let mut text = format!("{} points of {} hits\n", report.points, counts.hits);
    let notes = [
        (counts.mixed, "mixed pixels at edges left out"),
        (counts.unplaced, "hits at times without a pose or a tilt left out"),
    ];
    for (count, what) in notes.into_iter().filter(|(count, _)| *count > 0) {
        let _ = writeln!(text, "note: {count} {what}");
    }
    text
}

/// Of stops: their planes, how they lie to each other, and the cloud.
pub(super) fn stops_summary(report: &CloudReport) -> String {
    let mut text = String::new();
    report.stops.iter().for_each(|stop| write_planes(&mut text, stop));
    let placed = report.stops.iter().filter_map(|stop| Some((stop.name.as_str(), stop.registration?)));
    let placed: Vec<(&str, RegistrationReport)> = placed.collect();
    if !placed.is_empty() {
        write_row(
            &mut text,
            "",
            ["ours x, y m, deg", "given x, y m, deg", "apart m, deg", "in space", "near ours", "near given"],
        );
    }
    for (name, placed) in &placed {
        let pose = |[x, y, heading]: [f64; 3]| format!("{x:.3} {y:.3} {heading:.2}");
        let apart = |metres: f64, degrees: f64| format!("{metres:.3} {degrees:.2}");
        let near = |near: Nearness| format!("{:.1} mm {:.0} %", 1e3 * near.rms_m, 100.0 * near.share);
        let cells = [
            pose(placed.ours),
            pose(placed.given),
            apart(placed.apart_m, placed.apart_deg),
            apart(placed.apart_in_space_m, placed.apart_in_space_deg),
            near(placed.near_by_ours),
            near(placed.near_by_given),
        ];
        write_row(&mut text, name, cells.each_ref().map(String::as_str));
    }
    text.push_str(&log_summary(report));
    text
}

fn write_row(text: &mut String, name: &str, cells: [&str; 6]) {
    let [ours, given, apart, in_space, near, near_given] = cells;
    let _ = writeln!(text, "{name:<8}{ours:>20}{given:>20}{apart:>14}{in_space:>14}{near:>15}{near_given:>15}");
}

fn write_planes(text: &mut String, stop: &StopReport) {
    let [pitch, roll] = stop.floor_tilt_deg;
    let _ =
        writeln!(text, "{}: {} hits, laser off the floor by pitch {pitch:.2}°, roll {roll:.2}°", stop.name, stop.hits);
    let _ = writeln!(text, "  {:<10}{:>9}{:>9}{:>12}{:>14}", "plane", "points", "rms cm", "off, deg", "distance m");
    for plane in &stop.planes {
        let name = format!("{:?}", plane.surface).to_lowercase();
        let _ = writeln!(
            text,
            "  {name:<10}{:>9}{:>9.2}{:>12.2}{:>14.3}",
            plane.points,
            100.0 * plane.rms_m,
            plane.off_deg,
            plane.distance_m
        );
    }
}
