//! Answers to commands.

use lrfslam_core::time::{Duration, Instant};
use lrfslam_lrf::hokuyo_scip::command::split_tag;
use lrfslam_lrf::hokuyo_scip::parameters::emit_info;
use lrfslam_lrf::hokuyo_scip::{Acquire, Command, Encoding, Status, TimeMode, code};

use super::{POWER_UP_BAUD, Stream, VirtualHokuyo};
use crate::virtual_lrf::VirtualLrf;

/// Rates that `SS` takes, bit/s.
const RATES: [u32; 7] = [19_200, 38_400, 57_600, 115_200, 250_000, 500_000, 750_000];
/// A second `RB` must come within this time.
const REBOOT_WINDOW: Duration = Duration::from_millis(1000);

impl VirtualHokuyo {
    pub(super) fn answer(&mut self, now: Instant, line: &[u8]) {
        if self.scip1 {
            return self.answer_scip1(now, line);
        }
        let (command, tag) = match split_tag(line) {
            Ok((command, tag)) => (Command::parse(command), tag.unwrap_or(b"").to_vec()),
            Err(status) => return self.reply(now, line, status, ""),
        };
        match command {
            Err(status) => self.reply(now, line, status, ""),
            Ok(command) => self.obey(now, line, command, tag),
        }
    }

    fn obey(&mut self, now: Instant, line: &[u8], command: Command, tag: Vec<u8>) {
        let status = match command {
            Command::Version => return self.reply(now, line, Status::OK, &self.version()),
            Command::Parameters => {
                let mut body = String::new();
                // A String takes everything.
                let _ = self.model.parameters.emit(&mut body);
                return self.reply(now, line, Status::OK, &body);
            }
            Command::Information => return self.reply(now, line, Status::OK, &self.information(now)),
            Command::Quit => return self.quit(now, line),
            Command::Reset | Command::ResetKeepingRate => return self.reset(now, line, command == Command::Reset),
            Command::Reboot => return self.reboot(now, line),
            Command::Get(acquire) => return self.get(now, line, &acquire),
            Command::Stream { acquire, interval, count } => {
                return self.start(now, line, command, (acquire, interval, count), tag);
            }
            Command::Time(mode) => return self.time(now, line, mode),
            Command::BitRate(rate) => return self.set_rate(now, line, rate),
            Command::LaserOn if self.time_mode => Status::UNDEFINED,
            Command::LaserOn if std::mem::replace(&mut self.laser_on, true) => Status::code(2),
            Command::LaserOn => Status::OK,
            Command::MotorSpeed(speed) => self.set_motor(now, speed),
            Command::Sensitivity(_) => self.set_sensitivity(),
            Command::Malfunction(1..=5 | 10) => Status::OK,
            Command::Malfunction(_) => Status::code(2),
            // These are of SCIP 2.2, or of 1.1.
            Command::SwitchToScip2 | Command::State | Command::Sleep => Status::UNDEFINED,
        };
        self.reply(now, line, status, "");
    }

    /// `echo LF status sum LF body LF`; the body's lines end with a line feed already.
    pub(super) fn reply(&mut self, now: Instant, echo: &[u8], status: Status, body: &str) {
        let characters = status.bytes();
        let mut bytes = echo.to_vec();
        bytes.push(b'\n');
        bytes.extend(characters);
        bytes.push(code::sum(&characters));
        bytes.push(b'\n');
        bytes.extend(body.as_bytes());
        bytes.push(b'\n');
        self.line.send(now, bytes);
    }

    /// Takes away further copies of `line` that came before its answer: how many.
    pub(super) fn drop_repetitions(&mut self, line: &[u8]) -> usize {
        let before = self.queue.len();
        self.queue.retain(|(_, other)| other != line);
        before - self.queue.len()
    }

    pub(super) fn refuse_repetition(&mut self, now: Instant, line: &[u8]) {
        if !self.scip1 {
            self.reply(now, line, Status::REPEATED, "");
        }
    }

    fn version(&self) -> String {
        info(&[
            ("VEND", "Hokuyo Automatic Co.,Ltd."),
            ("PROD", self.model.product),
            ("FIRM", self.model.firmware),
            ("PROT", "SCIP 2.0"),
            ("SERI", self.model.serial),
        ])
    }

    fn information(&self, now: Instant) -> String {
        let rate = match self.said_baud {
            _ if !self.model.has_serial_port => "USB Full Speed".to_owned(),
            POWER_UP_BAUD => format!("{POWER_UP_BAUD}[bps]<-Default setting by user"),
            rate => format!("{rate}[bps]"),
        };
        let speed = self.turns_per_minute();
        let motor = match self.motor {
            0 => format!("Initial({speed}[rpm])<-Default setting by user"),
            level => format!("Level {level}({speed}[rpm])"),
        };
        info(&[
            ("MODL", &self.model.parameters.model),
            ("LASR", if self.laser_on { "ON" } else { "OFF" }),
            ("SCSP", &motor),
            ("MESM", if self.laser_on { "CLASSIC" } else { "IDLE" }),
            ("SBPS", &rate),
            ("TIME", &format!("{:06X}", self.clock_ms(now))),
            ("STAT", "Sensor works well."),
        ])
    }

    /// A URG-04LX in time mode does not know `QT`; a UTM leaves the mode.
    fn quit(&mut self, now: Instant, line: &[u8]) {
        if self.time_mode && self.model.starts_in_scip1 {
            return self.reply(now, line, Status::UNDEFINED, "");
        }
        self.time_mode = false;
        self.switch_off();
        self.reply(now, line, Status::OK, "");
    }

    fn switch_off(&mut self) {
        self.stream = None;
        self.laser_on = false;
    }

    fn reset(&mut self, now: Instant, line: &[u8], everything: bool) {
        self.switch_off();
        (self.time_mode, self.zero, self.clock_start_ms) = (false, now, 0);
        self.reply(now, line, Status::OK, "");
        if everything {
            self.motor = 0;
            self.believe(POWER_UP_BAUD);
        }
        self.turns_from = now;
    }

    /// Goes to another rate, once everything said so far is out; on USB it only says so.
    pub(super) fn believe(&mut self, baud: u32) {
        self.said_baud = baud;
        self.line.change_rate(baud);
    }

    fn reboot(&mut self, now: Instant, line: &[u8]) {
        let asked = self.reboot_asked_at.take().is_some_and(|at| now.since(at) <= REBOOT_WINDOW);
        if asked {
            self.reply(now, line, Status::OK, "");
            let answer = self.line.clone();
            self.power_on(now);
            self.line = answer;
            self.believe(POWER_UP_BAUD);
        } else {
            self.reboot_asked_at = Some(now);
            self.reply(now, line, Status::code(1), "");
        }
    }

    /// The status of a request for ranges that cannot be; `None` if it can.
    fn refusal(&self, acquire: &Acquire) -> Option<Status> {
        let last_step = self.model.parameters.steps_per_turn * 3 / 4;
        let cannot = acquire.multi_echo || (acquire.encoding == Encoding::Intensity && !self.model.has_intensity);
        if cannot || self.time_mode {
            return Some(Status::UNDEFINED);
        }
        let end = self.model.parameters.step_max.max(last_step);
        (acquire.last > end)
            .then_some(Status::code(4))
            .or_else(|| (acquire.last < acquire.first).then_some(Status::code(5)))
    }

    fn get(&mut self, now: Instant, line: &[u8], acquire: &Acquire) {
        if let Some(status) = self.refusal(acquire) {
            return self.reply(now, line, status, "");
        }
        if !self.laser_on {
            return self.reply(now, line, Status::LASER_OFF, "");
        }
        let body = self.scan_body(self.turn_start(self.turn_at(now) - 1), acquire);
        self.reply(now, line, Status::OK, &body);
    }

    fn start(&mut self, now: Instant, line: &[u8], command: Command, what: (Acquire, u8, u8), tag: Vec<u8>) {
        let (acquire, interval, count) = what;
        if let Some(status) = self.refusal(&acquire) {
            return self.reply(now, line, status, "");
        }
        self.laser_on = true;
        self.next_turn = self.turn_at(now);
        self.sight.stream_from(now);
        let remaining = (count > 0).then_some(count);
        self.stream = Some(Stream { command, acquire, tag, interval, remaining, skip: 0 });
        self.reply(now, line, Status::OK, "");
    }

    fn time(&mut self, now: Instant, line: &[u8], mode: TimeMode) {
        let is_urg = self.model.starts_in_scip1;
        let status = match mode {
            TimeMode::Enter if self.time_mode && is_urg => Status::code(2),
            TimeMode::Leave if !self.time_mode => Status::code(3),
            TimeMode::Read if !self.time_mode && is_urg => Status::code(4),
            _ => Status::OK,
        };
        match mode {
            TimeMode::Enter => {
                self.switch_off();
                self.time_mode = true;
            }
            TimeMode::Leave => self.time_mode = false,
            TimeMode::Read => {}
        }
        let mut body = String::new();
        if mode == TimeMode::Read && status == Status::OK {
            body = self.stamp_line(self.clock_ms(now));
        }
        self.reply(now, line, status, &body);
    }

    fn set_rate(&mut self, now: Instant, line: &[u8], rate: u32) {
        let status = match self.line.baud(now).unwrap_or(self.said_baud) {
            _ if !self.model.has_serial_port => Status::code(4),
            _ if !RATES.contains(&rate) => Status::code(2),
            holds if holds == rate => Status::code(3),
            _ => Status::OK,
        };
        self.reply(now, line, status, "");
        if status == Status::OK {
            self.believe(rate);
        }
    }

    /// Each step makes the motor 1 % slower (drivers).
    fn set_motor(&mut self, now: Instant, speed: u8) -> Status {
        match speed {
            _ if !self.model.has_serial_port => Status::code(4),
            11..=98 | 100.. => Status::code(2),
            same if same == self.motor => Status::code(3),
            // 99 is the usual speed again.
            new => {
                self.motor = new % 99;
                (self.turns_from, self.next_turn) = (now, 0);
                Status::OK
            }
        }
    }

    /// A URG-04LX calls it too short, with one digit (capture).
    fn set_sensitivity(&self) -> Status {
        if self.model.has_serial_port { Status::TOO_SHORT } else { Status::code(3) }
    }

    /// Four characters, their sum, line feed.
    pub(super) fn stamp_line(&self, ms: u32) -> String {
        let mut characters = [0; 4];
        code::encode(u64::from(ms), &mut characters);
        let mut line: String = characters.iter().map(|character| char::from(*character)).collect();
        line.push(char::from(code::sum(&characters)));
        line.push('\n');
        line
    }
}

fn info(lines: &[(&str, &str)]) -> String {
    let mut body = String::new();
    for (key, value) in lines {
        // A String takes everything.
        let _ = emit_info(&mut body, key, value);
    }
    body
}
