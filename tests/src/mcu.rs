//! The firmware on QEMU's microcontroller, between a virtual laser and the host: three parties that meet only as bytes.
//!
//! Time is the simulation's: laser and microcontroller both run `slow` times slower than the world, so that QEMU, which is no match for
//! the real processor, keeps up with the laser.

use std::io::{ErrorKind, Read, Write};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration as WallDuration, Instant as WallInstant};

use anyhow::{Context as _, bail};
use lrfslam_core::scan::Beam;
use lrfslam_core::time::{Duration, Instant};
use lrfslam_firmware_sim::cable::Cable;
use lrfslam_firmware_sim::virtual_lrf::VirtualLrf;
use lrfslam_host::robot::{ClientMemory, RobotClient, RobotEvent, RobotMap};
use lrfslam_host::scans::driver::LaserMemory;
use lrfslam_host::scans::family::{LrfFamily, LrfOptions};
use lrfslam_lrf::driver::{Event, Input, Output, drain, run_bytes};
use lrfslam_robot::wire::frame::MAX_FRAME;
use lrfslam_robot::wire::message::{FromRobot, Segment, Status, ToRobot};
use lrfslam_robot::{LaserFamily, RobotConfig};

/// Rate of a cable to a USB sensor, which has none.
const ANY_RATE: u32 = 115_200;
/// Scans that the laser may be ahead of the robot.
const SCANS_AHEAD: usize = 2;
/// No reply but a scan is so long.
const SCAN_BYTES: usize = 300;
/// How long the microcontroller may say nothing new.
const PATIENCE: WallDuration = WallDuration::from_secs(120);

/// Which microcontroller, with what in it.
#[derive(Debug, Clone)]
pub struct Mcu {
    /// QEMU's name of the board, and what sets the image apart.
    pub machine: String,
    /// The image.
    pub image: PathBuf,
    /// Its first two words say how slow the simulation is.
    psram: u32,
}

impl Mcu {
    /// The image for `machine` in the folder that the environment names by `LRFSLAM_FIRMWARE`; `None`, said on standard output, without.
    pub fn find(machine: &str) -> Option<Self> {
        let Some(folder) = std::env::var_os("LRFSLAM_FIRMWARE") else {
            println!("skipped: no firmware (firmware-sim/firmware/build makes it; set LRFSLAM_FIRMWARE to its folder)");
            return None;
        };
        let image = Path::new(&folder).join(machine);
        let psram = if machine.starts_with("mps2-an500") { 0x6000_0000 } else { 0x2100_0000 };
        Some(Self { machine: machine.to_owned(), image, psram })
    }

    /// Address of the board's PSRAM.
    pub fn psram(&self) -> u32 {
        self.psram
    }

    /// QEMU with the board and the image, and nothing at its lines.
    pub fn qemu(&self) -> Command {
        let qemu = std::env::var_os("LRFSLAM_QEMU").unwrap_or_else(|| "qemu-system-arm".into());
        let board = self.machine.get(.."mps2-anXXX".len()).unwrap_or(&self.machine);
        let mut command = Command::new(qemu);
        command.args(["-M", board, "-display", "none", "-monitor", "none", "-kernel"]).arg(&self.image);
        command
    }

    /// Starts it; it waits until somebody is at both its lines.
    fn start(&self, folder: &Path, slow: u32) -> anyhow::Result<Child> {
        let serial = |name: &str| format!("unix:{},server=on,wait=on", folder.join(name).display());
        let loader = |at: u32, data: u32| format!("loader,addr={at:#x},data={data},data-len=4");
        let mark = u32::from_le_bytes(*b"slow");
        let mut command = self.qemu();
        command.args(["-serial", &serial("laser"), "-serial", &serial("link")]);
        command.args(["-device", &loader(self.psram, mark), "-device", &loader(self.psram + 4, slow)]);
        command.stdin(Stdio::null()).spawn().context("starting qemu-system-arm")
    }
}

/// Bytes on the laser's line.
#[derive(Debug, Clone)]
pub struct LaserBytes {
    /// Simulation time.
    pub at: Instant,
    /// From the laser, or to it.
    pub is_from_laser: bool,
    /// They.
    pub bytes: Vec<u8>,
}

/// What came of a drive.
#[derive(Debug, Default)]
pub struct Drive {
    /// What the robot told.
    pub map: RobotMap,
    /// Every segment among it.
    pub segments: Vec<Segment>,
    /// Its last status.
    pub status: Status,
    /// All that went over the laser's line.
    pub laser_line: Vec<LaserBytes>,
    /// What the robot said in words.
    pub said: Vec<String>,
    /// Robots that were not there before: 1, or there was a reset.
    pub robots: u32,
}

/// Lets the microcontroller map what `device` sees until it has mapped so many scans, and has told all of its map.
///
/// # Errors
/// If QEMU does not start, or the microcontroller says nothing new for two minutes.
pub fn drive(
    mcu: &Mcu,
    device: &mut dyn VirtualLrf,
    config: &RobotConfig,
    scans: usize,
    slow: u32,
) -> anyhow::Result<Drive> {
    let folder = tempfile::tempdir()?;
    let mut qemu = mcu.start(folder.path(), slow)?;
    let done = Bench::connect(folder.path(), device, slow).and_then(|mut bench| bench.run(config, scans));
    qemu.kill()?;
    qemu.wait()?;
    done
}

struct Bench<'d> {
    laser: UnixStream,
    link: UnixStream,
    device: &'d mut dyn VirtualLrf,
    cable: Cable,
    started: WallInstant,
    slow: u32,
    /// The laser's time; it stands still while the robot is behind.
    laser_now: Instant,
    last: Instant,
    scans_sent: usize,
    drive: Drive,
    to_robot: Vec<u8>,
}

impl<'d> Bench<'d> {
    fn connect(folder: &Path, device: &'d mut dyn VirtualLrf, slow: u32) -> anyhow::Result<Self> {
        let laser = open(&folder.join("laser"))?;
        let link = open(&folder.join("link"))?;
        Ok(Self {
            laser,
            link,
            device,
            cable: Cable::default(),
            started: WallInstant::now(),
            slow,
            laser_now: Instant::default(),
            last: Instant::default(),
            scans_sent: 0,
            drive: Drive::default(),
            to_robot: Vec::new(),
        })
    }

    fn now(&self) -> Instant {
        Instant::from_micros(self.started.elapsed().as_micros() as i64 / i64::from(self.slow))
    }

    fn run(&mut self, config: &RobotConfig, scans: usize) -> anyhow::Result<Drive> {
        let mut memory = ClientMemory::default();
        let mut client = RobotClient::new(config, 1, None, &mut memory);
        client.session().connected(self.now());
        let mut is_stopped = false;
        let mut heard = (0, WallInstant::now());
        while !self.drive.map.is_complete() {
            self.serve_laser()?;
            self.serve_link(&mut client)?;
            if !is_stopped && self.drive.map.scans().len() >= scans {
                client.ask(&ToRobot::Stop)?;
                is_stopped = true;
            }
            let news = self.drive.map.scans().len() + self.drive.map.tiles().len() + self.drive.said.len();
            if news != heard.0 {
                heard = (news, WallInstant::now());
            }
            if heard.1.elapsed() > PATIENCE {
                bail!("nothing new: {} scans, {:?}, {:?}", news, self.drive.said, self.drive.status);
            }
            std::thread::sleep(WallDuration::from_micros(500));
        }
        Ok(std::mem::take(&mut self.drive))
    }

    /// A computer that is busy with other things is no reason to lose a scan.
    fn laser_time(&mut self, now: Instant) -> Instant {
        if self.scans_sent < self.drive.map.scans().len() + SCANS_AHEAD {
            self.laser_now = self.laser_now + now.since(self.last);
        }
        self.last = now;
        self.laser_now
    }

    fn serve_laser(&mut self) -> anyhow::Result<()> {
        let at = self.now();
        let now = self.laser_time(at);
        let heard = read(&mut self.laser)?;
        if !heard.is_empty() {
            self.device.receive(now, &heard);
            self.drive.laser_line.push(LaserBytes { at, is_from_laser: false, bytes: heard });
        }
        if now >= self.device.deadline() {
            self.device.timeout(now);
        }
        while let Some(emission) = self.device.poll() {
            self.scans_sent += usize::from(emission.bytes.len() >= SCAN_BYTES);
            self.cable.push(emission);
        }
        // The microcontroller's UART takes any rate in QEMU: the cable only takes its time.
        let rate = self.device.baud(now).unwrap_or(ANY_RATE);
        let arrived = self.cable.arrived(now, rate);
        if !arrived.is_empty() {
            write(&mut self.laser, &arrived)?;
            self.drive.laser_line.push(LaserBytes { at, is_from_laser: true, bytes: arrived });
        }
        Ok(())
    }

    fn serve_link(&mut self, client: &mut RobotClient<'_>) -> anyhow::Result<()> {
        let now = self.now();
        let heard = read(&mut self.link)?;
        let Drive { map, segments, status, said, robots, .. } = &mut self.drive;
        client.take(now, &heard, &mut |event| match event {
            RobotEvent::NewRobot => *robots += 1,
            RobotEvent::Status(now) => *status = now,
            RobotEvent::Foreign(why) => said.push(why.to_string()),
            RobotEvent::Absurd(why) => said.push(why.to_string()),
            RobotEvent::Busy => said.push("busy".to_owned()),
            RobotEvent::Message(told) => {
                let Some(message) = told.message() else { return };
                if let FromRobot::Said(text) | FromRobot::Refused(text) = message {
                    said.push(text.to_owned());
                }
                if let FromRobot::Segment(segment) = &message {
                    segments.push(segment.clone());
                }
                map.take(&message);
            }
            RobotEvent::Recall(recall) => recall.answer(map.to_give_back()),
        });
        let session = client.session();
        if now >= session.deadline() {
            session.timeout(now);
        }
        let mut memory = [0; MAX_FRAME];
        while let Some(frame) = session.poll_transmit(now, &mut memory) {
            self.to_robot.extend_from_slice(frame);
        }
        let to_robot = std::mem::take(&mut self.to_robot);
        write(&mut self.link, &to_robot)
    }
}

fn open(path: &Path) -> anyhow::Result<UnixStream> {
    let started = WallInstant::now();
    loop {
        match UnixStream::connect(path) {
            Ok(stream) => {
                stream.set_nonblocking(true)?;
                return Ok(stream);
            }
            Err(error) if started.elapsed() > WallDuration::from_secs(20) => {
                return Err(error).with_context(|| format!("{}", path.display()));
            }
            Err(_) => std::thread::sleep(WallDuration::from_millis(20)),
        }
    }
}

fn read(stream: &mut UnixStream) -> anyhow::Result<Vec<u8>> {
    let mut bytes = vec![0; 4096];
    match stream.read(&mut bytes) {
        Ok(0) => bail!("QEMU has closed the line"),
        Ok(count) => bytes.truncate(count),
        Err(error) if error.kind() == ErrorKind::WouldBlock => bytes.clear(),
        Err(error) => return Err(error.into()),
    }
    Ok(bytes)
}

fn write(stream: &mut UnixStream, bytes: &[u8]) -> anyhow::Result<()> {
    let mut rest = bytes;
    while !rest.is_empty() {
        match stream.write(rest) {
            Ok(count) => rest = &rest[count..],
            Err(error) if error.kind() == ErrorKind::WouldBlock => std::thread::sleep(WallDuration::from_micros(200)),
            Err(error) => return Err(error.into()),
        }
    }
    Ok(())
}

/// A scan with the time that its driver gave it, and its largest range, m.
pub type ReadScan = (Instant, Vec<Beam>, f32);

/// The scans on a recorded line, read by the driver that the configuration names, in the order and at the times in which it published
/// them.
pub fn scans_on(line: &[LaserBytes], config: &RobotConfig) -> Vec<ReadScan> {
    let mut memory = LaserMemory::default();
    let mut options = LrfOptions::new(match config.laser.family {
        LaserFamily::Hokuyo => LrfFamily::Hokuyo,
        LaserFamily::Sick => LrfFamily::SickLms2xx,
    });
    options.baud = config.laser.baud;
    let mut driver = options.driver(&mut memory);
    let mut scans = Vec::new();
    let mut sink = |output: Output<'_>| {
        if let Output::Event(Event::Scan(scan)) = output {
            scans.push((scan.stamp, scan.beams.to_vec(), scan.range_max_m));
        }
    };
    let begun = line.first().map_or(Instant::default(), |first| first.at);
    let _ = driver.handle_input(begun, Input::Connected);
    let mut deadline = drain(driver.as_mut(), &mut sink);
    for piece in line.iter().filter(|piece| piece.is_from_laser) {
        while deadline <= piece.at {
            let _ = driver.handle_input(deadline, Input::Timeout);
            let next = drain(driver.as_mut(), &mut sink);
            deadline = next.max(deadline + Duration::from_micros(1));
        }
        deadline = run_bytes(driver.as_mut(), piece.at, &piece.bytes, &mut sink);
    }
    scans
}
