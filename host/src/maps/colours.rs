//! Numbers told by colour: blue, green, red; dark enough to stand out on white.

use nalgebra::Point3;

/// The colours at equal distances.
const SCALE: [[u8; 3]; 5] = [[36, 64, 200], [0, 140, 190], [30, 160, 80], [235, 140, 10], [205, 25, 45]];

/// What the first and the last colour of a cloud stand for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ColourScale {
    /// What is told by colour.
    pub name: &'static str,
    /// Of its ends.
    pub unit: &'static str,
    /// The value of the first colour.
    pub first: f64,
    /// The value of the last one.
    pub last: f64,
}

/// A point as it is shown.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ColouredPoint {
    /// In the map, m.
    pub position: Point3<f32>,
    /// Red, green, blue.
    pub colour: [u8; 3],
}

/// The colour at `share` (0 to 1) of the way from first to last.
pub(crate) fn colour_at(share: f64) -> [u8; 3] {
    let place = share.clamp(0.0, 1.0) * (SCALE.len() - 1) as f64;
    let index = (place as usize).min(SCALE.len() - 2);
    let part = place - index as f64;
    let mix = |channel: usize| {
        let (a, b) = (f64::from(SCALE[index][channel]), f64::from(SCALE[index + 1][channel]));
        (a + part * (b - a)).round() as u8
    };
    [mix(0), mix(1), mix(2)]
}
