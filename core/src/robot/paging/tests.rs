use super::*;
use crate::geometry::Pose2;
use crate::ndt::{DirectoryEntry, NdtConfig, NdtTile};
use crate::time::{Duration, Instant};
use crate::wire::frame::MAX_FRAME;
use crate::wire::message::ToRobot;
use crate::wire::session::{Received, SessionMemory};
use std::boxed::Box;
use std::collections::HashMap;
use std::vec;
use std::vec::Vec;

const CONFIG: NdtConfig = NdtConfig {
    cell_size_m: 0.5,
    overlapping: false,
    points_min: 3,
    count_max: 240,
    eigenvalue_ratio_min: 0.001,
    noise_m: 0.02,
};
/// Side of a tile, m.
const TILE_M: f32 = 2.0;
/// How far the robot sees, m.
const SEEN_M: f32 = 8.0;

fn session(epoch: u32) -> Session<'static> {
    let (queue, frame) = (Box::leak(vec![0; 8192].into()), Box::leak(vec![0; MAX_FRAME].into()));
    Session::new(epoch, None, SessionMemory { queue, frame })
}

fn grid(side: usize, tiles: usize) -> NdtGrid<'static> {
    let directory = Box::leak(vec![DirectoryEntry::EMPTY; side * side].into());
    NdtGrid::new(&CONFIG, directory, Box::leak(vec![NdtTile::EMPTY; tiles].into())).unwrap()
}

/// A robot with little memory beside one with plenty, and a host.
struct Pair {
    now: Instant,
    robot: Session<'static>,
    host: Session<'static>,
    paging: Paging,
    small: NdtGrid<'static>,
    large: NdtGrid<'static>,
    pages: HashMap<(i16, i16), Vec<u8>>,
    asked: Vec<Recall>,
    answers: bool,
}

impl Pair {
    fn new() -> Self {
        let mut pair = Self {
            now: Instant::default(),
            robot: session(1),
            host: session(2),
            paging: Paging::new(PagedMap::Cells, TILE_M, 6),
            small: grid(16, 90),
            large: grid(128, 4000),
            pages: HashMap::new(),
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
                FromRobot::Left(Page { address, bytes, .. }) => {
                    self.pages.insert((address.column, address.row), bytes.to_vec());
                }
                FromRobot::Recall(recall) => self.asked.push(recall),
                other => panic!("{other:?}"),
            }
        }
        self.answer();
        true
    }

    fn answer(&mut self) {
        for recall in self.asked.drain(..).filter(|_| self.answers) {
            for ((column, row), bytes) in &self.pages {
                let address = TileAddress { layer: 0, column: *column, row: *row };
                if recall.region.contains(address) {
                    self.host.send(&ToRobot::Page(Page { map: PagedMap::Cells, address, bytes })).unwrap();
                }
            }
            self.host.send(&ToRobot::Recalled(recall)).unwrap();
        }
    }

    fn host_to_robot(&mut self) -> bool {
        let mut memory = [0; MAX_FRAME];
        let Some(frame) = self.host.poll_transmit(self.now, &mut memory) else { return false };
        let (_, received) = self.robot.take(self.now, frame);
        if let Some(Received::Reliable(message)) = received {
            match postcard::from_bytes(message).unwrap() {
                ToRobot::Page(page) => self.paging.take(&page, &mut self.small),
                ToRobot::Recalled(recall) => self.paging.recalled(&recall.region, &mut self.small),
                other => panic!("{other:?}"),
            }
        }
        true
    }

    /// The robot sees both walls of a corridor from (`x`, 0).
    fn see_from(&mut self, x: f32) {
        let along = (0..80).map(|i| 0.2 * i as f32 - SEEN_M);
        let points: Vec<Point2> = along.flat_map(|x| [Point2::new(x, 1.3), Point2::new(x, -1.3)]).collect();
        let pose = Pose2::new(x, 0.0, 0.0);
        self.large.insert(&points, pose);
        let report = self.small.insert(&points, pose);
        assert_eq!((report.dropped, report.evicted), (0, 0), "at {x} m");
        self.paging.drive(pose.position(), &mut self.small);
        for _ in 0..4 {
            let _ = self.paging.run(&mut self.small, &mut self.robot);
            self.exchange();
        }
    }

    /// What the robot sees, and what it holds, as the large memory has it.
    fn compare(&self, x: f32) {
        let mut compared = 0;
        for address in self.large.addresses() {
            let distance = (TILE_M * (f32::from(address.column) + 0.5) - x).abs();
            let is_here = self.small.addresses().any(|other| other == address);
            assert!(is_here || distance > SEEN_M, "{address:?} at {x} m");
            let mut memory = [[0; TILE_BYTES_MAX]; 2];
            let [a, b] = &mut memory;
            assert!(!is_here || self.large.tile_bytes(address, a) == self.small.tile_bytes(address, b), "{address:?}");
            compared += usize::from(is_here);
        }
        assert!(compared > 10);
    }
}

#[test]
fn map_about_the_robot_is_that_of_a_larger_memory() {
    let mut pair = Pair::new();
    pair.see_from(0.0);
    for step in (0..250).chain((0..250).rev()).chain(0..60) {
        pair.see_from(0.4 * step as f32);
        pair.compare(0.4 * step as f32);
    }
    let PageCounts { left, restored, forgotten } = pair.paging.counts;
    assert!(left > 150 && restored > 80 && forgotten == 0, "{:?}", pair.paging.counts);
}

#[test]
fn unanswered_requests_are_made_again_to_the_next_host() {
    let mut pair = Pair::new();
    for step in 0..100 {
        pair.see_from(0.4 * step as f32);
    }
    pair.answers = false;
    for step in (20..100).rev() {
        pair.see_from(0.4 * step as f32);
    }
    assert_eq!(pair.paging.counts.restored, 0);
    // The next host has the last one's pages.
    pair.answers = true;
    pair.paging.forget_request();
    for step in (0..20).rev() {
        pair.see_from(0.4 * step as f32);
    }
    assert!(pair.paging.counts.restored > 0 && pair.small.addresses().any(|address| address.column == -4));
}

/// Tiles with nothing in them.
struct Shelf(Vec<TileAddress>);

impl PageStore for Shelf {
    fn find(&self, is_wanted: &mut dyn FnMut(TileAddress) -> bool) -> Option<TileAddress> {
        self.0.iter().copied().find(|address| is_wanted(*address))
    }
    fn bytes_of<'b>(&self, _: TileAddress, bytes: &'b mut [u8]) -> Option<&'b [u8]> {
        bytes.get(..0)
    }
    fn hand_over(&mut self, address: TileAddress) -> bool {
        self.forget(address)
    }
    fn forget(&mut self, address: TileAddress) -> bool {
        self.0.retain(|other| *other != address);
        true
    }
    fn restore(&mut self, page: &Page<'_>, _: Point2) -> Option<Restored> {
        self.0.push(page.address);
        Some(Restored::Done)
    }
    fn capacity(&self) -> usize {
        80
    }
    fn home_is(&mut self, _: &Region) {}
}

#[test]
fn without_a_host_a_share_of_the_memory_waits_and_the_rest_is_forgotten() {
    let mut link = session(1);
    let mut paging = Paging::new(PagedMap::Squares, TILE_M, 2);
    let mut shelf = Shelf(Vec::new());
    for column in 0..60 {
        shelf.0.push(TileAddress { layer: 0, column, row: 0 });
        paging.drive(Point2::new(TILE_M * (f32::from(column) + 0.5), 0.0), &mut shelf);
        paging.run(&mut shelf, &mut link).unwrap();
    }
    // Two behind the robot and its own, and an eighth of 80 that wait.
    assert_eq!(shelf.0.len(), 3 + 10);
    assert_eq!(paging.counts, PageCounts { left: 0, restored: 0, forgotten: 60 - 13 });
}
