//! What the sensor is, and what it is to be.

use super::{Ask, Dialogue, RATES};
use crate::dialogue::Pending;
use crate::driver::{Cause, Identity, Step};
use crate::session::{Question as _, Session as _};
use crate::sick_lms::config_block::ConfigBlock;
use crate::sick_lms::measurement::REFLECTOR_MODE;
use crate::sick_lms::reply::{ModeResult, Reply, ReplyBody, StatusReport};
use crate::sick_lms::scan::TURN;
use lrfslam_scan::time::{Duration, Instant};

/// After a change of rate hosts wait 250 to 500 ms (drivers).
const SETTLE: Duration = Duration::from_millis(350);

impl Dialogue<'_> {
    /// Replies that set the sensor up; those that do not fit the question are ignored.
    pub(super) fn on_setup_reply(&mut self, now: Instant, ask: Ask, reply: &Reply<'_>) {
        match (ask, &reply.body) {
            (Ask::Type, ReplyBody::Type(text)) => {
                self.base.identity = Identity { model: printable(text), ..Identity::default() };
                self.ask(now, Ask::Status);
            }
            (Ask::Status, ReplyBody::Status(report)) => self.on_status(now, report),
            (Ask::Config, ReplyBody::Config(block)) => {
                self.measuring_mode = block.measuring_mode();
                self.block = Some(block.clone());
                self.after_config(now);
            }
            (Ask::Rate, ReplyBody::Mode(ModeResult::Done)) => {
                self.base.change_rate(now, self.config.baud.wanted(), SETTLE, Ask::VerifyRate);
            }
            (Ask::VerifyRate, ReplyBody::Status(report)) => {
                self.base.last_good_baud = self.base.baud;
                if report.variant().is_possible() {
                    (self.variant, self.variant_known) = (report.variant(), true);
                }
                self.after_rate(now);
            }
            (Ask::Variant, ReplyBody::Variant(taken, variant)) => {
                let now_holds = *taken && Some(*variant) == self.config.variant;
                self.variant = if variant.is_possible() { *variant } else { self.variant };
                self.variant_known |= variant.is_possible();
                if !now_holds {
                    self.refuse_setup(ask, Cause::Refused([0xBB, 0]));
                }
                self.after_variant(now);
            }
            (Ask::Install, ReplyBody::Mode(ModeResult::Done)) => self.ask(now, Ask::SetConfig),
            (Ask::SetConfig, ReplyBody::ConfigSet(taken, _)) => {
                if !*taken {
                    self.refuse_setup(ask, Cause::Refused([0xF7, 0]));
                }
                self.ask(now, Ask::LeaveInstall);
            }
            (Ask::LeaveInstall, ReplyBody::Mode(_)) => self.ask(now, Ask::Config),
            (Ask::StreamTurns | Ask::StreamAll, ReplyBody::Mode(ModeResult::Done)) => self.begin_streaming(now),
            (_, ReplyBody::Mode(ModeResult::WrongPassword)) => self.on_refused(now, ask, Cause::Refused([0xA0, 1])),
            (_, ReplyBody::Mode(ModeResult::Fault)) => self.on_refused(now, ask, Cause::Refused([0xA0, 2])),
            _ => {}
        }
    }

    /// The sensor said no: what can be done without goes on without.
    pub(super) fn on_refused(&mut self, now: Instant, ask: Ask, cause: Cause) {
        match ask {
            Ask::Type => self.ask(now, Ask::Status),
            Ask::Status => self.ask(now, Ask::Config),
            Ask::Config => self.after_config(now),
            Ask::Rate => {
                self.base.raise_failures = u8::MAX;
                self.base.warn(Step::RaiseBaud, cause, ask.text());
                self.after_rate(now);
            }
            Ask::Variant => {
                self.refuse_setup(ask, cause);
                self.after_variant(now);
            }
            Ask::Install | Ask::SetConfig => {
                self.refuse_setup(ask, cause);
                self.ask(now, Ask::LeaveInstall);
            }
            Ask::StreamTurns => self.without_turns(now),
            _ => self.fail(now, ask, cause),
        }
    }

    /// It goes on as the sensor is set.
    fn refuse_setup(&mut self, ask: Ask, cause: Cause) {
        self.setup_refused = true;
        self.base.warn(Step::Configure, cause, ask.text());
    }

    pub(super) fn without_turns(&mut self, now: Instant) {
        self.turns_refused = true;
        self.ask(now, Ask::StreamAll);
    }

    fn on_status(&mut self, now: Instant, report: &StatusReport<'_>) {
        if !report.variant().is_possible() {
            return self.fail(now, Ask::Status, Cause::BadParameters);
        }
        self.variant = report.variant();
        self.variant_known = true;
        self.measuring_mode = report.measuring_mode();
        self.base.identity.firmware = printable(report.software().as_bytes());
        let state = if report.has_error() { "reports an error in itself" } else { "no error" };
        self.base.identity.state = heapless::String::try_from(state).unwrap_or_default();
        self.ask(now, Ask::Config);
    }

    /// Type, status and configuration are known: the first time, the rate comes next; after a new configuration, the scans.
    pub(super) fn after_config(&mut self, now: Instant) {
        if self.layout().is_none() && !self.wants_config() {
            return self.fail(now, Ask::Config, Cause::BadParameters);
        }
        let change = self.base.wants_raise(self.config.baud, &RATES);
        if change { self.ask(now, Ask::Rate) } else { self.after_rate(now) }
    }

    fn after_rate(&mut self, now: Instant) {
        let wants_variant = self.config.variant.is_some_and(|variant| variant != self.variant);
        if wants_variant && !self.setup_refused {
            return self.ask(now, Ask::Variant);
        }
        self.after_variant(now);
    }

    fn after_variant(&mut self, now: Instant) {
        if self.wants_config() {
            return self.ask(now, Ask::Install);
        }
        self.describe();
        self.base.outbox.push(Pending::Identified);
        self.ask(now, if self.streams_turns() { Ask::StreamTurns } else { Ask::StreamAll });
    }

    fn wants_config(&self) -> bool {
        !self.setup_refused && self.wanted_block().is_some()
    }

    /// The configuration as asked for; `None` if the sensor's suits already, or is not known.
    pub(super) fn wanted_block(&self) -> Option<ConfigBlock> {
        let block = self.block.as_ref()?;
        let mut wanted = block.clone();
        self.config.unit.into_iter().for_each(|unit| wanted.set_unit(unit));
        if self.config.brightness {
            wanted.set_measuring_mode(REFLECTOR_MODE);
        }
        (wanted != *block).then_some(wanted)
    }

    fn describe(&mut self) {
        let half = f32::from(self.variant.angle_deg).to_radians() / 2.0;
        self.base.identity.angle_min_rad = -half;
        self.base.identity.angle_max_rad = half;
        self.base.identity.beams = self.variant.values();
        self.base.identity.turn = TURN;
        let unit = self.block.as_ref().and_then(ConfigBlock::unit);
        if let (Some(layout), Some(unit)) = (self.layout(), unit) {
            self.base.identity.range_max_m = f32::from(layout.format.beyond_maximum()) / unit.per_metre();
        }
    }
}

/// The printable part of a sensor's text, cut to what fits.
fn printable<const N: usize>(text: &[u8]) -> heapless::String<N> {
    let mut kept = heapless::String::new();
    let characters = text.iter().filter(|byte| (0x20..0x7F).contains(*byte));
    let _ = characters.copied().map(char::from).try_for_each(|character| kept.push(character));
    kept
}
