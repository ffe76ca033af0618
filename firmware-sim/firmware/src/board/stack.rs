//! How deep the stack has been: it was painted before the program began.
#![allow(unsafe_code)]

use core::ptr;

/// What cortex-m-rt's `paint-stack` writes.
const PAINT: u32 = 0xCCCC_CCCC;

unsafe extern "C" {
    static _stack_start: u32;
    static _stack_end: u32;
}

/// Deepest use so far, bytes.
pub fn used() -> u32 {
    let (top, bottom) = (&raw const _stack_start, &raw const _stack_end);
    let mut at = bottom;
    // SAFETY: both symbols are the linker's ends of the stack's memory, and are compared before each read.
    while at < top && unsafe { ptr::read_volatile(at) } == PAINT {
        at = at.wrapping_add(1);
    }
    top.addr().wrapping_sub(at.addr()) as u32
}
