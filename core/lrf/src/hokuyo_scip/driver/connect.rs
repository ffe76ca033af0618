//! From an open port to a sensor that is known, at the rate asked for, its clock compared.

use super::{Ask, Dialogue};
use crate::clock::{ClockOffset, MAX_EXCHANGES, PERIOD_24_BIT_MS, Stamp, StampUnwrapper};
use crate::dialogue::{DialogueBase, Patience, Pending, State, wire_time};
use crate::driver::{BaudPolicy, BaudRates, Cause, Identity, Step};
use crate::hokuyo_scip::command::Acquire;
use crate::hokuyo_scip::parameters::{SensorParameters, cut};
use crate::hokuyo_scip::reply::{Reply, Status};
use crate::session::{Question as _, Session};
use lrfslam_scan::time::{Duration, Instant};

/// Rates of the `SS` command, the power-up rate first, bit/s.
pub const RATES: [u32; 7] = [19_200, 115_200, 57_600, 38_400, 250_000, 500_000, 750_000];
/// Silence after which a line is called quiet: longer than a turn of the slowest motor.
const QUIET: Duration = Duration::from_millis(140);
/// A streaming sensor is never quiet: then `QT` goes out all the same.
const QUIET_AT_MOST: Duration = Duration::from_millis(300);
/// A sensor switches after its reply is out; drivers wait at least 150 ms.
const SETTLE: Duration = Duration::from_millis(200);
/// Attempts to lead a sensor out of SCIP 1.1 or time mode at one rate.
const MAX_DETOURS: u8 = 3;

impl Session for Dialogue<'_> {
    type Ask = Ask;

    fn base(&mut self) -> &mut DialogueBase<Ask> {
        &mut self.base
    }

    fn forget(&mut self) -> BaudRates {
        self.is_usb = false;
        self.stamps = StampUnwrapper::new(PERIOD_24_BIT_MS);
        self.offset = ClockOffset::default();
        self.config.baud.rates(self.base.last_good_baud, &RATES)
    }

    /// A line feed ends half a command; then it listens until it is quiet.
    fn look(&mut self, now: Instant) {
        self.base.set_rate();
        self.base.outbox.transmit(b"\n");
        self.noise = Default::default();
        self.detours = 0;
        self.base.state = State::Pausing(Ask::Quit);
        self.base.patience = Patience::new(now, QUIET, QUIET_AT_MOST);
    }

    fn changes_rate(&self, ask: Ask) -> bool {
        ask == Ask::Rate
    }

    fn attempts(&self, ask: Ask) -> u8 {
        match ask {
            Ask::Quit => u8::from(self.base.rate_index == 0),
            _ => 2,
        }
    }

    fn send(&mut self, now: Instant, ask: Ask) {
        let command = self.command(ask).emit();
        let mut line: heapless::Vec<u8, 24> = heapless::Vec::new();
        // The line feed before ends what is left of a damaged command; an empty line is ignored.
        let _ = line.push(b'\n');
        let _ = line.extend_from_slice(&command);
        let _ = line.push(b'\n');
        self.base.outbox.transmit(&line);
        self.sent_at = now;
        self.base.patience = Patience::new(now, self.reply_wait(), Duration::from_millis(3000));
    }

    fn on_no_reply(&mut self, now: Instant, ask: Ask) {
        match ask {
            Ask::Quit | Ask::SwitchToScip2 | Ask::LeaveTime => self.try_next_rate(now),
            // Not every model has a clock to read.
            Ask::EnterTime | Ask::ReadTime => self.ask(now, Ask::EndTime),
            Ask::EndTime => self.ask(now, Ask::LaserOn),
            Ask::Stop => self.base.stopped(false),
            _ => self.fail(now, ask, Cause::NoReply),
        }
    }
}

impl Dialogue<'_> {
    /// A sensor answers at its next turn (100 ms for the slowest), and the longest reply has 250 bytes.
    fn reply_wait(&self) -> Duration {
        Duration::from_micros(400_000 + wire_time(250, self.line_baud()).micros)
    }

    pub(super) fn on_bytes(&mut self, now: Instant, bytes: &[u8]) {
        match self.base.state {
            State::Pausing(Ask::Quit) => self.base.patience.put_off(now, QUIET),
            State::Asking(Ask::Quit) => {
                self.noise.add(bytes);
                if self.noise.is_wrong_rate() {
                    return self.try_next_rate(now);
                }
                self.base.patience.put_off(now, Duration::from_millis(250));
            }
            State::Asking(_) => self.base.patience.put_off(now, Duration::from_millis(250)),
            _ => {}
        }
    }

    pub(super) fn on_reply(&mut self, now: Instant, ask: Ask, reply: &Reply<'_>) {
        let refused = Cause::Refused(reply.status.bytes());
        match ask {
            Ask::Quit => self.on_quit(now, reply.status),
            Ask::SwitchToScip2 | Ask::LeaveTime => self.ask(now, Ask::Quit),
            Ask::Version => self.on_version(now, reply),
            Ask::Parameters => self.on_parameters(now, reply),
            Ask::Information => self.on_information(now, reply),
            Ask::Rate => self.on_rate(now, reply.status),
            Ask::VerifyRate => self.compare_clocks(now),
            Ask::EnterTime if matches!(reply.status.number(), Some(0 | 2)) => self.ask(now, Ask::ReadTime),
            Ask::ReadTime => self.on_time(now, reply),
            Ask::EnterTime | Ask::EndTime => self.ask(now, Ask::LaserOn),
            Ask::LaserOn if reply.status == Status::code(1) => {
                self.fail(now, ask, Cause::HardwareFault(reply.status.bytes()));
            }
            Ask::LaserOn => self.ask(now, Ask::Stream),
            Ask::Stream if reply.status == Status::OK => self.begin_streaming(now),
            Ask::Stream if reply.status == Status::SCAN => self.on_scan(now, reply),
            Ask::Stream => self.fail(now, ask, refused),
            Ask::Stop => self.base.stopped(true),
        }
    }

    /// `00` is SCIP 2; one character is SCIP 1.1; `0E` is time mode, in which a URG-04LX knows no `QT`.
    fn on_quit(&mut self, now: Instant, status: Status) {
        if status == Status::OK {
            self.base.found();
            return self.ask(now, Ask::Version);
        }
        self.detours += 1;
        if self.detours > MAX_DETOURS {
            return self.fail(now, Ask::Quit, Cause::Refused(status.bytes()));
        }
        self.ask(now, if status.is_scip1() { Ask::SwitchToScip2 } else { Ask::LeaveTime });
    }

    fn on_version(&mut self, now: Instant, reply: &Reply<'_>) {
        self.base.identity = Identity::default();
        for line in reply.info() {
            match line.key {
                "PROD" => self.base.identity.model = cut(line.value),
                "FIRM" => self.base.identity.firmware = cut(line.value),
                "SERI" => self.base.identity.serial = cut(line.value),
                _ => {}
            }
        }
        self.ask(now, Ask::Parameters);
    }

    fn on_parameters(&mut self, now: Instant, reply: &Reply<'_>) {
        let damaged = reply.info().any(|line| !line.sum_is_right);
        // A wrong sum may be the sensor's own habit: ask again, and in the end take it.
        if damaged && self.base.attempts_left > 0 {
            return;
        }
        let Some(parameters) = SensorParameters::parse(reply) else {
            return self.fail(now, Ask::Parameters, Cause::BadParameters);
        };
        let full = parameters.full_view();
        let (first, last) = self.config.steps.unwrap_or((full.first, full.last));
        self.acquire = Acquire { encoding: self.config.encoding, first, last, cluster: self.config.cluster, ..full };
        self.base.identity.model = parameters.model.clone();
        self.base.identity.angle_min_rad = parameters.bearing_rad(f32::from(first));
        self.base.identity.angle_max_rad = parameters.bearing_rad(f32::from(last));
        self.base.identity.beams = self.acquire.value_counts().0;
        self.base.identity.turn = parameters.turn();
        self.base.identity.range_max_m = parameters.distance_max_mm as f32 / 1000.0;
        self.parameters = Some(parameters);
        self.ask(now, Ask::Information);
    }

    fn on_information(&mut self, now: Instant, reply: &Reply<'_>) {
        for line in reply.info() {
            match line.key {
                "STAT" => self.base.identity.state = cut(line.value),
                // Not by `str::contains`: panics that nothing reaches come with it into a microcontroller's image.
                "SBPS" => {
                    self.is_usb = line.value.as_bytes().windows(3).any(|text| text == b"USB")
                        || says_slower(line.value, self.base.baud)
                }
                _ => {}
            }
        }
        self.base.outbox.push(Pending::Identified);
        let change = !self.is_usb && self.base.wants_raise(self.config.baud, &RATES);
        if change { self.ask(now, Ask::Rate) } else { self.compare_clocks(now) }
    }

    fn on_rate(&mut self, now: Instant, status: Status) {
        if status != Status::OK {
            // 03: it has that rate already; 02, 04, 0F, 0E: this model cannot. Go on at the rate found.
            if status != Status::code(3) {
                self.base.raise_failures = u8::MAX;
                if matches!(self.config.baud, BaudPolicy::Raise(_)) {
                    self.base.warn(Step::RaiseBaud, Cause::Refused(status.bytes()), Ask::Rate.text());
                }
            }
            return self.compare_clocks(now);
        }
        self.base.change_rate(now, self.config.baud.wanted(), SETTLE, Ask::VerifyRate);
    }

    fn compare_clocks(&mut self, now: Instant) {
        self.base.last_good_baud = self.base.baud;
        self.ask(now, Ask::EnterTime);
    }

    fn on_time(&mut self, now: Instant, reply: &Reply<'_>) {
        let stamp = reply.stamp_ms().ok().filter(|_| reply.status == Status::OK);
        let Some(Stamp::At(stamp_ms)) = stamp.map(|stamp| self.stamps.unwrap(stamp)) else {
            return self.ask(now, Ask::EndTime);
        };
        self.offset.add_exchange(self.sent_at, now, stamp_ms);
        let done = self.offset.exchanges() >= MAX_EXCHANGES;
        self.ask(now, if done { Ask::EndTime } else { Ask::ReadTime });
    }
}

/// A URG-04LX that names a slower rate than that at which it is heard is plugged in by its USB port, where rates mean nothing.
fn says_slower(said: &str, heard_at: u32) -> bool {
    let end = said.find(|character: char| !character.is_ascii_digit()).unwrap_or(said.len());
    said.get(..end).and_then(|digits| digits.parse::<u32>().ok()).is_some_and(|rate| rate < heard_at)
}
