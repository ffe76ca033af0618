//! Bytes between an interrupt handler and the program.

use core::cell::RefCell;

use critical_section::Mutex;
use heapless::Deque;

/// Both directions of one UART.
pub struct Port<const RX: usize, const TX: usize> {
    queues: Mutex<RefCell<Queues<RX, TX>>>,
}

struct Queues<const RX: usize, const TX: usize> {
    received: Deque<u8, RX>,
    to_send: Deque<u8, TX>,
    overrun: u32,
}

impl<const RX: usize, const TX: usize> Port<RX, TX> {
    /// Nothing received, nothing to send; all zero.
    pub const fn new() -> Self {
        let queues = Queues { received: Deque::new(), to_send: Deque::new(), overrun: 0 };
        Self { queues: Mutex::new(RefCell::new(queues)) }
    }

    /// Nobody else has the queues within a critical section; if somebody had, nothing would be done.
    fn with<T: Default>(&self, act: impl FnOnce(&mut Queues<RX, TX>) -> T) -> T {
        critical_section::with(|cs| {
            let mut queues = self.queues.borrow(cs).try_borrow_mut();
            queues.as_mut().map_or_else(|_| T::default(), |queues| act(queues))
        })
    }

    /// A byte came: for the interrupt handler. One that finds no room is counted and lost.
    pub fn push_received(&self, byte: u8) {
        self.with(|queues| {
            if queues.received.push_back(byte).is_err() {
                queues.overrun = queues.overrun.saturating_add(1);
            }
        });
    }

    /// The next byte to send, taken only if `is_ready` says that the UART takes it: for the interrupt handler.
    pub fn send_next(&self, is_ready: impl FnOnce() -> bool) -> Option<u8> {
        self.with(|queues| if is_ready() { queues.to_send.pop_front() } else { None })
    }

    /// Takes what was received, as much as fits; returns how much.
    pub fn read(&self, memory: &mut [u8]) -> usize {
        self.with(|queues| {
            let mut count = 0;
            for place in memory {
                let Some(byte) = queues.received.pop_front() else { break };
                *place = byte;
                count += 1;
            }
            count
        })
    }

    /// Queues bytes to be sent; what finds no room is lost: look at [`room`](Self::room) before.
    pub fn write(&self, bytes: &[u8]) {
        self.with(|queues| {
            for byte in bytes {
                let _ = queues.to_send.push_back(*byte);
            }
        });
    }

    /// Bytes that [`write`](Self::write) takes now.
    pub fn room(&self) -> usize {
        self.with(|queues| TX - queues.to_send.len())
    }

    /// True if there is nothing to read.
    pub fn is_quiet(&self) -> bool {
        self.with(|queues| queues.received.is_empty())
    }

    /// Bytes lost because nobody read.
    pub fn overrun(&self) -> u32 {
        self.with(|queues| queues.overrun)
    }
}
