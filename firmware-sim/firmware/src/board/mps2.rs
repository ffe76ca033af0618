//! Arm MPS2 with the AN500 (Cortex-M7) or AN386 (Cortex-M4F) image, as QEMU has it: `mps2-an500`, `mps2-an386`.
//!
//! UART 0: laser, UART 1: host, TIMER 0: clock, watchdog. All at 25 MHz. QEMU's clock is the world's while its processor has no fixed speed, so
//! a simulation may run slower than the world: the first two words of the PSRAM, which QEMU's loader can fill, are [`MARK`] and by how much.
#![allow(unsafe_code)]

use core::num::NonZeroU64;

use cortex_m::peripheral::{NVIC, Peripherals, SCB};
use cortex_m_rt::exception;
use lrfslam_core::time::Instant;
use lrfslam_robot::Ports;
use lrfslam_robot::wire::message::Health;
use tock_registers::interfaces::{Readable, Writeable};
use tock_registers::register_structs;
use tock_registers::registers::{ReadOnly, ReadWrite, WriteOnly};

use super::{LASER, LINK, Vitals, start_ticks};
use crate::port::Port;

#[cfg(feature = "mps2-an500")]
pub const NAME: &str = "mps2-an500";
#[cfg(feature = "mps2-an386")]
pub const NAME: &str = "mps2-an386";

#[cfg(feature = "mps2-an500")]
const PSRAM: usize = 0x6000_0000;
#[cfg(feature = "mps2-an386")]
const PSRAM: usize = 0x2100_0000;
/// "slow" in ASCII: the next word is how many times slower than the world the simulation runs.
const MARK: u32 = u32::from_le_bytes(*b"slow");

const CLOCK_MHZ: u32 = 25;
/// Until the watchdog barks; it bites at the second time.
const WATCHDOG_TICKS: u32 = 20 * 1_000_000 * CLOCK_MHZ;
const WATCHDOG_KEY: u32 = 0x1ACC_E551;

register_structs! {
    /// CMSDK UART (Arm DDI 0479D §4.3).
    Uart {
        (0x00 => data: ReadWrite<u32>),
        (0x04 => state: ReadWrite<u32>),
        (0x08 => control: ReadWrite<u32>),
        (0x0C => interrupts: ReadWrite<u32>),
        (0x10 => divider: ReadWrite<u32>),
        (0x14 => @END),
    },
    /// CMSDK timer (§4.4).
    Timer {
        (0x00 => control: ReadWrite<u32>),
        (0x04 => value: ReadWrite<u32>),
        (0x08 => reload: ReadWrite<u32>),
        (0x0C => interrupt: ReadWrite<u32>),
        (0x10 => @END),
    },
    /// CMSDK watchdog (§4.6).
    Watchdog {
        (0x000 => load: ReadWrite<u32>),
        (0x004 => value: ReadOnly<u32>),
        (0x008 => control: ReadWrite<u32>),
        (0x00C => clear: WriteOnly<u32>),
        (0x010 => _rest),
        (0xC00 => lock: ReadWrite<u32>),
        (0xC04 => @END),
    },
    /// What the loader may have put there.
    Slowness {
        (0x00 => mark: ReadOnly<u32>),
        (0x04 => factor: ReadOnly<u32>),
        (0x08 => @END),
    }
}

/// A recording that the loader has put behind these words: its length, then as many bytes.
pub fn recording() -> &'static [u8] {
    // SAFETY: 16 MiB of memory that nobody writes; the length is kept within it.
    unsafe {
        let length = core::ptr::read_volatile((PSRAM + 8) as *const u32) as usize;
        core::slice::from_raw_parts((PSRAM + 12) as *const u8, length.min((16 << 20) - 12))
    }
}

/// The peripherals that are used here.
struct Registers {
    laser: &'static Uart,
    link: &'static Uart,
    timer: &'static Timer,
    watchdog: &'static Watchdog,
    slowness: &'static Slowness,
}

fn registers() -> Registers {
    // SAFETY: the addresses on this board (Arm DAI 0500B and DAI 0386B, memory map); nothing else lives there, and all accesses go
    // through volatile cells.
    unsafe {
        Registers {
            laser: &*(0x4000_4000 as *const Uart),
            link: &*(0x4000_5000 as *const Uart),
            timer: &*(0x4000_0000 as *const Timer),
            watchdog: &*(0x4000_8000 as *const Watchdog),
            slowness: &*(PSRAM as *const Slowness),
        }
    }
}

/// UART state bits.
const TX_FULL: u32 = 1;
const RX_FULL: u32 = 2;
/// UART control: both directions, both interrupts.
const UART_ON: u32 = 0b1111;

/// An interrupt by its number: receive and transmit of the two UARTs.
#[derive(Clone, Copy)]
struct Irq(u16);

// SAFETY: the numbers are those of the board's interrupts.
unsafe impl cortex_m::interrupt::InterruptNumber for Irq {
    fn number(self) -> u16 {
        self.0
    }
}

/// See the [module](self).
pub struct Board {
    /// Ticks of the clock at the last look.
    last: u32,
    ticks: u64,
    ticks_per_us: NonZeroU64,
    pub(super) vitals: Vitals,
}

impl Board {
    /// Sets everything up; to be called once.
    pub fn take() -> Self {
        let peripherals = Peripherals::take();
        let Registers { laser, link, timer, watchdog, slowness } = registers();
        timer.reload.set(u32::MAX);
        timer.value.set(u32::MAX);
        timer.control.set(1);
        for uart in [laser, link] {
            uart.divider.set(CLOCK_MHZ * 1_000_000 / 115_200);
            uart.control.set(UART_ON);
        }
        if let Some(mut peripherals) = peripherals {
            // Wakes the program for its deadlines, 200 times a second.
            start_ticks(&mut peripherals.SYST, CLOCK_MHZ * 5000);
        }
        for number in 0..4 {
            // SAFETY: their handler is below, and shares with the program only what is behind critical sections.
            unsafe { NVIC::unmask(Irq(number)) };
        }
        watchdog.lock.set(WATCHDOG_KEY);
        watchdog.load.set(WATCHDOG_TICKS);
        watchdog.control.set(0b11);
        let factor = if slowness.mark.get() == MARK { slowness.factor.get().max(1) } else { 1 };
        Self {
            last: u32::MAX,
            ticks: 0,
            ticks_per_us: NonZeroU64::new(u64::from(CLOCK_MHZ) * u64::from(factor)).unwrap_or(NonZeroU64::MIN),
            vitals: Vitals::begin(),
        }
    }

    /// The clock; to be read more often than it wraps, every 171 s.
    pub fn now(&mut self) -> Instant {
        let value = registers().timer.value.get();
        self.ticks += u64::from(self.last.wrapping_sub(value));
        self.last = value;
        Instant::from_micros((self.ticks / self.ticks_per_us) as i64)
    }

    /// What nonces are made of. QEMU's boards have no random numbers: the count of starts, which power off sets back.
    pub fn entropy(&mut self) -> [u8; 16] {
        u128::from(self.epoch()).to_le_bytes()
    }

    /// The program is alive.
    pub fn feed_watchdog(&mut self) {
        registers().watchdog.clear.set(1);
    }
}

impl Ports for Board {
    fn send_to_laser(&mut self, bytes: &[u8]) {
        LASER.write(bytes);
        transmit(registers().laser, &LASER);
    }

    fn set_laser_baud(&mut self, baud: u32) {
        while LASER.room() < 64 {
            transmit(registers().laser, &LASER);
        }
        registers().laser.divider.set((CLOCK_MHZ * 1_000_000 / baud.max(1)).max(16));
    }

    fn link_room(&self) -> usize {
        LINK.room()
    }

    fn send_to_host(&mut self, frame: &[u8]) {
        LINK.write(frame);
        transmit(registers().link, &LINK);
    }

    fn restart(&mut self) {
        SCB::sys_reset()
    }

    fn health(&self) -> Health {
        self.vitals.health()
    }
}

fn transmit<const RX: usize, const TX: usize>(uart: &Uart, port: &Port<RX, TX>) {
    // Looking and writing must not be parted by the interrupt, or bytes would change places.
    critical_section::with(|_| {
        while let Some(byte) = port.send_next(|| uart.state.get() & TX_FULL == 0) {
            uart.data.set(u32::from(byte));
        }
    });
}

fn serve<const RX: usize, const TX: usize>(uart: &Uart, port: &Port<RX, TX>) {
    uart.interrupts.set(uart.interrupts.get());
    while uart.state.get() & RX_FULL != 0 {
        port.push_received(uart.data.get() as u8);
    }
    transmit(uart, port);
}

// SAFETY: reached for UARTs only, whose registers it may use.
#[exception]
unsafe fn DefaultHandler(number: i16) {
    match number {
        0 | 1 => serve(registers().laser, &LASER),
        2 | 3 => serve(registers().link, &LINK),
        _ => {}
    }
}

#[exception]
fn SysTick() {}
