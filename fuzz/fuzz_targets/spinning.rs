//! RPLIDAR and LDROBOT: any bytes, cut anywhere, through decoders and drivers.
#![no_main]

use libfuzzer_sys::fuzz_target;
use lrfslam_core::scan::{Beam, Echo};
use lrfslam_core::time::{Duration, Instant};
use lrfslam_lrf::driver::{Event, Input, LrfDriver, Output};
use lrfslam_lrf::ldrobot::{LdrobotDriver, PacketDecoder};
use lrfslam_lrf::rplidar::response::{Descriptor, ResponseKind};
use lrfslam_lrf::rplidar::{Capsule, RplidarConfig, RplidarDecoder, RplidarDriver};

fn ldrobot_packets(bytes: &[u8], piece: usize) -> usize {
    let mut decoder = PacketDecoder::default();
    let mut packets = 0;
    for mut rest in bytes.chunks(piece) {
        while !rest.is_empty() {
            let (taken, packet) = decoder.feed(rest);
            assert!(taken > 0, "no progress");
            packets += usize::from(packet.is_some());
            rest = &rest[taken..];
        }
    }
    packets
}

fn rplidar_events(bytes: &[u8], piece: usize) -> usize {
    let mut decoder = RplidarDecoder::default();
    let mut events = 0;
    for mut rest in bytes.chunks(piece) {
        loop {
            let (taken, event) = decoder.feed(rest);
            let quiet = event.is_none();
            events += usize::from(!quiet);
            rest = &rest[taken..];
            if quiet && rest.is_empty() {
                break;
            }
        }
    }
    events
}

/// Answers and packets with right sums, at angles of the input's choice.
fn help(step: u8) -> Vec<u8> {
    let kinds = [
        ResponseKind::Info,
        ResponseKind::Health,
        ResponseKind::Capsule,
        ResponseKind::DenseCapsule,
        ResponseKind::Sample,
    ];
    match step {
        0..=4 => {
            let kind = kinds[usize::from(step)];
            let mut bytes = Descriptor { kind }.emit().to_vec();
            bytes.resize(7 + if kind.repeats() { 0 } else { kind.length() }, 0);
            bytes
        }
        _ => {
            Capsule::build(step & 1 == 0, step == 5, f32::from(step) * 1.4, &[u16::from(step) * 9; 40]).bytes().to_vec()
        }
    }
}

fn run(driver: &mut dyn LrfDriver, input: &[u8]) {
    let mut now = Instant::default();
    let mut deadline = now;
    let mut give = |driver: &mut dyn LrfDriver, now: Instant, input: Input<'_>| {
        let taken = driver.handle_input(now, input);
        for _ in 0..64 {
            match driver.poll_output() {
                Output::Timeout(at) => {
                    deadline = at.max(now);
                    return (taken, deadline);
                }
                Output::Event(Event::Scan(scan)) => assert!(scan.beams.iter().all(|beam| beam.bearing_rad.abs() < 3.2)),
                _ => {}
            }
        }
        panic!("outputs without end");
    };
    let (_, mut due) = give(driver, now, Input::Connected);
    for chunk in input.chunks(9) {
        let Some((step, raw)) = chunk.split_first() else { continue };
        let helped = help(*step);
        let mut bytes = if raw.first().is_some_and(|byte| byte & 1 == 0) { &helped[..] } else { raw };
        while !bytes.is_empty() {
            let (taken, at) = give(driver, now, Input::Bytes(bytes));
            due = at;
            bytes = &bytes[taken..];
        }
        now = now + Duration::from_millis(i64::from(*step % 16));
        if step & 0x40 != 0 {
            now = now.max(due.min(now + Duration::from_millis(60_000)));
            (_, due) = give(driver, now, Input::Timeout);
        }
    }
}

fuzz_target!(|input: &[u8]| {
    let Some((how, bytes)) = input.split_first() else { return };
    let piece = usize::from(how >> 2) + 1;
    assert_eq!(ldrobot_packets(bytes, piece), ldrobot_packets(bytes, bytes.len().max(1)), "the cut matters");
    assert_eq!(rplidar_events(bytes, piece), rplidar_events(bytes, bytes.len().max(1)), "the cut matters");
    let mut beams = vec![Beam { bearing_rad: 0.0, offset: Duration::ZERO, echo: Echo::Invalid }; 500];
    if how & 1 == 0 {
        run(&mut RplidarDriver::new(RplidarConfig::default(), &mut beams), bytes);
    } else {
        run(&mut LdrobotDriver::new(Duration::ZERO, &mut beams), bytes);
    }
});
