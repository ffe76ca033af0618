use super::*;
use crate::scenario::Scenario;

/// What `device` says to `text` within `ms`, `|` for line feeds.
fn ask(device: &mut VirtualHokuyo, now: &mut Instant, text: &str, ms: i64) -> String {
    let until = *now + Duration::from_millis(ms);
    device.receive(*now, text.replace('|', "\n").as_bytes());
    let mut said = Vec::new();
    loop {
        while let Some(emission) = device.poll() {
            said.extend(emission.bytes);
        }
        if device.deadline() > until {
            *now = until;
            return String::from_utf8(said).unwrap().replace('\n', "|");
        }
        *now = (*now).max(device.deadline());
        device.timeout(*now);
    }
}

fn sensor(model: HokuyoModel) -> (VirtualHokuyo, Instant) {
    (VirtualHokuyo::new(model, Box::new(Scenario::load("room").unwrap().scene()), 1), Instant::from_micros(1_000_000))
}

fn urg_in_scip2() -> (VirtualHokuyo, Instant) {
    let (mut device, mut now) = sensor(HokuyoModel::urg_04lx());
    assert_eq!(ask(&mut device, &mut now, "SCIP2.0|", 150), "SCIP2.0|0||");
    (device, now)
}

#[test]
fn urg_wakes_in_scip1() {
    let (mut device, mut now) = sensor(HokuyoModel::urg_04lx());
    assert_eq!(ask(&mut device, &mut now, "QT|", 150), "QT|E||");
    let version = ask(&mut device, &mut now, "V|", 150);
    assert!(version.starts_with("V|0|VEND:Hokuyo Automatic Co.,Ltd.|"), "{version}");
    assert!(version.ends_with("|SERI:H0700001|STAT:Sensor works well.||"), "{version}");
    let scan = ask(&mut device, &mut now, "G00076801|", 150);
    assert!(scan.starts_with("G00076801|0|0C0C0C0C0C"), "{scan}");
    let data: usize = scan.split('|').skip(2).map(str::len).sum();
    assert_eq!(data, 769 * 2);
}

#[test]
fn replies_of_the_capture_come_back() {
    let (mut device, mut now) = urg_in_scip2();
    assert_eq!(
        ask(&mut device, &mut now, "PP|", 150),
        "PP|00P|MODL:URG-04LX(Hokuyo Automatic Co.,Ltd.);N|DMIN:20;4|DMAX:5600;_|ARES:1024;\\|AMIN:44;7|AMAX:725;o|AFRT:384;6|SCAN:600;e||"
    );
    for (command, reply) in [
        ("QT|", "QT|00P||"),
        ("BM|", "BM|00P||"),
        ("BM|", "BM|02R||"),
        ("CR00|", "CR00|03S||"),
        ("XY|", "XY|0Ee||"),
        ("VV;0123456789ABCDEFG|", "VV;0123456789ABCDEFG|0Gg||"),
        ("TM1|", "TM1|04T||"),
        ("TM0|", "TM0|00P||"),
        ("QT|", "QT|0Ee||"),
        ("TM2|", "TM2|00P||"),
        ("TM2|", "TM2|03S||"),
        ("GD0044072501|", "GD0044072501|10Q||"),
        ("GD0044099901|", "GD0044099901|04T||"),
        ("MD0725004401000|", "MD0725004401000|05U||"),
        ("ME0044072501000|", "ME0044072501000|0Ee||"),
        ("SS123456|", "SS123456|02R||"),
        ("SS019200|", "SS019200|03S||"),
        ("HS0|", "HS0|0Cc||"),
        ("DB|", "DB|0Cc||"),
        ("DB01|", "DB01|00P||"),
        ("||", ""),
        ("VV|VV|", "VV|00P|VEND:"),
    ] {
        let said = ask(&mut device, &mut now, command, 150);
        assert!(said == reply || (command == "VV|VV|" && said.starts_with(reply)), "{command}: {said}");
        assert!(command != "VV|VV|" || said.ends_with("VV|0Bb||"), "{said}");
    }
    let (mut utm, mut now) = sensor(HokuyoModel::utm_30lx());
    assert_eq!(ask(&mut utm, &mut now, "CR00|", 50), "CR00|04T||");
    assert_eq!(ask(&mut utm, &mut now, "SS019200|", 50), "SS019200|04T||");
    assert!(ask(&mut utm, &mut now, "II|", 50).contains("SBPS:USB Full Speed;P|"));
}

#[test]
fn string_comes_back_in_every_echo() {
    let (mut device, mut now) = sensor(HokuyoModel::utm_30lx());
    let said = ask(&mut device, &mut now, "MD0540054001002;id 1|", 200);
    let echoes: Vec<&str> = said.split('|').filter(|line| line.starts_with("MD")).collect();
    assert_eq!(echoes, ["MD0540054001002;id 1", "MD0540054001001;id 1", "MD0540054001000;id 1"]);
    assert!(ask(&mut device, &mut now, "II|", 50).contains("LASR:OFF;7"), "off again after the last scan");
}

#[test]
fn commands_are_answered_on_turns_and_at_once_in_time_mode() {
    let (mut device, mut now) = urg_in_scip2();
    now = now + Duration::from_millis(13);
    device.receive(now, b"QT\n");
    assert_eq!(device.deadline().micros % 100_000, 0);
    ask(&mut device, &mut now, "TM0|", 200);
    now = now + Duration::from_millis(13);
    device.receive(now, b"TM1\n");
    assert_eq!(device.deadline().since(now), Duration::from_millis(1));
}

#[test]
fn line_sets_the_rate_of_scans() {
    for (baud, scans_in_10_s) in [(19_200, 8..=9), (115_200, 50..=51), (750_000, 99..=101)] {
        let (mut device, mut now) = urg_in_scip2();
        device.set_baud(baud);
        ask(&mut device, &mut now, "MD0044072501000|", 2000);
        let said = ask(&mut device, &mut now, "", 10_000);
        let scans = said.matches("|99b|").count();
        assert!(scans_in_10_s.contains(&scans), "{scans} scans at {baud}");
    }
}

#[test]
fn rate_changes_after_the_reply() {
    let (mut device, mut now) = urg_in_scip2();
    device.receive(now, b"SS115200\n");
    now = device.deadline();
    device.timeout(now);
    let reply = device.poll().unwrap();
    assert_eq!((reply.baud, &reply.bytes[..]), (Some(19_200), &b"SS115200\n00P\n\n"[..]));
    assert_eq!(device.baud(now), Some(19_200));
    assert_eq!(device.baud(now + Duration::from_millis(8)), Some(115_200));
}

#[test]
fn second_reboot_within_a_second_reboots() {
    let (mut device, mut now) = urg_in_scip2();
    assert_eq!(ask(&mut device, &mut now, "RB|", 150), "RB|01Q||");
    assert_eq!(ask(&mut device, &mut now, "RB|", 150), "RB|00P||");
    assert_eq!(ask(&mut device, &mut now, "QT|", 200), "", "still booting");
    now = now + Duration::from_millis(2000);
    assert_eq!(ask(&mut device, &mut now, "QT|", 200), "QT|E||");
}

#[test]
fn urg_on_usb_wakes_in_scip1_and_sends_every_turn() {
    let (mut device, mut now) = sensor(HokuyoModel::urg_04lx_usb());
    assert_eq!(ask(&mut device, &mut now, "QT|", 150), "QT|E||");
    assert_eq!(ask(&mut device, &mut now, "SCIP2.0|", 150), "SCIP2.0|0||");
    assert!(ask(&mut device, &mut now, "II|", 150).contains("|SBPS:19200[bps]<-Default setting by user;A|"));
    assert_eq!(ask(&mut device, &mut now, "SS115200|", 150), "SS115200|00P||");
    assert!(ask(&mut device, &mut now, "II|", 150).contains("|SBPS:115200[bps];"));
    ask(&mut device, &mut now, "MD0044072501000|", 1000);
    let scans = ask(&mut device, &mut now, "", 5000).matches("|99b|").count();
    assert!((49..=51).contains(&scans), "{scans}");
}

#[test]
fn slower_motor_turns_slower_and_says_so() {
    let (mut device, mut now) = sensor(HokuyoModel::urg_04lx_usb());
    ask(&mut device, &mut now, "SCIP2.0|", 150);
    assert!(ask(&mut device, &mut now, "II|", 150).contains("|SCSP:Initial(600[rpm])<-Default setting by user;A|"));
    assert_eq!(ask(&mut device, &mut now, "CR10|", 150), "CR10|00P||");
    assert!(ask(&mut device, &mut now, "II|", 150).contains("|SCSP:Level 10(540[rpm]);"));
    ask(&mut device, &mut now, "MD0044072501000|", 1000);
    let scans = ask(&mut device, &mut now, "", 10_000).matches("|99b|").count();
    assert!((89..=91).contains(&scans), "{scans}");
    ask(&mut device, &mut now, "QT|", 200);
    assert_eq!(ask(&mut device, &mut now, "CR99|", 200), "CR99|00P||");
    assert!(ask(&mut device, &mut now, "II|", 150).contains("|SCSP:Initial(600[rpm])"));
}

#[test]
fn time_has_six_digits() {
    let (mut device, mut now) = sensor(HokuyoModel::utm_30lx());
    let information = ask(&mut device, &mut now, "II|", 50);
    let time = information.split('|').find_map(|line| line.strip_prefix("TIME:")).unwrap();
    let (digits, _) = time.split_once(';').unwrap();
    assert!(digits.len() == 6 && digits.starts_with("000"), "{time}");
}
