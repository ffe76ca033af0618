use super::*;
use crate::desk::{Desk, in_words};
use crate::driver::Event;
use crate::rplidar::response::Descriptor;
use std::string::String;
use std::vec::Vec;

impl<'a> Desk<RplidarDriver<'a>> {
    fn new(beams: &'a mut [Beam]) -> Self {
        Self::with(RplidarDriver::new(RplidarConfig::default(), beams), describe)
    }

    fn reply(&mut self, kind: ResponseKind, response: &[u8]) {
        self.answer(Duration::from_millis(5), &[&Descriptor { kind }.emit()[..], response].concat());
    }
}

fn describe(output: Output<'_>) -> String {
    match output {
        Output::Transmit(bytes) => std::format!("{:?}", Request::parse(bytes).unwrap()),
        Output::Event(Event::Identified(identity)) => std::format!("is {}", identity.model),
        output => in_words(output),
    }
}

const INFO: [u8; 20] = [0x18, 1, 1, 7, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16];

/// Packet `index` of a sensor with samples every 0.9 degrees, the n-th at 1000 + n mm.
fn capsule(dense: bool, index: usize) -> Capsule {
    let count = if dense { 40 } else { 32 };
    let distances: Vec<u16> = (0..count).map(|sample| 1000 + (index * count + sample) as u16).collect();
    Capsule::build(dense, index == 0, (index * count) as f32 * 0.9 % 360.0, &distances)
}

fn to_streaming(desk: &mut Desk<RplidarDriver<'_>>, kind: ResponseKind) {
    desk.wait();
    desk.reply(ResponseKind::Info, &INFO);
    desk.reply(ResponseKind::Health, &[0, 0, 0]);
    desk.reply(kind, &[]);
}

#[test]
fn session_goes_from_finding_to_whole_turns() {
    for (dense, kind) in [(false, ResponseKind::Capsule), (true, ResponseKind::DenseCapsule)] {
        let mut beams = [Beam::BLANK; BEAM_MEMORY];
        let mut desk = Desk::new(&mut beams);
        to_streaming(&mut desk, kind);
        assert_eq!(
            desk.heard()[..9],
            [
                "baud 115200",
                "Stop",
                "GetInfo",
                "Found { baud: 115200 }",
                "GetHealth",
                "is RPLIDAR model 0x18, hardware 7",
                "MotorPower(660)",
                "ExpressScan",
                "Streaming { baud: 115200, period: Duration { micros: 100000 } }",
            ]
        );
        for index in 0..40 {
            desk.now = desk.now + Duration::from_millis(8);
            desk.give(Input::Bytes(capsule(dense, index).bytes()));
        }
        let heard = desk.heard();
        assert!(heard.len() >= 2 && heard.iter().all(|said| said == "scan of 400"), "{heard:?}");
        desk.give(Input::Stop);
        desk.wait();
        assert_eq!(desk.heard(), ["Stop", "MotorPower(0)", "Stop", "Stopped { laser_off: true }"]);
    }
}

#[test]
fn damaged_packet_costs_its_turn() {
    let mut beams = [Beam::BLANK; BEAM_MEMORY];
    let mut desk = Desk::new(&mut beams);
    to_streaming(&mut desk, ResponseKind::DenseCapsule);
    desk.heard();
    for index in 0..60 {
        let mut bytes = *capsule(true, index).bytes();
        bytes[50] ^= if index == 22 { 8 } else { 0 };
        desk.now = desk.now + Duration::from_millis(8);
        desk.give(Input::Bytes(&bytes));
    }
    assert_eq!(desk.heard().len(), 4, "of five whole turns");
    assert_eq!(desk.driver.counters().damaged, 1);
}

#[test]
fn sensor_without_express_mode_is_scanned_the_old_way() {
    let mut beams = [Beam::BLANK; BEAM_MEMORY];
    let mut desk = Desk::new(&mut beams);
    desk.wait();
    desk.reply(ResponseKind::Info, &INFO);
    desk.reply(ResponseKind::Health, &[0, 0, 0]);
    desk.wait();
    desk.wait();
    desk.reply(ResponseKind::Sample, &[]);
    assert_eq!(desk.heard()[7..10], ["ExpressScan", "ExpressScan", "Scan"]);
    for index in 0..1200_u32 {
        let angle = ((index * 64 % (360 * 64)) << 1 | 1) as u16;
        let [low, high] = angle.to_le_bytes();
        let start = u8::from(index % 360 == 0);
        desk.give(Input::Bytes(&[0x3C | start | (1 - start) << 1, low, high, 0xA0, 0x0F]));
    }
    assert_eq!(desk.heard(), ["scan of 360", "scan of 360"]);
}

#[test]
fn sick_sensor_is_reset_and_told() {
    let mut beams = [Beam::BLANK; BEAM_MEMORY];
    let mut desk = Desk::new(&mut beams);
    desk.wait();
    desk.reply(ResponseKind::Info, &INFO);
    desk.reply(ResponseKind::Health, &[2, 9, 0]);
    assert_eq!(
        desk.heard()[5..],
        ["Reset", "asking what it is: it reports a fault in itself, status 0x09 to request 52 (health)"]
    );
}
