//! What went wrong, in words: which step, why, and what was tried.

use core::fmt;

use lrfslam_scan::time::Duration;

/// Which step of a session failed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Step {
    /// Looking for the sensor.
    Find,
    /// Asking what it is.
    Identify,
    /// Changing the baud rate.
    RaiseBaud,
    /// Setting it up.
    Configure,
    /// Starting scans.
    Start,
    /// Receiving scans.
    Stream,
    /// The port itself.
    Port,
}

/// Why.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cause {
    /// No answer.
    NoReply,
    /// It said no: the two characters or the code of its status.
    Refused([u8; 2]),
    /// Its numbers make no sensor, or are not what was asked for.
    BadParameters,
    /// Too many damaged scans in a row.
    Damaged,
    /// Scans stopped coming.
    Silent,
    /// It was reset: its clock began anew, or it said so.
    Reset,
    /// Its clock stands still.
    StuckClock,
    /// It reports a fault of its own hardware: the characters of its status.
    HardwareFault([u8; 2]),
    /// The same, by a number: the code of its status.
    FaultCode(u16),
    /// It does not have this rate, bit/s.
    NoSuchRate(u32),
    /// It scans in a way without check sums.
    Unchecked,
    /// The port was closed: unplugged?
    Unplugged,
}

/// A failure in words: what failed, why, and what was tried.
#[derive(Debug, Clone, PartialEq, Eq, Copy)]
pub struct Trouble {
    /// Step that failed.
    pub step: Step,
    /// Why.
    pub cause: Cause,
    /// What was sent last, as text for people.
    pub sent: &'static str,
    /// Rates tried, bit/s; empty if that does not matter.
    pub tried: BaudRates,
    /// The driver tries again after this time.
    pub retry_in: Duration,
}

/// Most rates in a list.
pub const MAX_BAUD_RATES: usize = 8;

/// A short list of rates, bit/s.
#[derive(Clone, Copy, Default, PartialEq, Eq)]
pub struct BaudRates {
    rates: [u32; MAX_BAUD_RATES],
}

impl BaudRates {
    /// The rates of `list` in order, without zeros and repetitions, cut to [`MAX_BAUD_RATES`].
    pub fn new(list: impl IntoIterator<Item = u32>) -> Self {
        let mut rates = Self::default();
        list.into_iter().for_each(|rate| rates.push(rate));
        rates
    }

    /// Adds a rate at the end unless it is in the list; dropped if the list is full.
    pub fn push(&mut self, rate: u32) {
        if rate != 0
            && !self.rates.contains(&rate)
            && let Some(slot) = self.rates.iter_mut().find(|slot| **slot == 0)
        {
            *slot = rate;
        }
    }

    /// The rates in order.
    pub fn iter(&self) -> impl Iterator<Item = u32> + '_ {
        self.rates.iter().copied().take_while(|rate| *rate != 0)
    }

    /// The rate at `index`.
    pub fn get(&self, index: usize) -> Option<u32> {
        self.rates.get(index).copied().filter(|rate| *rate != 0)
    }
}

impl fmt::Debug for BaudRates {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.debug_list().entries(self.iter()).finish()
    }
}

impl fmt::Display for BaudRates {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, rate) in self.iter().enumerate() {
            let comma = if index == 0 { "" } else { ", " };
            write!(out, "{comma}{rate}")?;
        }
        Ok(())
    }
}

impl fmt::Display for Step {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str(match self {
            Step::Find => "finding the laser range finder",
            Step::Identify => "asking what it is",
            Step::RaiseBaud => "changing the baud rate",
            Step::Configure => "setting it up",
            Step::Start => "starting scans",
            Step::Stream => "receiving scans",
            Step::Port => "the port",
        })
    }
}

impl fmt::Display for Cause {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let code = |status: &[u8; 2], out: &mut fmt::Formatter<'_>| {
            status.iter().filter(|byte| **byte != 0).try_for_each(|byte| match byte {
                0x20..0x7F => write!(out, "{}", char::from(*byte)),
                _ => write!(out, "0x{byte:02X}"),
            })
        };
        match self {
            Cause::NoReply => out.write_str("no reply"),
            Cause::Refused(status) => {
                out.write_str("refused with status ")?;
                code(status, out)
            }
            Cause::BadParameters => out.write_str("its parameters make no sense"),
            Cause::Damaged => out.write_str("too many damaged scans in a row; is the cable good?"),
            Cause::Silent => out.write_str("no scan for too long"),
            Cause::Reset => out.write_str("it was reset; is its power good?"),
            Cause::StuckClock => out.write_str("its clock stands still"),
            Cause::HardwareFault(status) => {
                out.write_str("it reports a fault in itself, status ")?;
                code(status, out)
            }
            Cause::FaultCode(code) => write!(out, "it reports a fault in itself, code 0x{code:02X}"),
            Cause::NoSuchRate(rate) => write!(out, "it does not have {rate} baud; the rate stays as it is"),
            Cause::Unchecked => {
                out.write_str("it has only a mode without check sums; damage on the line may go unseen")
            }
            Cause::Unplugged => out.write_str("closed: unplugged?"),
        }
    }
}

impl fmt::Display for Trouble {
    /// Such as "finding the laser range finder: no reply to QT at 19200, 115200 baud; is it powered, is this the right port?".
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "{}: {}", self.step, self.cause)?;
        if !self.sent.is_empty() {
            write!(out, " to {}", self.sent)?;
        }
        if self.tried.get(0).is_some() {
            write!(out, " at {} baud", self.tried)?;
        }
        if (self.step, self.cause) == (Step::Find, Cause::NoReply) {
            out.write_str("; is it powered, is this the right port, and the right kind of sensor?")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::string::ToString;

    #[test]
    fn trouble_says_what_failed_and_what_was_tried() {
        let trouble = Trouble {
            step: Step::Find,
            cause: Cause::NoReply,
            sent: "QT",
            tried: BaudRates::new([19_200, 115_200, 19_200]),
            retry_in: Duration::ZERO,
        };
        assert_eq!(
            trouble.to_string(),
            "finding the laser range finder: no reply to QT at 19200, 115200 baud; is it powered, is this the right port, and the right kind of sensor?"
        );
        let refused =
            Trouble { step: Step::Start, cause: Cause::Refused(*b"04"), tried: BaudRates::default(), ..trouble };
        assert_eq!(refused.to_string(), "starting scans: refused with status 04 to QT");
    }
}
