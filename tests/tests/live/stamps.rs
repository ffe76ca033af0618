//! How true stamps are, over pseudo-terminals: every beam sees a wall that tells the time ([`Clockwork`]).
//!
//! A few seconds. The table of docs/lasers.md, three minutes: `cargo test -p lrfslam-tests --test live stamps -- --ignored --nocapture`

use std::io;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration as WallDuration, Instant as WallInstant, SystemTime, UNIX_EPOCH};

use lrfslam_core::time::Instant;
use lrfslam_firmware_sim::fault::FaultPlan;
use lrfslam_firmware_sim::lrf_model::LrfErrors;
use lrfslam_firmware_sim::pty::{serve, wall_clock};
use lrfslam_firmware_sim::virtual_lrf::VirtualLrf;
use lrfslam_firmware_sim::virtual_lrf::hokuyo::{HokuyoModel, VirtualHokuyo};
use lrfslam_firmware_sim::virtual_lrf::ldrobot::VirtualLd06;
use lrfslam_firmware_sim::virtual_lrf::rplidar::{RplidarModel, VirtualRplidar};
use lrfslam_firmware_sim::virtual_lrf::sick::{SickModel, VirtualSick};
use lrfslam_host::scans::driver::{DriverEvent, Search, run_driver};
use lrfslam_host::scans::family::{LrfFamily, LrfOptions};
use lrfslam_host::scans::link::{Address, Link};
use lrfslam_lrf::driver::Event;
use lrfslam_tests::scenes::{Clockwork, late_us};

/// What goes on while stamps are made.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Trouble {
    None,
    /// Nobody reads for 0.3 s, every three seconds.
    Stopped,
    /// Two busy threads for each processor.
    Load,
}

/// A link whose reader is stopped now and then.
struct LateLink {
    link: Box<dyn Link>,
    next_stop: Option<WallInstant>,
}

impl Link for LateLink {
    fn receive(&mut self, buffer: &mut [u8], wait: WallDuration) -> io::Result<usize> {
        if self.next_stop.is_some_and(|at| WallInstant::now() >= at) {
            self.next_stop = Some(WallInstant::now() + WallDuration::from_secs(3));
            std::thread::sleep(WallDuration::from_millis(300));
        }
        self.link.receive(buffer, wait)
    }

    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.link.send(bytes)
    }

    fn set_baud(&mut self, baud: u32) -> io::Result<()> {
        self.link.set_baud(baud)
    }
}

/// A laser and how it is asked for.
struct Laser {
    name: &'static str,
    device: Box<dyn VirtualLrf>,
    options: LrfOptions,
    /// From one scan to the next, µs.
    period_us: i64,
}

fn lasers() -> Vec<Laser> {
    let of = |name, device: Box<dyn VirtualLrf>, family, baud, period_us| {
        let variant = Some((180, 100)).filter(|_| family == LrfFamily::SickLms2xx);
        Laser { name, device, options: LrfOptions { baud, variant, ..LrfOptions::new(family) }, period_us }
    };
    let hokuyo = |model| Box::new(VirtualHokuyo::new(model, Box::new(Clockwork), 1));
    let sick = || Box::new(VirtualSick::new(SickModel::lms200().with_errors(LrfErrors::NONE), Box::new(Clockwork), 1));
    let a2 = VirtualRplidar::new(RplidarModel::a2().with_errors(LrfErrors::NONE), Box::new(Clockwork), 1);
    vec![
        of("SICK LMS200, 500000 baud", sick(), LrfFamily::SickLms2xx, 500_000, 13_333),
        of("SICK LMS200, 38400 baud", sick(), LrfFamily::SickLms2xx, 38_400, 106_667),
        of("Hokuyo UTM-30LX", hokuyo(HokuyoModel::utm_30lx()), LrfFamily::Hokuyo, 0, 25_000),
        of("Hokuyo URG-04LX, 115200 baud", hokuyo(HokuyoModel::urg_04lx()), LrfFamily::Hokuyo, 115_200, 200_000),
        of("RPLIDAR A2", Box::new(a2), LrfFamily::Rplidar, 0, 100_000),
        of("LD06", Box::new(VirtualLd06::new(LrfErrors::NONE, Box::new(Clockwork), 1)), LrfFamily::Ld06, 0, 100_000),
    ]
}

/// Stamps, and by how much they are late, µs.
type Stamps = Vec<(Instant, f64)>;

fn stamps_of(laser: Laser, trouble: Trouble, seconds: f64, link: &Path) -> Stamps {
    let (mut device, stop) = (laser.device, AtomicBool::new(false));
    let mut stamps = Stamps::new();
    std::thread::scope(|scope| {
        let unix_us = SystemTime::now().duration_since(UNIX_EPOCH).unwrap().as_micros() as i64;
        let mut clock = wall_clock();
        let (device, stopped) = (device.as_mut(), &stop);
        let serving = scope.spawn(move || serve(device, link, FaultPlan::default(), 1, &mut clock, stopped).unwrap());
        let address: Address = link.display().to_string().parse().unwrap();
        let mut open = || {
            let next_stop = (trouble == Trouble::Stopped).then(|| WallInstant::now() + WallDuration::from_secs(3));
            Ok(Box::new(LateLink { link: address.open()?, next_stop }) as Box<dyn Link>)
        };
        let mut memories = Vec::new();
        let search = Search::new(&laser.options, false, false, &mut memories);
        let mut first: Option<WallInstant> = None;
        let _ = run_driver(search, &mut open, None, &|| false, &mut |_, event| {
            if let DriverEvent::Driver(Event::Scan(scan)) = event {
                let first = *first.get_or_insert_with(WallInstant::now);
                let late = late_us(&scan, Instant::from_micros(unix_us));
                stamps.extend(late.map(|late| (scan.stamp, late)));
                if first.elapsed().as_secs_f64() > seconds {
                    return ControlFlow::Break(());
                }
            }
            ControlFlow::Continue(())
        });
        stop.store(true, Ordering::Relaxed);
        serving.join().unwrap();
    });
    stamps
}

/// What a run says: median and largest lateness, ms, scans less than half a period after the one before, and not after it.
struct Row {
    scans: usize,
    median_ms: f64,
    largest_ms: f64,
    close: usize,
    disordered: usize,
}

fn judge(stamps: &[(Instant, f64)], period_us: i64) -> Row {
    let mut late: Vec<f64> = stamps.iter().map(|(_, late)| *late / 1000.0).collect();
    late.sort_by(f64::total_cmp);
    let steps = || stamps.windows(2).map(|pair| pair[1].0.since(pair[0].0).micros);
    Row {
        scans: late.len(),
        median_ms: late.get(late.len() / 2).copied().unwrap_or_default(),
        largest_ms: late.iter().fold(0.0, |largest, late| late.abs().max(largest)),
        close: steps().filter(|step| *step < period_us / 2).count(),
        disordered: steps().filter(|step| *step <= 0).count(),
    }
}

fn table(trouble: Trouble, seconds: f64) -> Vec<(&'static str, Row)> {
    let folder = tempfile::tempdir().unwrap();
    let busy = AtomicBool::new(trouble == Trouble::Load);
    // Ends by itself, also if a run fails.
    let busy_until = WallInstant::now() + WallDuration::from_secs_f64(seconds + 30.0);
    std::thread::scope(|scope| {
        let processors = std::thread::available_parallelism().map_or(2, usize::from);
        for _ in 0..2 * processors {
            scope.spawn(|| {
                while busy.load(Ordering::Relaxed) && WallInstant::now() < busy_until {
                    std::hint::spin_loop();
                }
            });
        }
        let runs: Vec<_> = lasers()
            .into_iter()
            .enumerate()
            .map(|(index, laser)| {
                let link = folder.path().join(index.to_string());
                let (name, period_us) = (laser.name, laser.period_us);
                (name, period_us, scope.spawn(move || stamps_of(laser, trouble, seconds, &link)))
            })
            .collect();
        let rows = runs.into_iter().map(|(name, period_us, run)| (name, judge(&run.join().unwrap(), period_us)));
        let rows: Vec<_> = rows.collect();
        busy.store(false, Ordering::Relaxed);
        rows
    })
}

fn show(trouble: Trouble, rows: &[(&'static str, Row)]) {
    for (name, row) in rows {
        let Row { scans, median_ms, largest_ms, close, disordered } = row;
        println!("| {name} | {trouble:?} | {scans} | {median_ms:.2} | {largest_ms:.1} | {close} | {disordered} |");
    }
}

/// How near says the table; what a busy machine does to it is no fault.
#[test]
fn stamps_are_in_order_while_the_reader_is_stopped() {
    let rows = table(Trouble::Stopped, 8.0);
    show(Trouble::Stopped, &rows);
    for (name, row) in rows {
        assert_eq!(row.disordered, 0, "{name}");
        assert!(row.scans > 10 && row.median_ms.abs() < 100.0, "{name}: {} ms of {}", row.median_ms, row.scans);
    }
}

#[test]
#[ignore = "minutes; run with --ignored"]
fn stamps_are_near_the_truth_whatever_goes_on() {
    println!(
        "| laser | meanwhile | scans | median late, ms | largest, ms | nearer than half a period | not in order |"
    );
    for trouble in [Trouble::None, Trouble::Stopped, Trouble::Load] {
        show(trouble, &table(trouble, 60.0));
    }
}
