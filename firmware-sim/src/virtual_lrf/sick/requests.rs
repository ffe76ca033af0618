//! Answers to requests.

use lrfslam_core::time::{Duration, Instant};
use lrfslam_lrf::sick_lms::request::PASSWORD;
use lrfslam_lrf::sick_lms::telegram::MAX_PAYLOAD;
use lrfslam_lrf::sick_lms::{OperatingMode, Request, Variant};

use super::VirtualSick;

/// From a request to its reply, most of them.
const REPLY: Duration = Duration::from_millis(10);
/// A change of operating mode.
const MODE_CHANGE: Duration = Duration::from_millis(60);
/// A configuration goes to flash. Drivers that work with real ones wait 600 ms at most (MRPT).
const FLASH: Duration = Duration::from_millis(300);

impl VirtualSick {
    pub(super) fn obey(&mut self, now: Instant, request: &Request) {
        let at = now + REPLY;
        match request {
            Request::Reset => {
                self.send(at, &[0x91]);
                self.reset(now);
            }
            Request::Mode(mode) => self.change_mode(now, *mode),
            Request::Scan => {
                self.single = true;
                self.sight.stream_from(now);
            }
            Request::Status => {
                let report = self.status_report(now);
                self.send(at, &report);
            }
            Request::Errors => self.send(at, &[0xB2]),
            Request::Type => self.send(at, &[&[0xBA][..], self.model.type_text].concat()),
            Request::Variant(variant) => self.set_variant(now, *variant),
            Request::PermanentBaud(on) if self.is_installing() => {
                self.permanent_baud = self.line.baud(now).filter(|_| *on);
                self.send(now + FLASH, &[0xE6, 0x00]);
            }
            Request::GetConfig => self.send(at, &[&[0xF4][..], self.config.bytes()].concat()),
            Request::SetConfig(block) if self.is_installing() => {
                self.config.overlay(block);
                self.send(now + FLASH, &[&[0xF7, 0x01][..], self.config.bytes()].concat());
            }
            Request::PermanentBaud(_) | Request::SetConfig(_) | Request::Unknown(_) => self.send(at, &[0x92]),
        }
    }

    pub(super) fn is_installing(&self) -> bool {
        matches!(self.mode, OperatingMode::Installation(_))
    }

    /// Says 91 at the old rate, then is away until it has booted.
    fn reset(&mut self, now: Instant) {
        self.line.change_rate(self.permanent_baud.unwrap_or(9600));
        self.boot(now);
    }

    fn change_mode(&mut self, now: Instant, mode: OperatingMode) {
        let at = now + MODE_CHANGE;
        match mode {
            OperatingMode::Installation(password) if password != PASSWORD => self.send(at, &[0xA0, 0x01]),
            mode if !self.knows(mode) => self.send(at, &[0x92]),
            mode if !self.can_stream(mode) => self.send(at, &[0xA0, 0x02]),
            OperatingMode::Baud(rate) => {
                self.send(at, &[0xA0, 0x00]);
                self.line.change_rate(rate);
            }
            mode => {
                self.mode = mode;
                self.send(at, &[0xA0, 0x00]);
                self.skip_to(at);
            }
        }
    }

    /// Ranges together with reflectivities are what an LMS200 does not have.
    fn knows(&self, mode: OperatingMode) -> bool {
        match mode {
            OperatingMode::Other(_) => false,
            OperatingMode::StreamReflectivity(..) => self.model.has_reflectivity_stream,
            _ => true,
        }
    }

    /// True if the values asked for exist, and fit into a telegram; of a recording, whole scans.
    fn can_stream(&self, mode: OperatingMode) -> bool {
        let values = self.variant.values();
        if self.sight.is_recording() && (mode.subrange().is_some() || is_of_turns(mode)) {
            return false;
        }
        let Some((first, last)) = mode.subrange() else { return true };
        let asked = last.saturating_sub(first).saturating_add(1);
        let bytes = match mode {
            OperatingMode::StreamReflectivity(..) => 2 * usize::from(values) + usize::from(asked) + 11,
            OperatingMode::StreamRemission(..) => 4 * usize::from(asked) + 10,
            _ => 2 * usize::from(asked) + 9,
        };
        first >= 1 && first <= last && last <= values && bytes <= MAX_PAYLOAD
    }

    fn set_variant(&mut self, now: Instant, variant: Variant) {
        let taken = variant.is_possible();
        if taken {
            self.variant = variant;
            self.skip_to(now);
        }
        let [a, b] = self.variant.angle_deg.to_le_bytes();
        let [c, d] = self.variant.resolution_cdeg.to_le_bytes();
        self.send(now + MODE_CHANGE, &[0xBB, u8::from(taken), a, b, c, d]);
    }
}

fn is_of_turns(mode: OperatingMode) -> bool {
    matches!(mode, OperatingMode::StreamMean(_) | OperatingMode::StreamPartial)
}
