//! A picture of one scan, seen from above: the way that is free, what was hit, and rings of distance.

use std::io;

use lrfslam_core::geometry::Point2;
use lrfslam_core::scan::{Echo, RangeScan};

use super::canvas::{Canvas, Rgb};
use super::{FREE, OCCUPIED, UNKNOWN, encode};

/// Side of the picture, pixels.
const SIDE: usize = 900;
const RING: Rgb = [190, 200, 212];
const LASER: Rgb = [200, 28, 40];

/// The picture as the bytes of a PNG file; forward is up, left is left.
///
/// # Errors
/// If encoding fails.
pub fn scan_png(scan: &RangeScan<'_>) -> io::Result<Vec<u8>> {
    let view_m = view_radius_m(scan);
    let mut canvas = Canvas::new(SIDE, SIDE, UNKNOWN);
    let centre = SIDE as f64 / 2.0;
    let pixel = |point: Point2| {
        let per_metre = (centre - 20.0) / f64::from(view_m);
        (centre - f64::from(point.y) * per_metre, centre - f64::from(point.x) * per_metre)
    };
    for beam in scan.beams {
        let end = match beam.echo {
            Echo::Hit(range_m) => Point2::from_polar(range_m.min(view_m), beam.bearing_rad),
            Echo::Miss => Point2::from_polar(view_m, beam.bearing_rad),
            Echo::Invalid => continue,
        };
        canvas.line(pixel(Point2::default()), pixel(end), 1.2, FREE);
    }
    for ring in 1..=4 {
        let radius = view_m * ring as f32 / 4.0;
        draw_ring(&mut canvas, radius, &pixel);
        let (x, y) = pixel(Point2::new(radius, 0.0));
        canvas.text(x as usize + 4, y as usize + 4, 2, &format!("{radius:.1} m"), OCCUPIED);
    }
    for point in scan.beams.iter().filter_map(Point2::of_hit) {
        canvas.line(pixel(point), pixel(point), 2.2, OCCUPIED);
    }
    canvas.line(pixel(Point2::default()), pixel(Point2::default()), 6.0, LASER);
    encode(&canvas)
}

fn draw_ring(canvas: &mut Canvas, radius_m: f32, pixel: &dyn Fn(Point2) -> (f64, f64)) {
    let corner = |step: u16| pixel(Point2::from_polar(radius_m, f32::from(step).to_radians() * 3.0));
    for step in 0..120 {
        canvas.line(corner(step), corner(step + 1), 0.8, RING);
    }
}

/// Nearly all hits are inside: a few far ones do not shrink the rest to nothing.
fn view_radius_m(scan: &RangeScan<'_>) -> f32 {
    let mut ranges: Vec<f32> = scan.beams.iter().filter_map(|beam| Point2::of_hit(beam).map(Point2::norm)).collect();
    ranges.sort_by(f32::total_cmp);
    let index = (ranges.len() * 98 / 100).min(ranges.len().saturating_sub(1));
    ranges.get(index).map_or(1.0, |range| (range * 1.1).max(0.5))
}

#[cfg(test)]
mod tests {
    use super::*;
    use lrfslam_core::scan::Beam;
    use lrfslam_core::time::{Duration, Instant};

    #[test]
    fn any_scan_has_a_picture() {
        let beam = |bearing_rad, echo| Beam { bearing_rad, offset: Duration::ZERO, echo };
        let beams = [beam(-1.0, Echo::Miss), beam(0.0, Echo::Hit(2.0)), beam(1.0, Echo::Invalid)];
        for beams in [&beams[..], &[]] {
            let scan = RangeScan { stamp: Instant::default(), range_max_m: 8.0, beams };
            assert!(scan_png(&scan).unwrap().starts_with(b"\x89PNG"));
        }
    }
}
