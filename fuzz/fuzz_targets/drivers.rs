//! Drivers: any inputs at any times; they take all bytes, come to rest, and never hand out more beams than fit.
#![no_main]

use libfuzzer_sys::fuzz_target;
use lrfslam_core::scan::{Beam, Echo};
use lrfslam_core::time::{Duration, Instant};
use lrfslam_lrf::driver::{BaudPolicy, Event, Input, LrfDriver, Output};
use lrfslam_lrf::hokuyo_scip::driver as hokuyo;
use lrfslam_lrf::hokuyo_scip::{HokuyoConfig, HokuyoDriver};
use lrfslam_lrf::sick_lms::driver as sick;
use lrfslam_lrf::sick_lms::telegram::{self, Direction};
use lrfslam_lrf::sick_lms::{SickConfig, SickDriver};

/// Answers that lead a driver on, so that what lies behind is reached.
const HELP: [&[u8]; 9] = [
    b"QT\n00P\n\n",
    b"VV\n00P\nSERI:H0706400;F\n\n",
    b"PP\n00P\nMODL:URG-04LX(Hokuyo Automatic Co.,Ltd.);N\nDMIN:20;4\nDMAX:5600;_\nARES:1024;\\\nAMIN:44;7\nAMAX:44;7\nAFRT:384;6\nSCAN:600;e\n\n",
    b"II\n00P\nSTAT:well;8\n\n",
    b"TM0\n01Q\n\n",
    b"BM\n00P\n\n",
    b"MD0044004401000\n00P\n\n",
    b"MD0044004401000\n99b\n00000\n0EX=\n\n",
    b"SS115200\n00P\n\n",
];

fn drain(driver: &mut dyn LrfDriver, now: Instant) -> Instant {
    for _ in 0..64 {
        match driver.poll_output() {
            Output::Timeout(deadline) => return deadline.max(now),
            Output::Event(Event::Scan(scan)) => assert!(scan.beams.len() <= 1081),
            _ => {}
        }
    }
    panic!("outputs without end");
}

fn run(driver: &mut dyn LrfDriver, input: &[u8]) {
    let mut now = Instant::default();
    let _ = driver.handle_input(now, Input::Connected);
    let mut deadline = drain(driver, now);
    let mut rest = input;
    while let Some((step, after)) = rest.split_first() {
        rest = after;
        let mut telegram = [0; 128];
        let bytes: &[u8] = match step {
            0..=8 => HELP[usize::from(*step)],
            9 => {
                now = deadline.min(now + Duration::from_millis(60_000));
                let _ = driver.handle_input(now, Input::Timeout);
                b""
            }
            10 | 11 | 12 => {
                let input = [Input::Disconnected, Input::Connected, Input::Stop][usize::from(step - 10)];
                let _ = driver.handle_input(now, input);
                b""
            }
            13..=76 => {
                let (payload, after) = rest.split_at(usize::from(step - 12).min(rest.len()));
                rest = after;
                let length = telegram::emit(Direction::ToHost, payload, &mut telegram).unwrap_or(0);
                &telegram[..length]
            }
            _ => {
                let (bytes, after) = rest.split_at(usize::from(step - 76).min(rest.len()));
                rest = after;
                now = now + Duration::from_millis(1);
                bytes
            }
        };
        deadline = drain(driver, now);
        let mut left = bytes;
        for _ in 0..1000 {
            let taken = driver.handle_input(now, Input::Bytes(left));
            left = &left[taken..];
            deadline = drain(driver, now);
            if left.is_empty() {
                break;
            }
        }
        assert!(left.is_empty(), "bytes not taken");
    }
}

fuzz_target!(|input: &[u8]| {
    let Some((which, input)) = input.split_first() else { return };
    let blank = Beam { bearing_rad: 0.0, offset: Duration::ZERO, echo: Echo::Invalid };
    let (mut bytes, mut beams) = (vec![0; hokuyo::FRAME_MEMORY], vec![blank; hokuyo::BEAM_MEMORY]);
    let baud = if which & 2 == 0 { BaudPolicy::Keep } else { BaudPolicy::Raise(115_200) };
    if which & 1 == 0 {
        run(&mut HokuyoDriver::new(HokuyoConfig { baud, ..HokuyoConfig::default() }, &mut bytes, &mut beams), input);
    } else {
        let config = SickConfig { baud, ..SickConfig::default() };
        run(&mut SickDriver::new(config, &mut bytes[..sick::TELEGRAM_MEMORY], &mut beams), input);
    }
});
