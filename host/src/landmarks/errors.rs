//! Errors of a path and of landmarks against the truth.
//!
//! A SLAM's frame is its own: estimates are first laid on the truth by the rotation and translation that fit best in the mean square, without
//! a scale (Umeyama, IEEE PAMI 13(4), 1991). The path is aligned by itself; landmarks once by themselves, and once with the path.

use lrfslam_core::landmark::RobotState;
use lrfslam_core::landmark::sight::Sensor;
use lrfslam_core::time::Instant;
use nalgebra::Vector2;
use serde::Serialize;

use super::{Drive, Estimate, MapLandmark, What};
use crate::pose_f64::PoseF64;
use crate::trajectory::TimedPose;

/// Truth this far from an estimate in time is no truth for it, s.
const GAP_MAX_S: f64 = 1.5;

/// Errors against the truth; what is not known is none.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct LandmarkErrors {
    /// Root mean square distance of the path from the true one, m.
    pub path_rmse_m: Option<f64>,
    /// The largest, m.
    pub path_max_m: Option<f64>,
    /// Root mean square error of the heading, degrees.
    pub heading_rmse_deg: Option<f64>,
    /// Root mean square distance of landmarks, aligned by themselves, m.
    pub landmarks_rmse_m: Option<f64>,
    /// The same, aligned with the path, m.
    pub landmarks_with_path_rmse_m: Option<f64>,
    /// True landmarks that were found.
    pub landmarks_found: usize,
    /// Landmarks in the map that stand for none, or for one that another stands for already.
    pub landmarks_false: usize,
}

type Pair = ((f64, f64), (f64, f64));

/// Judges a path and landmarks.
pub fn errors(drive: &Drive, path: &[TimedPose], landmarks: &[MapLandmark]) -> LandmarkErrors {
    let mut errors = LandmarkErrors::default();
    let pairs = with_truth(drive, path);
    let points: Vec<Pair> = pairs.iter().map(|(a, b)| ((a.x, a.y), (b.x, b.y))).collect();
    let by_path = align(&points);
    if let Some(truth_from_map) = by_path {
        let off = |(a, b): &(PoseF64, PoseF64)| {
            let at = truth_from_map.then(*a);
            ((at.x - b.x).hypot(at.y - b.y), crate::pose_f64::wrap(at.heading - b.heading))
        };
        let offs: Vec<(f64, f64)> = pairs.iter().map(off).collect();
        errors.path_rmse_m = Some(root_mean_square(offs.iter().map(|off| off.0)));
        errors.path_max_m = Some(offs.iter().map(|off| off.0).fold(0.0, f64::max));
        if drive.has_headings {
            errors.heading_rmse_deg = Some(root_mean_square(offs.iter().map(|off| off.1)).to_degrees());
        }
    }
    let matched = match drive.has_identities && landmarks.iter().all(|landmark| landmark.identity.is_some()) {
        true => by_identity(drive, landmarks),
        false => by_place(drive, landmarks, by_path),
    };
    errors.landmarks_found = matched.len();
    if !drive.landmarks.is_empty() {
        errors.landmarks_false = landmarks.len().saturating_sub(matched.len());
    }
    errors.landmarks_rmse_m = align(&matched).map(|by_self| distance(&matched, by_self));
    errors.landmarks_with_path_rmse_m =
        by_path.filter(|_| !matched.is_empty()).map(|by_path| distance(&matched, by_path));
    errors
}

/// The true path and landmarks in the frame of `path`, for a picture; empty if there is no truth.
pub fn aligned(drive: &Drive, path: &[TimedPose]) -> (Vec<TimedPose>, Vec<Vector2<f64>>) {
    let points: Vec<Pair> = with_truth(drive, path).iter().map(|(a, b)| ((b.x, b.y), (a.x, a.y))).collect();
    let Some(map_from_truth) = align(&points) else { return (Vec::new(), Vec::new()) };
    let pose = |pose: &TimedPose| TimedPose {
        stamp: pose.stamp,
        map_from_robot: map_from_truth.then(pose.map_from_robot.into()).to_f32(),
    };
    let landmark = |landmark: &super::TrueLandmark| {
        let (x, y) = moved(map_from_truth, (landmark.x, landmark.y));
        Vector2::new(x, y)
    };
    (drive.truth.iter().map(pose).collect(), drive.landmarks.iter().map(landmark).collect())
}

/// Poses with the true ones of the same time.
fn with_truth(drive: &Drive, path: &[TimedPose]) -> Vec<(PoseF64, PoseF64)> {
    let pair = |pose: &TimedPose| Some((pose.map_from_robot.into(), pose_at(&drive.truth, pose.stamp)?));
    path.iter().filter_map(pair).collect()
}

fn by_identity(drive: &Drive, landmarks: &[MapLandmark]) -> Vec<Pair> {
    let of = |truth: &super::TrueLandmark| {
        let same = landmarks.iter().filter(|landmark| landmark.identity == Some(truth.identity));
        same.max_by_key(|landmark| landmark.sightings).map(|found| ((found.at.x, found.at.y), (truth.x, truth.y)))
    };
    drive.landmarks.iter().filter_map(of).collect()
}

/// Median distance between a range as seen and as path and map expect it, m: how well a run fits its own data, without any truth.
///
/// * of sightings with the identity of a landmark in the map; the sensor is where the configuration has it
pub fn range_misfit(drive: &Drive, estimate: &Estimate) -> Option<f64> {
    let (path, landmarks) = (estimate.best_path(), &estimate.landmarks);
    let sensor = Sensor::new(&drive.config);
    let mut misfits: Vec<f64> = Vec::new();
    for event in &drive.events {
        let What::Sightings(sightings) = &event.what else { continue };
        let Some(pose) = pose_at(path, event.stamp) else { continue };
        let robot = RobotState::new(pose.x, pose.y, pose.heading, 1.0, 1.0);
        for sighting in sightings.iter().filter(|sighting| sighting.identity.is_some()) {
            let landmark = landmarks.iter().find(|landmark| landmark.identity == sighting.identity);
            let view = landmark.and_then(|landmark| sensor.view(&robot, landmark.at));
            misfits.extend(view.map(|view| (sighting.range_m - view.seen.x).abs()));
        }
    }
    misfits.sort_by(f64::total_cmp);
    misfits.get(misfits.len() / 2).copied()
}

/// Of each true landmark the nearest found within half a metre of it in the path's frame; each found one stands for one.
fn by_place(drive: &Drive, landmarks: &[MapLandmark], by_path: Option<PoseF64>) -> Vec<Pair> {
    let Some(truth_from_map) = by_path else { return Vec::new() };
    let mut near: Vec<(f64, usize, usize)> = Vec::new();
    for (index, truth) in drive.landmarks.iter().enumerate() {
        for (found, landmark) in landmarks.iter().enumerate() {
            let (x, y) = moved(truth_from_map, (landmark.at.x, landmark.at.y));
            near.push(((x - truth.x).hypot(y - truth.y), index, found));
        }
    }
    near.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut taken: (Vec<usize>, Vec<usize>) = (Vec::new(), Vec::new());
    let mut pairs = Vec::new();
    for (distance, index, found) in near {
        if distance > 0.5 || taken.0.contains(&index) || taken.1.contains(&found) {
            continue;
        }
        taken.0.push(index);
        taken.1.push(found);
        let (truth, landmark) = (&drive.landmarks[index], &landmarks[found]);
        pairs.push(((landmark.at.x, landmark.at.y), (truth.x, truth.y)));
    }
    pairs
}

/// The pose of `path` at a time, between its neighbours; none before the first, after the last, or in a gap.
pub(super) fn pose_at(path: &[TimedPose], stamp: Instant) -> Option<PoseF64> {
    let after = path.partition_point(|known| known.stamp < stamp);
    let (b, a) = (path.get(after)?, path.get(after.checked_sub(1)?).or(path.get(after))?);
    let (t, from, to) = (stamp.as_secs_f64(), a.stamp.as_secs_f64(), b.stamp.as_secs_f64());
    if to - from > GAP_MAX_S {
        return None;
    }
    let share = if to > from { (t - from) / (to - from) } else { 0.0 };
    let (a, b) = (PoseF64::from(a.map_from_robot), PoseF64::from(b.map_from_robot));
    let heading = a.heading + share * crate::pose_f64::wrap(b.heading - a.heading);
    Some(PoseF64::new(a.x + share * (b.x - a.x), a.y + share * (b.y - a.y), heading))
}

/// Rotation and translation that bring the first of each pair nearest to the second; none for fewer than two.
pub fn align(pairs: &[Pair]) -> Option<PoseF64> {
    if pairs.len() < 2 {
        return None;
    }
    let n = pairs.len() as f64;
    let mean = |of: fn(&Pair) -> f64| pairs.iter().map(of).sum::<f64>() / n;
    let (ax, ay, bx, by) = (mean(|p| p.0.0), mean(|p| p.0.1), mean(|p| p.1.0), mean(|p| p.1.1));
    let (mut dot, mut cross) = (0.0, 0.0);
    for ((x, y), (u, v)) in pairs {
        let (x, y, u, v) = (x - ax, y - ay, u - bx, v - by);
        dot += x * u + y * v;
        cross += x * v - y * u;
    }
    let heading = cross.atan2(dot);
    let (x, y) = moved(PoseF64::new(0.0, 0.0, heading), (ax, ay));
    Some(PoseF64::new(bx - x, by - y, heading))
}

fn moved(frame: PoseF64, (x, y): (f64, f64)) -> (f64, f64) {
    let at = frame.then(PoseF64::new(x, y, 0.0));
    (at.x, at.y)
}

fn distance(pairs: &[Pair], frame: PoseF64) -> f64 {
    root_mean_square(pairs.iter().map(|(a, b)| {
        let at = moved(frame, *a);
        (at.0 - b.0).hypot(at.1 - b.1)
    }))
}

fn root_mean_square(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0), |(sum, count), value| (sum + value * value, count + 1));
    if count == 0 { 0.0 } else { (sum / f64::from(count)).sqrt() }
}
