use super::*;
use crate::desk::{Desk, in_words};
use crate::driver::Event;
use std::string::String;

const VERSION: &str = "VV\n00P\nVEND:Hokuyo Automatic Co.,Ltd.;[\nPROD:SOKUIKI Sensor URG-04LX;[\nFIRM:3.1.04(02/Aug./2007);a\nPROT:SCIP 2.0;N\nSERI:H0706400;F\n\n";
const PARAMETERS: &str = "PP\n00P\nMODL:URG-04LX(Hokuyo Automatic Co.,Ltd.);N\nDMIN:20;4\nDMAX:5600;_\nARES:1024;\\\nAMIN:44;7\nAMAX:725;o\nAFRT:384;6\nSCAN:600;e\n\n";

impl<'a> Desk<HokuyoDriver<'a>> {
    fn new(config: HokuyoConfig, frame: &'a mut [u8], beams: &'a mut [Beam]) -> Self {
        Self::with(HokuyoDriver::new(config, frame, beams), describe)
    }

    fn reply(&mut self, text: &str) {
        self.answer(Duration::from_millis(10), text.as_bytes());
    }
}

fn describe(output: Output<'_>) -> String {
    match output {
        Output::Transmit(bytes) => std::string::String::from_utf8_lossy(bytes).replace('\n', "|"),
        Output::Event(Event::Identified(identity)) => std::format!("is {}, {}", identity.model, identity.state),
        output => in_words(output),
    }
}

fn to_streaming(desk: &mut Desk<HokuyoDriver<'_>>) {
    desk.wait();
    desk.reply("QT\n00P\n\n");
    desk.reply(VERSION);
    desk.reply(PARAMETERS);
    desk.reply("II\n00P\nSTAT:Sensor works well.;8\n\n");
    desk.reply("TM0\n00P\n\n");
    for stamp in 0..11_u64 {
        let mut line = [0; 4];
        super::super::code::encode(1000 + 10 * stamp, &mut line);
        let sum = char::from(super::super::code::sum(&line));
        desk.reply(&std::format!("TM1\n00P\n{}{sum}\n\n", core::str::from_utf8(&line).unwrap()));
    }
    desk.reply("TM2\n00P\n\n");
    desk.reply("BM\n02R\n\n");
}

#[test]
fn session_goes_from_finding_to_a_scan() {
    let (mut frame, mut beams) = ([0; 2300], [Beam::BLANK; 682]);
    let config = HokuyoConfig { steps: Some((384, 384)), ..HokuyoConfig::default() };
    let mut desk = Desk::new(config, &mut frame, &mut beams);
    assert_eq!(desk.heard(), ["baud 19200", "|"]);
    to_streaming(&mut desk);
    let heard = desk.heard();
    assert_eq!(heard[..4], ["|QT|", "Found { baud: 19200 }", "|VV|", "|PP|"]);
    assert_eq!(heard[5], "is URG-04LX(Hokuyo Automatic Co.,Ltd.), Sensor works well.");
    assert_eq!(heard.last().unwrap(), "|MD0384038401000|");
    desk.reply("MD0384038401000\n00P\n\n");
    desk.reply("MD0384038401000\n99b\n00QAb\n0EX=\n\n");
    assert_eq!(desk.heard()[1..], ["scan of 1"]);
    desk.reply("MD0384038401000\n99b\n00QBc\n0EY=\n\n");
    assert!(desk.heard().is_empty() && desk.driver.counters().damaged == 1);
    desk.give(Input::Stop);
    desk.reply("QT\n00P\n\n");
    assert_eq!(desk.heard(), ["|QT|", "Stopped { laser_off: true }"]);
}

#[test]
fn scip1_sensor_is_led_to_scip2() {
    let (mut frame, mut beams) = ([0; 2300], [Beam::BLANK; 682]);
    let mut desk = Desk::new(HokuyoConfig::default(), &mut frame, &mut beams);
    desk.wait();
    desk.reply("QT\nE\n\n");
    desk.reply("SCIP2.0\n0\n\n");
    desk.reply("QT\n00P\n\n");
    assert_eq!(desk.heard()[2..], ["|QT|", "|SCIP2.0|", "|QT|", "Found { baud: 19200 }", "|VV|"]);
}

#[test]
fn sensor_in_time_mode_is_led_out() {
    let (mut frame, mut beams) = ([0; 2300], [Beam::BLANK; 682]);
    let mut desk = Desk::new(HokuyoConfig::default(), &mut frame, &mut beams);
    desk.wait();
    desk.reply("QT\n0Ee\n\n");
    desk.reply("TM2\n00P\n\n");
    desk.reply("QT\n00P\n\n");
    assert_eq!(desk.heard()[2..], ["|QT|", "|TM2|", "|QT|", "Found { baud: 19200 }", "|VV|"]);
}

#[test]
fn silence_tries_every_rate_and_says_so() {
    let (mut frame, mut beams) = ([0; 2300], [Beam::BLANK; 682]);
    let config = HokuyoConfig { baud: BaudPolicy::Raise(115_200), ..HokuyoConfig::default() };
    let mut desk = Desk::new(config, &mut frame, &mut beams);
    while !desk.said.last().unwrap().contains("no reply") {
        desk.wait();
    }
    assert_eq!(
        desk.heard().last().unwrap(),
        "finding the laser range finder: no reply to QT at 115200, 19200, 57600, 38400, 250000, 500000, 750000 baud; is it powered, is this the right port, and the right kind of sensor?"
    );
    assert!(desk.now.micros < 6_000_000, "{:?}", desk.now);
}

#[test]
fn rate_is_raised_and_verified() {
    let (mut frame, mut beams) = ([0; 2300], [Beam::BLANK; 682]);
    let config = HokuyoConfig { baud: BaudPolicy::Raise(115_200), ..HokuyoConfig::default() };
    let mut desk = Desk::new(config, &mut frame, &mut beams);
    while desk.said.last().unwrap() != "|" || !desk.said.contains(&String::from("baud 19200")) {
        desk.wait();
    }
    desk.wait();
    desk.reply("QT\n00P\n\n");
    desk.reply(VERSION);
    desk.reply(PARAMETERS);
    desk.reply("II\n00P\nSTAT:well;8\n\n");
    desk.heard();
    desk.reply("SS115200\n00P\n\n");
    desk.wait();
    desk.reply(VERSION);
    assert_eq!(desk.heard(), ["baud 115200", "|VV|", "|TM0|"]);
}

#[test]
fn eight_damaged_scans_begin_the_session_anew() {
    let (mut frame, mut beams) = ([0; 2300], [Beam::BLANK; 682]);
    let mut desk = Desk::new(HokuyoConfig::default(), &mut frame, &mut beams);
    to_streaming(&mut desk);
    desk.reply("MD0044072501000\n00P\n\n");
    desk.heard();
    for _ in 0..8 {
        desk.reply("MD0044072501000\n99b\n00QAb\n0EX=\n\n");
    }
    assert_eq!(desk.heard(), ["receiving scans: too many damaged scans in a row; is the cable good?"]);
    desk.wait();
    assert_eq!(desk.heard(), ["baud 19200", "|"]);
}

#[test]
fn unplugging_is_told_and_replugging_begins_anew() {
    let (mut frame, mut beams) = ([0; 2300], [Beam::BLANK; 682]);
    let mut desk = Desk::new(HokuyoConfig::default(), &mut frame, &mut beams);
    desk.give(Input::Disconnected);
    desk.give(Input::Connected);
    assert_eq!(desk.heard()[2..], ["the port: closed: unplugged?", "baud 19200", "|"]);
}

/// To the request for another rate.
fn to_rate(desk: &mut Desk<HokuyoDriver<'_>>) {
    while desk.said.last().unwrap() != "|" || !desk.said.contains(&String::from("baud 19200")) {
        desk.wait();
    }
    desk.wait();
    desk.reply("QT\n00P\n\n");
    desk.reply(VERSION);
    desk.reply(PARAMETERS);
    desk.reply("II\n00P\nSTAT:well;8\n\n");
    desk.heard();
}

#[test]
fn stop_waits_until_both_sides_have_changed_their_rate() {
    let (mut frame, mut beams) = ([0; 2300], [Beam::BLANK; 682]);
    let config = HokuyoConfig { baud: BaudPolicy::Raise(115_200), ..HokuyoConfig::default() };
    let mut desk = Desk::new(config, &mut frame, &mut beams);
    to_rate(&mut desk);
    desk.give(Input::Stop);
    assert!(desk.heard().is_empty(), "the sensor would answer at the other rate");
    desk.reply("SS115200\n00P\n\n");
    assert_eq!(desk.heard(), ["baud 115200"]);
    desk.wait();
    assert_eq!(desk.heard(), ["|QT|"]);
    desk.reply("QT\n00P\n\n");
    assert_eq!(desk.heard(), ["Stopped { laser_off: true }"]);
}

#[test]
fn refused_rate_is_told() {
    let (mut frame, mut beams) = ([0; 2300], [Beam::BLANK; 682]);
    let config = HokuyoConfig { baud: BaudPolicy::Raise(115_200), ..HokuyoConfig::default() };
    let mut desk = Desk::new(config, &mut frame, &mut beams);
    to_rate(&mut desk);
    desk.reply("SS115200\n02R\n\n");
    assert_eq!(desk.heard(), ["changing the baud rate: refused with status 02 to SS", "|TM0|"]);
}

#[test]
fn rate_that_no_sensor_has_is_told_and_not_asked_for() {
    let (mut frame, mut beams) = ([0; 2300], [Beam::BLANK; 682]);
    let config = HokuyoConfig { baud: BaudPolicy::Raise(9600), ..HokuyoConfig::default() };
    let mut desk = Desk::new(config, &mut frame, &mut beams);
    desk.wait();
    desk.reply("QT\n00P\n\n");
    desk.reply(VERSION);
    desk.reply(PARAMETERS);
    desk.heard();
    desk.reply("II\n00P\nSTAT:well;8\n\n");
    let heard = desk.heard();
    let said = "changing the baud rate: it does not have 9600 baud; the rate stays as it is";
    assert_eq!((heard[1].as_str(), heard[2].as_str()), (said, "|TM0|"), "{heard:?}");
}

/// It names the rate of a port that is not in use.
#[test]
fn urg_on_usb_is_known_by_the_rate_it_names() {
    for (named, streaming) in [
        ("19200[bps]<-Default setting by user;A", "Streaming { baud: 0, period: Duration { micros: 100000 } }"),
        ("115200[bps];M", "Streaming { baud: 115200, period: Duration { micros: 200000 } }"),
    ] {
        let (mut frame, mut beams) = ([0; 2300], [Beam::BLANK; 682]);
        let config = HokuyoConfig { baud: BaudPolicy::AtLeast(115_200), ..HokuyoConfig::default() };
        let mut desk = Desk::new(config, &mut frame, &mut beams);
        desk.wait();
        desk.reply("QT\n00P\n\n");
        desk.reply(VERSION);
        desk.reply(PARAMETERS);
        desk.reply(&std::format!("II\n00P\nSBPS:{named}\nSTAT:well;8\n\n"));
        desk.reply("TM0\n04T\n\n");
        desk.reply("BM\n00P\n\n");
        desk.reply("MD0044072501000\n00P\n\n");
        assert_eq!(desk.heard().last().unwrap(), streaming, "{named}");
    }
}
