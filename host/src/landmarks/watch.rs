//! A run among landmarks for those who look: path, landmarks with their covariances, and how things stand.

use lrfslam_core::geometry::Pose2;
use lrfslam_core::landmark::fast::FastParticle;
use lrfslam_core::time::Instant;

use super::run::Glance;
use super::{Estimate, MapLandmark};
use crate::mapping::high::{SegmentPose, Stretch};
use crate::monitor::{Batch, Counts, Cursor, Feed, Now, State};
use crate::pose_f64::PoseF64;
use crate::trajectory::TimedPose;

/// Hands over what is new of a run on its way; call it when [`Feed::is_wanted`].
pub fn show(feed: &mut Feed, glance: &Glance<'_>) {
    let (robot, covariance) = glance.robot();
    let map_from_robot = PoseF64::new(robot[0], robot[1], robot[2]).to_f32();
    let particle = |particle: &FastParticle| {
        let robot = particle.robot;
        (PoseF64::new(robot[0], robot[1], robot[2]).to_f32(), particle.weight as f32)
    };
    let now = Now {
        stamp: glance.stamp,
        map_from_robot: Some(map_from_robot),
        low_from_robot: map_from_robot,
        covariance: covariance.cast(),
        particles: glance.particles().iter().map(particle).collect(),
        landmarks: told(&glance.landmarks()),
        state: if glance.share < 1.0 { State::Tracking } else { State::Fitting },
        counts: Counts { scans: glance.batches, ..Counts::default() },
        ..Now::default()
    };
    give(feed, glance.path, now);
}

/// Hands over path and landmarks as they are believed at the end; what was shown on the way [is not wanted any more](Feed::begin_anew).
pub fn show_end(feed: &mut Feed, estimate: &Estimate, batches: u64) {
    let path = estimate.best_path();
    let last = path.last().map(|pose| pose.map_from_robot);
    let now = Now {
        stamp: path.last().map_or(Instant::default(), |pose| pose.stamp),
        map_from_robot: last,
        low_from_robot: last.unwrap_or_default(),
        landmarks: told(&estimate.landmarks),
        counts: Counts { scans: batches, ..Counts::default() },
        ..Now::default()
    };
    give(feed, path, now);
}

fn told(landmarks: &[MapLandmark]) -> Vec<[f32; 5]> {
    let of = |landmark: &MapLandmark| {
        let c = landmark.covariance;
        [landmark.at.x, landmark.at.y, c.m11, c.m12, c.m22].map(|number| number as f32)
    };
    landmarks.iter().map(of).collect()
}

/// The path is one stretch that never moves.
fn give(feed: &mut Feed, path: &[TimedPose], now: Now) {
    let (mut batch, mut cursor): (Batch, Cursor) = feed.begin();
    let map_from_start = PoseF64::from(Pose2::IDENTITY);
    batch.stretches.push(Stretch { map_from_start, bend: PoseF64::default(), slack_m: 0.0, piece: 0 });
    while let Some(pose) = path.get(cursor.poses) {
        let (stamp, start_from_robot) = (pose.stamp, pose.map_from_robot);
        let pose = SegmentPose { stamp, start_from_robot, slack_m: 0.0, scan: None, is_lost: false };
        if !batch.push(&mut cursor, (0, &pose, false), |_| None) {
            break;
        }
    }
    batch.now = Some(now);
    feed.give(batch, cursor);
}
