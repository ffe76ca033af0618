//! Landmarks in a scan of a laser: reflectors by how bright they are, round posts and trunks by their shape.
//!
//! scan → rows of neighbouring hits of one thing → [`circle`](super::circle) → [`Detection`] of its centre. A row is a reflector where its
//! beams are bright, and may be a post where it stands free: what is beside it is farther away, or nothing.
//!
//! * The centre is meant, not the near side: from another side it is the same.
//! * Beams are taken for a snapshot: a robot that turns fast should give beams [corrected for that](crate::sweep::Sweep::middle_beam).
//! * Legs of people and of tables are posts too; the filters take landmarks out that are not seen again.

use nalgebra::Matrix2;

use super::Sighting;
use super::circle::{Arc, Circle, Radius, fit};
use crate::scan::{Beam, Echo, RangeScan};

crate::config! {
    /// Landmarks in a scan: reflectors and posts.
    pub struct DetectConfig {
        /// Reflectors are looked for, where the laser tells how bright its echoes are.
        reflectors: bool = true;
        /// An echo is a reflector's from this brightness on.
        brightness_min: u8 = 160, in 1..=255;
        /// Radius of reflectors, which are round, m.
        reflector_radius_m: f32 = 0.05, in 0.001..=2.0;
        /// A reflector has so many beams. One alone may have met its edge, and have the range of something between it and what is behind.
        reflector_beams_min: u16 = 2, in 1..=100;
        /// Round posts and trunks are looked for.
        posts: bool = true;
        /// Their smallest radius, m.
        post_radius_min_m: f32 = 0.04, in 0.001..=5.0;
        /// Their largest, m.
        post_radius_max_m: f32 = 0.4, in 0.001..=5.0;
        /// A post has so many beams.
        post_beams_min: u16 = 5, in 3..=1000;
        /// What is beside it is so much farther away, m.
        post_gap_m: f32 = 0.3, in 0.01..=10.0;
        /// Deviation of one range, m.
        range_noise_m: f32 = 0.02, in 0.0001..=1.0;
        /// What is farther away is not looked at, m.
        range_max_m: f32 = 20.0, in 0.1..=500.0;
    }
}

/// A round thing in the scan, in the lrf frame.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Detection {
    /// Distance of its centre, m.
    pub range_m: f64,
    /// Bearing of its centre, rad.
    pub bearing_rad: f64,
    /// Covariance of range (m) and bearing (rad).
    pub covariance: Matrix2<f64>,
    /// Its radius, m.
    pub radius_m: f64,
    /// It is bright.
    pub is_reflector: bool,
}

impl Detection {
    /// As the filters take it.
    pub fn sighting(&self) -> Sighting {
        let Self { range_m, bearing_rad, covariance, .. } = *self;
        Sighting { range_m, bearing_rad, identity: None, noise: Some(covariance) }
    }
}

/// What a search found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Found {
    /// Detections written.
    pub count: usize,
    /// Detections that there was no room for.
    pub left_out: usize,
}

/// A row of beams: first and last.
type Row = (usize, usize);

/// Looks for landmarks in `scan`.
///
/// * `brightness` — of each beam, 0 to 255; empty if the laser does not tell
/// * `found` — where to put them, in order of bearing
pub fn detect(config: &DetectConfig, scan: &RangeScan<'_>, brightness: &[u8], found: &mut [Detection]) -> Found {
    let search = Search { config, beams: scan.beams, brightness };
    let mut result = Found::default();
    let mut first = 0;
    while let Some(row) = search.row_from(first) {
        first = row.1 + 1;
        let Some(detection) = search.judge(row) else { continue };
        match found.get_mut(result.count) {
            Some(place) => {
                *place = detection;
                result.count += 1;
            }
            None => result.left_out += 1,
        }
    }
    result
}

struct Search<'a> {
    config: &'a DetectConfig,
    beams: &'a [Beam],
    brightness: &'a [u8],
}

impl Search<'_> {
    /// The range of a hit that is near enough, m.
    fn hit(&self, beam: usize) -> Option<f64> {
        match self.beams.get(beam)?.echo {
            Echo::Hit(range_m) if range_m <= self.config.range_max_m => Some(f64::from(range_m)),
            _ => None,
        }
    }

    fn is_bright(&self, beam: usize) -> bool {
        let level = self.brightness.get(beam).copied().unwrap_or(0);
        self.config.reflectors && level >= self.config.brightness_min
    }

    /// The next row of hits that are alike: of one brightness, and no farther from one another than their thing is deep.
    fn row_from(&self, first: usize) -> Option<Row> {
        let first = (first..self.beams.len()).find(|beam| self.hit(*beam).is_some())?;
        let mut last = first;
        while self.belongs(last, last + 1) {
            last += 1;
        }
        Some((first, last))
    }

    fn belongs(&self, beam: usize, next: usize) -> bool {
        let (Some(here), Some(there)) = (self.hit(beam), self.hit(next)) else { return false };
        let is_bright = self.is_bright(beam);
        let depth = match is_bright {
            true => 2.0 * f64::from(self.config.reflector_radius_m) + 4.0 * f64::from(self.config.range_noise_m),
            false => f64::from(self.config.post_gap_m),
        };
        is_bright == self.is_bright(next) && (here - there).abs() < depth
    }

    fn judge(&self, row: Row) -> Option<Detection> {
        let is_reflector = self.is_bright(row.0);
        let circle = if is_reflector { self.reflector(row)? } else { self.post(row)? };
        let Circle { range_m, bearing_rad, radius_m, covariance } = circle;
        Some(Detection { range_m, bearing_rad, covariance, radius_m, is_reflector })
    }

    fn reflector(&self, row: Row) -> Option<Circle> {
        if row.1 + 1 - row.0 < usize::from(self.config.reflector_beams_min) {
            return None;
        }
        let radius_m = f64::from(self.config.reflector_radius_m);
        // A tenth of it: as well as anybody measures a reflector.
        fit(&self.arc(row)?, &Radius { mean_m: radius_m, deviation_m: 0.1 * radius_m })
    }

    fn post(&self, row: Row) -> Option<Circle> {
        let config = self.config;
        let is_long_enough = row.1 + 1 - row.0 >= usize::from(config.post_beams_min);
        if !config.posts || !is_long_enough || !self.stands_free(row) {
            return None;
        }
        let [least, most] = [config.post_radius_min_m, config.post_radius_max_m].map(f64::from);
        // What is far too wide needs no fit.
        let arc = self.arc(row)?;
        if arc.range_m * (arc.end_rad - arc.begin_rad) > 4.0 * most {
            return None;
        }
        let radius = Radius { mean_m: 0.5 * (least + most), deviation_m: most - least };
        fit(&arc, &radius).filter(|circle| (least..=most).contains(&circle.radius_m))
    }

    /// On both sides there is a beam, and it goes farther, or meets nothing.
    fn stands_free(&self, (first, last): Row) -> bool {
        let gap = f64::from(self.config.post_gap_m);
        let is_behind = |beside: Option<usize>, end: usize| {
            let (Some(beam), Some(near)) = (beside.and_then(|beam| self.beams.get(beam)), self.hit(end)) else {
                return false;
            };
            match beam.echo {
                Echo::Hit(range_m) => f64::from(range_m) > near + gap,
                Echo::Miss => true,
                Echo::Invalid => false,
            }
        };
        is_behind(first.checked_sub(1), first) && is_behind(last.checked_add(1), last)
    }

    /// The row, with its ends half way to the beams beside it.
    fn arc(&self, (first, last): Row) -> Option<Arc<'_>> {
        let bearing = |beam: usize| self.beams.get(beam).map(|beam| f64::from(beam.bearing_rad));
        let (begin, end) = (bearing(first)?, bearing(last)?);
        let before = first.checked_sub(1).and_then(bearing).map(|before| begin - before);
        let after = bearing(last + 1).map(|after| after - end);
        let steps = [before.or(after)?, after.or(before)?];
        let is_usable = end >= begin && steps.iter().all(|step| step.is_finite() && *step > 0.0);
        is_usable.then_some(Arc {
            beams: self.beams.get(first..=last)?,
            begin_rad: begin - 0.5 * steps[0],
            end_rad: end + 0.5 * steps[1],
            steps_rad: steps,
            range_m: self.hit(first.midpoint(last))?,
            noise_m: f64::from(self.config.range_noise_m),
        })
    }
}

#[cfg(test)]
mod tests;
