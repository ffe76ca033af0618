//! The state machine: inputs in, outputs to [`Ports`].

use super::laser::Laser;
use super::mapping::{Mapped, Mapping};
use super::paging::Paging;
use super::pools::RobotMemory;
use super::report::MapReport;
use super::sweep_report::SweepReport;
use super::words::{Said, leave_out, leave_squares_out, remember, say};
use crate::wire::lock::Lock;
use crate::wire::message::{Capacities, FromRobot, Health, PARTICLES_MAX, ScanPose, Status};
use crate::wire::session::{QueueFullError, Session, SessionMemory};
use lrfslam_core::scan::{Beam, RangeScan};
use lrfslam_core::slam::{ScanCapacityError, SlamMemory, TILE_SIDE};
use lrfslam_core::sweep::Sweep;
use lrfslam_core::time::Instant;
use lrfslam_lrf::driver::{Event, Input as LaserInput, NEVER, Output};

/// Messages that the host may send ahead: most of them are tiles of 150 bytes.
const CREDIT: u16 = 8;
/// Poses and words that wait for room in the queue.
const POSES: usize = 16;

/// What happened in the world.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Input<'a> {
    /// The laser's port is open (again).
    LaserConnected,
    /// … is gone.
    LaserDisconnected,
    /// Bytes of the laser.
    LaserBytes(&'a [u8]),
    /// The host's port is open (again).
    LinkConnected,
    /// … is gone.
    LinkDisconnected,
    /// Bytes of the host.
    LinkBytes(&'a [u8]),
    /// The deadline has come, or the host's port has room again.
    Timeout,
}

/// Where outputs go. Nothing here may wait.
pub trait Ports {
    /// Bytes for the laser.
    fn send_to_laser(&mut self, bytes: &[u8]);
    /// Set the laser's line to this rate, bit/s, after all bytes given before are out.
    fn set_laser_baud(&mut self, baud: u32);
    /// Bytes that the host's port takes now.
    fn link_room(&self) -> usize;
    /// A frame for the host, no longer than the room.
    fn send_to_host(&mut self, frame: &[u8]);
    /// Start anew, as after power on.
    fn restart(&mut self);
    /// What the board knows of itself.
    fn health(&self) -> Health;
    /// So much newer bytes of the laser wait that the scan that came now is to be left out: it is asked for every scan.
    fn is_behind(&self) -> bool {
        false
    }
    /// A scan was mapped: for logs and tests.
    fn mapped(&mut self, _mapped: &Mapped) {}
}

/// The robot; see the [crate](crate).
#[derive(Debug)]
pub struct Robot<'m> {
    pub(super) board: &'static str,
    pub(super) capacities: Capacities,
    pub(super) link: Session<'m>,
    pub(super) work: Work<'m>,
    pub(super) map_report: MapReport<'m>,
    pub(super) sweep_report: SweepReport,
    pub(super) owes_identity: bool,
    pub(super) answer: Option<Answer>,
    pub(super) poses: heapless::Deque<ScanPose, POSES>,
    pub(super) said: Said,
    pub(super) status: Status,
    pub(super) status_at: Instant,
    pub(super) laser_connected: bool,
    pub(super) restart_at: Instant,
}

/// To a request.
#[derive(Debug, Clone)]
pub(super) enum Answer {
    Configured,
    Refused(heapless::String<96>),
}

#[derive(Debug)]
// Either exists for all of a robot's life.
#[allow(clippy::large_enum_variant)]
pub(super) enum Work<'m> {
    /// For a configuration.
    Waiting(Idle<'m>),
    Mapping(Running<'m>),
    /// Between the two.
    Nothing,
}

#[derive(Debug)]
pub(super) struct Idle<'m> {
    pub(super) mapping: SlamMemory<'m, TILE_SIDE>,
    pub(super) telegram: &'m mut [u8],
    pub(super) beams: &'m mut [Beam],
}

#[derive(Debug)]
pub(super) struct Running<'m> {
    pub(super) laser: Laser<'m>,
    pub(super) laser_deadline: Instant,
    pub(super) mapping: Mapping<'m>,
    pub(super) paging: Paging,
}

impl<'m> Robot<'m> {
    /// A robot that waits for its ports and for a configuration.
    ///
    /// * `board` — its name; `epoch` — another number than before, after every start
    pub fn new(board: &'static str, epoch: u32, memory: RobotMemory<'m>) -> Self {
        let RobotMemory { mapping, link, telegram, beams, ledger } = memory;
        let count = |length: usize| u16::try_from(length).unwrap_or(u16::MAX);
        let capacities = Capacities {
            beams: count(beams.len()),
            particles: count(mapping.particles.particles.len().min(PARTICLES_MAX)),
            tiles: count(mapping.particles.map.tiles.len()),
            tile_side: TILE_SIDE as u8,
            ndt_tiles: count(mapping.odometry.tiles.len()),
            window_side: count(mapping.particles.window.len().isqrt()),
        };
        Self {
            board,
            capacities,
            link: new_session(epoch, link),
            work: Work::Waiting(Idle { mapping, telegram, beams }),
            map_report: MapReport::new(ledger),
            sweep_report: SweepReport::default(),
            owes_identity: false,
            answer: None,
            poses: heapless::Deque::new(),
            said: heapless::Deque::new(),
            status: Status::default(),
            status_at: NEVER,
            laser_connected: false,
            restart_at: NEVER,
        }
    }

    /// The same for a robot that speaks only with a host that has its key, if it has one.
    #[must_use]
    pub fn with_lock(mut self, lock: impl Into<Option<Lock>>) -> Self {
        self.link = self.link.with_lock(lock);
        self
    }

    /// The mapping, once it is configured.
    pub fn mapping(&self) -> Option<&Mapping<'m>> {
        match &self.work {
            Work::Mapping(running) => Some(&running.mapping),
            Work::Waiting(_) | Work::Nothing => None,
        }
    }

    /// Takes one input, and gives what follows from it to `ports`; returns when [`Input::Timeout`] is due.
    pub fn handle(&mut self, now: Instant, input: Input<'_>, ports: &mut impl Ports) -> Instant {
        match input {
            Input::LaserConnected => {
                self.laser_connected = true;
                self.give_laser(now, LaserInput::Connected, ports);
            }
            Input::LaserDisconnected => {
                self.laser_connected = false;
                self.give_laser(now, LaserInput::Disconnected, ports);
            }
            Input::LaserBytes(bytes) => self.give_laser_bytes(now, bytes, ports),
            Input::LinkConnected => self.link.connected(now),
            Input::LinkDisconnected => self.link.disconnected(),
            Input::LinkBytes(bytes) => self.hear_host(now, bytes, ports),
            Input::Timeout => self.on_timeout(now, ports),
        }
        self.tell_host(now, ports);
        if now >= self.restart_at {
            self.restart_at = NEVER;
            ports.restart();
        }
        self.deadline()
    }

    fn deadline(&self) -> Instant {
        let laser = match &self.work {
            Work::Mapping(running) => running.laser_deadline,
            Work::Waiting(_) | Work::Nothing => NEVER,
        };
        let status = if self.link.is_live() { self.status_at } else { NEVER };
        laser.min(self.link.deadline()).min(status).min(self.restart_at)
    }

    fn on_timeout(&mut self, now: Instant, ports: &mut impl Ports) {
        if now >= self.link.deadline() {
            self.link.timeout(now);
        }
        if matches!(&self.work, Work::Mapping(running) if now >= running.laser_deadline) {
            self.give_laser(now, LaserInput::Timeout, ports);
        }
    }

    fn give_laser_bytes(&mut self, now: Instant, bytes: &[u8], ports: &mut impl Ports) {
        let mut rest = bytes;
        while !rest.is_empty() {
            let Work::Mapping(running) = &mut self.work else { return };
            let taken = running.laser.driver().handle_input(now, LaserInput::Bytes(rest));
            rest = rest.get(taken..).unwrap_or_default();
            self.drain_laser(ports);
        }
    }

    pub(super) fn give_laser(&mut self, now: Instant, input: LaserInput<'_>, ports: &mut impl Ports) {
        if let Work::Mapping(running) = &mut self.work {
            let _ = running.laser.driver().handle_input(now, input);
            self.drain_laser(ports);
        }
    }

    fn drain_laser(&mut self, ports: &mut impl Ports) {
        let Self {
            work: Work::Mapping(running), link, map_report, sweep_report, poses, said, status, restart_at, ..
        } = self
        else {
            return;
        };
        let Running { laser, laser_deadline, mapping, paging } = running;
        let driver = laser.driver();
        loop {
            match driver.poll_output() {
                Output::Timeout(deadline) => {
                    *laser_deadline = deadline;
                    break;
                }
                Output::Transmit(bytes) => ports.send_to_laser(bytes),
                Output::SetBaud(baud) => ports.set_laser_baud(baud),
                Output::Event(Event::Scan(_)) if ports.is_behind() => leave_out(status, said),
                Output::Event(Event::Scan(scan)) => {
                    let Ok(mapped) = map_scan(mapping, &scan, status, said) else { continue };
                    if mapped.report.filter.is_some() {
                        map_report.map_changed();
                    }
                    let (config, motion) = (mapping.config(), mapped.report.odometry.motion);
                    let sweep = Sweep { scan, robot_from_lrf: config.robot_from_lrf, motion };
                    let is_told = sweep_report.tell(&config.report, &sweep, &mapped, link);
                    status.untold_sweeps = status.untold_sweeps.saturating_add(u32::from(!is_told));
                    ports.mapped(&mapped);
                    keep_newest(poses, mapped.pose);
                    // Said in this order, whatever comes with the next scan: what the host gives back goes by what it has heard before.
                    let is_told = *restart_at == NEVER && tell_path(mapping, poses, link).is_ok();
                    if !map_report.is_telling_whole() {
                        page(paging, mapping, &mapped, link, (is_told, status.late_scans > 0), said);
                    }
                }
                Output::Event(event) => {
                    if matches!(event, Event::Stopped { .. }) {
                        map_report.tell_whole();
                    }
                    remember(said, &event);
                }
            }
        }
        let counters = driver.counters();
        (status.damaged, status.restarts) = (counters.damaged, counters.restarts);
    }
}

/// Queues where the robot and its particles were.
///
/// # Errors
/// [`QueueFullError`] if something waits for room.
pub(super) fn tell_path(
    mapping: &mut Mapping<'_>,
    poses: &mut heapless::Deque<ScanPose, POSES>,
    link: &mut Session<'_>,
) -> Result<(), QueueFullError> {
    if let Some(segment) = mapping.segment() {
        link.send(&FromRobot::Segment(segment))?;
        mapping.segment_told();
    }
    while let Some(pose) = poses.front() {
        link.send(&FromRobot::Scan(*pose))?;
        let _ = poses.pop_front();
    }
    Ok(())
}

/// When there is no room, the oldest goes.
fn keep_newest(poses: &mut heapless::Deque<ScanPose, POSES>, pose: ScanPose) {
    if poses.is_full() {
        let _ = poses.pop_front();
    }
    let _ = poses.push_back(pose);
}

/// Has tiles leave and come back.
///
/// Who is late by his own mapping does not blame the link.
///
/// * `is_told` — the host has heard of the scan, or will before what is queued now; `is_slow` — scans were left out
// As the host's requests: not in one stack frame with the mapping of a scan.
#[inline(never)]
fn page(
    paging: &mut Paging,
    mapping: &mut Mapping<'_>,
    mapped: &Mapped,
    link: &mut Session<'_>,
    (is_told, is_slow): (bool, bool),
    said: &mut Said,
) {
    let robot = mapping.slam().odometry().map_from_robot().position();
    let late = paging.counts.late;
    paging.scan_mapped(mapped.stamp, mapped.report.filter.map(|_| robot), mapping.map_mut(), link);
    if is_told {
        // What finds no room now does so later.
        let _ = paging.send(mapping.map_mut(), link);
    }
    let now_late = paging.counts.late;
    // The first, the second, the fourth, the eighth …
    if !is_slow && now_late.checked_ilog2() > late.checked_ilog2() {
        say(said, format_args!("{now_late} answers about tiles came late: now the map depends on the link"));
    }
}

// Its own frame: what follows from a scan is told when it is gone.
#[inline(never)]
fn map_scan(
    mapping: &mut Mapping<'_>,
    scan: &RangeScan<'_>,
    status: &mut Status,
    said: &mut Said,
) -> Result<Mapped, ScanCapacityError> {
    let mapped =
        mapping.add_scan(scan).inspect_err(|_| status.refused_scans = status.refused_scans.saturating_add(1))?;
    status.scans = status.scans.saturating_add(1);
    status.steps = mapping.steps();
    status.map_from_robot = mapped.report.map_from_robot;
    status.lost_scans = status.lost_scans.saturating_add(u32::from(mapped.report.odometry.is_lost));
    if let Some(filter) = &mapped.report.filter {
        status.particles = filter.particles as u16;
        status.tiles = filter.tiles as u16;
        status.dropped_particles = status.dropped_particles.saturating_add(filter.dropped as u32);
        leave_squares_out(filter.squares_left_out, status, said);
    }
    Ok(mapped)
}

/// A session that takes no more at once than a microcontroller's buffer holds while a scan is mapped.
fn new_session(epoch: u32, memory: SessionMemory<'_>) -> Session<'_> {
    let mut session = Session::new(epoch, None, memory);
    session.set_credit(CREDIT);
    session
}
