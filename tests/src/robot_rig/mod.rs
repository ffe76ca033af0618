//! The robot's program between a virtual laser and a host, the host's line as bad as it is told to be; all on one virtual clock.
//!
//! The laser is plugged in when it is told, and not when a request has come through: so the robot sees the same scans at the same times
//! whatever happens on the line.

mod disk;
mod line;
mod memory;
mod ports;

use lrfslam_core::time::{Duration, Instant};
use lrfslam_firmware_sim::cable::{Cable, resample};
use lrfslam_firmware_sim::virtual_lrf::VirtualLrf;
use lrfslam_host::robot::{ClientMemory, RobotClient, RobotEvent};
use lrfslam_lrf::driver::NEVER;
use lrfslam_robot::wire::frame::MAX_FRAME;
use lrfslam_robot::wire::key::Key;
use lrfslam_robot::wire::lock::Lock;
use lrfslam_robot::wire::message::{Status, ToRobot};
use lrfslam_robot::wire::session::SessionCounters;
use lrfslam_robot::{Input, Robot, RobotConfig, RobotMemory};

pub use disk::{Disk, HostDisk, Life};
use line::Line;
pub use line::LineFaults;
pub use memory::{Build, PoolSize};
use ports::RigPorts;
pub use ports::Tally;

/// Time resolution of the laser's cable.
const GRAIN: Duration = Duration::from_millis(5);

/// Makes the memory of a robot, for each of its lives.
pub type MakeMemory = Box<dyn Fn() -> RobotMemory<'static>>;

/// See the [module](self).
pub struct RobotRig<D = Disk> {
    /// The clock.
    pub now: Instant,
    /// What the host has stored.
    pub disk: D,
    /// What the robot said of itself last.
    pub status: Status,
    /// What its mapping did, in all its lives.
    pub tally: Tally,
    config: RobotConfig,
    device: Box<dyn VirtualLrf>,
    cable: Cable,
    laser_baud: u32,
    is_laser_in: bool,
    /// When the laser's line is looked at next: at times of its own, so that the other line's do not show in the robot's clock.
    laser_at: Instant,
    make_memory: MakeMemory,
    robot: Robot<'static>,
    robot_epoch: u32,
    robot_deadline: Instant,
    host: Option<RobotClient<'static>>,
    host_epoch: u32,
    key: Option<Key>,
    up: Line,
    down: Line,
}

impl RobotRig {
    /// A robot with the memory of a 512 KiB image and a host, just switched on, and a laser that is not plugged in yet.
    pub fn new(device: Box<dyn VirtualLrf>, config: &RobotConfig, faults: LineFaults, seed: u64) -> Self {
        let mut rig = Self::with(Disk::default(), Box::new(|| Build::Standard.memory(&[])), device, config);
        rig.set_faults(faults, seed);
        rig.start();
        rig
    }

    /// A host is started; with its disk, or on an empty one.
    pub fn start_host(&mut self, has_disk: bool) {
        if !has_disk {
            self.disk = Disk::default();
        }
        self.start_host_on_disk();
    }

    /// Runs until `is_done`, for a minute at most.
    pub fn run_until(&mut self, is_done: impl Fn(&Self) -> bool) {
        let until = self.now + Duration::from_millis(60_000);
        while !is_done(self) {
            assert!(self.now < until, "nothing came of it: {:?} {:?}", self.status, self.disk.said);
            self.step();
        }
    }
}

impl<D: HostDisk> RobotRig<D> {
    /// A robot and a host with this disk, both still to be [started](Self::start), and a line without faults between them.
    pub fn with(disk: D, make_memory: MakeMemory, device: Box<dyn VirtualLrf>, config: &RobotConfig) -> Self {
        Self {
            now: Instant::default(),
            disk,
            status: Status::default(),
            tally: Tally::default(),
            config: *config,
            device,
            cable: Cable::default(),
            laser_baud: 0,
            is_laser_in: false,
            laser_at: NEVER,
            robot: Robot::new("rig", 1, make_memory()),
            make_memory,
            robot_epoch: 1,
            robot_deadline: Instant::default(),
            host: None,
            host_epoch: 0,
            key: None,
            up: Line::new(LineFaults::default(), 0),
            down: Line::new(LineFaults::default(), 0),
        }
    }

    /// Makes the line as bad as this.
    pub fn set_faults(&mut self, faults: LineFaults, seed: u64) {
        self.up = Line::new(faults, seed);
        self.down = Line::new(faults, seed ^ 0x5EED);
    }

    /// From their next start on robot and host have this key.
    pub fn set_key(&mut self, key: Key) {
        self.key = Some(key);
        self.robot = self.new_robot();
    }

    /// A life of the robot, with the nonces of that life.
    fn new_robot(&self) -> Robot<'static> {
        let lock = self.key.clone().map(|key| Lock::of_robot(key, u128::from(self.robot_epoch).to_le_bytes()));
        Robot::new("rig", self.robot_epoch, (self.make_memory)()).with_lock(lock)
    }

    /// Somebody at the line says this to the robot, and to the host.
    pub fn put_in(&mut self, frame: &[u8]) {
        self.give(Input::LinkBytes(frame));
        self.up.send(self.now, frame);
    }

    /// Frames that the robot has refused, for want of the key.
    pub fn refused(&self) -> u32 {
        self.robot.refused()
    }

    /// Robot and host are switched on.
    pub fn start(&mut self) {
        self.give(Input::LinkConnected);
        self.start_host_on_disk();
    }

    fn start_host_on_disk(&mut self) {
        self.host_epoch += 100;
        let memory: &'static mut ClientMemory = Box::leak(Box::default());
        let mut host = RobotClient::new(&self.config, self.host_epoch, self.disk.progress(), memory)
            .with_lock(self.key.clone().map(|key| Lock::of_host(key, u128::from(self.host_epoch).to_le_bytes())));
        host.session().connected(self.now);
        self.host = Some(host);
    }

    /// The host is killed; what is under way to it is lost.
    pub fn kill_host(&mut self) {
        self.host = None;
    }

    /// The robot's end of the host's line is pulled out.
    pub fn unplug_link(&mut self) {
        self.give(Input::LinkDisconnected);
    }

    /// … and put in again.
    pub fn plug_link(&mut self) {
        self.give(Input::LinkConnected);
    }

    /// The robot's power goes off and on, and its laser out.
    pub fn reset_robot(&mut self) {
        self.plug_laser(false);
        self.robot_epoch += 1;
        self.robot = self.new_robot();
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
    pub fn ask(&mut self, request: &ToRobot<'_>) {
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

    fn next_event(&mut self) -> Instant {
        let mut next = self.robot_deadline;
        if self.is_laser_in {
            next = next.min(self.laser_at);
        }
        next = self.host.as_mut().map_or(next, |host| next.min(host.session().deadline()));
        [self.up.next_arrival(), self.down.next_arrival()].into_iter().flatten().fold(next, Instant::min)
    }

    /// Jumps to the next event, and lets it happen.
    pub fn step(&mut self) {
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
                RobotEvent::Message(told) => disk.take(&told),
                RobotEvent::Recall(recall) => disk.to_give_back().into_iter().for_each(|tiles| recall.answer(tiles)),
                RobotEvent::Status(now) => *status = now,
                RobotEvent::NewRobot => {}
                RobotEvent::Foreign(why) => panic!("{why}"),
                RobotEvent::Absurd(why) => panic!("{why}"),
                RobotEvent::Busy => panic!("there is one host"),
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
        let mut ports = RigPorts { room: self.up.room(), tally: self.tally, ..RigPorts::default() };
        self.robot_deadline = self.robot.handle(self.now, input, &mut ports);
        self.laser_baud = ports.baud.unwrap_or(self.laser_baud);
        self.tally = ports.tally;
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
