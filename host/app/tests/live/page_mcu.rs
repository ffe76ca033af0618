//! A microcontroller maps, and is watched live: firmware on QEMU's Cortex-M7, a simulated laser at one of its UARTs, `attach --monitor` at the
//! other, a browser at that.
//!
//! `firmware-sim/firmware/build && . firmware-sim/firmware/target/images/env && cargo test -p lrfslam --all-features --test live microcontroller -- --nocapture`

use std::io::{Read as _, Write as _};
use std::net::TcpListener;
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant as WallInstant};

use lrfslam_core::time::Instant;
use lrfslam_firmware_sim::cable::Cable;
use lrfslam_firmware_sim::scenario::Scenario;
use lrfslam_firmware_sim::virtual_lrf::VirtualLrf as _;
use lrfslam_firmware_sim::virtual_lrf::hokuyo::{HokuyoModel, VirtualHokuyo};

use crate::browser::Browser;
use crate::page::{HAS_MAP, Watched};

const LATER: Duration = Duration::from_secs(240);
/// Laser and microcontroller run so many times slower than the world: QEMU is no match for the real processor.
const SLOW: u32 = 4;
/// The board's PSRAM, whose first two words tell the firmware so.
const PSRAM: u32 = 0x6000_0000;
/// QEMU's UART takes any rate: the first one tried is the one found.
const BAUD: u32 = 250_000;

/// A board and its laser, until dropped.
struct Board {
    qemu: Child,
    stop: Arc<AtomicBool>,
    laser: Option<std::thread::JoinHandle<()>>,
    /// As for `--port`.
    port: String,
}

impl Board {
    /// `None`, which is said, where there is no firmware or no QEMU.
    fn start(folder: &Path) -> Option<Self> {
        let Some(images) = std::env::var_os("LRFSLAM_FIRMWARE") else {
            println!(
                "skipped: no microcontroller was watched (firmware-sim/firmware/build makes its program; set LRFSLAM_FIRMWARE to its folder)"
            );
            return None;
        };
        let free = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
        let line = folder.join("laser");
        let loader = |at: u32, data: u32| format!("loader,addr={at:#x},data={data},data-len=4");
        let program = std::env::var_os("LRFSLAM_QEMU").unwrap_or_else(|| "qemu-system-arm".into());
        let mut command = Command::new(program);
        command.args(["-M", "mps2-an500", "-display", "none", "-monitor", "none", "-kernel"]);
        command.arg(Path::new(&images).join("mps2-an500"));
        command.args(["-serial", &format!("unix:{},server=on,wait=off", line.display())]);
        command.args(["-serial", &format!("tcp:{free},server=on,wait=off")]);
        command.args(["-device", &loader(PSRAM, u32::from_le_bytes(*b"slow")), "-device", &loader(PSRAM + 4, SLOW)]);
        let qemu = match command.stdin(Stdio::null()).spawn() {
            Ok(qemu) => qemu,
            Err(error) => {
                println!("skipped: no microcontroller was watched (QEMU does not start: {error})");
                return None;
            }
        };
        let stop = Arc::new(AtomicBool::new(false));
        let flag = stop.clone();
        let laser = std::thread::spawn(move || serve_laser(&line, &flag));
        Some(Self { qemu, stop, laser: Some(laser), port: format!("tcp:{free}") })
    }
}

impl Drop for Board {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        let served = self.laser.take().map(std::thread::JoinHandle::join);
        let _ = self.qemu.kill();
        let _ = self.qemu.wait();
        assert!(std::thread::panicking() || served.is_none_or(|served| served.is_ok()), "the laser failed");
    }
}

/// A URG-04LX on a simulated floor, on the slow clock.
fn serve_laser(line: &Path, stop: &AtomicBool) {
    let scene = Scenario::load("floor").expect("comes with the program").scene();
    let mut device = VirtualHokuyo::new(HokuyoModel::urg_04lx(), Box::new(scene), 1);
    device.set_baud(BAUD);
    let mut stream = loop {
        match UnixStream::connect(line) {
            Ok(stream) => break stream,
            Err(_) if stop.load(Ordering::Relaxed) => return,
            Err(_) => std::thread::sleep(Duration::from_millis(20)),
        }
    };
    stream.set_read_timeout(Some(Duration::from_millis(1))).unwrap();
    let (begun, mut cable, mut bytes) = (WallInstant::now(), Cable::default(), [0; 4096]);
    while !stop.load(Ordering::Relaxed) {
        let now = Instant::from_micros(begun.elapsed().as_micros() as i64 / i64::from(SLOW));
        if let Ok(count) = stream.read(&mut bytes) {
            device.receive(now, &bytes[..count]);
        }
        if now >= device.deadline() {
            device.timeout(now);
        }
        while let Some(emission) = device.poll() {
            cable.push(emission);
        }
        if stream.write_all(&cable.arrived(now, device.baud(now).unwrap_or(BAUD))).is_err() {
            return;
        }
    }
}

#[test]
fn a_microcontroller_is_watched_while_it_maps() {
    let folder = tempfile::tempdir().unwrap();
    let Some(board) = Board::start(folder.path()) else { return };
    let Some(mut browser) = Browser::start() else { return };
    let baud = BAUD.to_string();
    // A search that QEMU gets done in a tenth of the time of the default one.
    let light = ["de.population=30", "de.generations=25", "recovery.population=60", "recovery.generations=30"];
    let mut args =
        vec!["attach", "--port", &board.port, "--lrf", "hokuyo", "--lrf-baud", &baud, "--out", "map", "--monitor=0"];
    light.iter().for_each(|setting| args.extend(["--set", setting]));
    let mut run = Watched::run(folder.path(), &args);
    let page = browser.open(&run.url(), [1000, 700]);
    browser.wait(&page, HAS_MAP, LATER);
    let scans = "lrfslam.robots()[0].status.scans";
    let seen = browser.value(&page, scans).as_u64().unwrap();
    // It grows while it is looked at, and the robot is seen to move.
    let way = browser.value(&page, "lrfslam.robots()[0].status.way_m").as_f64().unwrap();
    browser.wait(&page, &format!("{scans} >= {} && lrfslam.robots()[0].status.way_m > {way} + 0.3", seen + 30), LATER);
    let status = browser.value(&page, "JSON.stringify(lrfslam.robots()[0].status)");
    println!("{status}");
    assert_eq!(browser.value(&page, "lrfslam.robots()[0].status.health[0]"), 0, "frames of its link came damaged");
    if let Some(folder) = std::env::var_os("LRFSLAM_PICTURES") {
        std::fs::write(Path::new(&folder).join("microcontroller.png"), browser.picture(&page)).unwrap();
    }
    browser.click_on(&page, "#stop");
    browser.click_on(&page, "dialog [value=stop]");
    let code = run.child.wait().unwrap().code();
    assert_eq!(code, Some(0), "{}", run.said.lock().unwrap());
    assert!(folder.path().join("map/map.png").exists());
    assert_eq!(browser.faults, Vec::<String>::new());
}
