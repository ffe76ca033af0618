//! The robot and its host: what it is asked, and what it says.

use core::fmt::Write as _;

use super::fit::misfit;
use super::laser::Laser;
use super::machine::{Answer, Ports, Robot, Running, Work, tell_path};
use super::mapping::Mapping;
use super::paging::{Paging, TileCounts};
use super::words::say;
use crate::config::RobotConfig;
use crate::wire::frame::MAX_FRAME;
use crate::wire::message::{FromRobot, Health, Identity, Status, ToRobot};
use crate::wire::session::{QueueFullError, Received};
use lrfslam_core::time::{Duration, Instant};
use lrfslam_lrf::driver::{Input as LaserInput, NEVER};

/// From one status to the next.
const STATUS_EVERY: Duration = Duration::from_millis(250);
/// From a request to start anew to doing so: its acknowledgement goes out first, or the host would ask the next life again. Long enough
/// for the host to ask once more if it was lost.
const RESTART_AFTER: Duration = Duration::from_millis(1000);
/// Of a robot whose memory is gone without a mapping.
const UNUSABLE: &str = "its memory does not fit together";

/// What is asked of the robot as a whole, without the message that it came in.
// A request lives for a moment on the stack.
#[allow(clippy::large_enum_variant)]
enum Request {
    Configure(RobotConfig),
    Stop,
    Restart,
    /// Its frame was whole, and yet it says nothing that this program knows.
    Unknown,
}

impl Robot<'_> {
    /// The host that it talks to, or talked to last.
    pub fn host_epoch(&self) -> Option<u32> {
        self.link.progress().map(|host| host.epoch)
    }

    /// Frames that came without its key since the start; 0 if it has none.
    pub fn refused(&self) -> u32 {
        self.link.counters().refused
    }

    /// True if the host has something to acknowledge, and has not for some seconds.
    pub fn is_host_silent(&self) -> bool {
        self.link.is_silent()
    }

    /// Takes what the host says, and says once that others are not heard.
    pub(super) fn hear_host(&mut self, now: Instant, bytes: &[u8], ports: &mut impl Ports) {
        let before = self.refused();
        self.take_link(now, bytes, ports);
        if before == 0 && self.refused() > 0 {
            say(&mut self.said, format_args!("what came without the right key was refused; this is said once"));
        }
    }

    // Not in one stack frame with the mapping of a scan.
    #[inline(never)]
    fn take_link(&mut self, now: Instant, bytes: &[u8], ports: &mut impl Ports) {
        let mut rest = bytes;
        while !rest.is_empty() {
            let (taken, received) = self.link.take(now, rest);
            let request = match received {
                Some(Received::Reliable(message)) => match postcard::from_bytes(message) {
                    Ok(ToRobot::Configure(config)) => Some(Request::Configure(config)),
                    Ok(ToRobot::Stop) => Some(Request::Stop),
                    Ok(ToRobot::Restart) => Some(Request::Restart),
                    Ok(ToRobot::Tile(tile)) => {
                        if let Work::Mapping(Running { mapping, paging, .. }) = &mut self.work {
                            paging.take(&tile, mapping.map_mut());
                        }
                        None
                    }
                    Ok(ToRobot::Recalled(region)) => {
                        if let Work::Mapping(running) = &mut self.work {
                            running.paging.recalled(&region);
                        }
                        None
                    }
                    Err(_) => Some(Request::Unknown),
                },
                Some(Received::NewPeer { .. }) => {
                    self.owes_identity = true;
                    self.status_at = now;
                    self.map_report.forget();
                    self.sweep_report.forget();
                    if let Work::Mapping(running) = &mut self.work {
                        running.paging.forget_requests(running.mapping.map_mut());
                    }
                    None
                }
                _ => None,
            };
            rest = rest.get(taken..).unwrap_or_default();
            match request {
                Some(Request::Configure(config)) => self.configure(now, &config, ports),
                Some(Request::Stop) => self.stop(now, ports),
                Some(Request::Restart) => self.restart_at = now + RESTART_AFTER,
                Some(Request::Unknown) => self.answer = Some(refused("the request is not understood")),
                None => {}
            }
        }
    }

    fn configure(&mut self, now: Instant, config: &RobotConfig, ports: &mut impl Ports) {
        let settled = match &self.work {
            Work::Mapping(running) if running.mapping.config() == config => Some(Answer::Configured),
            Work::Mapping(_) => Some(refused("it maps with another configuration: restart it first")),
            Work::Waiting(idle) => misfit(config, &self.capacities, &idle.mapping).map(refused),
            Work::Nothing => Some(refused(UNUSABLE)),
        };
        self.answer = settled.or_else(|| Some(self.begin(now, config, ports)));
    }

    /// Takes the memory, for a configuration that fits it.
    fn begin(&mut self, now: Instant, config: &RobotConfig, ports: &mut impl Ports) -> Answer {
        let Work::Waiting(idle) = core::mem::replace(&mut self.work, Work::Nothing) else { return refused(UNUSABLE) };
        let mapping = match Mapping::new(config, idle.mapping) {
            Ok(mapping) => mapping,
            // Nothing fits memory that does not fit together: the program was built so.
            Err(error) => return refused(error),
        };
        let laser = Laser::new(&config.laser, idle.telegram, idle.beams);
        let paging = Paging::of(mapping.slam(), &mapping.config().slam);
        self.work = Work::Mapping(Running { laser, laser_deadline: NEVER, mapping, paging });
        if self.laser_connected {
            self.give_laser(now, LaserInput::Connected, ports);
        }
        Answer::Configured
    }

    fn stop(&mut self, now: Instant, ports: &mut impl Ports) {
        match &self.work {
            Work::Mapping(_) => self.give_laser(now, LaserInput::Stop, ports),
            Work::Waiting(_) | Work::Nothing => self.answer = Some(refused("not configured")),
        }
    }

    /// Queues what there is to say, most important first, and sends what the port has room for.
    // As above.
    #[inline(never)]
    pub(super) fn tell_host(&mut self, now: Instant, ports: &mut impl Ports) {
        // Who comes now is to meet the robot that it will be.
        if self.restart_at == NEVER {
            let _ = self.queue_messages();
        }
        if self.link.is_live() && now >= self.status_at {
            self.status_at = now + STATUS_EVERY;
            let status = self.status_now(now, ports.health());
            self.link.send_latest(&status);
        }
        let mut memory = [0; MAX_FRAME];
        while ports.link_room() >= MAX_FRAME {
            let Some(frame) = self.link.poll_transmit(now, &mut memory) else { break };
            ports.send_to_host(frame);
        }
    }

    fn status_now(&self, now: Instant, health: Health) -> Status {
        let counts = match &self.work {
            Work::Mapping(running) => running.paging.counts,
            Work::Waiting(_) | Work::Nothing => TileCounts::default(),
        };
        let TileCounts { left: tiles_left, restored: tiles_restored, forgotten: tiles_forgotten, .. } = counts;
        Status { now, health, tiles_left, tiles_restored, tiles_forgotten, ..self.status }
    }

    /// As far as there is room; what is left waits.
    fn queue_messages(&mut self) -> Result<(), QueueFullError> {
        let link = &mut self.link;
        let running = match &mut self.work {
            Work::Mapping(running) => Some(running),
            Work::Waiting(_) | Work::Nothing => None,
        };
        if self.owes_identity {
            let (board, capacities, is_configured) = (self.board, self.capacities, running.is_some());
            link.send(&FromRobot::Identity(Identity { board, is_configured, capacities }))?;
            self.owes_identity = false;
        }
        if let Some(answer) = &self.answer {
            match answer {
                Answer::Configured => link.send(&FromRobot::Configured)?,
                Answer::Refused(reason) => link.send(&FromRobot::Refused(reason))?,
            };
            self.answer = None;
        }
        while let Some(words) = self.said.front() {
            link.send(&FromRobot::Said(words))?;
            let _ = self.said.pop_front();
        }
        let Some(Running { mapping, paging, .. }) = running else { return Ok(()) };
        tell_path(mapping, &mut self.poses, link)?;
        if !self.map_report.is_telling_whole() {
            paging.send(mapping.map_mut(), link)?;
        }
        // A tile that nobody is there for would only be old when somebody comes.
        if link.is_live() {
            self.map_report.run(mapping, link);
        }
        Ok(())
    }
}

fn refused(reason: impl core::fmt::Display) -> Answer {
    let mut text = heapless::String::new();
    let _ = write!(text, "{reason}");
    Answer::Refused(text)
}
