//! Reads scans of a SICK at a serial port: `read-sick PORT SCANS`.

use std::io::{self, ErrorKind, Read as _};
use std::time::{Duration as Wait, Instant as Clock};

use lrfslam_lrf::driver::{Event, Input, LrfDriver, Output, drain, run_bytes};
use lrfslam_lrf::scan::{Beam, Echo};
use lrfslam_lrf::sick_lms::driver::{BEAM_MEMORY, SickConfig, SickDriver, TELEGRAM_MEMORY};
use lrfslam_lrf::time::Instant;
use serialport::SerialPort;

/// Longer than a SICK takes from any state to its first scan.
const PATIENCE: Wait = Wait::from_secs(30);

#[derive(Default)]
struct Seen {
    scans: usize,
    beams: usize,
    hits: usize,
    stopped: bool,
    broken: Option<io::Error>,
}

fn act(port: &mut dyn SerialPort, seen: &mut Seen, output: Output<'_>) {
    let done = match output {
        Output::Transmit(bytes) => port.write_all(bytes),
        Output::SetBaud(rate) => port.flush().and_then(|()| port.set_baud_rate(rate).map_err(io::Error::from)),
        Output::Event(Event::Scan(scan)) => {
            seen.scans += 1;
            seen.beams += scan.beams.len();
            seen.hits += scan.beams.iter().filter(|beam| matches!(beam.echo, Echo::Hit(_))).count();
            Ok(())
        }
        Output::Event(Event::Stopped { laser_off }) => {
            seen.stopped = true;
            println!("stopped, laser off: {laser_off}");
            Ok(())
        }
        Output::Event(event) => {
            println!("{event:?}");
            Ok(())
        }
        Output::Timeout(_) => Ok(()),
    };
    seen.broken = seen.broken.take().or(done.err());
}

fn main() -> io::Result<()> {
    let arguments: Vec<String> = std::env::args().collect();
    let (path, wanted) = (&arguments[1], arguments[2].parse::<usize>().expect("a number of scans"));
    let mut port = serialport::new(path, 9600).timeout(Wait::from_millis(10)).open()?;
    let (mut telegram, mut beams) = ([0; TELEGRAM_MEMORY], [Beam::BLANK; BEAM_MEMORY]);
    let mut driver = SickDriver::new(SickConfig::default(), &mut telegram, &mut beams);
    let began = Clock::now();
    let now = || Instant::from_micros(began.elapsed().as_micros() as i64);
    let mut seen = Seen::default();
    let _ = driver.handle_input(now(), Input::Connected);
    let mut deadline = drain(&mut driver, &mut |output| act(&mut *port, &mut seen, output));
    let (mut buffer, mut is_stopping) = ([0; 512], false);
    while !seen.stopped {
        assert!(began.elapsed() < PATIENCE, "{} scans of {wanted} in {PATIENCE:?}", seen.scans);
        let input = match port.read(&mut buffer) {
            _ if seen.scans >= wanted && !is_stopping => {
                is_stopping = true;
                Some(Input::Stop)
            }
            Ok(count) => Some(Input::Bytes(&buffer[..count])),
            Err(error) if error.kind() == ErrorKind::TimedOut => (now() >= deadline).then_some(Input::Timeout),
            Err(error) => return Err(error),
        };
        let mut act = |output: Output<'_>| act(&mut *port, &mut seen, output);
        deadline = match input {
            Some(Input::Bytes(bytes)) => run_bytes(&mut driver, now(), bytes, &mut act),
            Some(input) => {
                let _ = driver.handle_input(now(), input);
                drain(&mut driver, &mut act)
            }
            None => deadline,
        };
        if let Some(error) = seen.broken.take() {
            return Err(error);
        }
    }
    println!("{} scans, {} beams, {} hits", seen.scans, seen.beams, seen.hits);
    assert!(seen.hits * 2 > seen.beams, "a room has walls");
    Ok(())
}
