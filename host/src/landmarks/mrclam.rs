//! UTIAS MRCLAM: five robots with cameras among fifteen barcodes, motion capture as truth (Leung et al., IJRR 30(8), 2011).
//!
//! Files: `Barcodes.dat`, `Landmark_Groundtruth.dat`, and for each robot `robotN_Odometry.dat`, `robotN_Measurement.dat`,
//! `robotN_Groundtruth.dat`; any prefix, any case, plain or gzip. Without ground truth the drive has no errors.
//!
//! **Ranges are depths.** The cameras measure how large a code appears, which tells how far it is along the optical axis, not along the ray:
//! what is recorded as range is d cos β. Against the ground truth of dataset 7, recorded over true range falls from 1.02 ahead to 0.90 at
//! 0.55 rad; divided by cos β it is the same at all bearings to 1 %, and its spread goes from 0.10 to 0.02 m. The reader divides.
//!
//! **Their scale is right on average.** Who records depths as distances has calibrated them as distances, and so has made them right over the
//! bearings that occur: depths then are too long by the mean of 1/cos β over these. The reader divides by that mean, too: no truth is needed.
//!
//! A camera may still measure all lengths too long or too short. No SLAM can find that out: a robot that also does not know the scale of its
//! odometry has no other measure of length. What is left is for the caller to tell, from a calibration of the camera.
#![cfg_attr(not(test), deny(clippy::indexing_slicing))]

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail, ensure};
use lrfslam_core::landmark::{LandmarkConfig, Sighting};
use lrfslam_core::time::Instant;

use super::{Drive, TrueLandmark, Velocity, batches, merge};
use crate::input::table::read_table;
use crate::pose_f64::PoseF64;
use crate::trajectory::TimedPose;

/// Subjects up to this one are robots.
const ROBOTS: u16 = 5;

/// The least cosine of a bearing: cameras see less than 80° to each side.
const COS_MIN: f64 = 0.17;

/// What the recorded ranges are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Ranges {
    /// Along the optical axis.
    #[default]
    Depths,
    /// Along the ray, as the data set's description says.
    Distances,
}

/// Reads the drive of one robot.
///
/// * `place` — the folder of a data set; or a path whose last part begins the names of its files, such as `data/mrclam7`
/// * `range_scale` — true over recorded range, from a calibration; 1 without one
///
/// # Errors
/// If a file is missing, there are several, or a line is wrong.
pub fn read(place: &Path, robot: u8, ranges: Ranges, range_scale: f64) -> anyhow::Result<Drive> {
    let file = |name: &str| find(place, name);
    let barcodes = numbers(&file("barcodes.dat")?, "subject barcode")?;
    let subjects: HashMap<u16, u16> =
        barcodes.into_iter().filter_map(|[subject, barcode]| Some((code(barcode)?, code(subject)?))).collect();
    let odometry = numbers(&file(&format!("robot{robot}_odometry.dat"))?, "t v omega")?;
    let measurements = numbers(&file(&format!("robot{robot}_measurement.dat"))?, "t barcode range bearing")?;
    let velocities: Vec<Velocity> =
        in_order(odometry).map(|[t, forward_m_s, turn_rad_s]| Velocity { t, forward_m_s, turn_rad_s }).collect();
    let mean_stretch = mean_stretch(&measurements);
    let sightings = in_order(measurements).filter_map(|[t, barcode, range_m, bearing_rad]| {
        // A code that nobody has was misread.
        let subject = *subjects.get(&code(barcode)?)?;
        let range_m = match ranges {
            Ranges::Depths => range_m * stretch(bearing_rad) / mean_stretch,
            Ranges::Distances => range_m,
        } * range_scale;
        let sighting = Sighting { range_m, bearing_rad, identity: Some(subject), noise: None };
        (subject > ROBOTS).then_some((t, sighting))
    });
    let events = merge(&velocities, batches(sightings));
    ensure!(!events.is_empty(), "{}: neither odometry nor measurements", place.display());
    let truth = match file(&format!("robot{robot}_groundtruth.dat")) {
        Ok(path) => in_order(numbers(&path, "t x y theta")?).map(pose).collect(),
        Err(_) => Vec::new(),
    };
    let landmarks = match file("landmark_groundtruth.dat") {
        Ok(path) => numbers(&path, "subject x y")?.into_iter().filter_map(landmark).collect(),
        Err(_) => Vec::new(),
    };
    let name = format!("{}, robot {robot}", place.display());
    Ok(Drive {
        name,
        events,
        truth,
        has_headings: true,
        landmarks,
        config: config(),
        detect: None,
        has_identities: true,
    })
}

/// How much longer the ray at bearing `beta_rad` is than its depth.
fn stretch(beta_rad: f64) -> f64 {
    beta_rad.cos().max(COS_MIN).recip()
}

/// The mean over all measurements (`t barcode range bearing`); 1 without any.
fn mean_stretch(measurements: &[[f64; 4]]) -> f64 {
    let sum: f64 = measurements.iter().map(|[.., bearing_rad]| stretch(*bearing_rad)).sum();
    if measurements.is_empty() { 1.0 } else { sum / measurements.len() as f64 }
}

/// Noise of these robots and cameras.
///
/// Cameras: what is left of a range is an error of a few percent that lasts, from lens and mounting, and some centimetres that change.
/// Robots: wheels slip by a tenth, and turn by some degrees in a second beyond what they report.
fn config() -> LandmarkConfig {
    LandmarkConfig {
        alpha_1: 0.1,
        alpha_2: 0.02,
        alpha_3: 0.3,
        alpha_4: 0.3,
        control_hold_s: 0.5,
        range_noise_m: 0.03,
        range_noise_share: 0.02,
        bearing_noise_deg: 1.5,
        sighting_hold_s: 0.5,
        ..LandmarkConfig::default()
    }
}

fn code(number: f64) -> Option<u16> {
    (number >= 0.0 && number < f64::from(u16::MAX)).then_some(number as u16)
}

fn pose([t, x, y, heading]: [f64; 4]) -> TimedPose {
    TimedPose { stamp: Instant::from_secs_f64(t), map_from_robot: PoseF64::new(x, y, heading).to_f32() }
}

fn landmark([subject, x, y]: [f64; 3]) -> Option<TrueLandmark> {
    Some(TrueLandmark { identity: code(subject)?, x, y })
}

/// Rows in order of their first number; equal ones stay as they are.
pub(super) fn in_order<const N: usize>(mut rows: Vec<[f64; N]>) -> impl Iterator<Item = [f64; N]> {
    let first = |row: &[f64; N]| row.first().copied().unwrap_or_default();
    rows.sort_by(|a, b| first(a).total_cmp(&first(b)));
    rows.into_iter()
}

/// The first numbers of each row, of which `columns` says the names.
pub(super) fn numbers<const N: usize>(path: &Path, columns: &'static str) -> anyhow::Result<Vec<[f64; N]>> {
    Ok(read_table(path, columns, |words| {
        let mut row = [0.0; N];
        for (number, name) in row.iter_mut().zip(columns.split(' ')) {
            *number = words.finite(name)?;
        }
        Ok(row)
    })?)
}

/// The one file whose name ends with `ending`, without regard to case and `.gz`.
pub(super) fn find(place: &Path, ending: &str) -> anyhow::Result<PathBuf> {
    let (folder, prefix) = match place.is_dir() {
        true => (place.to_owned(), String::new()),
        false => {
            let parent = place.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
            (parent.to_owned(), place.file_name().unwrap_or_default().to_string_lossy().to_lowercase())
        }
    };
    let entries = std::fs::read_dir(&folder).with_context(|| format!("{}: cannot be read", folder.display()))?;
    let mut found: Vec<PathBuf> = Vec::new();
    for entry in entries {
        let path = entry?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
        let name = name.strip_suffix(".gz").unwrap_or(&name);
        if name.starts_with(&prefix) && name.ends_with(ending) {
            found.push(path);
        }
    }
    found.sort();
    match found.as_slice() {
        [one] => Ok(one.clone()),
        [] => bail!("{}: no file called …{ending}", place.display()),
        [first, second, ..] => bail!(
            "{}: {} and {} both end with {ending}; say how the names begin, as {}/mrclam7",
            place.display(),
            first.display(),
            second.display(),
            folder.display()
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depths_become_distances_that_are_the_same_on_average() {
        let measurements = [0.0, -0.5, 0.3].map(|beta| [0.0, 63.0, 2.0, beta]);
        let mean = mean_stretch(&measurements);
        let distances: f64 = measurements.iter().map(|row| row[2] * stretch(row[3]) / mean).sum();
        assert!((distances - 6.0).abs() < 1e-12, "{distances}");
        assert!(stretch(0.5) > 1.13 && (mean_stretch(&[]) - 1.0).abs() < 1e-12);
    }
}
