//! Lasers behind a microcontroller that sends their bytes as datagrams: some are lost, some change places, and no wrong beam comes out.
//!
//! Seconds: each laser has a bounded number of datagrams, on loopback.

use std::net::{SocketAddr, UdpSocket};
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration as WallDuration;

use lrfslam_core::math::uniform;
use lrfslam_core::random::RandomStream;
use lrfslam_core::scan::RangeScan;
use lrfslam_firmware_sim::lrf_model::LrfErrors;
use lrfslam_firmware_sim::pty::wall_clock;
use lrfslam_firmware_sim::virtual_lrf::VirtualLrf;
use lrfslam_firmware_sim::virtual_lrf::ldrobot::VirtualLd06;
use lrfslam_firmware_sim::virtual_lrf::rplidar::{RplidarModel, VirtualRplidar};
use lrfslam_host::scans::family::{LrfFamily, LrfOptions};
use lrfslam_host::scans::live::{Item, LiveLaser, ScanSource, SourceReport, for_each_scan};
use lrfslam_lrf::driver::Counters;
use lrfslam_tests::scenes::{Round, is_round};

/// Where the microcontroller sends its datagrams.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Way {
    /// To an address that it was told.
    Told,
    /// To whoever has called it.
    Called,
}

/// What happens to a datagram: chances, 0–1.
#[derive(Debug, Clone, Copy)]
struct Air {
    lost: f32,
    swapped: f32,
}

/// A laser at a microcontroller.
struct Bridge {
    device: Box<dyn VirtualLrf>,
    socket: UdpSocket,
    peer: Option<SocketAddr>,
    air: Air,
    rng: RandomStream,
    /// One that the next overtakes.
    held: Option<Vec<u8>>,
    datagrams: usize,
}

impl Bridge {
    /// Serves until so many datagrams were made, or `stop`.
    fn serve(mut self, most: usize, stop: &AtomicBool) -> usize {
        let mut clock = wall_clock();
        let mut buffer = [0; 2048];
        self.socket.set_read_timeout(Some(WallDuration::from_millis(1))).unwrap();
        while self.datagrams < most && !stop.load(Ordering::Relaxed) {
            if let Ok((count, from)) = self.socket.recv_from(&mut buffer) {
                self.peer = Some(from);
                self.device.receive(clock(), &buffer[..count]);
            }
            self.device.timeout(clock());
            while let Some(emission) = self.device.poll() {
                // The microcontroller collects no more than a network carries whole.
                emission.bytes.chunks(1400).for_each(|bytes| self.send(bytes.to_vec()));
            }
        }
        self.datagrams
    }

    fn send(&mut self, bytes: Vec<u8>) {
        let Some(peer) = self.peer else { return };
        self.datagrams += 1;
        if uniform(&mut self.rng) < self.air.lost {
            return;
        }
        if self.held.is_none() && uniform(&mut self.rng) < self.air.swapped {
            self.held = Some(bytes);
            return;
        }
        for datagram in [Some(bytes), self.held.take()].into_iter().flatten() {
            let _ = self.socket.send_to(&datagram, peer);
        }
    }
}

fn ld06() -> Box<dyn VirtualLrf> {
    Box::new(VirtualLd06::new(LrfErrors::NONE, Box::new(Round), 1))
}

fn rplidar(model: RplidarModel) -> Box<dyn VirtualLrf> {
    Box::new(VirtualRplidar::new(model.with_errors(LrfErrors::NONE), Box::new(Round), 1))
}

/// Takes scans until `enough`; returns how many came, and what the driver counted.
///
/// # Panics
/// If a scan has a wrong beam, or too few came of all the datagrams.
fn scans_of(family: LrfFamily, device: Box<dyn VirtualLrf>, way: Way, air: Air, enough: usize) -> (usize, Counters) {
    let free = |address: &str| UdpSocket::bind(address).unwrap();
    let socket = free("127.0.0.1:0");
    let (port, peer) = match way {
        Way::Called => (format!("udp:{}", socket.local_addr().unwrap()), None),
        Way::Told => {
            let host = free("0.0.0.0:0").local_addr().unwrap().port();
            (format!("udp::{host}"), Some(SocketAddr::from(([127, 0, 0, 1], host))))
        }
    };
    let bridge = Bridge { device, socket, peer, air, rng: RandomStream::new(11, 0, 0), held: None, datagrams: 0 };
    let stop = AtomicBool::new(false);
    let source = ScanSource::Live(LiveLaser::new(port.parse().unwrap(), LrfOptions::new(family)));
    let mut scans = 0;
    let report = std::thread::scope(|scope| {
        let serving = scope.spawn(|| bridge.serve(20_000, &stop));
        let report = for_each_scan(&source, &AtomicBool::new(false), &mut |item| {
            if let Item::Scan(scan) = item {
                scans += 1;
                check(family, &scan);
            }
            if scans < enough { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
        });
        stop.store(true, Ordering::Relaxed);
        println!("{family} {way:?} {air:?}: {scans} scans of {} datagrams", serving.join().unwrap());
        report
    });
    let SourceReport { counters, .. } = report.expect("the laser is found");
    println!("{counters:?}");
    (scans, counters)
}

fn check(family: LrfFamily, scan: &RangeScan<'_>) {
    assert!(is_round(scan), "{family}: a wrong beam at {:?}", scan.stamp);
}

const CLEAR: Air = Air { lost: 0.0, swapped: 0.0 };
const BAD: Air = Air { lost: 0.02, swapped: 0.02 };

#[test]
fn lasers_are_read_by_datagrams_either_way() {
    std::thread::scope(|scope| {
        for way in [Way::Told, Way::Called] {
            scope.spawn(move || {
                let (scans, counters) = scans_of(LrfFamily::Ld06, ld06(), way, CLEAR, 20);
                assert_eq!((scans, counters.damaged), (20, 0));
            });
        }
        // It is asked before it says anything, so that only one who is called is found.
        scope.spawn(|| {
            let (scans, counters) = scans_of(LrfFamily::Rplidar, rplidar(RplidarModel::a2()), Way::Called, CLEAR, 20);
            assert_eq!((scans, counters.damaged), (20, 0));
        });
    });
}

#[test]
fn datagrams_that_are_lost_or_change_places_make_no_wrong_beam() {
    std::thread::scope(|scope| {
        scope.spawn(|| {
            let (_, counters) = scans_of(LrfFamily::Ld06, ld06(), Way::Told, BAD, 50);
            assert!(counters.incomplete > 0, "two in a hundred are missing: {counters:?}");
        });
        scope.spawn(|| {
            let (_, counters) = scans_of(LrfFamily::Rplidar, rplidar(RplidarModel::a2()), Way::Called, BAD, 50);
            assert!(counters.incomplete + counters.damaged > 0, "{counters:?}");
        });
        scope.spawn(|| {
            scans_of(LrfFamily::Rplidar, rplidar(RplidarModel::c1()), Way::Called, BAD, 50);
        });
    });
}
