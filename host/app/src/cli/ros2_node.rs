//! The node of `--ros2` and of `--lrf ros2:TOPIC`.

use std::sync::atomic::AtomicBool;
use std::time::Instant;

use lrfslam_core::geometry::Pose2;
use lrfslam_core::scan::RangeScan;
use lrfslam_host::maps::occupancy::Raster;
use lrfslam_host::runs::map::Whereabouts;
use lrfslam_host::runs::scans::Scans;
use lrfslam_host::scans::live::{Say, Take};
use lrfslam_ros2::{Node, Patience, Step, Subscription, Topics};

use super::Failure;
use super::laser::say;
use super::ros2::Domain;

/// What a run publishes.
pub(super) struct Published(Topics);

impl Published {
    pub(super) fn announce(domain: Domain, has_scan: bool) -> Result<Self, Failure> {
        Topics::announce(&join(domain)?, has_scan).map(Self).map_err(Failure::start)
    }

    pub(super) fn step(&mut self, scan: RangeScan<'_>, robot_from_lrf: Pose2, place: Whereabouts) {
        self.0.step(&Step { scan, robot_from_lrf, place });
    }

    /// * `draw` — the map as it is now; called only if somebody wants one
    pub(super) fn map_if_due(&mut self, draw: impl FnOnce() -> Option<Raster>) {
        if self.0.wants_map() {
            self.map(draw);
        }
    }

    fn map(&mut self, draw: impl FnOnce() -> Option<Raster>) {
        let began = Instant::now();
        if let Some(raster) = draw() {
            self.0.map(&raster, began.elapsed());
        }
    }

    /// Publishes the last map, and waits a little for those who listen.
    pub(super) fn finish(mut self, draw: impl FnOnce() -> Option<Raster>) {
        self.map(draw);
        let left_out = self.0.finish();
        if left_out > 0 {
            say(&format!("--ros2: {left_out} messages were left out, since they were not taken in time"));
        }
    }
}

fn join(domain: Domain) -> Result<Node, Failure> {
    Node::join(domain.number, domain.is_local).map_err(Failure::start)
}

/// Scans that others publish.
pub(super) fn scans(
    topic: &'static str,
    (range_max_m, waits): (Option<f32>, bool),
    stop: &'static AtomicBool,
    say: Say,
) -> Result<Scans, Failure> {
    let node = join(Domain::of_environment().map_err(Failure::Start)?)?;
    let patience = if waits { Patience::Endless } else { Patience::Short };
    let subscription = Subscription::new(&node, topic, range_max_m, patience).map_err(Failure::start)?;
    let fetch = Box::new(move |enough: &AtomicBool, take: &mut Take<'_>| subscription.for_each_scan(enough, take));
    Ok(Scans::told(format!("ros2:{topic}"), fetch, stop, say))
}
