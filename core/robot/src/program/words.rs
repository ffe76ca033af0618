//! What the robot says of itself in words, for people.

use core::fmt::Write as _;

use crate::wire::message::Status;
use lrfslam_lrf::driver::Event;

/// Words for the host, oldest first.
pub(super) type Said = heapless::Deque<heapless::String<96>, 4>;

/// A scan that comes when newer ones wait: said the first time, the second, the fourth …
pub(super) fn leave_out(status: &mut Status, said: &mut Said) {
    status.late_scans = status.late_scans.saturating_add(1);
    if status.late_scans.is_power_of_two() {
        say(said, format_args!("scans come faster than they are mapped: {} left out so far", status.late_scans));
    }
}

/// Squares that found no tile with one particle left: said the first time, and whenever they are twice as many.
pub(super) fn leave_squares_out(squares: u32, status: &mut Status, said: &mut Said) {
    let now = status.squares_left_out.saturating_add(squares);
    if now.checked_ilog2() > status.squares_left_out.checked_ilog2() {
        say(said, format_args!("the map's memory is full: {now} of its squares left out so far"));
    }
    status.squares_left_out = now;
}

/// What the laser does, in words for the host.
pub(super) fn remember(said: &mut Said, event: &Event<'_>) {
    match event {
        Event::Found { baud } => say(said, format_args!("laser found at {baud} bit/s")),
        Event::Identified(identity) => say(said, format_args!("laser is {}", identity.model.trim())),
        Event::Streaming { .. } => say(said, format_args!("laser sends scans")),
        Event::Trouble(trouble) => say(said, format_args!("{trouble}")),
        Event::Stopped { laser_off: true } => say(said, format_args!("laser is off")),
        Event::Stopped { laser_off: false } => say(said, format_args!("laser has not confirmed that it is off")),
        Event::Brightness(_) | Event::Scan(_) => {}
    }
}

/// When it says more than fits, the oldest goes.
pub(super) fn say(said: &mut Said, words: core::fmt::Arguments<'_>) {
    let mut text = heapless::String::new();
    // A text that does not fit is cut.
    let _ = text.write_fmt(words);
    if said.is_full() {
        let _ = said.pop_front();
    }
    let _ = said.push_back(text);
}
