//! Bytes recorded from real devices, byte for byte, however they are cut.

use lrfslam_core::scan::{Beam, Echo};
use lrfslam_core::time::{Duration, Instant};
use lrfslam_firmware_sim::scenario::Scenario;
use lrfslam_firmware_sim::virtual_lrf::VirtualLrf;
use lrfslam_firmware_sim::virtual_lrf::hokuyo::{HokuyoModel, VirtualHokuyo};
use lrfslam_lrf::hokuyo_scip::scan::read_scan;
use lrfslam_lrf::hokuyo_scip::{Acquire, Command, Reply, ScipDecoder, SensorParameters, Status};
use lrfslam_lrf::sick_lms::measurement::{Part, ValueFormat};
use lrfslam_lrf::sick_lms::reply::DeviceStatus;
use lrfslam_lrf::sick_lms::scan::ScanLayout;
use lrfslam_lrf::sick_lms::telegram::{Direction, MAX_TELEGRAM};
use lrfslam_lrf::sick_lms::{self, DecoderEvent, ReplyBody, TelegramDecoder, Unit, Variant};
use lrfslam_tests::data;

/// Records of u32 seconds, u32 microseconds, u32 n, n bytes, big endian: all their bytes.
fn logged_bytes(file: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut rest = file;
    while let Some((head, after)) = rest.split_first_chunk::<12>() {
        let length = u32::from_be_bytes([head[8], head[9], head[10], head[11]]) as usize;
        bytes.extend(&after[..length]);
        rest = &after[length..];
    }
    bytes
}

fn frames(bytes: &[u8], piece: usize) -> Vec<Vec<u8>> {
    let mut memory = [0; 7168];
    let mut decoder = ScipDecoder::new(&mut memory);
    let mut frames = Vec::new();
    for piece in bytes.chunks(piece) {
        let mut rest = piece;
        while !rest.is_empty() {
            let (taken, frame) = decoder.feed(rest);
            frames.extend(frame.map(<[u8]>::to_vec));
            rest = &rest[taken..];
        }
    }
    frames
}

/// The session of a recorded sensor: its commands parse, their replies come in order, every sum is right.
fn session(name: &str) -> Option<Vec<Vec<u8>>> {
    let (read, written) = (data::file(&format!("serial/{name}.logr"))?, data::file(&format!("serial/{name}.logw"))?);
    let (read, written) = (logged_bytes(&read), logged_bytes(&written));
    let frames_read = frames(&read, read.len());
    assert_eq!(frames(&read, 1), frames_read, "one byte at a time");
    assert_eq!(frames(&read, 13), frames_read);
    let garbled = [b"\x00\xFF99b\n31\n\n\n".as_slice(), &read].concat();
    assert_eq!(frames(&garbled, 7)[1..], frames_read, "garbage first");
    for (line, frame) in written.split(|byte| *byte == b'\n').filter(|line| !line.is_empty()).zip(&frames_read) {
        assert_eq!(Command::parse(line).unwrap().emit(), line);
        let reply = Reply::parse(frame).unwrap();
        assert_eq!(reply.echo, line);
        let letters = &line[..2];
        if [b"VV", b"PP", b"II"].iter().any(|info| letters == *info) {
            assert!(reply.info().count() >= 5 && reply.info().all(|line| line.sum_is_right));
        }
    }
    Some(frames_read)
}

fn parameters(frames: &[Vec<u8>]) -> SensorParameters {
    let frame = frames.iter().find(|frame| frame.starts_with(b"PP")).unwrap();
    SensorParameters::parse(&Reply::parse(frame).unwrap()).unwrap()
}

#[test]
fn recorded_urg_session_replays_with_682_points() {
    let Some(frames) = session("example_urg_04lx") else { return };
    assert_eq!(frames.len(), 10);
    let sensor = parameters(&frames);
    let reply = Reply::parse(&frames[9]).unwrap();
    let acquire = Acquire { first: 44, last: 725, ..sensor.full_view() };
    let values: Vec<u32> = reply.values(&acquire).unwrap().map(|value| value.range).collect();
    assert_eq!(
        values[..21],
        [392, 392, 391, 385, 381, 381, 376, 371, 371, 371, 368, 365, 362, 359, 359, 357, 355, 351, 355, 352, 352]
    );
    let (least, most) = (values.iter().min().unwrap(), values.iter().max().unwrap());
    assert_eq!((values.len(), *least, *most), (682, 0, 4166));
    assert_eq!([0, 7, 10].map(|code| values.iter().filter(|value| **value == code).count()), [94, 6, 1]);
    let mut beams = [Beam::BLANK; 700];
    let header = read_scan(&reply, &sensor, &acquire, &mut beams).unwrap();
    assert_eq!((header.stamp_ms, header.beams), (6_968_830, 682));
    assert_eq!(beams[..682].iter().filter(|beam| beam.echo == Echo::Invalid).count(), 101);
    assert_eq!(beams[0].echo, Echo::Hit(0.392));
    // The hexadecimal TIME just before is of the same clock.
    let info = Reply::parse(&frames[8]).unwrap();
    let time = info.info().find(|line| line.key == "TIME").unwrap().value;
    assert_eq!(u32::from_str_radix(time, 16).unwrap(), 0x6A55F8);
    assert_eq!(0x6A55FE, header.stamp_ms);
}

#[test]
fn recorded_utm_session_replays_with_1081_pairs() {
    let Some(frames) = session("example_utm_30lx") else { return };
    let sensor = parameters(&frames);
    let started = Reply::parse(&frames[9]).unwrap();
    assert_eq!((started.echo, started.status), (&b"ME0000108001101"[..], Status::OK));
    let Ok(Command::Stream { acquire, interval: 1, count: 1 }) = Command::parse(started.echo) else {
        panic!("not the command for one scan");
    };
    let reply = Reply::parse(&frames[10]).unwrap();
    assert_eq!((reply.echo, reply.status), (&b"ME0000108001100"[..], Status::SCAN));
    let pairs: Vec<(u32, u32)> = reply.values(&acquire).unwrap().map(|value| (value.range, value.intensity)).collect();
    assert_eq!((pairs.len(), &pairs[..4]), (1081, &[(45, 1809), (48, 1780), (49, 1792), (50, 1746)][..]));
    let mut beams = [Beam::BLANK; 1081];
    assert_eq!(read_scan(&reply, &sensor, &acquire, &mut beams).unwrap().stamp_ms, 4_821_609);
    assert_eq!(frames[10].len() + 2, 6717);
}

#[test]
fn every_flipped_bit_of_the_recorded_urg_scan_is_seen() {
    let Some(frames) = session("example_urg_04lx") else { return };
    let sensor = parameters(&frames);
    let acquire = Acquire { first: 44, last: 725, ..sensor.full_view() };
    let mut beams = [Beam::BLANK; 700];
    let mut frame = frames[9].clone();
    for at in 0..frame.len() {
        for bit in 0..8 {
            frame[at] ^= 1 << bit;
            let passes = Reply::find(&frame, b"GD0044072501", 12)
                .ok()
                .filter(|reply| reply.status == Status::OK)
                .is_some_and(|reply| read_scan(&reply, &sensor, &acquire, &mut beams).is_ok());
            assert!(!passes, "byte {at}, bit {bit}");
            frame[at] ^= 1 << bit;
        }
    }
}

fn recorded_sick() -> Option<Vec<u8>> {
    let text = data::file("serial/lms361_mobotware.hex")?;
    let text = String::from_utf8(text).unwrap();
    Some(text.split_whitespace().map(|byte| u8::from_str_radix(byte, 16).unwrap()).collect())
}

fn sick_payloads(bytes: &[u8], piece: usize) -> Vec<Vec<u8>> {
    let mut memory = [0; MAX_TELEGRAM];
    let mut decoder = TelegramDecoder::new(Direction::ToHost, &mut memory);
    let mut payloads = Vec::new();
    for piece in bytes.chunks(piece) {
        let mut rest = piece;
        loop {
            let (taken, event) = decoder.feed(rest);
            rest = &rest[taken..];
            match event {
                Some(DecoderEvent::Telegram(payload)) => payloads.push(payload.to_vec()),
                Some(_) => {}
                None if rest.is_empty() => break,
                None => {}
            }
        }
    }
    payloads
}

#[test]
fn recorded_sick_telegram_has_361_values() {
    let Some(bytes) = recorded_sick() else { return };
    assert_eq!((bytes.len(), &bytes[730..]), (732, &[0x64, 0x47][..]));
    let payloads = sick_payloads(&bytes, bytes.len());
    assert_eq!((payloads.len(), &sick_payloads(&bytes, 1)), (1, &payloads));
    let garbled = [&[0x02, 0x80, 0xD6, 0x02, 0xB0, 0x06][..], &bytes, &bytes].concat();
    assert_eq!(sick_payloads(&garbled, 11).last(), payloads.last(), "garbage first");
    let reply = sick_lms::Reply::parse(&payloads[0]).unwrap();
    assert_eq!(reply.status, DeviceStatus::OK);
    let ReplyBody::Scan(scan) = reply.body else { panic!("no scan") };
    let values: Vec<u16> = scan.raw_values().collect();
    assert_eq!((scan.part, scan.unit, values.len()), (Part::All, Unit::Millimetre, 361));
    assert_eq!(
        (&values[..5], values[180], *values.iter().max().unwrap()),
        (&[2251, 2251, 2242, 2242, 2243][..], 3289, 9007)
    );
    // 9007 mm: the sensor was set to a measuring mode with more than 13 bits of range.
    let layout = ScanLayout { variant: Variant::DEG_180_BY_HALF, format: ValueFormat::of_mode(3).unwrap() };
    let mut beams = [Beam::BLANK; 401];
    let shape = layout.read(&scan, &mut beams).unwrap();
    assert_eq!((shape.beams, beams[180].echo), (361, Echo::Hit(3.289)));
    assert!(beams[180].bearing_rad.abs() < 1e-6);
}

#[test]
fn every_flipped_bit_of_the_recorded_sick_telegram_is_seen() {
    let Some(mut bytes) = recorded_sick() else { return };
    for at in 0..bytes.len() {
        for bit in 0..8 {
            bytes[at] ^= 1 << bit;
            assert!(sick_payloads(&bytes, bytes.len()).is_empty(), "byte {at}, bit {bit}");
            bytes[at] ^= 1 << bit;
        }
    }
}

/// The lines of a reply that do not depend on which sensor it is, nor on what it sees or when.
fn of_the_model(reply: &[u8]) -> Vec<String> {
    let text = String::from_utf8_lossy(reply).into_owned();
    let is_scan = text.starts_with("GD") || text.starts_with("ME");
    let own = |line: &&str| !line.starts_with("SERI:") && !line.starts_with("TIME:");
    let lines = text.lines().filter(own);
    // Of a scan: what comes before the time stamp, then the lengths of its lines.
    let line = |(index, line): (usize, &str)| {
        if is_scan && index >= 2 { line.len().to_string() } else { line.to_owned() }
    };
    lines.enumerate().map(line).collect()
}

/// Asks the virtual sensor what the recorded one was asked, one command after the other.
fn virtual_session(mut device: VirtualHokuyo, before: &[&str], written: &[u8]) -> Vec<Vec<u8>> {
    let mut now = Instant::from_micros(1_000_000);
    let mut replies = Vec::new();
    for line in before.iter().map(|line| line.as_bytes()).chain(written.split(|byte| *byte == b'\n')) {
        if line.is_empty() {
            continue;
        }
        device.receive(now, &[line, b"\n"].concat());
        now = now + Duration::from_millis(400);
        device.timeout(now);
        replies.extend(std::iter::from_fn(|| device.poll()).map(|emission| emission.bytes));
    }
    replies.iter().skip(before.len()).flat_map(|bytes| frames(bytes, bytes.len())).collect()
}

/// The recorded sessions begin in SCIP 2, the laser on.
fn compare_with_recording(name: &str, model: HokuyoModel, before: &[&str]) {
    let Some(recorded) = session(name) else { return };
    let Some(written) = data::file(&format!("serial/{name}.logw")) else { return };
    let scene = Box::new(Scenario::load("room").expect("comes with the program").scene());
    let mut device = VirtualHokuyo::new(model, scene, 1);
    device.set_clock(0x6A_0000);
    let said = virtual_session(device, before, &logged_bytes(&written));
    assert_eq!(said.len(), recorded.len());
    for (said, recorded) in said.iter().zip(&recorded) {
        assert_eq!(of_the_model(said), of_the_model(recorded));
        let time = |reply: &[u8]| reply.windows(5).position(|window| window == b"TIME:").map(|at| reply[at + 11]);
        assert_eq!(time(said), time(recorded), "six digits, then a semicolon");
    }
}

#[test]
fn virtual_urg_says_what_the_recorded_one_said() {
    for model in [HokuyoModel::urg_04lx(), HokuyoModel::urg_04lx_usb()] {
        compare_with_recording("example_urg_04lx", model, &["SCIP2.0", "BM"]);
    }
}

#[test]
fn virtual_utm_says_what_the_recorded_one_said() {
    compare_with_recording("example_utm_30lx", HokuyoModel::utm_30lx(), &["BM"]);
}
