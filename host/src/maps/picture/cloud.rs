//! A picture of a cloud of points, seen from a height at an angle, without perspective: lengths on the scale bar hold across
//! the picture.

use std::io;

use nalgebra::{Point3, Rotation3, Vector3};

use super::canvas::Canvas;
use super::{FOOTER, FOOTER_ROWS, FREE, MARGIN, OCCUPIED, WIDTH_MIN, draw_colours, draw_scale_bar, encode};
use crate::maps::colours::{ColourScale, ColouredPoint};

/// From where a cloud is seen, and how large.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CloudView {
    /// Where the viewer stands, from the cloud's middle: counter-clockwise from +x, degrees.
    pub azimuth_deg: f64,
    /// How high he stands: 0 sees it from the side, 90 from above, degrees.
    pub elevation_deg: f64,
    /// Longer side of the picture, pixels.
    pub side: usize,
}

/// Smallest and largest of each coordinate on the screen.
type Extent = [(f64, f64); 2];

/// The picture as the bytes of a PNG file.
///
/// * `scale` — what the colours stand for, told in the footer
///
/// The farthest half hundredth of the points to each side may lie outside: a few stray hits must not make the rest tiny.
///
/// # Errors
/// If encoding fails.
pub fn cloud_png(points: &[ColouredPoint], view: &CloudView, scale: Option<&ColourScale>) -> io::Result<Vec<u8>> {
    let mut dots = seen(points, view);
    let [(left, right), (low, high)] = extent(&dots);
    let (width_m, height_m) = ((right - left).max(0.1), (high - low).max(0.1));
    let room = view.side.max(2 * MARGIN + 1) - 2 * MARGIN;
    let per_metre = room as f64 / width_m.max(height_m);
    let pixels = |metres: f64| (metres * per_metre).ceil() as usize + 2 * MARGIN;
    let mut canvas = Canvas::new(pixels(width_m).max(WIDTH_MIN), pixels(height_m) + FOOTER, FREE);
    let bottom = pixels(height_m);
    // The nearest are drawn last; equal distances keep their order.
    dots.sort_by(|a, b| a.at.z.total_cmp(&b.at.z));
    let size = (per_metre * 0.02).round().clamp(1.0, 6.0) as usize;
    for dot in &dots {
        let (x, y) = ((dot.at.x - left) * per_metre, (high - dot.at.y) * per_metre);
        let inside = x >= 0.0 && y >= 0.0 && (y as usize + MARGIN + size) <= bottom;
        if inside {
            canvas.fill(x as usize + MARGIN, y as usize + MARGIN, size, size, dot.colour);
        }
    }
    draw_scale_bar(&mut canvas, 1.0 / per_metre);
    if let Some(ColourScale { name, unit, first, last }) = scale {
        // Adding zero takes the sign from what is rounded to it.
        let ends = [first, last].map(|end| format!("{:.1} {unit}", (end * 10.0).round() / 10.0 + 0.0));
        draw_colours(&mut canvas, ends.each_ref().map(String::as_str));
        let left = canvas.width.saturating_sub(MARGIN + Canvas::text_width(2, name));
        let y = canvas.height - FOOTER + FOOTER_ROWS[1];
        canvas.text(left, y - 7, 2, name, OCCUPIED);
    }
    encode(&canvas)
}

/// A point on the screen: x right, y up, z towards the viewer, m.
struct Dot {
    at: Point3<f64>,
    colour: [u8; 3],
}

fn seen(points: &[ColouredPoint], view: &CloudView) -> Vec<Dot> {
    let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), -view.azimuth_deg.to_radians());
    let (sin, cos) = view.elevation_deg.to_radians().sin_cos();
    let shown = |point: &&ColouredPoint| point.position.coords.iter().all(|v| v.is_finite());
    let dot = |point: &ColouredPoint| {
        // The viewer is in the direction of +x now, and looks along −x: his right is +y.
        let turned = turn * point.position.cast::<f64>();
        let at = Point3::new(turned.y, cos * turned.z - sin * turned.x, cos * turned.x + sin * turned.z);
        Dot { at, colour: point.colour }
    };
    points.iter().filter(shown).map(dot).collect()
}

fn extent(dots: &[Dot]) -> Extent {
    [0, 1].map(|axis| {
        let mut sorted: Vec<f64> = dots.iter().map(|dot| dot.at[axis]).collect();
        sorted.sort_by(f64::total_cmp);
        let cut = sorted.len() / 200;
        let end = |value: Option<&f64>| value.copied().unwrap_or(0.0);
        (end(sorted.get(cut)), end(sorted.iter().rev().nth(cut)))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const VIEW: CloudView = CloudView { azimuth_deg: 0.0, elevation_deg: 0.0, side: 500 };

    fn pixels(points: &[ColouredPoint], view: &CloudView) -> (usize, Vec<[u8; 3]>) {
        let bytes = cloud_png(points, view, None).unwrap();
        let mut reader = png::Decoder::new(io::Cursor::new(bytes)).read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut pixels).unwrap();
        (info.width as usize, pixels.chunks(3).map(|p| [p[0], p[1], p[2]]).collect())
    }

    fn place(image: &(usize, Vec<[u8; 3]>), colour: [u8; 3]) -> Option<(usize, usize)> {
        image.1.iter().position(|&pixel| pixel == colour).map(|at| (at % image.0, at / image.0))
    }

    fn point(x: f32, y: f32, z: f32, colour: [u8; 3]) -> ColouredPoint {
        ColouredPoint { position: Point3::new(x, y, z), colour }
    }

    #[test]
    fn seen_from_ahead_left_is_right_and_up_is_up() {
        let [red, green, blue] = [[200, 0, 0], [0, 200, 0], [0, 0, 200]];
        let points = [point(0.0, -1.0, 0.0, red), point(0.0, 1.0, 0.0, green), point(0.0, 0.0, 1.0, blue)];
        let image = pixels(&points, &VIEW);
        let [r, g, b] = [red, green, blue].map(|colour| place(&image, colour).unwrap());
        assert!(r.0 < b.0 && b.0 < g.0 && b.1 < r.1 && r.1 == g.1, "{r:?} {g:?} {b:?}");
    }

    #[test]
    fn the_nearer_point_hides_the_farther() {
        let [near, far, corner] = [[9, 9, 9], [99, 9, 9], [9, 9, 99]];
        let points = [point(1.0, 0.0, 0.0, near), point(-1.0, 0.0, 0.0, far), point(0.0, 1.0, 1.0, corner)];
        let image = pixels(&points, &VIEW);
        assert!(place(&image, near).is_some() && place(&image, corner).is_some());
        assert_eq!(place(&image, far), None);
        assert!(place(&pixels(&points, &CloudView { azimuth_deg: 180.0, ..VIEW }), far).is_some());
    }

    #[test]
    fn nothing_and_nonsense_are_drawn_too() {
        assert!(cloud_png(&[], &VIEW, None).is_ok());
        let points = [point(f32::NAN, 0.0, 0.0, [0; 3]), point(1e30, -1e30, 0.0, [0; 3])];
        assert!(cloud_png(&points, &VIEW, None).is_ok());
    }

    #[test]
    fn the_colours_are_told_where_there_is_a_scale() {
        let points = [point(0.0, 0.0, 0.0, [0, 0, 0]), point(0.0, 1.0, 2.0, [0, 0, 0])];
        let scale = ColourScale { name: "height", unit: "m", first: -0.5, last: 2.0 };
        let coloured = |scale| {
            let bytes = cloud_png(&points, &VIEW, scale).unwrap();
            let mut reader = png::Decoder::new(io::Cursor::new(bytes)).read_info().unwrap();
            let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
            reader.next_frame(&mut pixels).unwrap();
            [0.0, 0.5].map(|share| pixels.chunks(3).any(|pixel| pixel == crate::maps::picture::colour_at(share)))
        };
        assert_eq!((coloured(Some(&scale)), coloured(None)), ([true; 2], [false; 2]));
    }
}
