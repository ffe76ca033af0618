use super::*;
use crate::desk::{Desk, in_words};
use crate::driver::Event;
use crate::rplidar::response::Descriptor;
use lrfslam_scan::Echo;
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
                "Streaming { baud: 115200, period: Duration { micros: 0 } }",
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
fn damaged_packet_is_a_hole_in_its_turn() {
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
    assert_eq!(desk.heard().len(), 5, "all turns");
    let counters = desk.driver.counters();
    assert_eq!((counters.damaged, counters.incomplete), (1, 1));
}

#[test]
fn sensor_without_express_mode_is_scanned_the_old_way() {
    let mut beams = [Beam::BLANK; BEAM_MEMORY];
    let mut desk = Desk::new(&mut beams);
    desk.wait();
    desk.reply(ResponseKind::Info, &INFO);
    desk.reply(ResponseKind::Health, &[0, 0, 0]);
    (0..4).for_each(|_| desk.wait());
    desk.reply(ResponseKind::Sample, &[]);
    assert_eq!(
        desk.heard()[7..13],
        [
            "ExpressScan",
            "ExpressScan",
            "ExpressScan",
            "ExpressScan",
            "starting scans: it has only a mode without check sums; damage on the line may go unseen",
            "Scan"
        ]
    );
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
        ["Reset", "asking what it is: it reports a fault in itself, code 0x09 to request 52 (health)"]
    );
}

/// Turns of 60 packets whose corrections jump between 0 and `correction_deg`, and those that were not whole.
fn turns_with_corrections(correction_deg: f32) -> (usize, u32) {
    let mut beams = [Beam::BLANK; BEAM_MEMORY];
    let mut desk = Desk::new(&mut beams);
    to_streaming(&mut desk, ResponseKind::Capsule);
    desk.heard();
    for index in 0..400 {
        let distances: Vec<u16> = (0..32).map(|sample| 1000 + sample).collect();
        let start_deg = (index * 32) as f32 * 0.9 % 360.0;
        let correction = if index % 3 == 0 { correction_deg } else { 0.0 };
        desk.now = desk.now + Duration::from_millis(8);
        desk.give(Input::Bytes(Capsule::build_corrected(false, index == 0, start_deg, &distances, correction).bytes()));
    }
    (desk.heard().len(), desk.driver.counters().incomplete)
}

#[test]
fn no_turn_is_lost_where_corrections_jump() {
    for correction_deg in [0.0, 1.0, 2.5, 5.0, 7.75] {
        assert_eq!(turns_with_corrections(correction_deg), (31, 0), "{correction_deg} degrees");
    }
}

/// Sample `index` of a sensor in the old mode, one every degree.
fn old_sample(index: usize) -> [u8; 5] {
    let [low, high] = (((index * 64 % (360 * 64)) << 1 | 1) as u16).to_le_bytes();
    let start = u8::from(index.is_multiple_of(360));
    [0x3C | start | (1 - start) << 1, low, high, 0xA0, 0x0F]
}

#[test]
fn angles_that_jump_cost_their_turn_in_the_old_mode() {
    for damage in [0, 1] {
        let mut beams = [Beam::BLANK; BEAM_MEMORY];
        let mut desk = Desk::new(&mut beams);
        desk.wait();
        desk.reply(ResponseKind::Info, &INFO);
        desk.reply(ResponseKind::Health, &[0, 0, 0]);
        (0..4).for_each(|_| desk.wait());
        desk.reply(ResponseKind::Sample, &[]);
        desk.heard();
        for index in 0..1600 {
            let mut bytes = old_sample(index);
            // Both check bits stay right.
            bytes[2] ^= if damage == 1 && index == 700 { 0x10 } else { 0 };
            desk.give(Input::Bytes(&bytes));
        }
        let counters = desk.driver.counters();
        assert_eq!(
            (desk.heard().len(), counters.incomplete, counters.damaged),
            (3 - damage, damage as u32, damage as u32)
        );
    }
}

#[test]
fn fault_is_told_by_its_number() {
    let mut beams = [Beam::BLANK; BEAM_MEMORY];
    let mut desk = Desk::new(&mut beams);
    desk.wait();
    desk.reply(ResponseKind::Info, &INFO);
    desk.reply(ResponseKind::Health, &[2, 0x34, 0]);
    assert!(desk.heard()[6].contains("a fault in itself, code 0x34 to"), "not the letter 4");
}

/// Turns of 400 packets whose distances tell their angles, through a line that does this to each packet; and how many had a wrong beam.
fn turns_through(line: impl Fn(usize, &[u8]) -> Vec<u8>) -> (usize, usize) {
    let mut beams = [Beam::BLANK; BEAM_MEMORY];
    let mut desk = Desk::new(&mut beams);
    to_streaming(&mut desk, ResponseKind::Capsule);
    desk.heard();
    let distance_mm = |clockwise_deg: f32| 1000.0 + 10.0 * clockwise_deg.rem_euclid(360.0);
    let (mut turns, mut wrong) = (0, 0);
    for index in 0..400 {
        let start_deg = (index * 32) as f32 * 0.9 % 360.0;
        let distances: Vec<u16> = (0..32).map(|sample| distance_mm(start_deg + 0.9 * sample as f32) as u16).collect();
        let packet = Capsule::build_corrected(false, index == 0, start_deg, &distances, 0.0);
        desk.now = desk.now + Duration::from_millis(8);
        desk.give(Input::Bytes(&line(index, packet.bytes())));
        if !desk.heard().is_empty() {
            turns += 1;
            let (_, beams) = desk.driver.dialogue.turns.turn();
            let is_wrong = |beam: &Beam| match beam.echo {
                Echo::Hit(range_m) => (range_m * 1000.0 - distance_mm(-beam.bearing_rad.to_degrees())).abs() > 20.0,
                _ => false,
            };
            // At the seam, straight ahead, the distance jumps.
            wrong += usize::from(beams.iter().filter(|beam| beam.bearing_rad.abs() > 0.05).any(is_wrong));
        }
    }
    (turns, wrong)
}

#[test]
fn packet_lost_without_a_trace_makes_no_wrong_beam() {
    assert_eq!(turns_through(|_, packet| packet.to_vec()), (31, 0));
    assert_eq!(turns_through(|index, packet| if index == 100 { Vec::new() } else { packet.to_vec() }), (31, 0));
}

/// Every other packet, for a while: what is missing between those that come is not taken for the motor's speed.
#[test]
fn packets_lost_one_after_the_other_make_no_wrong_beam() {
    let lossy = |index: usize, packet: &[u8]| {
        if (100..140).contains(&index) && index % 2 == 1 { Vec::new() } else { packet.to_vec() }
    };
    assert_eq!(turns_through(lossy), (28, 0));
}

/// The sum of exclusive ors is right if the last byte, which the doubled one pushes out, is the same.
#[test]
fn doubled_byte_that_the_sum_does_not_see_makes_no_wrong_beam() {
    let doubled = |index: usize, packet: &[u8]| {
        let mut bytes = packet.to_vec();
        assert_eq!(bytes[8], bytes[83]);
        bytes.splice(8..8, (index == 100).then_some(bytes[8]));
        bytes
    };
    assert_eq!(turns_through(doubled), (31, 0));
}

/// 32 samples by 250 us, of which a packet takes 7.3 ms on a line of 115200 baud.
#[test]
fn stamps_are_the_samples_own_times_not_those_of_arrival() {
    let mut beams = [Beam::BLANK; BEAM_MEMORY];
    let mut desk = Desk::new(&mut beams);
    to_streaming(&mut desk, ResponseKind::Capsule);
    let began = desk.now.micros + 10_000;
    for index in 0..200 {
        desk.now = Instant::from_micros(began + (index * 32 + 31) * 250 + 84 * 10_000_000 / 115_200);
        desk.give(Input::Bytes(capsule(false, index as usize).bytes()));
    }
    // Turns begin behind: at sample 200 of 400.
    let late = (0..).zip(&desk.stamps).map(|(turn, stamp)| stamp.micros - began - (200 + turn * 400) * 250);
    assert!(
        desk.stamps.len() >= 14 && late.clone().all(|late: i64| late.abs() < 300),
        "{:?}",
        late.collect::<Vec<_>>()
    );
}
