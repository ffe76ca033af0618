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
use lrfslam_robot::Ports;
use lrfslam_robot::wire::frame::MAX_FRAME;

/// Of the laser: a scan of a URG-04LX may wait while another is mapped.
pub type LaserPort = Port<4096, 64>;
/// Of the host: eight tiles of 150 bytes, which it may send ahead, may wait while a scan is mapped.
pub type LinkPort = Port<2048, 2048>;

pub static LASER: LaserPort = Port::new();
pub static LINK: LinkPort = Port::new();

impl Board {
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
        has_room && !core::mem::replace(&mut self.had_link_room, has_room)
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
