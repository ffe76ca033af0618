//! A run for those who watch it.

use std::time::Duration as WallDuration;

use lrfslam_core::geometry::Pose2;
use lrfslam_core::scan::RangeScan;
use lrfslam_core::slam::StepReport;
use lrfslam_core::sweep::Sweep;
use lrfslam_core::time::Instant;

use super::{MapRun, Run};
use crate::mapping::LowLevel;
use crate::mapping::mapper::Mapper;
use crate::monitor::{Batch, Counts, Cursor, Feed, Health, Now, State};
use crate::results::quality::Fit;
use crate::robot::RobotMap;
use crate::runs::live::{now_of_step, pose_on, show_high, spread, stiff};

/// What a run does not know of itself.
#[derive(Debug, Clone, Copy, Default)]
pub struct Beside {
    /// Scans that were taken besides, such as a tilted laser's.
    pub scans: u64,
    /// Of laser or link, where it is known.
    pub health: Option<Health>,
    /// From the scan's stamp to now, of what is live.
    pub late: Option<WallDuration>,
}

impl Run<'_, Mapper<'_>> {
    /// Hands what is new to those who look; call it when [`Feed::is_wanted`]. The run does not change.
    ///
    /// * `seen` — the last scan, where the laser sat on the robot, and what came of it; `None` if nothing came
    pub fn show(&self, feed: &mut Feed, seen: Option<(&RangeScan<'_>, Pose2, &StepReport)>, beside: Beside) {
        self.give(feed, beside, |low| {
            let (scan, robot_from_lrf, step) = seen?;
            let sweep = Sweep { scan: *scan, robot_from_lrf, motion: step.odometry.motion };
            Some(now_of_step(&sweep, step, low.particles()))
        });
    }
}

impl Run<'_, RobotMap> {
    /// The same, of what a robot has told.
    ///
    /// * `hits` — of its last scan, robot frame, m, as far as it was told
    pub fn show(&self, feed: &mut Feed, beside: Beside) {
        self.give(feed, beside, |low| {
            let scan = low.scans().last()?;
            let particles = low.particles();
            let state = if scan.is_lost { State::Lost } else { State::Tracking };
            Some(Now {
                stamp: scan.stamp,
                low_from_robot: scan.odometry,
                covariance: spread(&particles),
                undetermined: scan.undetermined,
                state,
                hits: self.last_hits(),
                particles,
                ..Now::default()
            })
        });
    }

    fn last_hits(&self) -> Vec<lrfslam_core::geometry::Point2> {
        let scans = self.high.as_ref().map_or(&self.scans, |high| high.scans());
        scans.len().checked_sub(1).map_or_else(Vec::new, |last| scans.hits(last, f32::INFINITY).collect())
    }
}

impl<L: LowLevel> Run<'_, L> {
    fn give(&self, feed: &mut Feed, beside: Beside, now: impl FnOnce(&L) -> Option<Now>) {
        let (mut batch, mut cursor) = feed.begin();
        let map_from_robot = match &self.high {
            Some(high) => {
                show_high(high, false, &mut batch, &mut cursor);
                Some(high.map_from_robot())
            }
            None => self.show_low(&mut batch, &mut cursor),
        };
        if self.scans() > 0 {
            let now = now(&self.low).unwrap_or_else(|| self.now_of_path(map_from_robot));
            batch.now =
                Some(Now { map_from_robot, counts: self.watched_counts(beside), ..beside.with(now, self.working) });
        }
        feed.give(batch, cursor);
    }

    /// Of what was known already, for those who come when no scan does.
    fn now_of_path(&self, map_from_robot: Option<Pose2>) -> Now {
        let stamp = self.ends.map_or(Instant::default(), |[_, last]| last);
        let state = if self.fits.last() == Some(Fit::Lost) { State::Lost } else { State::Tracking };
        Now { stamp, state, low_from_robot: map_from_robot.unwrap_or_default(), ..Now::default() }
    }

    fn watched_counts(&self, beside: Beside) -> Counts {
        let high = self.high_counts().unwrap_or_default();
        Counts {
            scans: self.scans() as u64 + beside.scans,
            lost_scans: self.low.counts().lost_scans,
            closures: high.closures,
            pieces_apart: high.pieces_apart,
            found: 0,
        }
    }

    /// Without a high level the path is that of the best particle: each of its steps is a stretch, and may be another one the next time.
    fn show_low(&self, batch: &mut Batch, cursor: &mut Cursor) -> Option<Pose2> {
        batch.stretches = self.low.path().into_iter().map(|pose| stiff(pose, 0)).collect();
        if batch.stretches.is_empty() {
            batch.stretches.push(stiff(Pose2::IDENTITY, 0));
        }
        let last = batch.stretches.len() - 1;
        let mut beams = Vec::new();
        while let Some(place) = self.places.get(cursor.poses) {
            let scan = self.drawn.binary_search(&cursor.poses).ok().map(|scan| scan as u32);
            let pose = pose_on(place.stamp, place.step_from_robot, place.fit == Fit::Lost, scan);
            let given = (place.step.min(last), &pose, false);
            if !batch.push(cursor, given, |scan| self.scans.sweep(scan, &mut beams)) {
                break;
            }
        }
        let place = self.places.last()?;
        let stretch = batch.stretches.get(place.step.min(last))?;
        Some(stretch.map_from_start.to_f32() * place.step_from_robot)
    }
}

impl Beside {
    fn with(self, now: Now, working: WallDuration) -> Now {
        Now { health: self.health, late: self.late, working, ..now }
    }
}

impl MapRun<'_> {
    /// The run is over: says how it ended, and lets those who look see the last of it.
    ///
    /// * `stays` — see [`Feed::finish`]
    pub fn show_end(&self, feed: &mut Feed, words: &str, stays: Option<&std::sync::atomic::AtomicBool>) {
        feed.finish(words, stays, |feed| self.show(feed, None, Beside::default()));
    }
}
