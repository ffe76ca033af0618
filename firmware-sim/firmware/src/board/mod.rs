//! What differs from board to board: UARTs, clock, watchdog. One file for each; the only ones that touch registers.

mod fault;
#[cfg(any(feature = "mps2-an500", feature = "mps2-an386"))]
mod mps2;
#[cfg(feature = "nucleo-h743zi")]
mod nucleo_h743zi;
pub mod stack;

#[cfg(any(feature = "mps2-an500", feature = "mps2-an386"))]
pub use mps2::{Board, NAME, recording};
#[cfg(feature = "nucleo-h743zi")]
pub use nucleo_h743zi::{Board, NAME};

use crate::port::Port;
use cortex_m::peripheral::SYST;
use cortex_m::peripheral::syst::SystClkSource;
use lrfslam_core::time::{Duration, Instant};
use lrfslam_robot::Ports;
use lrfslam_robot::wire::frame::MAX_FRAME;
use lrfslam_robot::wire::message::Health;

/// Of the laser: a scan of a URG-04LX may wait while another is mapped.
pub type LaserPort = Port<4096, 64>;
/// Of the host: eight tiles of 150 bytes, which it may send ahead, may wait while a scan is mapped.
pub type LinkPort = Port<2048, 2048>;

pub static LASER: LaserPort = Port::new();
pub static LINK: LinkPort = Port::new();

/// How a program began, and how it does.
pub struct Vitals {
    epoch: u32,
    fault_at: u32,
    longest_us: u32,
    had_link_room: bool,
}

impl Vitals {
    fn begin() -> Self {
        Self { epoch: fault::count_start(), fault_at: fault::last(), longest_us: 0, had_link_room: true }
    }

    fn health(&self) -> Health {
        Health {
            stack_used: stack::used(),
            lrf_overrun: LASER.overrun(),
            link_overrun: LINK.overrun(),
            longest_us: self.longest_us,
            fault_at: self.fault_at,
        }
    }
}

/// Wakes the program for its deadlines, every `ticks` of the core's clock.
fn start_ticks(timer: &mut SYST, ticks: u32) {
    timer.set_clock_source(SystClkSource::Core);
    timer.set_reload(ticks - 1);
    timer.enable_counter();
    timer.enable_interrupt();
}

impl Board {
    /// Another number after every start.
    pub fn epoch(&self) -> u32 {
        self.vitals.epoch
    }

    /// An input was handled.
    pub fn took(&mut self, started: Instant) {
        let Duration { micros } = self.now().since(started);
        self.vitals.longest_us = self.vitals.longest_us.max(micros as u32);
    }

    /// The laser's bytes.
    pub fn laser(&self) -> &'static LaserPort {
        &LASER
    }

    /// The host's bytes.
    pub fn link(&self) -> &'static LinkPort {
        &LINK
    }

    /// True once after the host's port has got room for a frame again.
    pub fn link_has_room(&mut self) -> bool {
        let has_room = self.link_room() >= MAX_FRAME;
        has_room && !core::mem::replace(&mut self.vitals.had_link_room, has_room)
    }

    /// Waits for an interrupt, unless bytes are there already.
    pub fn sleep(&self) {
        critical_section::with(|_| {
            if LASER.is_quiet() && LINK.is_quiet() {
                cortex_m::asm::wfi();
            }
        });
    }
}
