//! The robot's program on a microcontroller: laser on one UART, host on another. All of its sense is in `lrfslam_robot::Robot`; here
//! bytes and the time are brought to it.
#![no_std]
#![no_main]
#![forbid(unsafe_code)]

use cortex_m::peripheral::SCB;
use lrfslam_core::time::Instant;
use lrfslam_firmware::Pools;
use lrfslam_firmware::board::{self, Board};
use lrfslam_robot::wire::key::Key;
use lrfslam_robot::wire::lock::Lock;
use lrfslam_robot::{Input, Pools as _, Robot};
use static_cell::ConstStaticCell;

static POOLS: ConstStaticCell<Pools> = ConstStaticCell::new(Pools::EMPTY);

/// Bytes handled at once.
const CHUNK: usize = 256;

/// The host's key, if LRFSLAM_KEY had one when this was built.
const KEY: Option<Key> = match option_env!("LRFSLAM_KEY") {
    None => None,
    Some(digits) if digits.is_empty() => None,
    Some(digits) => match Key::from_hex(digits) {
        None => panic!("LRFSLAM_KEY: 64 hexadecimal digits, as `lrfslam key` makes them"),
        key => key,
    },
};

#[cortex_m_rt::entry]
fn main() -> ! {
    let mut board = Board::take();
    let lock = KEY.map(|key| Lock::of_robot(key, board.entropy()));
    // They are free: this is called once.
    let Some(pools) = POOLS.try_take() else { SCB::sys_reset() };
    let mut robot = Robot::new(board::NAME, board.epoch(), pools.lend()).with_lock(lock);
    let mut give = |board: &mut Board, input: Input<'_>| {
        let started = board.now();
        let deadline = robot.handle(started, input, board);
        board.took(started);
        deadline
    };
    give(&mut board, Input::LaserConnected);
    let mut deadline = give(&mut board, Input::LinkConnected);
    let mut chunk = [0; CHUNK];
    loop {
        board.feed_watchdog();
        deadline = match next_input(&mut board, deadline, &mut chunk) {
            Some(input) => give(&mut board, input),
            None => {
                board.sleep();
                deadline
            }
        };
    }
}

/// The laser first: its bytes carry the time.
fn next_input<'c>(board: &mut Board, deadline: Instant, chunk: &'c mut [u8]) -> Option<Input<'c>> {
    let count = board.laser().read(chunk);
    if count > 0 {
        return chunk.get(..count).map(Input::LaserBytes);
    }
    let count = board.link().read(chunk);
    if count > 0 {
        return chunk.get(..count).map(Input::LinkBytes);
    }
    (board.link_has_room() || board.now() >= deadline).then_some(Input::Timeout)
}
