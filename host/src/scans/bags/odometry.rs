//! Odometry at the times of the scans: between the message before and the one after.

use std::collections::VecDeque;

use lrfslam_core::time::Instant;

use super::BagScan;
use crate::pose_f64::{PoseF64, wrap};

/// Scans that wait for the next odometry.
const WAITING_MAX: usize = 20;
/// Odometry farther away from a scan says nothing about it, µs.
const NEAR_US: i64 = 500_000;

/// Scans on their way, and the odometry on both sides of them.
#[derive(Debug, Default)]
pub(super) struct Odometry {
    before: Option<(Instant, PoseF64)>,
    waiting: VecDeque<BagScan>,
    done: VecDeque<BagScan>,
}

impl Odometry {
    /// A scan; it waits if there is odometry in the bag.
    pub fn add_scan(&mut self, scan: BagScan) {
        self.waiting.push_back(scan);
        while self.waiting.len() > WAITING_MAX || (self.before.is_none() && !self.waiting.is_empty()) {
            self.release(None);
        }
    }

    /// A pose; the scans before it can go.
    pub fn add(&mut self, stamp: Instant, pose: PoseF64) {
        while self.waiting.front().is_some_and(|scan| scan.stamp <= stamp) {
            self.release(Some((stamp, pose)));
        }
        self.before = Some((stamp, pose));
    }

    /// Scans that wait for nothing more.
    pub fn ready(&mut self) -> impl Iterator<Item = BagScan> + '_ {
        self.done.drain(..)
    }

    /// All that are left.
    pub fn finish(&mut self) -> impl Iterator<Item = BagScan> + '_ {
        while !self.waiting.is_empty() {
            self.release(None);
        }
        self.done.drain(..)
    }

    fn release(&mut self, after: Option<(Instant, PoseF64)>) {
        let Some(mut scan) = self.waiting.pop_front() else { return };
        let is_near = |(stamp, _): &(Instant, PoseF64)| stamp.since(scan.stamp).micros.abs() <= NEAR_US;
        let pose = match (self.before.filter(is_near), after.filter(is_near)) {
            (Some(before), Some(after)) => Some(between(before, after, scan.stamp)),
            (before, after) => before.or(after).map(|(_, pose)| pose),
        };
        // Scans of this program carry their own.
        scan.odometry_from_robot = scan.odometry_from_robot.or(pose);
        self.done.push_back(scan);
    }
}

/// Evenly between two poses.
fn between((from, a): (Instant, PoseF64), (to, b): (Instant, PoseF64), at: Instant) -> PoseF64 {
    let span = to.since(from).micros;
    let share = if span > 0 { (at.since(from).micros as f64 / span as f64).clamp(0.0, 1.0) } else { 1.0 };
    let mixed = |a: f64, b: f64| a + share * (b - a);
    PoseF64::new(mixed(a.x, b.x), mixed(a.y, b.y), wrap(a.heading + share * wrap(b.heading - a.heading)))
}
