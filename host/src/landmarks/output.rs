//! Results of a run: the path, the landmarks with their covariances, a picture, and what the run was.

use std::io::Write as _;
use std::path::Path;

use lrfslam_core::landmark::detect::DetectConfig;
use lrfslam_core::landmark::{LandmarkConfig, SightingCounts};
use serde::Serialize;

use super::errors::{LandmarkErrors, aligned, errors, range_misfit};
use super::{Drive, Filter, LandmarkRun};
use crate::maps::picture::{LandmarkScene, landmarks_png};
use crate::output::{save_by, save_file, save_json};
use crate::program::Program;
use crate::trajectory::write_trajectory;

/// What a run was, and how it went.
#[derive(Debug, Clone, Serialize)]
pub struct LandmarkReport {
    /// Name and version of the program.
    pub program: Program,
    /// Which drive.
    pub drive: String,
    /// Which filter.
    pub filter: Filter,
    /// Every value used.
    pub config: LandmarkConfig,
    /// How landmarks were looked for in a laser's scans.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub detect: Option<DetectConfig>,
    /// Of the random numbers.
    pub seed: u64,
    /// What became of sightings.
    pub sightings: Counts,
    /// Landmarks in the map.
    pub landmarks: usize,
    /// True over reported distance, as estimated.
    pub distance_scale: f64,
    /// True over reported turn, as estimated.
    pub turn_scale: f64,
    /// Errors of path and landmarks as they are believed at the end (trajectory.tum, landmarks.csv).
    pub errors: LandmarkErrors,
    /// Errors of the path as it was believed on the way (online.tum), and of the landmarks as the filter has them.
    pub online: LandmarkErrors,
    /// Median distance between ranges as seen and as path and map at the end expect them, m; needs identities, but no truth.
    pub range_misfit_m: Option<f64>,
    /// Controls taken.
    pub controls: u64,
    /// Batches of sightings taken.
    pub batches: u64,
    /// Time spent in the filter, s.
    pub wall_s: f64,
    /// Memory lent to it, bytes.
    pub memory_bytes: usize,
}

/// [`SightingCounts`], as the report has them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Counts {
    /// Of a landmark that was known.
    pub matched: u32,
    /// Of a new one.
    pub began: u32,
    /// Not used.
    pub refused: u32,
    /// No room for a new one.
    pub full: u32,
    /// Landmarks taken out again.
    pub removed: u32,
}

impl From<SightingCounts> for Counts {
    fn from(counts: SightingCounts) -> Self {
        let SightingCounts { matched, began, refused, full, removed } = counts;
        Self { matched, began, refused, full, removed }
    }
}

impl LandmarkReport {
    /// Judges a run.
    pub fn new(drive: &Drive, config: &LandmarkConfig, filter: Filter, seed: u64, run: &LandmarkRun) -> Self {
        let estimate = &run.estimate;
        Self {
            program: Program::THIS,
            drive: drive.name.clone(),
            filter,
            config: *config,
            detect: drive.detect,
            seed,
            sightings: run.counts.into(),
            landmarks: estimate.landmarks.len(),
            distance_scale: estimate.distance_scale,
            turn_scale: estimate.turn_scale,
            errors: errors(drive, estimate.best_path(), &estimate.landmarks),
            online: errors(drive, &estimate.online, &estimate.online_landmarks),
            range_misfit_m: range_misfit(drive, estimate),
            controls: run.controls,
            batches: run.batches,
            wall_s: run.wall_s,
            memory_bytes: run.memory_bytes,
        }
    }
}

/// Writes trajectory.tum, online.tum, landmarks.csv, landmarks.png and run.json into `folder`.
///
/// # Errors
/// If a file cannot be written; it is named.
pub fn write(folder: &Path, drive: &Drive, run: &LandmarkRun, report: &LandmarkReport) -> anyhow::Result<()> {
    let estimate = &run.estimate;
    write_trajectory(&folder.join("trajectory.tum"), estimate.best_path().to_vec())?;
    write_trajectory(&folder.join("online.tum"), estimate.online.clone())?;
    save_by(&folder.join("landmarks.csv"), |out| {
        writeln!(out, "identity,x_m,y_m,xx_m2,xy_m2,yy_m2,sightings")?;
        for landmark in &estimate.landmarks {
            let identity = landmark.identity.map_or(String::new(), |identity| identity.to_string());
            let (at, c) = (landmark.at, landmark.covariance);
            writeln!(
                out,
                "{identity},{:.6},{:.6},{:e},{:e},{:e},{}",
                at.x, at.y, c.m11, c.m12, c.m22, landmark.sightings
            )?;
        }
        Ok(())
    })?;
    let landmarks: Vec<_> = estimate.landmarks.iter().map(|landmark| (landmark.at, landmark.covariance)).collect();
    let (truth, true_landmarks) = aligned(drive, estimate.best_path());
    let scene = LandmarkScene {
        path: estimate.best_path(),
        truth: &truth,
        landmarks: &landmarks,
        true_landmarks: &true_landmarks,
    };
    save_file(&folder.join("landmarks.png"), &landmarks_png(&scene)?)?;
    save_json(&folder.join("run.json"), report)
}
