//! SICK: any bytes, cut anywhere, through decoder, reply and scan, both directions.
#![no_main]

use libfuzzer_sys::fuzz_target;
use lrfslam_core::scan::{Beam, Echo};
use lrfslam_core::time::Duration;
use lrfslam_lrf::sick_lms::measurement::ValueFormat;
use lrfslam_lrf::sick_lms::request::Variant;
use lrfslam_lrf::sick_lms::scan::ScanLayout;
use lrfslam_lrf::sick_lms::telegram::{self, Direction, MAX_TELEGRAM};
use lrfslam_lrf::sick_lms::{DecoderEvent, Reply, ReplyBody, Request, TelegramDecoder};

/// All events of `bytes`, in pieces of `piece`; ACK and NAK as one byte.
fn events(direction: Direction, bytes: &[u8], piece: usize) -> Vec<Vec<u8>> {
    let mut memory = [0; MAX_TELEGRAM];
    let mut decoder = TelegramDecoder::new(direction, &mut memory);
    let mut found = Vec::new();
    for mut rest in bytes.chunks(piece) {
        loop {
            let (taken, event) = decoder.feed(rest);
            rest = &rest[taken..];
            match event {
                Some(DecoderEvent::Telegram(payload)) => found.push(payload.to_vec()),
                Some(DecoderEvent::Ack) => found.push(vec![telegram::ACK]),
                Some(DecoderEvent::Nak) => found.push(vec![telegram::NAK]),
                None if rest.is_empty() => break,
                None => assert!(taken > 0, "no progress"),
            }
        }
    }
    found
}

fn read(payload: &[u8]) {
    let _ = Request::parse(payload);
    let Some(reply) = Reply::parse(payload) else { return };
    let ReplyBody::Scan(measurement) = reply.body else { return };
    let mut beams = [Beam { bearing_rad: 0.0, offset: Duration::ZERO, echo: Echo::Invalid }; 401];
    for values in [101, 181, 201, 361, 401] {
        let (Some(variant), Some(format)) = (Variant::with_values(values), ValueFormat::of_mode(payload[0])) else {
            continue;
        };
        if let Ok(shape) = (ScanLayout { variant, format }).read(&measurement, &mut beams) {
            assert!(beams[..shape.beams].iter().all(|beam| beam.bearing_rad.abs() < 1.6));
        }
    }
}

/// Makes telegrams out of the input, so that what is behind the check sum is reached: a length byte, then so much payload.
fn wrap(direction: Direction, bytes: &[u8]) -> Vec<u8> {
    let (mut wrapped, mut rest) = (Vec::new(), bytes);
    while let Some((length, after)) = rest.split_first() {
        let (payload, after) = after.split_at((usize::from(*length) * 4).min(after.len()));
        let mut out = [0; MAX_TELEGRAM];
        if !payload.is_empty() {
            if let Ok(length) = telegram::emit(direction, payload, &mut out) {
                wrapped.extend(&out[..length]);
            }
        }
        rest = after;
    }
    wrapped
}

fuzz_target!(|input: &[u8]| {
    let Some((how, bytes)) = input.split_first() else { return };
    let direction = if how & 1 == 0 { Direction::ToHost } else { Direction::ToSensor };
    let bytes = if how & 2 == 0 { bytes.to_vec() } else { wrap(direction, bytes) };
    let found = events(direction, &bytes, usize::from(how >> 2) + 1);
    assert_eq!(found, events(direction, &bytes, bytes.len().max(1)), "the cut matters");
    found.iter().for_each(|payload| read(payload));
});
