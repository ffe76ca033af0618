//! Which laser is looked for at a port, for how long, and what is said when there is none.
//!
//! Drivers take turns: the one that was asked for, or all if nobody knows which it is. A turn ends when its driver has tried
//! everything, or its time is over; then the next begins. Before it gives up on the laser that was asked for, the search
//! looks once for the others, so that it can name the one that is there. From the first scan on nothing is given up any more.
#![allow(
    clippy::indexing_slicing,
    reason = "turns name drivers of the list that they are made with; no data choose them"
)]

use std::fmt;

use lrfslam_core::time::{Duration, Instant};
use lrfslam_lrf::driver::{LrfDriver, Step, Trouble};

use super::LaserMemory;
use crate::scans::family::{LrfFamily, LrfOptions};

/// For a port that cannot be opened, and for the laser that was asked for to answer: twice what the slowest takes, a URG-04LX at
/// 750,000 baud (5.2 s to the first scan).
const PATIENCE: Duration = Duration::from_millis(10_000);
/// A second turn for a SICK, after all others had theirs: it boots for 15 s.
const BOOTED: Duration = Duration::from_millis(10_000);
/// From the first answer to the first scan: a SICK's modes take 3 s each, an RPLIDAR's motor 4 s.
const ANSWERED: Duration = Duration::from_millis(20_000);
/// A turn of one that is only looked for; its driver has tried every rate before.
const LOOK: Duration = Duration::from_millis(8000);
/// An LD06 talks all the time: 260 packets in this one.
const LISTEN: Duration = Duration::from_millis(700);

/// One turn of one driver.
#[derive(Debug, Clone, Copy)]
struct Turn {
    driver: usize,
    /// `None` for ever.
    at_most: Option<Duration>,
    /// Over as soon as the driver has tried everything.
    is_once: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Stage {
    Looking,
    Answered,
    Scanning,
}

/// Drivers and their turns.
pub struct Search<'a> {
    drivers: Vec<(LrfFamily, Box<dyn LrfDriver + Send + 'a>)>,
    turns: Vec<Turn>,
    turn: usize,
    /// The family that was asked for.
    wanted: Option<LrfFamily>,
    /// Never give up.
    waits: bool,
    stage: Stage,
    /// The turn, or the wait for the port, ends.
    until: Option<Instant>,
    /// The port is open since before the turn, or was in it.
    was_open: bool,
    /// Why the port cannot be opened.
    refusal: Option<String>,
    heard: Heard,
    trouble: Option<Trouble>,
}

/// Bytes by the rate that they came at.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Heard {
    /// Rate, bit/s, 0 where the link has none, and bytes.
    bytes: Vec<(u32, u64)>,
}

/// What is to be done next.
pub(super) enum Verdict {
    GoOn,
    /// The turn of the next driver.
    Next,
    GiveUp(GaveUp),
}

/// Signs of a driver.
#[derive(Debug, Default)]
pub(super) struct Signs {
    /// It has found its laser, at this rate.
    pub(super) found: Option<u32>,
    pub(super) scanned: bool,
    /// What went wrong; at [`Step::Find`], it has tried everything.
    pub(super) trouble: Option<Trouble>,
}

/// Why there is no laser.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum GaveUp {
    /// The port cannot be opened, in words that name it.
    NotOpened(String),
    /// Nothing that makes sense was heard.
    Silent {
        /// The family that was asked for, if one was.
        wanted: Option<LrfFamily>,
        /// What came.
        heard: Heard,
    },
    /// Another laser is there.
    Other {
        /// The family that was asked for.
        wanted: LrfFamily,
        /// The one that is there.
        found: LrfFamily,
        /// Its rate, bit/s, 0 where the link has none.
        baud: u32,
    },
    /// It answers, but does not scan; what went wrong last.
    NoScan(Option<Trouble>),
}

impl<'a> Search<'a> {
    /// Looks for the laser of `options`, or for any if `any_family`; `waits`: for ever.
    ///
    /// * `memories` — of the drivers; filled here
    pub fn new(options: &LrfOptions, any_family: bool, waits: bool, memories: &'a mut Vec<LaserMemory>) -> Self {
        let suits = |family: &LrfFamily| options.has_baud || family.suits_fixed_rate();
        let own = Some(options.family).filter(|_| !any_family);
        let others = LrfFamily::ALL.into_iter().filter(|family| Some(*family) != own && suits(family));
        let families: Vec<LrfFamily> = own.into_iter().chain(others).collect();
        memories.resize_with(families.len(), LaserMemory::default);
        let make = |(family, memory): (&LrfFamily, &'a mut LaserMemory)| {
            (*family, options_of(options, *family, own).driver(memory))
        };
        let drivers = families.iter().zip(memories).map(make).collect();
        let turns = match own {
            None => (0..2 * families.len()).map(|turn| look(&families, turn % families.len())).collect(),
            Some(_) if waits => vec![Turn { driver: 0, at_most: None, is_once: false }],
            Some(family) => turns_of(family, &families),
        };
        Self {
            drivers,
            turns,
            turn: 0,
            wanted: own,
            waits,
            stage: Stage::Looking,
            until: None,
            was_open: false,
            refusal: None,
            heard: Heard::default(),
            trouble: None,
        }
    }

    pub(super) fn driver(&mut self) -> &mut (dyn LrfDriver + Send + 'a) {
        self.drivers[self.turns[self.turn].driver].1.as_mut()
    }

    /// The family whose turn it is.
    pub(super) fn family(&self) -> LrfFamily {
        self.drivers[self.turns[self.turn].driver].0
    }

    /// What this driver finds is what was asked for.
    pub(super) fn is_wanted(&self) -> bool {
        self.wanted.is_none_or(|wanted| wanted == self.family())
    }

    /// Nothing has answered yet, and all have turns: that one has tried everything is no news.
    pub(super) fn is_among_many(&self) -> bool {
        self.wanted.is_none() && self.stage == Stage::Looking
    }

    /// Nothing has answered yet.
    pub(super) fn is_looking(&self) -> bool {
        self.stage == Stage::Looking
    }

    /// The port is open.
    pub(super) fn opened(&mut self, now: Instant) {
        self.refusal = None;
        if self.stage == Stage::Looking && !self.was_open {
            self.was_open = true;
            self.until = self.turns[self.turn].at_most.map(|wait| now + wait);
        }
    }

    /// The port cannot be opened.
    pub(super) fn refused(&mut self, now: Instant, why: String) {
        self.refusal = Some(why);
        if !self.waits {
            self.until.get_or_insert(now + PATIENCE);
        }
    }

    pub(super) fn hear(&mut self, baud: u32, count: usize) {
        if self.stage == Stage::Looking && self.is_wanted() {
            self.heard.add(baud, count as u64);
        }
    }

    /// What the driver did, and what is to be done about it.
    pub(super) fn judge(&mut self, now: Instant, signs: &Signs) -> Verdict {
        if let (Some(baud), Some(wanted), false) = (signs.found, self.wanted, self.is_wanted()) {
            return Verdict::GiveUp(GaveUp::Other { wanted, found: self.family(), baud });
        }
        if signs.found.is_some() && self.stage == Stage::Looking {
            self.stage = Stage::Answered;
            self.until = Some(now + ANSWERED).filter(|_| !self.waits);
        }
        if signs.scanned {
            self.stage = Stage::Scanning;
            self.until = None;
        }
        let has_tried =
            signs.trouble.is_some_and(|trouble| trouble.step == Step::Find) && self.turns[self.turn].is_once;
        self.trouble = signs.trouble.or(self.trouble);
        let is_over = self.until.is_some_and(|until| now >= until);
        match self.stage {
            Stage::Looking if has_tried => self.next(now),
            _ if !is_over => Verdict::GoOn,
            Stage::Looking => match &self.refusal {
                Some(_) if self.waits => Verdict::GoOn,
                Some(why) => Verdict::GiveUp(GaveUp::NotOpened(why.clone())),
                None => self.next(now),
            },
            Stage::Answered => Verdict::GiveUp(GaveUp::NoScan(self.trouble)),
            Stage::Scanning => Verdict::GoOn,
        }
    }

    fn next(&mut self, now: Instant) -> Verdict {
        if self.turn + 1 < self.turns.len() {
            self.turn += 1;
        } else if self.waits {
            self.turn = 0;
        } else {
            return Verdict::GiveUp(GaveUp::Silent { wanted: self.wanted, heard: self.heard.clone() });
        }
        self.until = self.turns[self.turn].at_most.map(|wait| now + wait);
        Verdict::Next
    }
}

/// What to ask of `family`: of the one that was asked for what was asked; of others what they have.
fn options_of(options: &LrfOptions, family: LrfFamily, own: Option<LrfFamily>) -> LrfOptions {
    let is_own = own.is_none_or(|own| own == family);
    let (has_baud, latency_us) = (options.has_baud, options.latency_us);
    let plain = LrfOptions { has_baud, latency_us, ..LrfOptions::new(family) };
    if is_own { LrfOptions { family, ..options.clone() } } else { plain }
}

/// A turn of `families[driver]` that is over when it has tried everything.
fn look(families: &[LrfFamily], driver: usize) -> Turn {
    let at_most = if families[driver] == LrfFamily::Ld06 { LISTEN } else { LOOK };
    Turn { driver, at_most: Some(at_most), is_once: true }
}

/// Its own turn, then one of each other, then perhaps its own again.
fn turns_of(own: LrfFamily, families: &[LrfFamily]) -> Vec<Turn> {
    let own_turn = |at_most| Turn { driver: 0, at_most: Some(at_most), is_once: false };
    let again = Some(own_turn(BOOTED)).filter(|_| own == LrfFamily::SickLms2xx);
    let others = (1..families.len()).map(|driver| look(families, driver));
    std::iter::once(own_turn(PATIENCE)).chain(others).chain(again).collect()
}

impl Heard {
    fn add(&mut self, baud: u32, count: u64) {
        match self.bytes.iter_mut().find(|(rate, _)| *rate == baud) {
            Some((_, bytes)) => *bytes += count,
            None => self.bytes.push((baud, count)),
        }
    }
}

impl fmt::Display for Heard {
    /// Such as "1240 bytes at 9600 baud, 77 bytes at 38400 baud".
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, (baud, bytes)) in self.bytes.iter().enumerate() {
            let comma = if index == 0 { "" } else { ", " };
            match baud {
                0 => write!(out, "{comma}{bytes} bytes")?,
                baud => write!(out, "{comma}{bytes} bytes at {baud} baud")?,
            }
        }
        Ok(())
    }
}

impl fmt::Display for GaveUp {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotOpened(why) => {
                write!(out, "{why}; gave up after {} s (--wait waits for it)", PATIENCE.micros / 1_000_000)
            }
            Self::Silent { wanted, heard } => {
                match wanted {
                    Some(family) => write!(out, "no {family} answers, nor any other laser that this program knows: ")?,
                    None => out.write_str("no laser that this program knows answers: ")?,
                }
                match (heard.bytes.is_empty(), wanted) {
                    (true, _) => out.write_str("nothing was heard")?,
                    (false, Some(family)) => write!(out, "heard {heard}, none of it {}", family.names().protocol)?,
                    (false, None) => write!(out, "heard {heard}, none of it of a laser")?,
                }
                out.write_str("; is it powered, is this the right port? (--wait waits for it)")
            }
            Self::Other { wanted, found, baud } => {
                write!(out, "no {wanted} answers, but {} {found} does", found.names().article)?;
                if *baud > 0 {
                    write!(out, " at {baud} baud")?;
                }
                write!(out, ": try --lrf {}", found.names().flag)
            }
            Self::NoScan(trouble) => {
                write!(out, "the laser answers, but no scan came in {} s", ANSWERED.micros / 1_000_000)?;
                trouble.map_or(Ok(()), |trouble| write!(out, "; {trouble}"))?;
                out.write_str(" (--wait goes on)")
            }
        }
    }
}

#[cfg(test)]
mod tests;
