//! How far the points of a 3D map lie from the surfaces of the world that was simulated (thesis, chapter 5).

use std::path::Path;

use nalgebra::{Point3, Vector3};
use serde::Serialize;

use lrfslam_host::input::table::{TableError, read_table};
use lrfslam_host::input::text::{FieldFault, Words, fault};

/// A point this near to a surface counts as on it, m.
const NEAR_M: f64 = 0.05;
/// Corners of a rectangle close to this, m.
const CLOSED_M: f64 = 1e-3;

/// A rectangle of the world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Surface {
    corner: Point3<f64>,
    sides: [Vector3<f64>; 2],
}

impl Surface {
    /// The rectangle with these corners, in order round it; `None` if they are none.
    pub fn from_corners([a, b, c, d]: [Point3<f64>; 4]) -> Option<Self> {
        let sides = [b - a, d - a];
        let is_rectangle = (c - b - sides[1]).norm() <= CLOSED_M
            && sides.iter().all(|side| side.norm() > CLOSED_M)
            && sides[0].dot(&sides[1]).abs() <= CLOSED_M * sides[0].norm().max(sides[1].norm());
        is_rectangle.then_some(Self { corner: a, sides })
    }

    /// Distance from `point` to the nearest point of the rectangle, m.
    pub fn distance_m(&self, point: &Point3<f64>) -> f64 {
        let offset = point - self.corner;
        let along = |side: &Vector3<f64>| side * (side.dot(&offset) / side.norm_squared()).clamp(0.0, 1.0);
        (offset - along(&self.sides[0]) - along(&self.sides[1])).norm()
    }
}

/// Reads surfaces as `lrf-sim surfaces` writes them: four corners in a line, 12 numbers, m.
///
/// # Errors
/// If the file cannot be read, has no surface, or a line that is wrong (named).
pub fn read_surfaces(path: &Path) -> Result<Vec<Surface>, TableError> {
    read_table(path, "ax ay az bx by bz cx cy cz dx dy dz", |words| {
        let corners = [corner(words, "a")?, corner(words, "b")?, corner(words, "c")?, corner(words, "d")?];
        let wrong = || fault("corners".to_owned(), "those of a rectangle, in order round it", None);
        Surface::from_corners(corners).ok_or_else(wrong)
    })
}

fn corner(words: &mut Words<'_>, name: &str) -> Result<Point3<f64>, FieldFault> {
    let mut coordinate = |axis: &str| words.finite(&format!("{name}{axis}"));
    Ok(Point3::new(coordinate("x")?, coordinate("y")?, coordinate("z")?))
}

/// Distances of a cloud's points from the nearest surface, m.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct CloudError {
    /// Points judged.
    pub points: usize,
    /// Surfaces of the world.
    pub surfaces: usize,
    /// Mean.
    pub mean_m: f64,
    /// Half lie below.
    pub median_m: f64,
    /// 95 % lie below.
    pub most_m: f64,
    /// The largest.
    pub max_m: f64,
    /// Share within 5 cm, 0 to 1.
    pub near: f64,
}

/// Measures every point against all surfaces. Cost O(points × surfaces).
pub fn judge_cloud(points: &[Point3<f64>], surfaces: &[Surface]) -> CloudError {
    let nearest = |point| surfaces.iter().map(|surface| surface.distance_m(point)).fold(f64::INFINITY, f64::min);
    let mut sorted: Vec<f64> = points.iter().map(nearest).collect();
    sorted.sort_by(f64::total_cmp);
    let at = |share: f64| sorted.get((share * sorted.len() as f64) as usize).or(sorted.last()).copied().unwrap_or(0.0);
    let count = sorted.len().max(1) as f64;
    CloudError {
        points: sorted.len(),
        surfaces: surfaces.len(),
        mean_m: sorted.iter().sum::<f64>() / count,
        median_m: at(0.5),
        most_m: at(0.95),
        max_m: at(1.0),
        near: sorted.iter().filter(|&&distance| distance <= NEAR_M).count() as f64 / count,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A floor of 2 m by 1 m.
    const FLOOR: &str = "# floor\n0 0 0 2 0 0 2 1 0 0 1 0\n";

    fn read(text: &str) -> Result<Vec<Surface>, TableError> {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), text).unwrap();
        read_surfaces(file.path())
    }

    #[test]
    fn points_are_as_far_as_the_face_the_edge_or_the_corner() {
        let floor = read(FLOOR).unwrap();
        let points = [[1.0, 0.5, 0.01], [2.0, 0.5, -0.02], [2.03, 0.5, 0.04], [2.0, 1.3, 0.4]];
        let error = judge_cloud(&points.map(|[x, y, z]| Point3::new(x, y, z)), &floor);
        assert!((error.mean_m - (0.01 + 0.02 + 0.05 + 0.5) / 4.0).abs() < 1e-12, "{error:?}");
        assert!((error.max_m - 0.5).abs() < 1e-12 && (error.median_m - 0.05).abs() < 1e-12, "{error:?}");
        assert_eq!((error.points, error.near), (4, 0.75));
        assert_eq!(judge_cloud(&[], &floor).points, 0);
    }

    #[test]
    fn wrong_surfaces_are_named() {
        let text = |text: &str| read(text).unwrap_err().to_string();
        assert!(text("0 0 0 2 0 0 2 1 0 0 1\n").contains("line 1: field dz: expected a finite number"));
        let skew = text("0 0 0 2 0 0 3 1 0 1 1 0\n");
        assert!(skew.contains("line 1: field corners: expected those of a rectangle, in order round it"), "{skew}");
    }
}
