use super::*;
use crate::scenario::Scenario;
use lrfslam_lrf::sick_lms::{DecoderEvent, Measurement, TelegramDecoder};

/// What an LMS200 in a room says to `bytes`, within `ms`: ACK and NAK as themselves, payloads without their frame.
fn ask(device: &mut VirtualSick, now: &mut Instant, bytes: &[u8], ms: i64) -> Vec<Vec<u8>> {
    let until = *now + Duration::from_millis(ms);
    device.receive(*now, bytes);
    let mut memory = [0; telegram::MAX_TELEGRAM];
    let mut decoder = TelegramDecoder::new(Direction::ToHost, &mut memory);
    let mut said = Vec::new();
    loop {
        while let Some(emission) = device.poll() {
            let mut rest = &emission.bytes[..];
            while let (taken, Some(event)) = decoder.feed(rest) {
                rest = &rest[taken..];
                said.push(match event {
                    DecoderEvent::Ack => vec![ACK],
                    DecoderEvent::Nak => vec![NAK],
                    DecoderEvent::Telegram(payload) => payload.to_vec(),
                });
            }
        }
        if device.deadline() > until {
            *now = until;
            return said;
        }
        *now = (*now).max(device.deadline());
        device.timeout(*now);
    }
}

fn hex(text: &str) -> Vec<u8> {
    text.split_whitespace().map(|byte| u8::from_str_radix(byte, 16).unwrap()).collect()
}

fn sensor(model: SickModel) -> (VirtualSick, Instant) {
    (VirtualSick::new(model, Box::new(Scenario::load("room").unwrap().scene()), 1), Instant::from_micros(1_000_000))
}

fn lms200() -> (VirtualSick, Instant) {
    sensor(SickModel::lms200())
}

/// Into the installation mode.
fn install(device: &mut VirtualSick, now: &mut Instant) {
    let install = Request::Mode(OperatingMode::Installation(*b"SICK_LMS")).emit();
    assert_eq!(ask(device, now, &install, 500)[1], [0xA0, 0x00, 0x10]);
}

/// What comes first of a mode at 500000 baud and 1 degree: its answer, and the telegram after it.
fn mode(model: SickModel, mode: OperatingMode) -> (Vec<u8>, Option<Vec<u8>>) {
    let (mut device, mut now) = sensor(model);
    device.set_baud(500_000);
    device.variant = Variant::DEG_180_BY_1;
    let mut said = ask(&mut device, &mut now, &Request::Mode(mode).emit(), 400).into_iter().skip(1);
    (said.next().unwrap(), said.next())
}

#[test]
fn each_request_is_acknowledged_then_answered() {
    let (mut device, mut now) = lms200();
    for (request, reply) in [
        ("02 00 01 00 3A 1E 12", 0xBA),
        ("02 00 01 00 31 15 12", 0xB1),
        ("02 00 01 00 32 16 12", 0xB2),
        ("02 00 01 00 74 50 12", 0xF4),
        ("02 00 02 00 20 25 35 08", 0xA0),
        ("02 00 05 00 3B B4 00 64 00 97 49", 0xBB),
        ("02 00 02 00 66 01 9D 4E", 0x92),
        ("02 00 02 00 30 01 31 18", 0xB0),
    ] {
        let said = ask(&mut device, &mut now, &hex(request), 500);
        assert_eq!((said.len(), &said[0][..], said[1][0]), (2, &[ACK][..], reply), "{request}");
    }
}

#[test]
fn wrong_sum_gets_nak_and_silence_drops_half_a_telegram() {
    let (mut device, mut now) = lms200();
    let install_with_wrong_sum = hex("02 00 0A 00 20 00 53 49 43 4B 5F 4C 4D 53 5F B2");
    assert_eq!(ask(&mut device, &mut now, &install_with_wrong_sum, 500), [vec![NAK]]);
    assert!(ask(&mut device, &mut now, &hex("02 00 0A 00 20"), 200).is_empty());
    assert_eq!(ask(&mut device, &mut now, &hex("02 00 01 00 32 16 12"), 500).len(), 2);
}

#[test]
fn configuration_is_taken_in_installation_mode_only() {
    let (mut device, mut now) = lms200();
    let set = Request::SetConfig(device.config.clone()).emit();
    assert_eq!(ask(&mut device, &mut now, &set, 500)[1][0], 0x92);
    let install = Request::Mode(OperatingMode::Installation(*b"SICK_LMS")).emit();
    assert_eq!(ask(&mut device, &mut now, &install, 500)[1], [0xA0, 0x00, 0x10]);
    assert_eq!(ask(&mut device, &mut now, &set, 5000)[1][..2], [0xF7, 0x01]);
    let wrong = Request::Mode(OperatingMode::Installation(*b"PASSWORD")).emit();
    assert_eq!(ask(&mut device, &mut now, &wrong, 500)[1], [0xA0, 0x01, 0x10]);
}

#[test]
fn rate_of_scans_is_what_the_line_allows() {
    for (baud, values, per_second) in
        [(500_000, 181, 74..=76), (38_400, 181, 9..=10), (38_400, 361, 4..=5), (500_000, 361, 37..=38)]
    {
        let (mut device, mut now) = lms200();
        device.variant = if values == 181 { Variant::DEG_180_BY_1 } else { Variant::DEG_180_BY_HALF };
        device.set_baud(baud);
        ask(&mut device, &mut now, &hex("02 00 02 00 20 24 34 08"), 1000);
        let said = ask(&mut device, &mut now, b"", 10_000);
        let rate = said.len() / 10;
        assert!(per_second.contains(&rate), "{values} values at {baud}: {rate}");
        let scan = Measurement::parse(&said[0][..said[0].len() - 1]).unwrap();
        assert_eq!(scan.len(), values);
    }
}

#[test]
fn reset_says_so_then_boots_and_announces_itself() {
    let (mut device, mut now) = lms200();
    device.set_baud(38_400);
    let said = ask(&mut device, &mut now, &hex("02 00 01 00 10 34 12"), 20_000);
    assert_eq!((said.len(), said[1][0], said[2][0], said[2].len()), (3, 0x91, 0x90, 23));
    assert_eq!(device.baud(now), Some(9600));
}

#[test]
fn turns_of_a_half_degree_scan_alternate() {
    let (mut device, mut now) = lms200();
    device.set_baud(500_000);
    ask(&mut device, &mut now, &hex("02 00 02 00 20 2A 3A 08"), 500);
    let said = ask(&mut device, &mut now, b"", 200);
    let sizes: Vec<usize> =
        said.iter().map(|payload| Measurement::parse(&payload[..payload.len() - 1]).unwrap().len()).collect();
    assert!(sizes.windows(2).all(|pair| pair[0] + pair[1] == 361) && sizes.len() >= 13, "{sizes:?}");
}

#[test]
fn other_ways_of_streaming_have_their_telegrams() {
    for (request, command) in [
        ("02 00 03 00 20 26 0A 76 3E", 0xB6),
        ("02 00 06 00 20 27 01 00 B5 00 12 09", 0xB7),
        ("02 00 06 00 20 50 01 00 B5 00 68 B6", 0xC4),
    ] {
        let (mut device, mut now) = sensor(SickModel::lms291());
        device.set_baud(500_000);
        device.variant = Variant::DEG_180_BY_1;
        let said = ask(&mut device, &mut now, &hex(request), 1000);
        let scan = &said[2];
        assert_eq!((said[1][0], scan[0]), (0xA0, command), "{request}");
        assert!(Measurement::parse(&scan[..scan.len() - 1]).is_some(), "{request}");
    }
}

/// MRPT waits 600 ms, and CARMEN no longer.
#[test]
fn configuration_is_answered_before_drivers_give_up() {
    let (mut device, mut now) = lms200();
    install(&mut device, &mut now);
    let set = Request::SetConfig(device.config.clone()).emit();
    assert_eq!(ask(&mut device, &mut now, &set, 500)[1][..2], [0xF7, 0x01]);
    assert_eq!(ask(&mut device, &mut now, &Request::PermanentBaud(true).emit(), 500)[1], [0xE6, 0x00, 0x10]);
}

#[test]
fn reflectivity_comes_instead_of_ranges_in_its_measuring_mode() {
    for measuring_mode in [0x00, 0x3F] {
        let (mut device, mut now) = lms200();
        install(&mut device, &mut now);
        let block = ConfigBlock::parse(&[70, 0, 0, 0, 0, measuring_mode, 1]).unwrap();
        ask(&mut device, &mut now, &Request::SetConfig(block).emit(), 500);
        ask(&mut device, &mut now, &Request::Mode(OperatingMode::OnRequest).emit(), 500);
        let said = ask(&mut device, &mut now, &Request::Scan.emit(), 1500);
        let scan = Measurement::parse(&said[1][..said[1].len() - 1]).unwrap();
        let largest = scan.raw_values().max().unwrap();
        assert!((largest <= 255) == (measuring_mode == 0x3F), "{measuring_mode:02X}: {largest}");
    }
}

/// As CARMEN asks for it, and reads it.
#[test]
fn remission_has_its_part_first_and_last_before_the_values() {
    let remission = OperatingMode::StreamRemission(1, 181);
    assert_eq!(Request::Mode(remission).emit()[4..12], [0x20, 0x2B, 1, 0, 1, 0, 181, 0]);
    let (answer, telegram) = mode(SickModel::lms291(), remission);
    let telegram = telegram.unwrap();
    assert_eq!(answer, [0xA0, 0x00, 0x10]);
    assert_eq!((&telegram[..9], telegram.len()), (&[0xF5, 1, 0, 1, 0, 181, 0, 181, 0][..], 9 + 4 * 181 + 1));
    assert!(Measurement::parse(&telegram[..telegram.len() - 1]).is_some());
}

#[test]
fn parts_come_in_turn_on_a_line_too_slow_for_all() {
    let (mut device, mut now) = lms200();
    device.set_baud(38_400);
    ask(&mut device, &mut now, &Request::Mode(OperatingMode::StreamPartial).emit(), 200);
    let said = ask(&mut device, &mut now, b"", 3000);
    let sizes: Vec<usize> =
        said.iter().map(|payload| Measurement::parse(&payload[..payload.len() - 1]).unwrap().len()).collect();
    assert!(sizes.len() > 20 && sizes.windows(2).all(|pair| pair[0] + pair[1] == 361), "{sizes:?}");
}

#[test]
fn modes_of_the_telegram_listing_are_taken() {
    let done = [0xA0, 0x00, 0x10];
    let mean = OperatingMode::StreamMeanSubrange(10, 91, 100);
    let (answer, telegram) = mode(SickModel::lms200(), mean);
    assert_eq!((&answer[..], &telegram.unwrap()[..8]), (&done[..], &[0xBF, 10, 91, 0, 100, 0, 10, 0x40][..]));
    let watching = [0x20, 0x21, 0x22, 0x23, 0x29, 0x2C, 0x2D, 0x2E, 0x2F].map(OperatingMode::Watch);
    for quiet in watching.into_iter().chain([OperatingMode::Diagnosis]) {
        assert_eq!(mode(SickModel::lms200(), quiet), (done.to_vec(), None), "{quiet:?}");
    }
    let with_reflectivity = OperatingMode::StreamReflectivity(1, 181);
    assert_eq!(mode(SickModel::lms200(), with_reflectivity).0, [0x92, 0x10], "an LMS200 does not have it");
    assert_eq!(mode(SickModel::lms291(), with_reflectivity).0, done);
}
