//! A robot at a port: opened, and opened again after it was gone; bytes and deadlines are brought to a [`RobotClient`].

use std::io;
use std::time::Duration as WallDuration;

use lrfslam_robot::wire::frame::MAX_FRAME;

use super::client::{RobotClient, RobotEvent};
use crate::scans::driver::HostClock;
use crate::scans::link::{Address, Link};

/// How long to wait before a port that is gone is opened again.
const REOPEN: WallDuration = WallDuration::from_millis(300);

/// What happens at the port.
#[derive(Debug)]
pub enum LinkEvent<'a> {
    /// The robot says something.
    Robot(RobotEvent<'a>),
    /// The port is open.
    Open,
    /// It is gone, or cannot be opened; it is tried again.
    Gone(&'a io::Error),
}

/// A robot at a port, and the conversation with it.
pub struct RobotLink<'m> {
    address: Address,
    baud: u32,
    client: RobotClient<'m>,
    link: Option<Box<dyn Link>>,
    clock: HostClock,
}

impl<'m> RobotLink<'m> {
    /// * `baud` — of a serial port, bit/s
    pub fn new(address: &Address, baud: u32, client: RobotClient<'m>) -> Self {
        Self { address: address.clone(), baud, client, link: None, clock: HostClock::default() }
    }

    /// The conversation.
    pub fn client(&mut self) -> &mut RobotClient<'m> {
        &mut self.client
    }

    /// Does what is due, waits for bytes up to `wait`, and tells `sink` what they bring.
    pub fn serve(&mut self, wait: WallDuration, sink: &mut dyn FnMut(LinkEvent<'_>)) {
        let done = match self.link {
            Some(_) => self.exchange(wait, sink),
            None => self.open(sink),
        };
        if let Err(error) = done {
            if self.link.take().is_some() {
                self.client.session().disconnected();
            }
            sink(LinkEvent::Gone(&error));
            std::thread::sleep(REOPEN);
        }
    }

    fn open(&mut self, sink: &mut dyn FnMut(LinkEvent<'_>)) -> io::Result<()> {
        let mut link = self.address.open()?;
        link.set_baud(self.baud)?;
        self.link = Some(link);
        self.client.session().connected(self.clock.now());
        sink(LinkEvent::Open);
        Ok(())
    }

    fn exchange(&mut self, wait: WallDuration, sink: &mut dyn FnMut(LinkEvent<'_>)) -> io::Result<()> {
        self.send()?;
        let until = self.client.session().deadline().since(self.clock.now()).micros.max(0) as u64;
        let mut buffer = [0; 4096];
        let Some(link) = &mut self.link else { return Ok(()) };
        let count = link.receive(&mut buffer, wait.min(WallDuration::from_micros(until)))?;
        self.client
            .take(self.clock.now(), buffer.get(..count).unwrap_or(&buffer), &mut |event| sink(LinkEvent::Robot(event)));
        let now = self.clock.now();
        if now >= self.client.session().deadline() {
            self.client.session().timeout(now);
        }
        self.send()
    }

    fn send(&mut self) -> io::Result<()> {
        let Some(link) = &mut self.link else { return Ok(()) };
        let mut memory = [0; MAX_FRAME];
        while let Some(frame) = self.client.session().poll_transmit(self.clock.now(), &mut memory) {
            link.send(frame)?;
        }
        Ok(())
    }
}
