use super::super::report::TILE_BYTES;
use super::*;
use crate::program::square::kept_free;
use crate::wire::frame::MAX_FRAME;
use crate::wire::message::{FromRobot, ToRobot};
use crate::wire::session::{Received, SessionMemory};
use lrfslam_core::ancestry::{Ancestry, Node, NodeId};
use lrfslam_core::distributed_map::{
    MapMemory, ParticleMapConfig, Print, Tile, TileHeader, TileId, Window, WindowFrame,
};
use lrfslam_core::geometry::Pose2;
use lrfslam_core::rays::Ray;
use lrfslam_core::time::{Duration, Instant};
use std::boxed::Box;
use std::collections::HashMap;
use std::vec;
use std::vec::Vec;

const CONFIG: ParticleMapConfig = ParticleMapConfig { square_size_m: 0.125, print_step: 1 };
/// Side of a tile, m.
const TILE_M: f32 = 1.0;
/// How far the robot sees, m.
const SEEN_M: f32 = 4.0;
/// Tiles to each side of the robot's.
const RADIUS: i16 = 6;
/// From scan to scan.
const SCAN_EVERY: Duration = Duration::from_millis(500);

fn leak<T: Clone>(value: T, count: usize) -> &'static mut [T] {
    Box::leak(vec![value; count].into())
}

fn session(epoch: u32) -> Session<'static> {
    Session::new(epoch, None, SessionMemory { queue: leak(0, 65_536), frame: leak(0, MAX_FRAME) })
}

/// The map of one particle.
struct OneMap {
    tree: Ancestry<'static>,
    map: DistributedMap<'static, TILE_SIDE>,
    window: Window<'static>,
}

impl OneMap {
    fn new(tiles: usize) -> Self {
        let memory = MapMemory {
            tiles: leak(Tile::UNSEEN, tiles),
            headers: leak(TileHeader::FREE, tiles),
            node_tiles: leak(TileId::NONE, 2),
            directory: leak(TileId::NONE, 256),
            ages: &mut [],
        };
        let map = DistributedMap::new(&CONFIG, memory).unwrap();
        let tree = Ancestry::new(leak(Node::FREE, 2)).unwrap();
        Self { tree, map, window: Window::new(leak(TileId::NONE, 256)).unwrap() }
    }

    fn keeping_free(mut self, tiles: u16) -> Self {
        self.map.keep_free(tiles);
        self
    }

    fn print(&mut self, rays: &[Ray], pose: Pose2) {
        let reach = Point2::new(SEEN_M, SEEN_M);
        let frame = WindowFrame::around(pose.position() - reach, pose.position() + reach, 16, TILE_M);
        self.window.open(&self.map, &self.tree, frame, NodeId::ROOT);
        Print::new(rays, pose).run(&mut self.map, &mut self.window).unwrap();
    }

    fn tiles(&self) -> HashMap<TilePlace, Vec<u8>> {
        let bytes = |place: TilePlace| {
            let mut memory = [0; TILE_BYTES];
            self.map.settled_tile(place).unwrap().to_bytes(&mut memory).unwrap().to_vec()
        };
        self.map.settled_places().map(|place| (place, bytes(place))).collect()
    }
}

/// A robot with little memory beside one with plenty, and a host.
struct Pair {
    now: Instant,
    robot: Session<'static>,
    host: Session<'static>,
    paging: Paging,
    small: OneMap,
    large: OneMap,
    left: HashMap<TilePlace, Vec<u8>>,
    asked: Vec<Region>,
    answers: bool,
}

impl Pair {
    fn new() -> Self {
        let mut pair = Self {
            now: Instant::default(),
            robot: session(1),
            host: session(2),
            paging: Paging::new(TILE_M, RADIUS),
            small: OneMap::new(120).keeping_free(kept_free(RADIUS, 120)),
            large: OneMap::new(4000),
            left: HashMap::new(),
            asked: Vec::new(),
            answers: true,
        };
        pair.robot.connected(pair.now);
        pair.host.connected(pair.now);
        pair.exchange();
        pair
    }

    /// Frames both ways until both are silent, a millisecond each.
    fn exchange(&mut self) {
        let mut is_busy = true;
        while is_busy {
            self.now = self.now + Duration::from_millis(1);
            is_busy = self.robot_to_host() | self.host_to_robot();
        }
    }

    fn robot_to_host(&mut self) -> bool {
        let mut memory = [0; MAX_FRAME];
        let Some(frame) = self.robot.poll_transmit(self.now, &mut memory) else { return false };
        let (_, received) = self.host.take(self.now, frame);
        if let Some(Received::Reliable(message)) = received {
            match postcard::from_bytes(message).unwrap() {
                FromRobot::Left(TileUpdate { column, row, squares }) => {
                    self.left.insert(TilePlace { column, row }, squares.to_vec());
                }
                FromRobot::Recall(region) => self.asked.push(region),
                other => panic!("{other:?}"),
            }
        }
        self.answer();
        true
    }

    fn answer(&mut self) {
        for region in self.asked.drain(..).filter(|_| self.answers) {
            for (place, squares) in self.left.iter().filter(|(place, _)| region.contains(**place)) {
                let tile = TileUpdate { column: place.column, row: place.row, squares };
                self.host.send(&ToRobot::Tile(tile)).unwrap();
            }
            self.host.send(&ToRobot::Recalled(region)).unwrap();
        }
    }

    fn host_to_robot(&mut self) -> bool {
        let mut memory = [0; MAX_FRAME];
        let Some(frame) = self.host.poll_transmit(self.now, &mut memory) else { return false };
        let (_, received) = self.robot.take(self.now, frame);
        if let Some(Received::Reliable(message)) = received {
            match postcard::from_bytes(message).unwrap() {
                ToRobot::Tile(tile) => self.paging.take(&tile, &mut self.small.map),
                ToRobot::Recalled(region) => self.paging.recalled(&region),
                other => panic!("{other:?}"),
            }
        }
        true
    }

    /// The robot sees what is about (`x`, 0), and the link has time for what that brings.
    fn see_from(&mut self, x: f32) {
        self.map_from(x);
        let next = self.now + SCAN_EVERY;
        self.exchange();
        self.now = self.now.max(next);
    }

    fn map_from(&mut self, x: f32) {
        let ray = |index: u8| {
            let (sin, cos) = lrfslam_core::math::sin_cos(f32::from(index) * 0.1);
            Ray { direction: Point2::new(cos, sin), length_m: 1.0 + 0.05 * f32::from(index % 60), hit: index & 3 > 0 }
        };
        let rays: Vec<Ray> = (0..63).map(ray).collect();
        let pose = Pose2::new(x, 0.1, 0.3 * x);
        self.large.print(&rays, pose);
        self.small.print(&rays, pose);
        self.paging.scan_mapped(self.now, Some(pose.position()), &mut self.small.map, &self.robot);
        let _ = self.paging.send(&self.small.map, &mut self.robot);
    }

    /// About the robot the small memory holds what the large one holds, and together with the host's everything.
    fn compare(&self, x: f32) {
        let (large, small) = (self.large.tiles(), self.small.tiles());
        for (place, tile) in &large {
            let is_near = (TILE_M * (f32::from(place.column) + 0.5) - x).abs() < SEEN_M;
            let here = small.get(place);
            assert!(here.is_some() || !is_near, "{place:?} at {x} m");
            assert_eq!(here.or_else(|| self.left.get(place)), Some(tile), "{place:?} at {x} m");
        }
        assert!(small.keys().all(|place| large.contains_key(place)));
    }
}

#[test]
fn map_about_the_robot_is_that_of_a_larger_memory() {
    let mut pair = Pair::new();
    for step in (0..300).chain((0..300).rev()).chain(0..100) {
        let x = 0.2 * step as f32;
        pair.see_from(x);
        pair.compare(x);
    }
    let TileCounts { left, restored, forgotten, late } = pair.paging.counts;
    assert!(pair.large.map.tiles_used() > 400, "{}", pair.large.map.tiles_used());
    assert!(left > 600 && restored > 300 && (forgotten, late) == (0, 0), "{:?}", pair.paging.counts);
}

#[test]
fn what_leaves_and_returns_goes_by_the_scans_and_not_by_when_the_host_answers() {
    let (mut prompt, mut slow) = (Pair::new(), Pair::new());
    for step in (0..200).chain((0..200).rev()) {
        let x = 0.2 * step as f32;
        prompt.see_from(x);
        slow.map_from(x);
        let next = slow.now + SCAN_EVERY;
        if step % 2 == 0 {
            slow.exchange();
        }
        slow.now = slow.now.max(next);
        assert_eq!(prompt.small.map.tiles_used(), slow.small.map.tiles_used(), "at {x} m");
        assert!(prompt.small.tiles() == slow.small.tiles(), "at {x} m");
    }
    assert!(prompt.paging.counts.left > 300 && prompt.paging.counts.restored > 100, "{:?}", prompt.paging.counts);
    assert_eq!((prompt.paging.counts, prompt.paging.counts.late), (slow.paging.counts, 0));
}

#[test]
fn a_host_that_is_too_slow_loses_nothing_and_is_counted() {
    let mut pair = Pair::new();
    for step in (0..200).chain((0..200).rev()) {
        let x = 0.1 * step as f32;
        pair.map_from(x);
        let next = pair.now + SCAN_EVERY;
        if step % 5 == 0 {
            pair.exchange();
        }
        pair.now = pair.now.max(next);
        pair.compare(x);
    }
    let TileCounts { left, restored, forgotten, late } = pair.paging.counts;
    assert!(left > 100 && restored > 50 && late > 20 && forgotten == 0, "{:?}", pair.paging.counts);
}

#[test]
fn unanswered_requests_are_made_again_to_the_next_host() {
    let mut pair = Pair::new();
    (0..200).for_each(|step| pair.see_from(0.2 * step as f32));
    pair.answers = false;
    (60..200).rev().for_each(|step| pair.see_from(0.2 * step as f32));
    assert_eq!(pair.paging.counts.restored, 0);
    // The next host has the last one's tiles.
    pair.answers = true;
    pair.paging.forget_requests(&mut pair.small.map);
    (20..60).rev().for_each(|step| pair.see_from(0.2 * step as f32));
    assert!(pair.paging.counts.restored > 0);
    assert_eq!(pair.paging.returning.home(), pair.paging.square.unwrap());
}

#[test]
fn without_a_host_a_share_of_the_memory_waits_and_the_rest_is_forgotten() {
    let mut pair = Pair::new();
    pair.robot.disconnected();
    for step in 0..300 {
        pair.see_from(0.2 * step as f32);
        let square = pair.paging.square.unwrap();
        let outside = pair.small.map.settled_places().filter(|place| !square.contains(*place)).count();
        assert!(outside <= 119 / WAITING_SHARE, "{outside}");
    }
    let TileCounts { left, restored, forgotten, .. } = pair.paging.counts;
    assert!(left == 0 && restored == 0 && forgotten > 200, "{:?}", pair.paging.counts);
}
