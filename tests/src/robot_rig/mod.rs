//! The robot's program between a virtual laser and a host, the host's line as bad as it is told to be; all on one virtual clock.
//!
//! The laser is plugged in when it is told, and not when a request has come through: so the robot sees the same scans at the same times
//! whatever happens on the line.

use std::collections::VecDeque;

use lrfslam_core::lrf::driver::NEVER;
use lrfslam_core::math::uniform;
use lrfslam_core::random::RandomStream;
use lrfslam_core::robot::{Input, Ports, Robot, RobotConfig, StandardPools};
use lrfslam_core::time::{Duration, Instant};
use lrfslam_core::wire::frame::MAX_FRAME;
use lrfslam_core::wire::message::{FromRobot, Health, Status, ToRobot};
use lrfslam_core::wire::session::{Progress, SessionCounters};
use lrfslam_firmware_sim::cable::{Cable, resample};
use lrfslam_firmware_sim::virtual_lrf::VirtualLrf;
use lrfslam_host::robot::{ClientMemory, RobotClient, RobotEvent, RobotMap, Sweeps};
use rand_core::Rng as _;

/// Rate of the line between robot and host, bytes a second: 921,600 baud.
const LINE_BYTES_PER_SECOND: i64 = 92_160;
/// Bytes that the robot's end of it holds.
const LINE_BUFFER: usize = 4096;
/// Time resolution of the laser's cable.
const GRAIN: Duration = Duration::from_millis(5);

/// Chance of each fault per frame, 0–1.
#[derive(Debug, Clone, Copy, Default)]
pub struct LineFaults {
    /// One bit is flipped.
    pub flip: f32,
    /// One byte is missing.
    pub lose_byte: f32,
    /// One byte comes twice.
    pub double_byte: f32,
    /// All of it is missing.
    pub lose: f32,
    /// It comes twice.
    pub double: f32,
}

impl LineFaults {
    /// Everything, each with this chance.
    pub fn all(chance: f32) -> Self {
        Self { flip: chance, lose_byte: chance, double_byte: chance, lose: chance, double: chance }
    }
}

/// One direction of the host's line.
struct Line {
    faults: LineFaults,
    rng: RandomStream,
    under_way: VecDeque<(Instant, Vec<u8>)>,
    free_at: Instant,
    struck: u32,
}

impl Line {
    fn new(faults: LineFaults, seed: u64) -> Self {
        let rng = RandomStream::new(seed, 0, 0);
        Self { faults, rng, under_way: VecDeque::new(), free_at: Instant::default(), struck: 0 }
    }

    fn strikes(&mut self, chance: f32) -> bool {
        let strikes = uniform(&mut self.rng) < chance;
        self.struck += u32::from(strikes);
        strikes
    }

    fn send(&mut self, now: Instant, frame: &[u8]) {
        let LineFaults { flip, lose_byte, double_byte, lose, double } = self.faults;
        let mut bytes = frame.to_vec();
        let at = |rng: &mut RandomStream, length: usize| rng.next_u32() as usize % length.max(1);
        if self.strikes(flip) {
            let place = at(&mut self.rng, bytes.len());
            bytes[place] ^= 1 << (self.rng.next_u32() % 8);
        }
        if self.strikes(lose_byte) {
            let place = at(&mut self.rng, bytes.len());
            bytes.remove(place);
        }
        if self.strikes(double_byte) {
            let place = at(&mut self.rng, bytes.len());
            bytes.insert(place, bytes[place]);
        }
        let copies = 1 + usize::from(self.strikes(double));
        if self.strikes(lose) {
            return;
        }
        for _ in 0..copies {
            let took = Duration::from_micros(bytes.len() as i64 * 1_000_000 / LINE_BYTES_PER_SECOND);
            self.free_at = self.free_at.max(now) + took;
            self.under_way.push_back((self.free_at, bytes.clone()));
        }
    }

    fn room(&self) -> usize {
        LINE_BUFFER.saturating_sub(self.under_way.iter().map(|(_, bytes)| bytes.len()).sum())
    }

    fn arrived(&mut self, now: Instant) -> Option<Vec<u8>> {
        let (at, _) = self.under_way.front()?;
        if *at <= now { self.under_way.pop_front().map(|(_, bytes)| bytes) } else { None }
    }

    fn next_arrival(&self) -> Option<Instant> {
        self.under_way.front().map(|(at, _)| *at)
    }
}

/// What the robot does to its ports.
#[derive(Default)]
struct RigPorts {
    to_laser: Vec<Vec<u8>>,
    baud: Option<u32>,
    room: usize,
    to_host: Vec<Vec<u8>>,
    is_restart: bool,
}

impl Ports for RigPorts {
    fn send_to_laser(&mut self, bytes: &[u8]) {
        self.to_laser.push(bytes.to_vec());
    }
    fn set_laser_baud(&mut self, baud: u32) {
        self.baud = Some(baud);
    }
    fn link_room(&self) -> usize {
        self.room
    }
    fn send_to_host(&mut self, frame: &[u8]) {
        self.room = self.room.saturating_sub(frame.len());
        self.to_host.push(frame.to_vec());
    }
    fn restart(&mut self) {
        self.is_restart = true;
    }
    fn health(&self) -> Health {
        Health::default()
    }
}

/// All that a host has heard of one life of a robot.
#[derive(Debug, Clone, Default)]
pub struct Life {
    /// Epoch of the robot, once it is known.
    pub epoch: Option<u32>,
    /// Numbers of the reliable messages, as they came.
    pub numbers: Vec<u32>,
    /// What they say of path and map.
    pub map: RobotMap,
    /// Beams of each scan that was told with them.
    pub sweeps: Vec<usize>,
}

impl Life {
    fn take(&mut self, at: Progress, message: &FromRobot<'_>, parts: &mut Sweeps) {
        self.epoch = Some(at.epoch);
        self.numbers.push(at.next);
        self.map.take(message);
        match message {
            FromRobot::Sweep(part) => parts.take_part(part),
            FromRobot::Scan(pose) => {
                self.sweeps.extend(parts.taken_at(pose.stamp).map(|sweep| sweep.scan().beams.len()));
            }
            _ => {}
        }
    }
}

/// What a host has on its disk: all lives of the robot, and how far it had come with the last.
#[derive(Debug, Clone, Default)]
pub struct Disk {
    /// In order.
    pub lives: Vec<Life>,
    /// In words, and refusals.
    pub said: Vec<String>,
    progress: Option<Progress>,
    parts: Sweeps,
}

impl Disk {
    fn take(&mut self, at: Progress, message: &FromRobot<'_>) {
        if self.lives.last().is_none_or(|life| life.epoch.is_some_and(|epoch| epoch != at.epoch)) {
            self.lives.push(Life::default());
        }
        let parts = &mut self.parts;
        self.lives.last_mut().into_iter().for_each(|life| life.take(at, message, parts));
        self.progress = Some(Progress { epoch: at.epoch, next: at.next.wrapping_add(1) });
        if let FromRobot::Said(text) | FromRobot::Refused(text) = message {
            self.said.push((*text).to_owned());
        }
    }
}

/// See the [module](self).
pub struct RobotRig {
    /// The clock.
    pub now: Instant,
    /// What the host has stored.
    pub disk: Disk,
    /// What the robot said of itself last.
    pub status: Status,
    config: RobotConfig,
    device: Box<dyn VirtualLrf>,
    cable: Cable,
    laser_baud: u32,
    is_laser_in: bool,
    /// When the laser's line is looked at next: at times of its own, so that the other line's do not show in the robot's clock.
    laser_at: Instant,
    robot: Robot<'static>,
    robot_epoch: u32,
    robot_deadline: Instant,
    host: Option<RobotClient<'static>>,
    host_epoch: u32,
    up: Line,
    down: Line,
}

impl RobotRig {
    /// A robot with the memory of a 512 KiB image and a host, just switched on, and a laser that is not plugged in yet.
    pub fn new(device: Box<dyn VirtualLrf>, config: &RobotConfig, faults: LineFaults, seed: u64) -> Self {
        let mut rig = Self {
            now: Instant::default(),
            disk: Disk::default(),
            status: Status::default(),
            config: *config,
            device,
            cable: Cable::default(),
            laser_baud: 0,
            is_laser_in: false,
            laser_at: NEVER,
            robot: new_robot(1),
            robot_epoch: 1,
            robot_deadline: Instant::default(),
            host: None,
            host_epoch: 0,
            up: Line::new(faults, seed),
            down: Line::new(faults, seed ^ 0x5EED),
        };
        rig.give(Input::LinkConnected);
        rig.start_host(true);
        rig
    }

    /// A host is started; with its disk, or on an empty one.
    pub fn start_host(&mut self, has_disk: bool) {
        if !has_disk {
            self.disk = Disk::default();
        }
        self.host_epoch += 100;
        let memory: &'static mut ClientMemory = Box::leak(Box::default());
        let mut host = RobotClient::new(&self.config, self.host_epoch, self.disk.progress, memory);
        host.session().connected(self.now);
        self.host = Some(host);
    }

    /// The host is killed; what is under way to it is lost.
    pub fn kill_host(&mut self) {
        self.host = None;
    }

    /// The robot's power goes off and on, and its laser out.
    pub fn reset_robot(&mut self) {
        self.plug_laser(false);
        self.robot_epoch += 1;
        self.robot = new_robot(self.robot_epoch);
        self.give(Input::LinkConnected);
    }

    /// Plugs the laser in, freshly switched on, or out.
    pub fn plug_laser(&mut self, is_in: bool) {
        self.is_laser_in = is_in;
        self.cable.cut();
        if is_in {
            self.device.power_on(self.now);
            self.laser_at = self.now;
        }
        self.give(if is_in { Input::LaserConnected } else { Input::LaserDisconnected });
    }

    /// The host asks for something.
    pub fn ask(&mut self, request: &ToRobot) {
        let asked = self.host.as_mut().map(|host| host.ask(request));
        assert!(matches!(asked, Some(Ok(()))), "no host, or its queue is full");
    }

    /// Counters of the host's end of the session.
    pub fn host_counters(&mut self) -> SessionCounters {
        self.host.as_mut().map(|host| host.session().counters()).unwrap_or_default()
    }

    /// Faults so far, both ways.
    pub fn faults(&self) -> u32 {
        self.up.struck + self.down.struck
    }

    /// Runs for `span`.
    pub fn run_for(&mut self, span: Duration) {
        let until = self.now + span;
        while self.next_event() <= until {
            self.step();
        }
        self.now = until;
    }

    /// Runs until `is_done`, for a minute at most.
    pub fn run_until(&mut self, is_done: impl Fn(&Self) -> bool) {
        let until = self.now + Duration::from_millis(60_000);
        while !is_done(self) {
            assert!(self.now < until, "nothing came of it: {:?} {:?}", self.status, self.disk.said);
            self.step();
        }
    }

    fn next_event(&mut self) -> Instant {
        let mut next = self.robot_deadline;
        if self.is_laser_in {
            next = next.min(self.laser_at);
        }
        next = self.host.as_mut().map_or(next, |host| next.min(host.session().deadline()));
        [self.up.next_arrival(), self.down.next_arrival()].into_iter().flatten().fold(next, Instant::min)
    }

    fn step(&mut self) {
        // What is due now may be due again at once: time goes on by a microsecond at least.
        self.now = self.next_event().max(self.now + Duration::from_micros(1));
        self.serve_laser();
        while let Some(bytes) = self.down.arrived(self.now) {
            self.give(Input::LinkBytes(&bytes));
        }
        if self.now >= self.robot_deadline {
            self.give(Input::Timeout);
        }
        self.serve_host();
    }

    fn serve_laser(&mut self) {
        if !self.is_laser_in || self.now < self.laser_at {
            return;
        }
        self.device.timeout(self.now);
        while let Some(emission) = self.device.poll() {
            self.cable.push(emission);
        }
        let arrived = self.cable.arrived(self.now, self.laser_baud);
        if !arrived.is_empty() {
            self.give(Input::LaserBytes(&arrived));
        }
        self.plan_laser();
    }

    fn plan_laser(&mut self) {
        let arrival = self.cable.next_arrival(self.now, GRAIN);
        self.laser_at = arrival.map_or(self.device.deadline(), |at| at.min(self.device.deadline()));
    }

    fn serve_host(&mut self) {
        let Self { now, host, up, down, disk, status, .. } = self;
        let now = *now;
        let Some(host) = host else {
            while up.arrived(now).is_some() {}
            return;
        };
        while let Some(bytes) = up.arrived(now) {
            host.take(now, &bytes, &mut |event| match event {
                RobotEvent::Message(told) => {
                    let message = told.message().expect("robot and host are of one version");
                    disk.take(told.at, &message);
                }
                RobotEvent::Status(now) => *status = now,
                RobotEvent::NewRobot => {}
                RobotEvent::OtherVersion(version) => panic!("version {version}"),
            });
        }
        if now >= host.session().deadline() {
            host.session().timeout(now);
        }
        let mut memory = [0; MAX_FRAME];
        while let Some(frame) = host.session().poll_transmit(now, &mut memory) {
            down.send(now, frame);
        }
    }

    fn give(&mut self, input: Input<'_>) {
        let mut ports = RigPorts { room: self.up.room(), ..RigPorts::default() };
        self.robot_deadline = self.robot.handle(self.now, input, &mut ports);
        self.laser_baud = ports.baud.unwrap_or(self.laser_baud);
        ports.to_host.iter().for_each(|frame| self.up.send(self.now, frame));
        for bytes in ports.to_laser.iter().filter(|_| self.is_laser_in) {
            let heard = match self.device.baud(self.now) {
                Some(baud) => resample(bytes, self.laser_baud, baud),
                None => bytes.clone(),
            };
            self.device.receive(self.now, &heard);
            self.laser_at = self.now;
        }
        if ports.is_restart {
            self.reset_robot();
        }
    }
}

fn new_robot(epoch: u32) -> Robot<'static> {
    let pools: &'static mut StandardPools = Box::leak(Box::new(StandardPools::EMPTY));
    Robot::new("rig", epoch, pools.lend())
}
