//! Both ends on the clock of the wall: apart from all that keeps the cores busy.

mod hil_mcu;
mod hil_pty;
mod mrpt;
mod stamps;
mod udp;
