//! A page without a run: the test itself hands over scans, at poses that it chooses. So what is rare, and what takes a run hours, is seen soon.

use std::f64::consts::FRAC_PI_2;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::{Duration as WallDuration, Instant as WallInstant};

use lrfslam_core::geometry::{Point2, Pose2};
use lrfslam_core::scan::{Beam, Echo, RangeScan};
use lrfslam_core::sweep::Sweep;
use lrfslam_core::time::{Duration, Instant};
use lrfslam_firmware_sim::scenario::Scenario;
use lrfslam_firmware_sim::scene::Scene as _;
use lrfslam_host::mapping::high::{SegmentPose, Stretch};
use lrfslam_host::maps::occupancy::MapConfig;
use lrfslam_host::monitor::{About, Counts, Feed, Monitor, Now};
use lrfslam_host::pose_f64::PoseF64;
use lrfslam_host::scans::store::ScanStore;
use lrfslam_monitor::{Robot, Server, ServerConfig};

/// Beams of a scan: half a turn.
const BEAMS: usize = 181;
const RANGE_MAX_M: f32 = 30.0;
/// Watchers take what they are given within this.
const TAKEN_WITHIN: WallDuration = WallDuration::from_secs(60);

/// Nobody stops it.
static STOP: AtomicBool = AtomicBool::new(false);

/// A page, and what is on it.
pub struct Fed {
    pub feed: Feed,
    pub server: Server,
    pub stretches: Vec<Stretch>,
    /// By stretch.
    poses: Vec<Vec<SegmentPose>>,
    scans: ScanStore,
    /// Starts of two stretches each.
    pub closures: Vec<[usize; 2]>,
    /// How things stand; the pose and what was counted are filled in.
    pub now: Now,
}

impl Fed {
    /// Nothing is on it yet.
    pub fn start(source: &str) -> Self {
        let about =
            About { what: "map".to_owned(), source: source.to_owned(), map: MapConfig::default(), ..About::default() };
        let (monitor, feed) = Monitor::start(about, &STOP).unwrap();
        let config = ServerConfig {
            address: "127.0.0.1:0".parse().unwrap(),
            token: None,
            tell: Arc::new(|text| println!("{text}")),
        };
        let server = Server::start(config, vec![Robot::here(source, monitor)]).unwrap();
        let (stretches, poses, scans) = (Vec::new(), Vec::new(), ScanStore::default());
        Self { feed, server, stretches, poses, scans, closures: Vec::new(), now: Now::default() }
    }

    /// A stretch of path that begins there, in a piece of map.
    pub fn begin_stretch(&mut self, map_from_start: Pose2, piece: usize) {
        let map_from_start = PoseF64::from(map_from_start);
        self.stretches.push(Stretch { map_from_start, bend: PoseF64::default(), slack_m: 0.0, piece });
        self.poses.push(Vec::new());
    }

    /// What the laser of a simulated robot sees at a time joins the last stretch; its frame is the building's.
    pub fn add_scan(&mut self, scenario: &Scenario, at: Instant) {
        let scene = scenario.scene();
        let beam = |k: usize| {
            let bearing = k as f64 * std::f64::consts::PI / (BEAMS - 1) as f64 - FRAC_PI_2;
            let range_m = scene.range_m(at, bearing).map(|range_m| range_m as f32);
            let echo = range_m.filter(|range_m| *range_m < RANGE_MAX_M).map_or(Echo::Miss, Echo::Hit);
            Beam { bearing_rad: bearing as f32, offset: Duration::ZERO, echo }
        };
        let beams: Vec<Beam> = (0..BEAMS).map(beam).collect();
        let scan = RangeScan { stamp: at, range_max_m: RANGE_MAX_M, beams: &beams };
        self.scans.add(&Sweep::at_rest(scan, Pose2::IDENTITY));
        let there = scenario.drive().pose(at);
        let pose = PoseF64::new(there.x, there.y, there.heading);
        let start = self.stretches.last().expect("a stretch has begun").map_from_start;
        let start_from_robot = start.between(pose).to_f32();
        let number = Some(self.scans.len() as u32 - 1);
        let poses = self.poses.last_mut().expect("a stretch has begun");
        poses.push(SegmentPose { stamp: at, start_from_robot, slack_m: 0.0, scan: number, is_lost: false });
        self.now.stamp = at;
        self.now.hits = beams.iter().filter_map(Point2::of_hit).collect();
    }

    /// Hands over all that is new, once somebody looks.
    pub fn give(&mut self) {
        let begun = WallInstant::now();
        loop {
            assert!(begun.elapsed() < TAKEN_WITHIN, "nobody takes what is given");
            if !self.feed.is_wanted() {
                std::thread::sleep(WallDuration::from_millis(5));
                continue;
            }
            if self.give_some() {
                return;
            }
        }
    }

    /// `true` if that was all.
    fn give_some(&mut self) -> bool {
        let (mut batch, mut cursor) = self.feed.begin();
        batch.stretches.clone_from(&self.stretches);
        batch.closures.clone_from(&self.closures);
        let last = self.stretches.len() - 1;
        let mut beams = Vec::new();
        while !batch.has_more {
            match self.poses[cursor.stretch].get(cursor.poses) {
                Some(pose) => {
                    let given = (cursor.stretch, pose, false);
                    batch.push(&mut cursor, given, |scan| self.scans.sweep(scan, &mut beams));
                }
                None if cursor.stretch < last => (cursor.stretch, cursor.poses) = (cursor.stretch + 1, 0),
                None => break,
            }
        }
        let end = self.poses[last].last().map_or(Pose2::IDENTITY, |pose| pose.start_from_robot);
        let pose = self.stretches[last].map_from_start.then(PoseF64::from(end)).to_f32();
        let scans = self.poses.iter().map(|poses| poses.len() as u64).sum();
        let closures = self.closures.len() as u64;
        let counts = Counts { scans, closures, ..self.now.counts };
        let known = Some(pose);
        batch.now = Some(Now { map_from_robot: known, low_from_robot: pose, counts, ..self.now.clone() });
        let has_more = batch.has_more;
        self.feed.give(batch, cursor);
        // What was not taken is wanted still.
        !has_more && !self.feed.is_wanted()
    }
}
