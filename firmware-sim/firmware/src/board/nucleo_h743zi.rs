//! ST NUCLEO-H743ZI (also ZI2): STM32H743, Cortex-M7 at 480 MHz, 2 MiB of flash, 512 KiB of AXI SRAM for the pools.
//!
//! USART 2 (PD5 transmits, PD6 receives; D53 and D52 of the Zio connector): laser. USART 3 (PD8, PD9), which the board's own debugger shows as a
//! serial port on USB: host, 921600 bit/s. TIM 2: clock of 1 MHz. Compiles; not yet run on the board.
#![allow(unsafe_code)]

use cortex_m::peripheral::{NVIC, SCB};
use cortex_m_rt::exception;
use lrfslam_core::time::Instant;
use lrfslam_robot::Ports;
use lrfslam_robot::wire::message::Health;
use stm32h7xx_hal::independent_watchdog::IndependentWatchdog;
use stm32h7xx_hal::pac::{self, interrupt};
use stm32h7xx_hal::prelude::*;
use stm32h7xx_hal::rcc::PllConfigStrategy;
use stm32h7xx_hal::rng::Rng;

use super::{LASER, LINK, Vitals, start_ticks};
use crate::port::Port;

pub const NAME: &str = "nucleo-h743zi";

/// Rate of the host's line, bit/s.
const LINK_BAUD: u32 = 921_600;
/// Longer than any scan takes.
const WATCHDOG_MS: u32 = 5000;

type Usart = pac::usart1::RegisterBlock;

fn laser_uart() -> &'static Usart {
    // SAFETY: the peripheral is set up once, in `take`; afterwards its registers are used behind critical sections.
    unsafe { &*pac::USART2::ptr() }
}

fn link_uart() -> &'static Usart {
    // SAFETY: as above.
    unsafe { &*pac::USART3::ptr() }
}

/// See the [module](self).
pub struct Board {
    timer: pac::TIM2,
    random: Rng,
    watchdog: IndependentWatchdog,
    uart_clock_hz: u32,
    /// Clock at the last look, and its wraps.
    last: u32,
    wraps: i64,
    pub(super) vitals: Vitals,
}

impl Board {
    /// Sets everything up; to be called once.
    ///
    /// # Panics
    /// If it is called again: there is one of each peripheral.
    pub fn take() -> Self {
        let mut core = cortex_m::Peripherals::take().expect("taken once");
        let device = pac::Peripherals::take().expect("taken once");
        let power = device.PWR.constrain().vos0(&device.SYSCFG).freeze();
        // The debugger gives its 8 MHz to the processor. 480 MHz are beyond the PLL's usual range of 420.
        let clocks = device.RCC.constrain().use_hse(8.MHz()).bypass_hse();
        let clocks = clocks.pll1_strategy(PllConfigStrategy::Iterative).sys_ck(480.MHz()).pclk1(120.MHz());
        let clocks = clocks.freeze(power, &device.SYSCFG);
        core.SCB.enable_icache();
        core.SCB.enable_dcache(&mut core.CPUID);

        let pins = device.GPIOD.split(clocks.peripheral.GPIOD);
        let laser = (pins.pd5.into_alternate(), pins.pd6.into_alternate());
        let link = (pins.pd8.into_alternate(), pins.pd9.into_alternate());
        let usart = device.USART2.serial(laser, 115_200.bps(), clocks.peripheral.USART2, &clocks.clocks);
        usart.expect("a rate that the clock can make").listen(stm32h7xx_hal::serial::Event::Rxne);
        let usart = device.USART3.serial(link, LINK_BAUD.bps(), clocks.peripheral.USART3, &clocks.clocks);
        usart.expect("a rate that the clock can make").listen(stm32h7xx_hal::serial::Event::Rxne);

        let random = device.RNG.constrain(clocks.peripheral.RNG, &clocks.clocks);
        let timer = device.TIM2.tick_timer(1.MHz(), clocks.peripheral.TIM2, &clocks.clocks).free().0;

        start_ticks(&mut core.SYST, 480_000);
        // SAFETY: their handlers are below, and share with the program only what is behind critical sections.
        unsafe {
            NVIC::unmask(pac::Interrupt::USART2);
            NVIC::unmask(pac::Interrupt::USART3);
        }
        let mut watchdog = IndependentWatchdog::new(device.IWDG);
        watchdog.start(WATCHDOG_MS.millis());
        let uart_clock_hz = clocks.clocks.pclk1().raw();
        Self { timer, random, watchdog, uart_clock_hz, last: 0, wraps: 0, vitals: Vitals::begin() }
    }

    /// The clock; to be read more often than it wraps, every 71 minutes.
    pub fn now(&mut self) -> Instant {
        let count = self.timer.cnt.read().bits();
        self.wraps += i64::from(count < self.last);
        self.last = count;
        Instant::from_micros((self.wraps << 32) + i64::from(count))
    }

    /// What nonces are made of: random numbers of the board.
    ///
    /// # Panics
    /// If its generator fails: then the board starts anew.
    pub fn entropy(&mut self) -> [u8; 16] {
        let mut bytes = [0; 16];
        self.random.fill(&mut bytes).expect("random numbers");
        bytes
    }

    /// The program is alive.
    pub fn feed_watchdog(&mut self) {
        self.watchdog.feed();
    }
}

impl Ports for Board {
    fn send_to_laser(&mut self, bytes: &[u8]) {
        LASER.write(bytes);
        laser_uart().cr1.modify(|_, w| w.txeie().set_bit());
    }

    fn set_laser_baud(&mut self, baud: u32) {
        let uart = laser_uart();
        // At most 64 bytes at the slowest rate: 70 ms.
        while LASER.room() < 64 || uart.isr.read().tc().bit_is_clear() {}
        critical_section::with(|_| {
            uart.cr1.modify(|_, w| w.ue().clear_bit());
            // SAFETY: any divider from 16 on is valid.
            uart.brr.write(|w| unsafe { w.bits((self.uart_clock_hz / baud.max(1)).clamp(16, 0xFFFF)) });
            uart.cr1.modify(|_, w| w.ue().set_bit());
        });
    }

    fn link_room(&self) -> usize {
        LINK.room()
    }

    fn send_to_host(&mut self, frame: &[u8]) {
        LINK.write(frame);
        link_uart().cr1.modify(|_, w| w.txeie().set_bit());
    }

    fn restart(&mut self) {
        SCB::sys_reset()
    }

    fn health(&self) -> Health {
        self.vitals.health()
    }
}

fn serve<const RX: usize, const TX: usize>(uart: &Usart, port: &Port<RX, TX>) {
    let state = uart.isr.read();
    if state.ore().bit_is_set() {
        uart.icr.write(|w| w.orecf().set_bit());
    }
    if state.rxne().bit_is_set() {
        port.push_received(uart.rdr.read().rdr().bits() as u8);
    }
    if state.txe().bit_is_set() && uart.cr1.read().txeie().bit_is_set() {
        match port.send_next(|| true) {
            Some(byte) => uart.tdr.write(|w| w.tdr().bits(u16::from(byte))),
            None => uart.cr1.modify(|_, w| w.txeie().clear_bit()),
        }
    }
}

#[interrupt]
fn USART2() {
    serve(laser_uart(), &LASER);
}

#[interrupt]
fn USART3() {
    serve(link_uart(), &LINK);
}

#[exception]
fn SysTick() {}
