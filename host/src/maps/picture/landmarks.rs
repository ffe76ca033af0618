//! A picture of landmarks: their 95 % ellipses, the path coloured by time, and the truth behind both.

use std::io;

use nalgebra::{Matrix2, Vector2};

use super::canvas::Canvas;
use super::{FOOTER, FREE, MARGIN, OCCUPIED, SIDE_MIN, TRUTH, WIDTH_MIN, draw_path, draw_scale_bar, encode};
use crate::trajectory::TimedPose;

/// Within so many deviations lie 95 % of a Gaussian in the plane: √5.991.
const DEVIATIONS: f64 = 2.448;
/// Corners of a drawn ellipse.
const CORNERS: usize = 48;
const ELLIPSE: [u8; 3] = [120, 60, 160];

/// What is drawn, all in the map's frame.
#[derive(Debug, Clone, Copy)]
pub struct LandmarkScene<'a> {
    /// The path.
    pub path: &'a [TimedPose],
    /// The true path; empty if it is not known.
    pub truth: &'a [TimedPose],
    /// Positions (m) and covariances (m²).
    pub landmarks: &'a [(Vector2<f64>, Matrix2<f64>)],
    /// True positions, m.
    pub true_landmarks: &'a [Vector2<f64>],
}

/// The picture as the bytes of a PNG file.
///
/// # Errors
/// If encoding fails.
pub fn landmarks_png(scene: &LandmarkScene<'_>) -> io::Result<Vec<u8>> {
    let of_pose = |pose: &TimedPose| Vector2::new(f64::from(pose.map_from_robot.x), f64::from(pose.map_from_robot.y));
    let points = (scene.path.iter().map(of_pose))
        .chain(scene.truth.iter().map(of_pose))
        .chain(scene.landmarks.iter().map(|landmark| landmark.0))
        .chain(scene.true_landmarks.iter().copied())
        .filter(|point| point.iter().all(|number| number.is_finite()));
    let nowhere = (Vector2::repeat(f64::INFINITY), Vector2::repeat(f64::NEG_INFINITY));
    let (low, high) = points.fold(nowhere, |(low, high), point| (low.inf(&point), high.sup(&point)));
    let (low, high) = if low.x <= high.x {
        (low.add_scalar(-0.5), high.add_scalar(0.5))
    } else {
        (Vector2::zeros(), Vector2::repeat(1.0))
    };
    let size = high - low;
    let per_metre = SIDE_MIN as f64 / size.max();
    let pixels = |metres: f64| (metres * per_metre).ceil() as usize + 2 * MARGIN;
    let mut canvas = Canvas::new(pixels(size.x).max(WIDTH_MIN), pixels(size.y) + FOOTER, FREE);
    let place =
        |at: Vector2<f64>| ((at.x - low.x) * per_metre + MARGIN as f64, (high.y - at.y) * per_metre + MARGIN as f64);
    for pair in scene.truth.windows(2) {
        canvas.line(place(of_pose(&pair[0])), place(of_pose(&pair[1])), 2.0, TRUTH);
    }
    for at in scene.true_landmarks {
        canvas.line(place(*at), place(*at), 6.0, TRUTH);
    }
    let path: Vec<_> = scene.path.iter().map(|pose| Some(place(of_pose(pose)))).collect();
    draw_path(&mut canvas, &path);
    for (at, covariance) in scene.landmarks {
        let ring: Vec<(f64, f64)> = ellipse(*at, covariance).map(place).collect();
        for corner in ring.windows(2) {
            canvas.line(corner[0], corner[1], 0.8, ELLIPSE);
        }
        canvas.line(place(*at), place(*at), 1.5, OCCUPIED);
    }
    draw_scale_bar(&mut canvas, 1.0 / per_metre);
    encode(&canvas)
}

/// The 95 % ellipse, closed.
fn ellipse(at: Vector2<f64>, covariance: &Matrix2<f64>) -> impl Iterator<Item = Vector2<f64>> {
    let l11 = covariance.m11.max(0.0).sqrt();
    let l21 = if l11 > 0.0 { covariance.m21 / l11 } else { 0.0 };
    let root = Matrix2::new(l11, 0.0, l21, (covariance.m22 - l21 * l21).max(0.0).sqrt());
    (0..=CORNERS).map(move |corner| {
        let (sin, cos) = (corner as f64 / CORNERS as f64 * std::f64::consts::TAU).sin_cos();
        at + root * Vector2::new(cos, sin) * DEVIATIONS
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_ellipse_reaches_as_far_as_its_deviations() {
        let ring: Vec<_> = ellipse(Vector2::new(1.0, 2.0), &Matrix2::new(0.04, 0.0, 0.0, 0.01)).collect();
        let reach = |axis: usize| ring.iter().map(|at| at[axis]).fold(f64::NEG_INFINITY, f64::max);
        assert!((reach(0) - 1.0 - 0.2 * DEVIATIONS).abs() < 1e-9 && (reach(1) - 2.0 - 0.1 * DEVIATIONS).abs() < 1e-9);
    }

    #[test]
    fn nothing_and_nonsense_are_drawn_too() {
        let scene = LandmarkScene { path: &[], truth: &[], landmarks: &[], true_landmarks: &[] };
        assert!(landmarks_png(&scene).is_ok());
        let bad = [(Vector2::new(f64::NAN, 1.0), Matrix2::repeat(f64::NAN))];
        assert!(landmarks_png(&LandmarkScene { landmarks: &bad, ..scene }).is_ok());
    }
}
