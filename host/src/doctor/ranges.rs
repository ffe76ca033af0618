//! What the ranges say: shares of hits, misses and invalid beams, and values that cannot be walls.

use lrfslam_core::scan::Echo;

use super::finding::{Finding, percent};
use crate::scans::log::{LimitOrigin, LogScan, RangeNotes};

/// Ranges are counted to 1 cm up to here, m.
const COUNTED_M: f32 = 200.0;
/// Values within this share of one another are one.
const SAME: f64 = 0.01;
/// A value near the far end with a larger share of all beams may be no wall …
const CROWD: f64 = 0.01;
/// … if it has so many times the beams of any other value in the far half.
const CROWDED: f64 = 4.0;
/// Directions that hits are counted by.
const SECTORS: usize = 36;
/// A flat wall is as far as another within 2 % over so many of them: 23° …
const WALL_SECTORS: usize = 3;
/// … so that no more than this share of the beams at its range lies elsewhere. Chosen.
const ELSEWHERE: f64 = 0.1;
/// A larger share of invalid beams is unusual …
const INVALID: f64 = 0.3;
/// … and a larger one is wrong.
const INVALID_MOST: f64 = 0.95;
/// A larger share of ranges that no laser has shows another unit.
const BEYOND: f64 = 0.2;
/// A smaller median is nearer than any laser measures, m.
const TINY_M: f64 = 0.05;

/// Counts ranges.
#[derive(Debug, Default)]
pub(super) struct RangeCheck {
    /// Hits by their range, 1 cm each, and by their direction.
    hits_by_cm: Vec<[u64; SECTORS]>,
    hits: u64,
    misses: u64,
    invalid: u64,
    range_max_m: f32,
}

impl RangeCheck {
    pub fn see(&mut self, scan: &LogScan) {
        self.range_max_m = scan.range_max_m;
        for beam in &scan.beams {
            match beam.echo {
                Echo::Miss => self.misses += 1,
                Echo::Invalid => self.invalid += 1,
                Echo::Hit(range_m) => {
                    self.hits += 1;
                    let cm = (range_m.min(COUNTED_M) * 100.0) as usize;
                    if self.hits_by_cm.len() <= cm {
                        self.hits_by_cm.resize(cm + 1, [0; SECTORS]);
                    }
                    let turns = f64::from(beam.bearing_rad) / std::f64::consts::TAU;
                    let sector = (turns.rem_euclid(1.0) * SECTORS as f64) as usize;
                    self.hits_by_cm[cm][sector.min(SECTORS - 1)] += 1;
                }
            }
        }
    }

    fn beams(&self) -> f64 {
        (self.hits + self.misses + self.invalid) as f64
    }

    /// Share of beams that hit something.
    pub fn hit_share(&self) -> f64 {
        self.hits as f64 / self.beams().max(1.0)
    }

    /// Range below which a share of the hits lies, m.
    fn quantile_m(&self, share: f64) -> f64 {
        let wanted = (share * self.hits as f64) as u64;
        let mut seen = 0;
        let at = self.hits_by_cm.iter().position(|hits| {
            seen += hits.iter().sum::<u64>();
            seen > wanted
        });
        at.map_or(0.0, |cm| cm as f64 / 100.0)
    }

    /// Hits of these ranges, by their direction.
    fn sectors_between(&self, from_m: f64, to_m: f64) -> [u64; SECTORS] {
        let cm = |metres: f64| ((metres * 100.0).round() as usize).min(self.hits_by_cm.len());
        let ranges = self.hits_by_cm.get(cm(from_m)..cm(to_m).max(cm(from_m))).unwrap_or_default();
        std::array::from_fn(|sector| ranges.iter().map(|hits| hits[sector]).sum())
    }

    fn between(&self, from_m: f64, to_m: f64) -> f64 {
        self.sectors_between(from_m, to_m).iter().sum::<u64>() as f64
    }

    /// True if the hits of these ranges may be those of one flat wall, for a robot that stands.
    fn may_be_wall(&self, from_m: f64, to_m: f64) -> bool {
        let sectors = self.sectors_between(from_m, to_m);
        let arc = |first: usize| (0..WALL_SECTORS).map(|next| sectors[(first + next) % SECTORS]).sum::<u64>();
        let most = (0..SECTORS).map(arc).max().unwrap_or(0);
        let all: u64 = sectors.iter().sum();
        (all - most) as f64 <= ELSEWHERE * all as f64
    }

    /// * `stands` — the robot has not moved
    pub fn report(&self, notes: &RangeNotes, stands: bool, findings: &mut Vec<Finding>) {
        let beams = self.beams();
        let share = |part: u64| percent(part as f64, beams);
        let from = match notes.limit {
            LimitOrigin::Told => "as you say",
            LimitOrigin::Declared => "as the log or laser says",
            LimitOrigin::Shown => "as its values show",
            LimitOrigin::Guessed => "a guess: no value of it looks like \"nothing seen\"",
        };
        let found = format!(
            "{} of the beams hit something, at {:.2} m in the median; {} saw nothing up to {:.2} m ({from}); {} are invalid",
            share(self.hits),
            self.quantile_m(0.5),
            share(self.misses),
            self.range_max_m,
            share(self.invalid)
        );
        findings.push(Finding::note("ranges", found));
        if !self.other_unit(notes, findings) {
            self.invalid_beams(findings);
            self.crowd(stands, findings);
        }
    }

    /// True if lengths are in another unit than metres.
    fn other_unit(&self, notes: &RangeNotes, findings: &mut Vec<Finding>) -> bool {
        let beyond = notes.beyond as f64 / (notes.finite as f64).max(1.0);
        let typical = f64::from(notes.typical);
        let is_tiny = self.hits > 0 && self.quantile_m(0.9) < TINY_M && self.hit_share() > 0.5;
        let unit = match beyond > BEYOND {
            true if typical > 400.0 => "millimetres",
            true => "centimetres",
            false if is_tiny => "kilometres, or metres divided by 1000",
            false => return false,
        };
        let found = match is_tiny {
            true => format!("nine of ten ranges are below {:.2} m", self.quantile_m(0.9) + 0.01),
            false => format!(
                "{} of the ranges are over 200 m, the first scan's median is {typical:.0} m",
                percent(beyond, 1.0)
            ),
        };
        let found = format!("{found}: the log seems to have {unit}");
        let means = "a log has metres: as it is there are no walls in it";
        findings.push(Finding::wrong("other-unit", found, means).so("convert the ranges to metres"));
        true
    }

    fn invalid_beams(&self, findings: &mut Vec<Finding>) {
        let (invalid, beams) = (self.invalid as f64, self.beams());
        if invalid <= INVALID * beams {
            return;
        }
        let found = format!("{} of the beams are invalid: zero, below zero or not a number", percent(invalid, beams));
        let means = "what is invalid says neither wall nor free; some lasers say 0 where they see nothing";
        let advice = "if it is more than this laser always has, look at its window for dust, and for sunlight";
        let of = if invalid > INVALID_MOST * beams { Finding::wrong } else { Finding::unusual };
        findings.push(of("mostly-invalid", found, means).so(advice));
    }

    /// Too many hits at one range near the farthest: what the device says for "nothing seen".
    fn crowd(&self, stands: bool, findings: &mut Vec<Finding>) {
        let far_m = self.quantile_m(0.999);
        let width_m = (SAME * far_m).max(0.02);
        let crowd = self.between(far_m - width_m, far_m + width_m);
        let elsewhere = (1..)
            .map(|step| far_m - width_m * f64::from(2 * step + 1))
            .take_while(|at_m| *at_m > far_m / 2.0)
            .map(|at_m| self.between(at_m - width_m, at_m + width_m))
            .fold(1.0, f64::max);
        let is_crowd = crowd > CROWD * self.beams() && crowd >= CROWDED * elsewhere;
        let is_wall = stands && self.may_be_wall(far_m - width_m, far_m + width_m);
        if far_m < 2.0 || !is_crowd || is_wall {
            return;
        }
        let found = format!("{} of the beams end at {far_m:.2} m, within 1 %", percent(crowd, self.beams()));
        let means = "a laser that sees nothing says so by a value; taken as a wall it draws a circle about the robot";
        let advice = format!("set log.range_max_m={:.2} if no wall is there", far_m - 1.5 * width_m);
        findings.push(Finding::wrong("no-return-as-wall", found, means).so(advice));
    }
}
