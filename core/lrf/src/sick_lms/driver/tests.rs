use super::*;
use crate::desk::{Desk, in_words};
use crate::driver::Event;
use crate::sick_lms::measurement::count_word;
use crate::sick_lms::telegram;
use std::string::String;
use std::vec::Vec;

impl<'a> Desk<SickDriver<'a>> {
    fn new(config: SickConfig, telegram: &'a mut [u8], beams: &'a mut [Beam]) -> Self {
        Self::with(SickDriver::new(config, telegram, beams), describe)
    }

    fn reply(&mut self, payload: &[u8]) {
        self.now = self.now + Duration::from_millis(10);
        self.answer(Duration::ZERO, &[&[telegram::ACK][..], &telegram_of(payload)].concat());
    }
}

fn telegram_of(payload: &[u8]) -> Vec<u8> {
    let mut out = [0; telegram::MAX_TELEGRAM];
    let length = telegram::emit(Direction::ToHost, payload, &mut out).unwrap();
    out[..length].to_vec()
}

/// Requests by their payload in hexadecimal.
fn describe(output: Output<'_>) -> String {
    match output {
        Output::Transmit(bytes) => {
            let bytes: Vec<String> = telegram::payload(bytes).iter().map(|byte| std::format!("{byte:02X}")).collect();
            bytes.join(" ")
        }
        Output::Event(Event::Identified(identity)) => std::format!("is {}, {}", identity.model, identity.firmware),
        output => in_words(output),
    }
}

const DONE: [u8; 3] = [0xA0, 0x00, 0x10];

fn status(resolution_cdeg: u8) -> Vec<u8> {
    let mut payload = vec![0; 154];
    payload[0] = 0xB1;
    payload[1..8].copy_from_slice(b"V02.30 ");
    (payload[107], payload[109], payload[153]) = (180, resolution_cdeg, 0x10);
    payload
}

fn config() -> Vec<u8> {
    [&[0xF4][..], ConfigBlock::new(34).bytes(), &[0x10]].concat()
}

fn scan(values: u16, turn: Option<u8>) -> Vec<u8> {
    let mut payload = vec![0xB0];
    payload.extend(count_word(values, Unit::Millimetre, turn).to_le_bytes());
    payload.resize(usize::from(values) * 2 + 3, 0x04);
    payload.push(0x10);
    payload
}

#[test]
fn session_goes_from_finding_to_a_scan() {
    let (mut bytes, mut beams) = ([0; TELEGRAM_MEMORY], [Beam::BLANK; BEAM_MEMORY]);
    let fast = SickConfig { baud: BaudPolicy::Raise(500_000), ..SickConfig::default() };
    let mut desk = Desk::new(fast, &mut bytes, &mut beams);
    assert_eq!(desk.heard(), ["baud 500000", "20 25"]);
    desk.wait();
    desk.wait();
    assert_eq!(desk.heard(), ["20 25", "baud 9600", "20 25"]);
    desk.reply(&DONE);
    desk.reply(&[&[0xBA][..], b"LMS200;301063;V02.30 ", &[0x10]].concat());
    desk.reply(&status(50));
    desk.reply(&config());
    assert_eq!(desk.heard(), ["Found { baud: 9600 }", "3A", "31", "74", "20 48"]);
    desk.reply(&DONE);
    desk.wait();
    desk.reply(&status(50));
    assert_eq!(desk.heard(), ["baud 500000", "31", "is LMS200;301063;V02.30 , V02.30 ", "20 2A"]);
    desk.reply(&DONE);
    desk.reply(&scan(180, Some(2)));
    desk.reply(&scan(181, Some(0)));
    assert_eq!(desk.heard()[1..], ["scan of 180", "scan of 181"]);
    desk.reply(&scan(181, Some(2)));
    assert!(desk.heard().is_empty() && desk.driver.counters().damaged == 1);
    desk.give(Input::Stop);
    desk.reply(&scan(181, Some(0)));
    desk.reply(&DONE);
    assert_eq!(desk.heard(), ["20 25", "Stopped { laser_off: true }"]);
}

#[test]
fn sensor_that_refuses_turns_streams_whole_scans() {
    let (mut bytes, mut beams) = ([0; TELEGRAM_MEMORY], [Beam::BLANK; BEAM_MEMORY]);
    let fast = SickConfig { baud: BaudPolicy::NoRate, ..SickConfig::default() };
    let mut desk = Desk::new(fast, &mut bytes, &mut beams);
    desk.reply(&DONE);
    desk.reply(&[0x92, 0x10]);
    desk.reply(&status(50));
    desk.reply(&config());
    desk.reply(&[0x92, 0x10]);
    desk.reply(&DONE);
    desk.reply(&scan(361, None));
    let heard = desk.heard();
    assert_eq!(heard[heard.len() - 4..heard.len() - 2], ["20 2A", "20 24"]);
    assert_eq!(heard.last().unwrap(), "scan of 361");
}

#[test]
fn unit_is_changed_in_installation_mode() {
    let (mut bytes, mut beams) = ([0; TELEGRAM_MEMORY], [Beam::BLANK; BEAM_MEMORY]);
    let config_cm = SickConfig { unit: Some(Unit::Centimetre), ..SickConfig::default() };
    let mut desk = Desk::new(config_cm, &mut bytes, &mut beams);
    desk.reply(&DONE);
    desk.reply(&[0xBA, 0x10]);
    desk.reply(&status(100));
    desk.reply(&config());
    desk.reply(&DONE);
    let mut wanted = ConfigBlock::new(34);
    wanted.set_unit(Unit::Centimetre);
    desk.reply(&[&[0xF7, 1][..], wanted.bytes(), &[0x10]].concat());
    desk.reply(&DONE);
    desk.reply(&[&[0xF4][..], wanted.bytes(), &[0x10]].concat());
    let heard = desk.heard();
    assert_eq!(heard[6], "20 00 53 49 43 4B 5F 4C 4D 53");
    assert!(heard[7].starts_with("77 46 00 00 00 00 00 00"), "{}", heard[7]);
    assert_eq!((heard[8].as_str(), heard[9].as_str(), heard[11].as_str()), ("20 25", "74", "20 24"));
}

#[test]
fn wrong_password_is_told_and_scans_come_all_the_same() {
    let (mut bytes, mut beams) = ([0; TELEGRAM_MEMORY], [Beam::BLANK; BEAM_MEMORY]);
    let config_cm = SickConfig { unit: Some(Unit::Centimetre), ..SickConfig::default() };
    let mut desk = Desk::new(config_cm, &mut bytes, &mut beams);
    desk.reply(&DONE);
    desk.reply(&[0xBA, 0x10]);
    desk.reply(&status(100));
    desk.reply(&config());
    desk.reply(&[0xA0, 0x01, 0x10]);
    desk.reply(&DONE);
    desk.reply(&config());
    let heard = desk.heard();
    assert_eq!(heard[7], "setting it up: refused with status 0xA00x01 to telegram 20 00 (installation mode)");
    assert_eq!(heard.last().unwrap(), "20 24");
}

#[test]
fn power_on_telegram_begins_the_session_anew() {
    let (mut bytes, mut beams) = ([0; TELEGRAM_MEMORY], [Beam::BLANK; BEAM_MEMORY]);
    let mut desk = Desk::new(SickConfig::default(), &mut bytes, &mut beams);
    desk.reply(&DONE);
    desk.reply(&[0xBA, 0x10]);
    desk.reply(&status(100));
    desk.reply(&config());
    desk.reply(&DONE);
    desk.heard();
    desk.reply(&[&[0x90][..], b"LMS200;301063;V02.30 ", &[0x10]].concat());
    desk.wait();
    assert_eq!(desk.heard(), ["receiving scans: it was reset; is its power good?", "baud 9600", "20 25"]);
}

#[test]
fn silence_tries_every_rate_and_says_so() {
    let (mut bytes, mut beams) = ([0; TELEGRAM_MEMORY], [Beam::BLANK; BEAM_MEMORY]);
    let mut desk = Desk::new(SickConfig::default(), &mut bytes, &mut beams);
    while !desk.said.last().unwrap().contains("no reply") {
        desk.wait();
    }
    assert!(desk.heard().last().unwrap().contains("at 9600, 38400, 500000, 19200 baud"));
    assert!(desk.now.micros < 4_000_000, "{:?}", desk.now);
}

/// A simple sensor, or a simple simulator: it streams, and answers nothing else.
#[test]
fn sensor_that_knows_nothing_but_streaming_gives_scans() {
    let (mut bytes, mut beams) = ([0; TELEGRAM_MEMORY], [Beam::BLANK; BEAM_MEMORY]);
    let mut desk = Desk::new(SickConfig::default(), &mut bytes, &mut beams);
    desk.reply(&DONE);
    while desk.said.last().unwrap() != "20 24" {
        desk.wait();
    }
    desk.reply(&DONE);
    desk.reply(&scan(361, None));
    assert_eq!(desk.heard().last().unwrap(), "scan of 361");
    assert!(desk.now.micros < 8_000_000);
}

/// To the request for scans, of a sensor that answers all but its status.
fn to_stream_without_status(desk: &mut Desk<SickDriver<'_>>) {
    desk.reply(&DONE);
    desk.reply(&[&[0xBA][..], b"LMS200;301063;V02.30 ", &[0x10]].concat());
    while desk.said.last().unwrap() != "74" {
        desk.wait();
    }
    desk.reply(&config());
}

#[test]
fn scans_show_the_resolution_that_the_sensor_could_not_say() {
    let (mut bytes, mut beams) = ([0; TELEGRAM_MEMORY], [Beam::BLANK; BEAM_MEMORY]);
    let fast = SickConfig { baud: BaudPolicy::NoRate, ..SickConfig::default() };
    let mut desk = Desk::new(fast, &mut bytes, &mut beams);
    to_stream_without_status(&mut desk);
    assert_eq!(desk.said.iter().filter(|said| *said == "31").count(), 5, "asked again");
    assert_eq!(desk.said.last().unwrap(), "20 24");
    desk.reply(&DONE);
    desk.heard();
    desk.reply(&scan(361, None));
    assert_eq!(desk.heard(), ["20 2A"], "two turns a scan: each on its own is wanted");
    desk.reply(&DONE);
    desk.reply(&scan(180, Some(2)));
    assert_eq!(desk.heard().last().unwrap(), "scan of 180");
}

#[test]
fn line_too_slow_for_every_turn_gets_whole_scans() {
    for (baud, stream) in [(38_400, "20 24"), (500_000, "20 2A")] {
        let (mut bytes, mut beams) = ([0; TELEGRAM_MEMORY], [Beam::BLANK; BEAM_MEMORY]);
        let config_at = SickConfig { baud: BaudPolicy::Raise(baud), ..SickConfig::default() };
        let mut desk = Desk::new(config_at, &mut bytes, &mut beams);
        desk.reply(&DONE);
        desk.reply(&[0xBA, 0x10]);
        desk.reply(&status(50));
        desk.reply(&config());
        assert_eq!(desk.heard().last().unwrap(), stream, "{baud}");
    }
}

#[test]
fn rate_that_no_sensor_has_is_told_and_not_tried() {
    let (mut bytes, mut beams) = ([0; TELEGRAM_MEMORY], [Beam::BLANK; BEAM_MEMORY]);
    let config_at = SickConfig { baud: BaudPolicy::Raise(115_200), ..SickConfig::default() };
    let mut desk = Desk::new(config_at, &mut bytes, &mut beams);
    desk.reply(&DONE);
    desk.reply(&[0xBA, 0x10]);
    desk.reply(&status(100));
    desk.reply(&config());
    let heard = desk.heard();
    let said = "changing the baud rate: it does not have 115200 baud; the rate stays as it is";
    assert!(heard.iter().any(|text| text == said), "{heard:?}");
    assert!(heard.iter().all(|text| text != "baud 115200") && heard.last().unwrap() == "20 24", "{heard:?}");
}

/// 75 scans a second for 18 s, of which a reader that is stopped five times for 0.3 s reads 23 at once.
#[test]
fn stamps_keep_the_sensors_pace_while_the_reader_is_stopped() {
    let (mut bytes, mut beams) = ([0; TELEGRAM_MEMORY], [Beam::BLANK; BEAM_MEMORY]);
    let fast = SickConfig { baud: BaudPolicy::NoRate, ..SickConfig::default() };
    let mut desk = Desk::new(fast, &mut bytes, &mut beams);
    desk.reply(&DONE);
    desk.reply(&[0xBA, 0x10]);
    desk.reply(&status(100));
    desk.reply(&config());
    desk.reply(&DONE);
    desk.heard();
    desk.stamps.clear();
    let began = desk.now.micros;
    let complete = |turn: i64| turn * 1_000_000 / 75;
    let stop = |at: i64| if at % 3_500_000 > 3_200_000 { at / 3_500_000 * 3_500_000 + 3_500_000 } else { at };
    let mut turn = 0;
    while turn < 1376 {
        let read = stop(complete(turn));
        let mut bytes = Vec::new();
        while turn < 1376 && complete(turn) <= read {
            bytes.extend(telegram_of(&scan(181, None)));
            turn += 1;
        }
        desk.now = Instant::from_micros(began + read);
        desk.give(Input::Bytes(&bytes));
    }
    let late: Vec<i64> =
        (0..).zip(&desk.stamps).map(|(turn, stamp)| stamp.micros + 6666 - began - complete(turn)).collect();
    assert_eq!((late.len(), late.iter().filter(|late| late.abs() > 7000).count()), (1376, 0), "{late:?}");
    assert!(late.iter().filter(|late| late.abs() > 500).count() <= 5, "{late:?}");
    assert!(desk.stamps.windows(2).all(|pair| pair[1].since(pair[0]).micros > 6600), "{:?}", desk.stamps);
}
