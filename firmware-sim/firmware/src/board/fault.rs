//! What is remembered across a reset: how often the board has started, and where it failed.
#![allow(unsafe_code)]

use core::sync::atomic::{AtomicU32, Ordering};

use cortex_m::peripheral::SCB;
use cortex_m_rt::{ExceptionFrame, exception};

/// A fault word that means something; memory is random after power on.
const MARK: u32 = 0x0FA1_7ED5;

// SAFETY: plain words without a destructor, in memory that the start-up code leaves alone; any content is a valid value.
#[unsafe(link_section = ".uninit.STARTS")]
static STARTS: AtomicU32 = AtomicU32::new(0);
// SAFETY: as above.
#[unsafe(link_section = ".uninit.FAULT_MARK")]
static FAULT_MARK: AtomicU32 = AtomicU32::new(0);
// SAFETY: as above.
#[unsafe(link_section = ".uninit.FAULT_AT")]
static FAULT_AT: AtomicU32 = AtomicU32::new(0);

/// Another number after every start.
pub fn count_start() -> u32 {
    let starts = STARTS.load(Ordering::Relaxed).wrapping_add(1);
    STARTS.store(starts, Ordering::Relaxed);
    starts
}

/// Program counter of the fault before this start; 0 for none.
pub fn last() -> u32 {
    let is_known = FAULT_MARK.swap(0, Ordering::Relaxed) == MARK;
    if is_known { FAULT_AT.load(Ordering::Relaxed) } else { 0 }
}

fn start_anew(at: u32) -> ! {
    FAULT_AT.store(at, Ordering::Relaxed);
    FAULT_MARK.store(MARK, Ordering::Relaxed);
    SCB::sys_reset()
}

// SAFETY: reads the frame that the processor has stacked, and resets.
#[exception]
unsafe fn HardFault(frame: &ExceptionFrame) -> ! {
    start_anew(frame.pc())
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    start_anew(u32::MAX)
}
