//! What a driver does, as a message for the consumer: scans as they are, the rest in words.

use lrfslam_core::time::Duration;
use lrfslam_lrf::driver::{Cause, Event, Identity, Trouble};

use super::Message;
use crate::scans::driver::DriverEvent;
use crate::scans::family::LrfFamily;

/// Says things once.
pub(super) struct Words {
    /// Which family it is was found out.
    any_family: bool,
    /// The one that answers.
    family: Option<LrfFamily>,
    /// It is still to be said which it is.
    unsaid: Option<LrfFamily>,
    baud: u32,
    last_refusal: String,
    last_trouble: String,
    looks_for_others: bool,
}

impl Words {
    pub(super) fn new(any_family: bool) -> Self {
        let (last_refusal, last_trouble) = (String::new(), String::new());
        Self { any_family, family: None, unsaid: None, baud: 0, last_refusal, last_trouble, looks_for_others: false }
    }

    /// An event as messages; what was said of the same trouble already is not said again.
    pub(super) fn tell(&mut self, event: DriverEvent<'_>, post: &mut dyn FnMut(Message)) {
        match event {
            DriverEvent::Driver(event) => self.tell_event(event, post),
            DriverEvent::Found(family) => {
                self.family = Some(family);
                self.unsaid = self.family.filter(|_| self.any_family);
            }
            DriverEvent::CannotOpen(error) => {
                let refusal = error.to_string();
                if refusal != self.last_refusal {
                    post(Message::Said(format!("{refusal}; trying again")));
                }
                self.last_refusal = refusal;
            }
            DriverEvent::LookingForOthers if self.looks_for_others => {}
            DriverEvent::LookingForOthers => {
                self.looks_for_others = true;
                post(Message::Said("it does not answer; looking whether another laser is there".to_owned()));
            }
            DriverEvent::RecordingFailed(error) => {
                post(Message::Said(format!("the recording ends here, the run goes on: {error}")));
            }
            DriverEvent::OfTheDisk(news) => post(Message::Said(news.to_owned())),
        }
    }

    fn tell_event(&mut self, event: Event<'_>, post: &mut dyn FnMut(Message)) {
        match event {
            Event::Trouble(trouble) => {
                let text = trouble.to_string();
                if text == self.last_trouble {
                    return;
                }
                self.last_trouble = text;
            }
            Event::Found { baud } => {
                self.baud = baud;
                self.last_trouble.clear();
                self.last_refusal.clear();
                if self.unsaid.is_some() {
                    return;
                }
            }
            Event::Identified(identity) => {
                if let Some(family) = self.unsaid.take() {
                    post(Message::Said(found(family, identity, self.baud)));
                }
            }
            Event::Streaming { .. } => self.last_trouble.clear(),
            Event::Brightness(_) | Event::Scan(_) | Event::Stopped { .. } => {}
        }
        tell(event, self.family, post);
    }
}

/// Which laser it is, and how to say so the next time.
fn found(family: LrfFamily, identity: &Identity, baud: u32) -> String {
    // A SICK tells its part's number and version too.
    let model = identity.model.split(';').next().unwrap_or_default().trim();
    let maker = match family {
        LrfFamily::SickLms2xx => "a SICK",
        LrfFamily::Hokuyo => "a Hokuyo",
        // They say it themselves.
        LrfFamily::Rplidar | LrfFamily::Ld06 => "an",
    };
    let rate = if baud == 0 { String::new() } else { format!(" at {baud} baud") };
    format!("found {maker} {model}{rate}; the same without searching: --lrf {}", family.names().flag)
}

/// An event of a driver as a message; `family` is the laser's that answers, if one does.
pub(super) fn tell(event: Event<'_>, family: Option<LrfFamily>, post: &mut dyn FnMut(Message)) {
    post(match event {
        Event::Scan(scan) => {
            Message::Scan { stamp: scan.stamp, range_max_m: scan.range_max_m, beams: scan.beams.to_vec() }
        }
        Event::Brightness(_) => return,
        Event::Identified(identity) => Message::Identified(Box::new(identity.clone())),
        Event::Found { baud: 0 } => Message::Said("laser found".to_owned()),
        Event::Found { baud } => Message::Said(format!("laser found at {baud} baud")),
        Event::Streaming { baud, period } => Message::Said(streaming(baud, period)),
        Event::Trouble(trouble) => Message::Said(troubled(&trouble)),
        Event::Stopped { laser_off: true } => Message::Said("laser stopped".to_owned()),
        Event::Stopped { laser_off: false } if family.is_some_and(|family| !family.can_be_stopped()) => {
            Message::Said("this laser cannot be told to stop: it is on while it has power".to_owned())
        }
        Event::Stopped { laser_off: false } => {
            Message::Said("no answer to the stop: if a laser is there, it may still be on".to_owned())
        }
    });
}

fn streaming(baud: u32, period: Duration) -> String {
    let scans = match period {
        Duration::ZERO => "scans".to_owned(),
        period => format!("up to {:.1} scans a second", 1.0 / period.as_secs_f32()),
    };
    match baud {
        0 => format!("receiving {scans}"),
        baud => format!("receiving {scans} at {baud} baud"),
    }
}

fn troubled(trouble: &Trouble) -> String {
    match trouble.retry_in.micros {
        _ if trouble.cause == Cause::Unplugged => format!("{trouble} waiting for it to come back"),
        0 => trouble.to_string(),
        wait => format!("{trouble}; trying again in {:.1} s", wait as f64 * 1e-6),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn said(event: Event<'_>, family: Option<LrfFamily>) -> String {
        let mut text = String::new();
        tell(event, family, &mut |message| {
            if let Message::Said(said) = message {
                text = said;
            }
        });
        text
    }

    #[test]
    fn only_a_laser_that_could_stop_may_still_be_on() {
        let stopped = |family| said(Event::Stopped { laser_off: false }, family);
        for family in [None, Some(LrfFamily::Hokuyo), Some(LrfFamily::SickLms2xx)] {
            assert!(stopped(family).contains("may still be on"), "{family:?}");
        }
        assert_eq!(stopped(Some(LrfFamily::Ld06)), "this laser cannot be told to stop: it is on while it has power");
    }

    #[test]
    fn a_rate_that_nobody_knows_is_not_said() {
        let streaming = |period| said(Event::Streaming { baud: 115_200, period }, None);
        assert_eq!(streaming(Duration::ZERO), "receiving scans at 115200 baud");
        assert_eq!(streaming(Duration::from_millis(100)), "receiving up to 10.0 scans a second at 115200 baud");
    }
}
