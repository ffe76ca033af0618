//! Lasers without a simulator, played over a link in memory.

mod memory_link;

use std::sync::mpsc::RecvTimeoutError;
use std::time::Duration as WallDuration;

use lrfslam_lrf::ldrobot::{Packet, Point};
use lrfslam_lrf::rplidar::{Capsule, Descriptor, Request, ResponseKind};

use self::memory_link::{FarEnd, Sent, memory_pair};
use super::*;
use crate::scans::family::LrfFamily;
use crate::scans::recording::RecordingReader;

/// An A1: samples every 0.9 degrees, 12 turns a second, and only at its own rate.
fn play_rplidar(far: &FarEnd) {
    let send = |kind, response: &[u8]| {
        let _ = far.to_host.send([&Descriptor { kind }.emit()[..], response].concat());
    };
    let (mut baud, mut packets, mut scans) = (0, 0_usize, false);
    loop {
        match far.from_host.recv_timeout(WallDuration::from_millis(7)) {
            Ok(Sent::Baud(rate)) => baud = rate,
            Ok(Sent::Bytes(bytes)) if baud == 115_200 => match Request::parse(&bytes) {
                Some(Request::GetInfo) => send(ResponseKind::Info, &[0x18; 20]),
                Some(Request::GetHealth) => send(ResponseKind::Health, &[0; 3]),
                Some(Request::ExpressScan) => {
                    scans = true;
                    send(ResponseKind::Capsule, &[]);
                }
                Some(Request::Stop) => scans = false,
                _ => {}
            },
            Ok(_) => {}
            Err(RecvTimeoutError::Timeout) if scans => {
                let start_deg = (packets * 32) as f32 * 0.9 % 360.0;
                let capsule = Capsule::build(false, packets == 0, start_deg, &[2000; 32]);
                let _ = far.to_host.send(capsule.bytes().to_vec());
                packets += 1;
            }
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return,
        }
    }
}

/// An LD06, ten turns a second, which is heard at its own rate only.
fn play_ld06(far: &FarEnd) {
    let mut baud = 0;
    for index in 0.. {
        match far.from_host.recv_timeout(WallDuration::from_micros(2667)) {
            Ok(Sent::Baud(rate)) => baud = rate,
            Err(RecvTimeoutError::Disconnected) => return,
            Ok(Sent::Bytes(_)) | Err(RecvTimeoutError::Timeout) => {}
        }
        let cdeg = |sample: i64| ((index * 12 + sample) * 80 % 36_000) as u16;
        let points = [Point { distance_mm: 1500, intensity: 200 }; 12];
        let stamp_ms = (index * 12_000 / 4500 % 30_000) as u16;
        let packet = Packet { speed_degps: 3600, start_cdeg: cdeg(0), points, end_cdeg: cdeg(11), stamp_ms };
        if baud == 230_400 {
            let _ = far.to_host.send(packet.emit().to_vec());
        }
    }
}

/// A source that ended after `scans` scans, and what it said.
struct Heard {
    said: Vec<String>,
    scans: u32,
    done: anyhow::Result<SourceReport>,
}

/// Listens to `play` as `laser` until `scans` scans came.
fn listen(laser: &LiveLaser, play: fn(&FarEnd), scans: u32) -> Heard {
    let (link, far) = memory_pair();
    let mut link = Some(link);
    let mut open =
        || link.take().map_or_else(|| Err(std::io::ErrorKind::NotFound.into()), |link| Ok(Box::new(link) as _));
    let mut heard = Heard { said: Vec::new(), scans: 0, done: Ok(SourceReport::default()) };
    std::thread::scope(|scope| {
        scope.spawn(move || play(&far));
        heard.done = live_over(laser, &mut open, &AtomicBool::new(false), &mut |item| {
            match item {
                Item::Scan(_) => heard.scans += 1,
                Item::Said(text) => heard.said.push(text.to_owned()),
                Item::Identified(_) => {}
            }
            if heard.scans >= scans { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        });
    });
    heard
}

fn any_laser(record: Option<RecordPlan>) -> LiveLaser {
    let options = LrfOptions::new(LrfFamily::Hokuyo);
    let address = Address::Serial("memory".into());
    LiveLaser { any_family: true, record, ..LiveLaser::new(address, options) }
}

/// Finds `play`, and replays what was recorded of it.
fn found(play: fn(&FarEnd), family: LrfFamily) -> Vec<String> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("results/laser.rec");
    let heard = listen(&any_laser(Some(RecordPlan::new(&path))), play, 5);
    let report = heard.done.unwrap();
    assert!(heard.scans >= 5, "{:?}", heard.said);
    let recording = report.recording.expect("recorded");
    assert_eq!((&recording.path, recording.fault), (&path, None));
    assert_eq!(recording.bytes, std::fs::metadata(&path).unwrap().len());
    assert_eq!(RecordingReader::open(&path).unwrap().header().lrf.family, family);
    let mut scans = 0;
    let source = ScanSource::Recording { path, fast: true };
    let replayed = for_each_scan(&source, &AtomicBool::new(false), &mut |item| {
        scans += u32::from(matches!(item, Item::Scan(_)));
        ControlFlow::Continue(())
    });
    let replayed = replayed.unwrap();
    assert_eq!((replayed.input, replayed.input_fault()), (Some(RecordingEnd::WHOLE), None));
    assert_eq!((scans, replayed.counters.scans), (report.counters.scans, report.counters.scans));
    heard.said
}

#[test]
fn an_rplidar_is_found_out_and_recorded() {
    let said = found(play_rplidar, LrfFamily::Rplidar);
    let words = "found an RPLIDAR model 0x18, hardware 24 at 115200 baud; the same without searching: --lrf rplidar";
    assert!(said.iter().any(|text| text == words), "{said:?}");
}

#[test]
fn an_ld06_is_found_out_and_recorded() {
    let said = found(play_ld06, LrfFamily::Ld06);
    let words = "found an LD06 or LD19 at 230400 baud; the same without searching: --lrf ld06";
    assert!(said.iter().any(|text| text == words), "{said:?}");
}

#[test]
fn another_laser_than_was_asked_for_is_named() {
    let laser = LiveLaser { any_family: false, ..any_laser(None) };
    let heard = listen(&laser, play_ld06, 1);
    assert_eq!(
        heard.done.unwrap_err().to_string(),
        "memory: no Hokuyo answers, but an LD06 does at 230400 baud: try --lrf ld06"
    );
    assert_eq!(heard.scans, 0);
    let vain = heard.said.iter().filter(|text| text.contains("no reply")).count();
    assert_eq!(vain, 1, "said once: {:?}", heard.said);
}
