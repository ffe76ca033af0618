//! Maps a recording from memory, and says for each scan what its stages took: for `figures` beside `build`, which runs it in QEMU with
//! `-icount`, where time is the number of instructions.
#![no_std]
#![no_main]
#![forbid(unsafe_code)]

use core::fmt::Write as _;

use lrfslam_core::geometry::Pose2;
use lrfslam_core::scan::{Beam, Echo, RangeScan};
use lrfslam_core::time::{Duration, Instant};
use lrfslam_firmware::Pools;
use lrfslam_firmware::board::{Board, recording, stack};
use lrfslam_robot::{Mapping, Pools as _, Ports as _, RobotConfig};
use static_cell::ConstStaticCell;

static POOLS: ConstStaticCell<Pools> = ConstStaticCell::new(Pools::EMPTY);

/// The end of the recording, or what is no recording.
struct End;

/// Takes a value off the front of the recording.
fn take<'r, T: serde::Deserialize<'r>>(bytes: &mut &'r [u8]) -> Result<T, End> {
    let (value, rest) = postcard::take_from_bytes(bytes).map_err(|_| End)?;
    *bytes = rest;
    Ok(value)
}

/// Sends text to the host, and waits until there is room for more.
fn say(board: &mut Board, text: &str) {
    while board.link().room() < text.len() {
        board.sleep();
    }
    board.send_to_host(text.as_bytes());
}

fn map(board: &mut Board, mut bytes: &[u8]) -> Result<u32, End> {
    let config: RobotConfig = take(&mut bytes)?;
    let memory = POOLS.take().lend();
    let beams = memory.beams;
    let mut mapping = Mapping::new(&config, memory.mapping).map_err(|_| End)?;
    let mut scans = 0;
    while let Ok((stamp, range_max_m, count)) = take::<(Instant, f32, u16)>(&mut bytes) {
        let beams = beams.get_mut(..usize::from(count)).ok_or(End)?;
        for beam in beams.iter_mut() {
            let (bearing_rad, offset, echo) = take::<(f32, Duration, Echo)>(&mut bytes)?;
            *beam = Beam { bearing_rad, offset, echo };
        }
        let scan = RangeScan { stamp, range_max_m, beams };
        let (mut weigh_begun, mut weighed) = (None, None);
        let begun = board.now();
        let mapped = mapping.add_scan_with(&scan, |weighing, samples, window| {
            weigh_begun = Some(board.now());
            weighing.weigh_all(samples, window);
            weighed = Some(board.now());
        });
        let done = board.now();
        let report = mapped.map_err(|_| End)?.report;
        let Pose2 { x, y, heading } = report.map_from_robot;
        let matching = weigh_begun.unwrap_or(done).since(begun).micros;
        let weighing = weighed.zip(weigh_begun).map_or(0, |(end, begin)| end.since(begin).micros);
        let printing = weighed.map_or(0, |end| done.since(end).micros);
        let is_step = u8::from(report.filter.is_some());
        let mut text = heapless::String::<160>::new();
        let [x, y, heading] = [x, y, heading].map(f32::to_bits);
        let _ = writeln!(text, "scan {is_step} {matching} {weighing} {printing} {x:08x} {y:08x} {heading:08x}");
        say(board, &text);
        board.feed_watchdog();
        scans += 1;
    }
    Ok(scans)
}

#[cortex_m_rt::entry]
fn main() -> ! {
    let mut board = Board::take();
    let scans = map(&mut board, recording()).unwrap_or(0);
    let mut text = heapless::String::<160>::new();
    let _ = writeln!(text, "done {scans} {}", stack::used());
    say(&mut board, &text);
    loop {
        board.sleep();
    }
}
