//! The run's end: asks whether anybody looks, and hands over what is new.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration as WallDuration, Instant as WallInstant};

use lrfslam_core::geometry::Pose2;
use lrfslam_core::sweep::Sweep;

use super::batch::{Batch, GivenPose};
use super::hub::Hub;
use crate::mapping::high::SegmentPose;

/// A map to look at needs scans so far apart only, m …
const APART_M: f32 = 0.1;
/// … or so far turned, rad. Both chosen.
const APART_RAD: f32 = 0.09;
/// Scans in a batch: a few ms to copy. Chosen.
const SCANS_MAX: usize = 1000;
/// Poses in a batch.
const POSES_MAX: usize = 20_000;
/// Watchers are given so long to fetch the last state.
const FAREWELL: WallDuration = WallDuration::from_secs(2);
/// How soon a paused or ended run notices that it is asked for something.
const NOTICED_AFTER: WallDuration = WallDuration::from_millis(10);

/// What was given already.
#[derive(Debug, Clone, Copy, Default)]
pub struct Cursor {
    /// Index of the first stretch that was not given whole.
    pub stretch: usize,
    /// Poses of it that were given.
    pub poses: usize,
    /// Stretch and pose of the last scan given.
    kept: Option<(usize, Pose2)>,
}

/// The run's end of the live state: takes what happens, and never waits.
#[derive(Debug)]
pub struct Feed {
    hub: Arc<Hub>,
    cursor: Cursor,
    begins_anew: bool,
    cloud: Vec<[f32; 3]>,
    cloud_given: usize,
}

impl Feed {
    pub(super) fn new(hub: Arc<Hub>) -> Self {
        Self { hub, cursor: Cursor::default(), begins_anew: true, cloud: Vec::new(), cloud_given: 0 }
    }

    /// True if somebody looks, and the last batch has been taken: one load of an atomic.
    pub fn is_wanted(&self) -> bool {
        self.hub.wanted.load(Ordering::Relaxed)
    }

    /// Another run begins: nothing of it was given yet.
    pub fn begin_anew(&mut self) {
        (self.cursor, self.begins_anew, self.cloud_given) = (Cursor::default(), true, 0);
        self.cloud.clear();
    }

    /// Adds points to the 3D map, map frame, m.
    pub fn add_cloud(&mut self, points: impl IntoIterator<Item = [f32; 3]>) {
        self.cloud.extend(points);
    }

    /// A batch to fill, and what was given before it.
    pub fn begin(&mut self) -> (Batch, Cursor) {
        let cloud = self.cloud[self.cloud_given..].to_vec();
        (Batch { begins_anew: self.begins_anew, cloud, ..Batch::default() }, self.cursor)
    }

    /// Hands the batch over; if it cannot be taken now, it will be asked for again from the same `cursor` on.
    pub fn give(&mut self, batch: Batch, cursor: Cursor) {
        if self.hub.take(batch) {
            (self.cursor, self.begins_anew, self.cloud_given) = (cursor, false, self.cloud.len());
        }
    }

    /// Somebody wants the results to be saved now.
    pub fn is_asked_to_save(&self) -> bool {
        self.hub.saves.load(Ordering::Relaxed) && self.hub.saves.swap(false, Ordering::Relaxed)
    }

    /// Returns once nobody wants a pause, or `stop`; `show` is called whenever the state is wanted.
    pub fn pause(&mut self, stop: &AtomicBool, mut show: impl FnMut(&mut Self)) {
        while self.hub.is_paused.load(Ordering::Relaxed) && !stop.load(Ordering::Relaxed) {
            if self.is_wanted() {
                show(self);
            }
            std::thread::sleep(NOTICED_AFTER);
        }
    }

    /// The run is over: says so, and lets those who look fetch the last state, two seconds long at most.
    ///
    /// * `stays` — keeps the state until then, for those who come later
    /// * `show` — gives what is left
    pub fn finish(&mut self, words: &str, stays: Option<&AtomicBool>, mut show: impl FnMut(&mut Self)) {
        self.hub.end(words);
        let ended = WallInstant::now();
        let is_leaving = |feed: &Self| stays.map_or(feed.hub.is_left_alone(ended), |stop| stop.load(Ordering::Relaxed));
        while !is_leaving(self) && (stays.is_some() || ended.elapsed() < FAREWELL) {
            if self.is_wanted() {
                show(self);
            }
            std::thread::sleep(NOTICED_AFTER);
        }
    }
}

impl Batch {
    /// Adds the pose after `cursor`, with its scan if that is needed for a map; `false` if the batch is full.
    ///
    /// * `sweep` — the scan that was stored under a number
    pub fn push<'s>(
        &mut self,
        cursor: &mut Cursor,
        (stretch, pose, is_old): (usize, &SegmentPose, bool),
        sweep: impl FnOnce(usize) -> Option<Sweep<'s>>,
    ) -> bool {
        if self.scans.len() >= SCANS_MAX || self.poses.len() >= POSES_MAX {
            self.has_more = true;
            return false;
        }
        let is_apart = cursor.kept.is_none_or(|(of, kept)| {
            let moved = kept.between(pose.start_from_robot);
            of != stretch || moved.position().norm() >= APART_M || moved.heading.abs() >= APART_RAD
        });
        let scan = pose.scan.filter(|_| is_apart).and_then(|scan| sweep(scan as usize)).map(|sweep| {
            cursor.kept = Some((stretch, pose.start_from_robot));
            self.scans.add(&sweep);
            self.scans.len() as u32 - 1
        });
        self.poses.push(GivenPose { stretch, pose: SegmentPose { scan, ..*pose }, is_old });
        cursor.poses += 1;
        true
    }
}
