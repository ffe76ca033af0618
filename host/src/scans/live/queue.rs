//! From the laser's thread to the consumer's: the newest scans, however slow the consumer is.

use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, PoisonError};

use lrfslam_core::time::Duration;

use super::Message;

/// Scans wait up to here for a consumer that pauses, as for a loop to be closed or results to be saved. Older ones are left out.
pub(super) const LAG_MAX: Duration = Duration::from_millis(3000);
/// No more wait, however close they follow one another.
const SCANS_MAX: usize = 256;
/// Words that nobody takes.
const WORDS_MAX: usize = 1000;

/// Messages that wait.
#[derive(Default)]
pub(super) struct Queue {
    waiting: Mutex<Waiting>,
    changed: Condvar,
}

#[derive(Default)]
struct Waiting {
    messages: VecDeque<Message>,
    scans: usize,
    left_out: u32,
    is_closed: bool,
}

impl Queue {
    /// Adds a message; scans that have waited for too long go, and that is said: the first time, the second, the fourth …
    pub(super) fn post(&self, message: Message) {
        let mut waiting = self.waiting.lock().unwrap_or_else(PoisonError::into_inner);
        match &message {
            Message::Scan { .. } => waiting.scans += 1,
            _ if waiting.messages.len() - waiting.scans >= WORDS_MAX => return,
            _ => {}
        }
        waiting.messages.push_back(message);
        let before = waiting.left_out;
        while waiting.is_behind() && waiting.drop_oldest_scan() {}
        if waiting.left_out.checked_ilog2() > before.checked_ilog2() {
            let told = format!(
                "scans come faster than this computer maps them: the newest go first, {} left out so far",
                waiting.left_out
            );
            waiting.messages.push_back(Message::Said(told));
        }
        self.changed.notify_one();
    }

    /// Nothing more comes.
    pub(super) fn close(&self) {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner).is_closed = true;
        self.changed.notify_one();
    }

    /// The next message, as soon as there is one; `None` when nothing more comes.
    pub(super) fn take(&self) -> Option<Message> {
        let waiting = self.waiting.lock().unwrap_or_else(PoisonError::into_inner);
        let is_waited_for = |waiting: &mut Waiting| waiting.messages.is_empty() && !waiting.is_closed;
        let mut waiting = self.changed.wait_while(waiting, is_waited_for).unwrap_or_else(PoisonError::into_inner);
        let message = waiting.messages.pop_front();
        waiting.scans -= usize::from(matches!(message, Some(Message::Scan { .. })));
        message
    }

    /// Scans left out so far.
    pub(super) fn left_out(&self) -> u32 {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner).left_out
    }
}

impl Waiting {
    fn is_behind(&self) -> bool {
        let mut stamps = self.messages.iter().filter_map(|message| match message {
            Message::Scan { stamp, .. } => Some(*stamp),
            _ => None,
        });
        let ends = stamps.next().zip(stamps.next_back());
        self.scans > SCANS_MAX || ends.is_some_and(|(oldest, newest)| newest.since(oldest) > LAG_MAX)
    }

    fn drop_oldest_scan(&mut self) -> bool {
        let oldest = self.messages.iter().position(|message| matches!(message, Message::Scan { .. }));
        let Some(oldest) = oldest else { return false };
        self.messages.remove(oldest);
        self.scans -= 1;
        self.left_out = self.left_out.saturating_add(1);
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lrfslam_core::time::Instant;

    fn scan(at_ms: i64) -> Message {
        Message::Scan { stamp: Instant::from_micros(1000 * at_ms), range_max_m: 8.0, beams: Vec::new() }
    }

    #[test]
    fn of_scans_that_nobody_takes_the_newest_stay_and_it_is_said() {
        let queue = Queue::default();
        for number in 0..100 {
            queue.post(scan(100 * number));
        }
        queue.close();
        let (mut stamps, mut said) = (Vec::new(), Vec::new());
        while let Some(message) = queue.take() {
            match message {
                Message::Scan { stamp, .. } => stamps.push(stamp.micros / 1000),
                Message::Said(text) => said.push(text),
                Message::Identified(_) => {}
            }
        }
        assert_eq!(stamps, (69..100).map(|number| 100 * number).collect::<Vec<i64>>());
        assert_eq!((queue.left_out(), said.len()), (69, 7), "{said:?}");
    }

    #[test]
    fn however_close_they_follow_there_is_a_bound() {
        let queue = Queue::default();
        (0..1000).for_each(|_| queue.post(scan(0)));
        assert_eq!(queue.left_out() as usize, 1000 - SCANS_MAX);
        (0..10_000).for_each(|_| queue.post(Message::Said(String::new())));
        assert!(queue.waiting.lock().unwrap().messages.len() < SCANS_MAX + WORDS_MAX + 20);
    }
}
