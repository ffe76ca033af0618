//! How a session goes from state to state, whatever the family of the sensor; what is a family's own is asked of it.
//!
//! ```text
//! Idle ─ connected ─► Pausing ─► Asking, Asking … ─► Streaming
//!                        ▲  a rate without answer: the next │
//!                        └──────── BackOff ◄── trouble ─────┘
//! ```

use super::dialogue::{DialogueBase, Patience, State};
use super::driver::Input;
use super::trouble::{BaudRates, Cause, Step};
use lrfslam_scan::time::Instant;

/// What a reply is awaited to. The default is what is asked first at a rate: every sensor of the family answers it.
pub(super) trait Question: Copy + PartialEq + Default {
    /// Switches the laser off.
    const STOP: Self;

    /// The step of the session that fails without an answer, and what is sent, as text for people.
    fn told(self) -> (Step, &'static str);

    /// The step alone.
    fn step(self) -> Step {
        self.told().0
    }

    /// The text alone.
    fn text(self) -> &'static str {
        self.told().1
    }
}

/// A session with a sensor of one family.
pub(super) trait Session {
    /// What can be asked.
    type Ask: Question;

    /// What it has in common with others.
    fn base(&mut self) -> &mut DialogueBase<Self::Ask>;

    /// Forgets what is known of the sensor; returns the rates to look at, the likeliest first.
    fn forget(&mut self) -> BaudRates;

    /// Looks for the sensor at the rate whose turn it is.
    fn look(&mut self, now: Instant);

    /// How often `ask` is asked again when nothing answers.
    fn attempts(&self, ask: Self::Ask) -> u8;

    /// True if asking again cannot help.
    fn is_hopeless(&self, _ask: Self::Ask) -> bool {
        false
    }

    /// True if nothing may be sent before this is answered: both sides then go to another rate.
    fn changes_rate(&self, _ask: Self::Ask) -> bool {
        false
    }

    /// Sends the request of `ask`, and waits for its reply.
    fn send(&mut self, now: Instant, ask: Self::Ask);

    /// Nothing has answered, for the last time: goes on without it, or [fails](Self::fail).
    fn on_no_reply(&mut self, now: Instant, ask: Self::Ask);

    /// Takes any input but bytes.
    fn on_input(&mut self, now: Instant, input: Input<'_>) {
        match input {
            Input::Timeout if self.base().patience.is_over(now) => self.on_timeout(now),
            Input::Connected => {
                self.base().raise_failures = 0;
                self.base().stop_wanted = false;
                self.base().back_off.reset();
                self.find(now);
            }
            Input::Disconnected => self.base().unplugged(),
            Input::Stop => self.on_stop(now),
            Input::Timeout | Input::Bytes(_) => {}
        }
    }

    fn on_timeout(&mut self, now: Instant) {
        match self.base().state {
            State::Idle => self.base().patience = Patience::FOREVER,
            State::BackOff => self.find(now),
            State::Pausing(next) => self.ask(now, next),
            State::Asking(ask) => {
                if !self.is_hopeless(ask) && self.ask_again(now, ask) {
                    return;
                }
                if ask.step() == Step::RaiseBaud {
                    self.base().raise_failures = self.base().raise_failures.saturating_add(1);
                }
                if self.base().stop_wanted && ask != Self::Ask::STOP {
                    return self.ask(now, Self::Ask::STOP);
                }
                self.on_no_reply(now, ask);
            }
            State::Streaming => self.base().lose(now, Cause::Silent),
        }
    }

    fn on_stop(&mut self, now: Instant) {
        let state = self.base().state;
        match state {
            State::Idle => self.base().stopped(false),
            State::Asking(ask) if ask == Self::Ask::STOP => {}
            State::Asking(ask) if self.changes_rate(ask) => self.base().stop_wanted = true,
            State::Pausing(next) if next.step() == Step::RaiseBaud => self.base().stop_wanted = true,
            _ => self.ask(now, Self::Ask::STOP),
        }
    }

    /// Begins to look, at the rate most likely.
    fn find(&mut self, now: Instant) {
        let rates = self.forget();
        let base = self.base();
        (base.rates, base.rate_index) = (rates, 0);
        self.look(now);
    }

    /// Nothing at this rate: looks at the next.
    fn try_next_rate(&mut self, now: Instant) {
        let base = self.base();
        base.rate_index += 1;
        if base.rates.get(base.rate_index).is_some() {
            self.look(now);
        } else {
            self.fail(now, Self::Ask::default(), Cause::NoReply);
        }
    }

    /// Sends the request of `ask` for the first time.
    fn ask(&mut self, now: Instant, ask: Self::Ask) {
        let ask = if self.base().stop_wanted { Self::Ask::STOP } else { ask };
        self.base().attempts_left = self.attempts(ask);
        self.base().state = State::Asking(ask);
        self.send(now, ask);
    }

    /// Sends the request of `ask` again; false if it was sent often enough.
    fn ask_again(&mut self, now: Instant, ask: Self::Ask) -> bool {
        let left = self.base().attempts_left;
        if left > 0 {
            self.base().attempts_left = left - 1;
            self.send(now, ask);
        }
        left > 0
    }

    /// It does not go on without an answer to `ask`: begins anew.
    fn fail(&mut self, now: Instant, ask: Self::Ask, cause: Cause) {
        self.base().begin_anew(now, ask.step(), cause, ask.text());
    }
}
