//! The robot's program as a process: [`lrfslam_robot`] between a laser at a serial port and a host at another one or on the network.
//!
//! What firmware is on a microcontroller, this is on a computer of a robot: the same state machine, to which bytes and the time are brought.
//! Each line has a thread that reads and stamps; the robot itself has one, because its results must depend on nothing but the order of
//! its inputs.
//!
//! What a line brings waits in a queue with an end, and the line waits then. A scan whose bytes have waited for too long is decoded and not mapped, so that a robot
//! that is too slow for its laser lags by no more than that. By the network there is one host at a time. If the robot has a key, one that comes by the network
//! is a guest until it has proved that it knows it.

mod clock;
mod guest;
mod key;
mod port;
mod wiring;

use std::net::{TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::time::Duration as WallDuration;

use anyhow::{Context as _, Result};
use lrfslam_core::time::{Duration, Instant};
use lrfslam_robot::wire::lock::Lock;
use lrfslam_robot::wire::message::Health;
use lrfslam_robot::{Input, Pools, Ports, Robot, RobotMemory};

use self::clock::Clock;
use self::guest::{GUESTS_MAX, Guest, Introduction};
use self::key::entropy;
pub use self::key::read_key_file;
use self::port::{News, Port};
pub use self::wiring::{HostLine, Wiring};
use crate::fault::FaultLink;

/// A port that is not there is tried again after this time.
const REOPEN: Duration = Duration::from_millis(300);
/// Longest wait, so that a stop is noticed …
const IDLE: Duration = Duration::from_millis(20);
/// … and while a line has bytes to take.
const BUSY: Duration = Duration::from_millis(1);
/// Messages of the lines that wait, of 4 KiB at most.
const EVENTS_MAX: usize = 2048;
/// A scan that has waited for so long is left out: newer ones are there.
const LATE: Duration = Duration::from_millis(1000);
/// A host on the network that has said nothing for so long, or does not acknowledge, makes room for another.
const HOST_SILENT: Duration = Duration::from_millis(30_000);
/// The rate of the laser's port until its driver sets one.
const FIRST_BAUD: u32 = 9600;

/// Runs a robot with memory of the size `M` until `stop` is set; `say` is told what happens on its lines.
///
/// # Errors
/// If the host's line cannot be opened at the start, or is open to others and the robot has no key.
pub fn serve<M: Pools>(wiring: &Wiring, stop: &Arc<AtomicBool>, say: &(dyn Fn(&str) + Sync)) -> Result<()> {
    wiring.check()?;
    let mut lines = Lines::open(wiring, stop, say)?;
    // The pools pass over the stack once, on their way to the heap.
    let stack = 2 * size_of::<M>() + (4 << 20);
    std::thread::scope(|scope| {
        let robot = std::thread::Builder::new().name("robot".to_owned()).stack_size(stack);
        let robot = robot.spawn_scoped(scope, || {
            while !stop.load(Ordering::Relaxed) {
                let mut pools = Box::new(M::EMPTY);
                lines.run(pools.lend(), stop);
                say("the robot starts anew");
            }
        });
        robot.context("starting the robot's thread").map(|_| ())
    })
}

/// What happens on the lines.
enum Event {
    Laser(u32, News),
    Host(u32, News),
    Connection(TcpStream),
    Guest(u32, News),
}

/// The lines of a robot.
struct Lines<'s> {
    wiring: Wiring,
    clock: Clock,
    say: &'s (dyn Fn(&str) + Sync),
    events: Receiver<Event>,
    sender: SyncSender<Event>,
    /// Number of the last line opened: what an older one still says is not heard.
    generation: u32,
    laser: Option<Port>,
    laser_at: Instant,
    host: Option<Port>,
    host_at: Instant,
    /// When the host was heard last.
    host_heard: Instant,
    guests: Vec<Guest>,
    /// Guests who did not know the key.
    turned_away: u32,
    /// When the bytes of the laser came that the robot has now.
    laser_heard: Instant,
    to_host: FaultLink,
    from_host: FaultLink,
    is_restart: bool,
    longest_us: u32,
}

impl<'s> Lines<'s> {
    fn open(wiring: &Wiring, stop: &Arc<AtomicBool>, say: &'s (dyn Fn(&str) + Sync)) -> Result<Self> {
        let (sender, events) = sync_channel(EVENTS_MAX);
        let (chance, seed) = wiring.faults;
        let mut lines = Self {
            wiring: wiring.clone(),
            clock: Clock::start(),
            say,
            events,
            sender,
            generation: 0,
            laser: None,
            laser_at: Instant::default(),
            host: None,
            host_at: Instant::default(),
            host_heard: Instant::default(),
            guests: Vec::new(),
            turned_away: 0,
            laser_heard: Instant::default(),
            to_host: FaultLink::new(chance, seed),
            from_host: FaultLink::new(chance, seed ^ 0x5EED),
            is_restart: false,
            longest_us: 0,
        };
        match &wiring.host {
            HostLine::Tcp(address) => {
                let listener = TcpListener::bind(address).with_context(|| format!("listening at {address}"))?;
                say(&format!("listening at {}", listener.local_addr().unwrap_or(*address)));
                port::accept(listener, lines.sender.clone(), stop.clone(), Event::Connection);
            }
            HostLine::Serial(path, baud) => lines.host = lines.plug(Port::serial(path, *baud)?, Event::Host),
            HostLine::Terminal(path) => lines.host = lines.plug(Port::terminal(path)?, Event::Host),
        }
        Ok(lines)
    }

    /// Listens to `port`, as the newest of its kind.
    fn plug(&mut self, mut port: Port, event: fn(u32, News) -> Event) -> Option<Port> {
        self.generation += 1;
        port.generation = self.generation;
        let generation = port.generation;
        port.listen(self.clock, self.sender.clone(), move |news| event(generation, news));
        Some(port)
    }

    /// One life of the robot: until `stop`, or until it wants to start anew.
    fn run(&mut self, memory: RobotMemory<'_>, stop: &AtomicBool) {
        self.is_restart = false;
        let lock = match self.lock() {
            Ok(lock) => lock,
            Err(error) => {
                (self.say)(&format!("{error:#}"));
                return std::thread::sleep(WallDuration::from_secs(1));
            }
        };
        let mut robot = Robot::new("linux", self.clock.epoch(), memory).with_lock(lock);
        let mut deadline = self.clock.now();
        for input in
            [self.laser.is_some().then_some(Input::LaserConnected), self.host.is_some().then_some(Input::LinkConnected)]
                .into_iter()
                .flatten()
        {
            deadline = self.give(&mut robot, self.clock.now(), input);
        }
        while !stop.load(Ordering::Relaxed) && !self.is_restart {
            deadline = self.reopen(&mut robot, deadline);
            deadline = match self.events.recv_timeout(self.patience(deadline)) {
                Ok(event) => self.take(&mut robot, event, deadline),
                Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => {
                    [&mut self.laser, &mut self.host].into_iter().flatten().for_each(Port::flush);
                    // Its frames wait until the line has room again.
                    self.give(&mut robot, self.clock.now(), Input::Timeout)
                }
            };
        }
        // A new epoch must differ from this one.
        std::thread::sleep(WallDuration::from_millis(40));
    }

    /// How long nothing has to be done.
    fn patience(&self, deadline: Instant) -> WallDuration {
        let is_busy = [&self.laser, &self.host].into_iter().flatten().any(|port| port.pending() > 0);
        let longest = if is_busy { BUSY } else { IDLE };
        let wait = deadline.since(self.clock.now()).micros.clamp(0, longest.micros);
        WallDuration::from_micros(wait as u64)
    }

    /// Opens serial ports that are gone.
    fn reopen(&mut self, robot: &mut Robot<'_>, mut deadline: Instant) -> Instant {
        let now = self.clock.now();
        self.turn_late_guests_away(now);
        if self.laser.is_none() && now >= self.laser_at {
            self.laser_at = now + REOPEN;
            if let Ok(port) = Port::serial(&self.wiring.laser, FIRST_BAUD) {
                (self.say)("the laser is plugged in");
                self.laser = self.plug(port, Event::Laser);
                deadline = self.give(robot, now, Input::LaserConnected);
            }
        }
        if let HostLine::Serial(path, baud) = &self.wiring.host
            && self.host.is_none()
            && now >= self.host_at
        {
            self.host_at = now + REOPEN;
            if let Ok(port) = Port::serial(path, *baud) {
                self.host = self.plug(port, Event::Host);
                deadline = self.give(robot, now, Input::LinkConnected);
            }
        }
        deadline
    }

    fn take(&mut self, robot: &mut Robot<'_>, event: Event, deadline: Instant) -> Instant {
        match event {
            Event::Laser(generation, news) if is_of(&self.laser, generation) => match news {
                News::Bytes(at, bytes) => {
                    self.laser_heard = at;
                    self.give(robot, at, Input::LaserBytes(&bytes))
                }
                News::Gone => {
                    (self.say)("the laser is unplugged");
                    self.laser = None;
                    self.give(robot, self.clock.now(), Input::LaserDisconnected)
                }
            },
            Event::Host(generation, news) if is_of(&self.host, generation) => match news {
                News::Bytes(at, bytes) => {
                    self.host_heard = at;
                    let bytes = self.from_host.pass(at, bytes);
                    self.give(robot, at, Input::LinkBytes(&bytes))
                }
                News::Gone => {
                    (self.say)("the host is gone");
                    self.host = None;
                    self.give(robot, self.clock.now(), Input::LinkDisconnected)
                }
            },
            Event::Connection(stream) => match Port::tcp(stream) {
                Ok(port) => self.come(robot, port, deadline),
                Err(_) => deadline,
            },
            Event::Guest(generation, News::Bytes(at, bytes)) => {
                self.hear_guest(robot, (generation, at, &bytes), deadline)
            }
            Event::Guest(generation, News::Gone) if is_of(&self.host, generation) => {
                self.take(robot, Event::Host(generation, News::Gone), deadline)
            }
            Event::Guest(generation, News::Gone) => {
                self.guests.retain(|guest| guest.port.generation != generation);
                deadline
            }
            Event::Laser(..) | Event::Host(..) => deadline,
        }
    }

    /// Somebody comes by the network: a guest if there is a host, or if it is to prove that it has the key.
    fn come(&mut self, robot: &mut Robot<'_>, port: Port, deadline: Instant) -> Instant {
        let now = self.clock.now();
        if self.wiring.key.is_none() && !self.is_engaged(robot, now) {
            let port = self.plug(port, Event::Host);
            return self.attach(robot, port);
        }
        // Without random numbers nobody can prove anything.
        let Ok(lock) = self.lock() else { return deadline };
        if self.guests.len() >= GUESTS_MAX {
            self.guests.remove(0);
            self.turn_away();
        }
        let port = self.plug(port, Event::Guest);
        self.guests.extend(port.map(|port| Guest::new(port, now, lock)));
        deadline
    }

    /// True if there is a host that is still there, as far as one knows.
    fn is_engaged(&self, robot: &Robot<'_>, now: Instant) -> bool {
        self.host.is_some() && now.since(self.host_heard) < HOST_SILENT && !robot.is_host_silent()
    }

    /// The robot's end of a link with a key, if it has one.
    fn lock(&self) -> Result<Option<Lock>> {
        let key = self.wiring.key.clone();
        key.map(|key| Ok(Lock::of_robot(key, entropy()?))).transpose()
    }

    /// A guest has had its time, or its place is needed, and has not proved that it has the key.
    fn turn_away(&mut self) {
        if self.wiring.key.is_some() {
            if self.turned_away == 0 {
                (self.say)("somebody came who has not the robot's key, and was turned away; this is said once");
            }
            self.turned_away = self.turned_away.saturating_add(1);
        }
    }

    fn turn_late_guests_away(&mut self, now: Instant) {
        while let Some(at) = self.guests.iter().position(|guest| guest.is_late(now)) {
            self.guests.remove(at);
            self.turn_away();
        }
    }

    /// A host comes, in place of another if there is one.
    fn attach(&mut self, robot: &mut Robot<'_>, port: Option<Port>) -> Instant {
        (self.say)("a host is there");
        self.give(robot, self.clock.now(), Input::LinkDisconnected);
        self.host = port;
        self.host_heard = self.clock.now();
        self.give(robot, self.clock.now(), Input::LinkConnected)
    }

    /// One that is the host itself, whose line was cut, takes its own place; another is told that there is one.
    fn hear_guest(
        &mut self,
        robot: &mut Robot<'_>,
        (generation, at, bytes): (u32, Instant, &[u8]),
        deadline: Instant,
    ) -> Instant {
        // What comes later on the line of a guest that has become the host is the host's.
        if is_of(&self.host, generation) {
            return self.take(robot, Event::Host(generation, News::Bytes(at, bytes.to_vec())), deadline);
        }
        let Some(place) = self.guests.iter().position(|guest| guest.port.generation == generation) else {
            return deadline;
        };
        let said = self.guests.get_mut(place).map_or(Introduction::None, |guest| guest.hear(at, bytes));
        let Introduction::Host(epoch) = said else {
            if said == Introduction::Nonsense {
                self.guests.remove(place);
                self.turn_away();
            }
            return deadline;
        };
        let guest = self.guests.remove(place);
        if robot.host_epoch() == Some(epoch) || !self.is_engaged(robot, at) {
            let (port, heard) = guest.welcome();
            self.attach(robot, Some(port));
            return self.take(robot, Event::Host(generation, News::Bytes(at, heard)), deadline);
        }
        (self.say)("another host came, and was told that there is one");
        guest.send_away(epoch);
        deadline
    }

    fn give(&mut self, robot: &mut Robot<'_>, now: Instant, input: Input<'_>) -> Instant {
        let started = self.clock.now();
        let deadline = robot.handle(now, input, self);
        let took = self.clock.now().since(started).micros;
        self.longest_us = self.longest_us.max(u32::try_from(took).unwrap_or(u32::MAX));
        deadline
    }
}

fn is_of(port: &Option<Port>, generation: u32) -> bool {
    port.as_ref().is_some_and(|port| port.generation == generation)
}

impl Ports for Lines<'_> {
    fn send_to_laser(&mut self, bytes: &[u8]) {
        self.laser.iter_mut().for_each(|port| port.write(bytes));
    }

    fn set_laser_baud(&mut self, baud: u32) {
        self.laser.iter_mut().for_each(|port| port.set_baud(baud));
    }

    fn link_room(&self) -> usize {
        self.host.as_ref().map_or(0, Port::room)
    }

    fn send_to_host(&mut self, frame: &[u8]) {
        let bytes = self.to_host.pass(self.clock.now(), frame.to_vec());
        self.host.iter_mut().for_each(|port| port.write(&bytes));
    }

    fn restart(&mut self) {
        self.is_restart = true;
    }

    fn is_behind(&self) -> bool {
        self.clock.now().since(self.laser_heard) > LATE
    }

    fn health(&self) -> Health {
        Health { longest_us: self.longest_us, ..Health::default() }
    }
}
