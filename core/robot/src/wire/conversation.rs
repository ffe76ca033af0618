//! Who has said what, and who has heard it: a session without its bytes.

use super::packet::{Foreign, LAYOUT, Packet, VERSION};
use super::queue::SendQueue;
use super::session::{CREDIT, MAX_LATEST, Progress, Received, SessionCounters};
use lrfslam_core::time::{Duration, Instant};
use lrfslam_lrf::driver::NEVER;

const HELLO_EVERY: Duration = Duration::from_millis(500);
/// Without an acknowledgement everything is sent again after so long …
const RESEND_FIRST: Duration = Duration::from_millis(200);
/// … so many times, and then each time after twice as long: a bad line loses one message now and then; several in a row, hardly ever …
const RESENDS_SOON: u8 = 3;
/// … up to this many, when the wait has come to 3.2 s: after so many, 3.4 s, the other end is taken to be gone.
const RESENDS_LONGEST: u8 = 6;

/// See the [module](self).
#[derive(Debug)]
pub(super) struct Conversation<'m> {
    epoch: u32,
    pub(super) queue: SendQueue<'m>,
    pub(super) latest: heapless::Vec<u8, MAX_LATEST>,
    pub(super) peer: Option<Progress>,
    /// The other end has said hello since the link was opened.
    pub(super) is_live: bool,
    hello_at: Instant,
    owes_hello: bool,
    owes_ack: bool,
    is_missing: bool,
    credit: u16,
    peer_credit: u16,
    resend_at: Instant,
    /// In a row, without an acknowledgement.
    timeouts: u8,
    /// Where it was last sent again from because the other end said so.
    resent_from: Option<u32>,
    pub(super) counters: SessionCounters,
}

/// What [`Conversation::next_packet`] chose.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Turn {
    Hello,
    Ack,
    Latest,
    Reliable,
}

impl<'m> Conversation<'m> {
    pub(super) fn new(epoch: u32, resume: Option<Progress>, queue: &'m mut [u8]) -> Self {
        Self {
            epoch,
            queue: SendQueue::new(queue),
            latest: heapless::Vec::new(),
            peer: resume,
            is_live: false,
            hello_at: NEVER,
            owes_hello: false,
            owes_ack: false,
            is_missing: false,
            credit: CREDIT,
            peer_credit: 0,
            resend_at: NEVER,
            timeouts: 0,
            resent_from: None,
            counters: SessionCounters::default(),
        }
    }

    pub(super) fn connected(&mut self, now: Instant) {
        self.is_live = false;
        self.hello_at = now;
    }

    pub(super) fn disconnected(&mut self) {
        self.is_live = false;
        self.hello_at = NEVER;
        self.resend_at = NEVER;
    }

    /// Something waits, and the other end has not answered for some seconds.
    pub(super) fn is_silent(&self) -> bool {
        self.timeouts >= RESENDS_LONGEST && self.is_waiting()
    }

    /// Something was not acknowledged yet.
    fn is_waiting(&self) -> bool {
        self.queue.base() != self.queue.end()
    }

    pub(super) fn set_credit(&mut self, credit: u16) {
        self.owes_ack |= credit != self.credit;
        self.credit = credit;
    }

    pub(super) fn deadline(&self) -> Instant {
        if self.is_live { self.resend_at } else { self.hello_at }
    }

    pub(super) fn on_packet<'a>(&mut self, now: Instant, packet: Packet<'a>) -> Option<Received<'a>> {
        match packet {
            Packet::Hello { layout, .. } if layout != LAYOUT => Some(Received::Foreign(Foreign::Layout)),
            Packet::Hello { epoch, peer, next, base, credit, is_heard, .. } => {
                self.owes_hello |= !is_heard;
                self.on_hello(now, Progress { epoch, next: base }, peer, next, credit)
            }
            Packet::Reliable { epoch, sequence, message } => {
                self.is_from_peer(epoch).then_some(())?;
                self.on_reliable(sequence).then_some(Received::Reliable(message))
            }
            Packet::Ack { epoch, peer, next, credit, missing } => {
                if self.is_from_peer(epoch) && peer == self.epoch {
                    self.on_ack(now, next, credit, missing);
                }
                None
            }
            Packet::Busy { peer } => (peer == self.epoch).then_some(Received::Busy),
            Packet::Latest { epoch, message } => self.is_from_peer(epoch).then_some(Received::Latest(message)),
        }
    }

    /// False for a stranger, who is asked to introduce himself.
    fn is_from_peer(&mut self, epoch: u32) -> bool {
        let is_known = self.is_live && self.peer.is_some_and(|peer| peer.epoch == epoch);
        self.owes_hello |= !is_known;
        is_known
    }

    fn on_hello<'a>(
        &mut self,
        now: Instant,
        oldest: Progress,
        peer: Option<u32>,
        next: u32,
        credit: u16,
    ) -> Option<Received<'a>> {
        let known = self.peer.filter(|known| known.epoch == oldest.epoch);
        // What is older than the oldest was acknowledged by an earlier run of this end.
        let is_older = known.is_some_and(|known| oldest.next.wrapping_sub(known.next) as i32 <= 0);
        self.peer = if is_older { known } else { Some(oldest) };
        self.is_live = true;
        self.is_missing = false;
        if peer == Some(self.epoch) {
            self.queue.acknowledge(next);
            self.owes_ack = true;
        } else {
            self.owes_hello = true;
        }
        self.peer_credit = credit;
        self.queue.rewind();
        self.resent_from = None;
        self.timeouts = 0;
        self.resend_at = now + RESEND_FIRST;
        known.is_none().then_some(Received::NewPeer { epoch: oldest.epoch })
    }

    /// True if it is the one expected.
    fn on_reliable(&mut self, sequence: u32) -> bool {
        self.owes_ack = true;
        let Some(peer) = self.peer.as_mut() else { return false };
        let ahead = sequence.wrapping_sub(peer.next) as i32;
        self.is_missing = ahead > 0;
        if ahead == 0 {
            peer.next = peer.next.wrapping_add(1);
            return true;
        }
        let counter = if ahead > 0 { &mut self.counters.early } else { &mut self.counters.doubled };
        *counter = counter.saturating_add(1);
        false
    }

    fn on_ack(&mut self, now: Instant, next: u32, credit: u16, missing: bool) {
        if self.queue.acknowledge(next) {
            self.timeouts = 0;
            self.resend_at = if self.is_waiting() { now + RESEND_FIRST } else { NEVER };
        }
        if next == self.queue.base() {
            self.peer_credit = credit;
            if missing && self.resent_from != Some(next) {
                self.resent_from = Some(next);
                self.resend(now);
            }
        }
    }

    fn resend(&mut self, now: Instant) {
        self.queue.rewind();
        self.counters.resends = self.counters.resends.saturating_add(1);
        self.resend_at = now + self.back_off();
    }

    pub(super) fn on_timeout(&mut self, now: Instant) {
        if !self.is_live && now >= self.hello_at {
            self.owes_hello = true;
            self.hello_at = now + HELLO_EVERY;
        } else if self.is_live && now >= self.resend_at {
            self.resend_at = NEVER;
            self.resent_from = None;
            if self.is_waiting() {
                // An acknowledgement may have been lost, or the other end waits for us to notice that it takes more.
                self.owes_hello = true;
                self.timeouts = (self.timeouts + 1).min(RESENDS_LONGEST);
                self.resend(now);
            }
        }
    }

    /// From sending to sending again.
    fn back_off(&self) -> Duration {
        let doublings = (self.timeouts + 1).saturating_sub(RESENDS_SOON);
        Duration::from_micros(RESEND_FIRST.micros << doublings)
    }

    fn turn(&self) -> Option<Turn> {
        let ahead = self.queue.next().wrapping_sub(self.queue.base());
        if self.owes_hello {
            Some(Turn::Hello)
        } else if !self.is_live {
            None
        } else if self.owes_ack {
            Some(Turn::Ack)
        } else if !self.latest.is_empty() {
            Some(Turn::Latest)
        } else {
            (ahead < u32::from(self.peer_credit) && self.queue.front().is_some()).then_some(Turn::Reliable)
        }
    }

    /// The other end may hear it now.
    pub(super) fn introduce(&mut self) {
        self.owes_hello = true;
    }

    /// True if a hello would be sent now; where a key is still to be shown, that comes first, and the hello again later.
    pub(super) fn introduces_itself(&mut self, now: Instant) -> bool {
        if !self.is_live && now >= self.hello_at {
            self.on_timeout(now);
        }
        core::mem::take(&mut self.owes_hello)
    }

    pub(super) fn next_packet(&mut self, now: Instant) -> Option<Packet<'_>> {
        if !self.is_live && now >= self.hello_at {
            self.on_timeout(now);
        }
        let (epoch, credit) = (self.epoch, self.credit);
        let next = self.peer.map_or(0, |peer| peer.next);
        Some(match self.turn()? {
            Turn::Hello => {
                let peer = self.peer.map(|peer| peer.epoch);
                let (base, is_heard) = (self.queue.base(), self.is_live);
                Packet::Hello { version: VERSION, epoch, peer, next, base, credit, is_heard, layout: LAYOUT }
            }
            Turn::Ack => {
                let peer = self.peer.map_or(0, |peer| peer.epoch);
                Packet::Ack { epoch, peer, next, credit, missing: self.is_missing }
            }
            Turn::Latest => Packet::Latest { epoch, message: &self.latest },
            Turn::Reliable => {
                Packet::Reliable { epoch, sequence: self.queue.next(), message: self.queue.front().unwrap_or_default() }
            }
        })
    }

    /// The packet chosen is on its way.
    pub(super) fn on_sent(&mut self, now: Instant) {
        match self.turn() {
            Some(Turn::Hello) => self.owes_hello = false,
            Some(Turn::Ack) => self.owes_ack = false,
            Some(Turn::Latest) => self.latest.clear(),
            Some(Turn::Reliable) => {
                self.queue.advance();
                if self.resend_at == NEVER {
                    self.resend_at = now + self.back_off();
                }
            }
            None => {}
        }
    }
}
