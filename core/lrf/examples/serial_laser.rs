//! Reads a laser at a serial port and prints what it sees ahead.
//!
//! `cargo run -p lrfslam-lrf --example serial_laser -- /dev/ttyUSB0 sick`; `hokuyo` is the other one. With a third argument it ends after so
//! many scans.

use std::error::Error;
use std::io::ErrorKind;
use std::time::{Duration as Wait, Instant as Clock};

use lrfslam_lrf::driver::{Event, Input, LrfDriver, Output, run_input};
use lrfslam_lrf::hokuyo_scip::driver as hokuyo;
use lrfslam_lrf::hokuyo_scip::{HokuyoConfig, HokuyoDriver};
use lrfslam_lrf::scan::{Beam, Echo, RangeScan};
use lrfslam_lrf::sick_lms::driver as sick;
use lrfslam_lrf::sick_lms::{SickConfig, SickDriver};
use lrfslam_lrf::time::Instant;
use serialport::SerialPort;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [path, family, rest @ ..] = &arguments[..] else { return Err("expected a port and `sick` or `hokuyo`".into()) };
    let scans = rest.first().map_or(Ok(u32::MAX), |count| count.parse())?;
    let mut port = serialport::new(path, 9600).timeout(Wait::from_millis(20)).open()?;
    let (mut bytes, mut beams) = ([0; hokuyo::FRAME_MEMORY], [Beam::BLANK; hokuyo::BEAM_MEMORY]);
    match family.as_str() {
        "sick" => {
            let telegram = &mut bytes[..sick::TELEGRAM_MEMORY];
            read(&mut SickDriver::new(SickConfig::default(), telegram, &mut beams), &mut *port, scans)
        }
        "hokuyo" => read(&mut HokuyoDriver::new(HokuyoConfig::default(), &mut bytes, &mut beams), &mut *port, scans),
        other => Err(format!("{other}: expected `sick` or `hokuyo`").into()),
    }
}

/// Prints so many scans, then switches the laser off.
fn read(driver: &mut dyn LrfDriver, port: &mut dyn SerialPort, scans: u32) -> Result<(), Box<dyn Error>> {
    let started = Clock::now();
    let now = || Instant::from_micros(started.elapsed().as_micros() as i64);
    let (mut bytes, mut count, mut is_stopping, mut is_over) = ([0; 1024], 0, false, false);
    let mut input = Some(Input::Connected);
    let mut deadline = now();
    while !is_over {
        let mut failed = None;
        let mut act = |output: Output<'_>| {
            let done = match output {
                Output::Transmit(bytes) => port.write_all(bytes),
                Output::SetBaud(rate) => port.flush().and_then(|()| Ok(port.set_baud_rate(rate)?)),
                Output::Event(event) => {
                    tell(&event);
                    count += u32::from(matches!(event, Event::Scan(_)));
                    is_over |= matches!(event, Event::Stopped { .. });
                    Ok(())
                }
                Output::Timeout(_) => Ok(()),
            };
            failed = failed.take().or(done.err());
        };
        deadline = match input.take() {
            Some(input) => run_input(driver, now(), input, &mut act),
            None => deadline,
        };
        failed.map_or(Ok(()), Err)?;
        if count >= scans && !is_stopping {
            (is_stopping, input) = (true, Some(Input::Stop));
            continue;
        }
        input = match port.read(&mut bytes) {
            Ok(0) => return Err("the port is gone".into()),
            Ok(length) => Some(Input::Bytes(&bytes[..length])),
            Err(error) if error.kind() == ErrorKind::TimedOut => (now() >= deadline).then_some(Input::Timeout),
            Err(error) => return Err(error.into()),
        };
    }
    Ok(())
}

fn tell(event: &Event<'_>) {
    match event {
        Event::Scan(RangeScan { stamp, beams, .. }) => {
            let hits = beams.iter().filter(|beam| matches!(beam.echo, Echo::Hit(_))).count();
            let ahead = beams.iter().min_by(|a, b| a.bearing_rad.abs().total_cmp(&b.bearing_rad.abs()));
            let ahead = ahead.map(|beam| beam.echo);
            println!("{:.3} s: {} beams, {hits} hits, ahead {ahead:?}", stamp.as_secs_f64(), beams.len());
        }
        Event::Trouble(trouble) => println!("{trouble}"),
        event => println!("{event:?}"),
    }
}
