//! A colour for every point: by its height or by its time, from blue over green to red.

use serde::Serialize;

use super::CloudPoint;
use crate::maps::colours::{ColourScale, ColouredPoint, colour_at};

/// What the colour of a point tells.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Paint {
    /// How high it is; the lowest and highest hundredth of the points share the ends of the scale.
    Height,
    /// When it was measured.
    Time,
}

impl Paint {
    /// `points` with their colours, in the same order.
    pub fn apply(self, points: &[CloudPoint]) -> Vec<ColouredPoint> {
        let Some([low, high]) = self.ends(points) else { return Vec::new() };
        let span = (high - low).max(1e-9);
        let coloured = |point: &CloudPoint| ColouredPoint {
            position: point.position,
            colour: colour_at((self.value(point) - low) / span),
        };
        points.iter().map(coloured).collect()
    }

    /// What the colours of `points` stand for: heights in m, or s since the first; `None` without points.
    pub fn scale(self, points: &[CloudPoint]) -> Option<ColourScale> {
        let [first, last] = self.ends(points)?;
        Some(match self {
            Self::Height => ColourScale { name: "height", unit: "m", first, last },
            Self::Time => ColourScale { name: "time", unit: "s", first: 0.0, last: last - first },
        })
    }

    fn value(self, point: &CloudPoint) -> f64 {
        match self {
            Self::Height => f64::from(point.position.z),
            Self::Time => point.stamp.as_secs_f64(),
        }
    }

    /// The values of the first and the last colour.
    fn ends(self, points: &[CloudPoint]) -> Option<[f64; 2]> {
        let mut sorted: Vec<f64> = points.iter().map(|point| self.value(point)).collect();
        sorted.sort_by(f64::total_cmp);
        let cut = if self == Self::Height { sorted.len() / 100 } else { 0 };
        Some([*sorted.get(cut)?, *sorted.iter().rev().nth(cut)?])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lrfslam_core::time::Instant;
    use nalgebra::Point3;

    #[test]
    fn low_is_blue_high_is_red_and_so_are_early_and_late() {
        let point =
            |z: f32, micros| CloudPoint { position: Point3::new(0.0, 0.0, z), stamp: Instant::from_micros(micros) };
        let points = [point(2.0, 0), point(0.0, 5_000_000)];
        let by_height = Paint::Height.apply(&points);
        let by_time = Paint::Time.apply(&points);
        let (red, blue) = (by_height[0].colour, by_height[1].colour);
        assert!(red[0] > red[2] && blue[2] > blue[0]);
        assert_eq!([by_time[0].colour, by_time[1].colour], [blue, red]);
        assert!(Paint::Time.apply(&[]).is_empty());
        let scale = |paint: Paint| paint.scale(&points).map(|scale| (scale.name, scale.unit, scale.first, scale.last));
        assert_eq!(scale(Paint::Height), Some(("height", "m", 0.0, 2.0)));
        assert_eq!((scale(Paint::Time), Paint::Time.scale(&[])), (Some(("time", "s", 0.0, 5.0)), None));
    }
}
