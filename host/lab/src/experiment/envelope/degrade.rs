//! A log made harder, in memory: other people, a shorter or sparser or narrower laser, a lower rate, noise.

use std::f32::consts::{FRAC_PI_4, PI};

use lrfslam_core::math::{normal, uniform};
use lrfslam_core::random::RandomStream;
use lrfslam_core::scan::{Beam, Echo};
use lrfslam_core::time::{Duration, Instant};
use lrfslam_host::scans::log::LogScan;

/// Spread of a range to a leg, m.
const LEG_NOISE_M: f32 = 0.02;
/// Half the width of a leg, and half the way between two, m.
const LEG_M: f32 = 0.07;
const STRIDE_M: f32 = 0.15;
/// How long somebody walks along, s.
const COMPANY_S: (f32, f32) = (5.0, 20.0);

/// What is made of a log.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Degradation {
    /// Nothing: the log as it is.
    None,
    /// So large a share of the beams, 0 to 1, hits somebody 0.4 to 3 m away, in groups of 3 to 10 beams, others in every scan.
    People(f32),
    /// So many people walk about the robot at 1 to 2.5 m, 5 to 20 s each.
    Walkers(usize),
    /// The middle of the view alone: to each side so far, rad.
    View(f32),
    /// Nothing farther than `range_m` returns, and ranges err by up to `share` of themselves.
    Range {
        /// m.
        range_m: f32,
        /// Of a range, 0 to 1.
        share: f32,
    },
    /// Every n-th beam.
    Beams(usize),
    /// Every n-th scan.
    Scans(usize),
    /// So large a share of the beams, 0 to 1, returns nothing.
    NoReturn(f32),
    /// Gaussian noise of the ranges, m.
    Noise(f32),
}

/// A row: its name, and what is made of the log.
pub type EnvelopeRow = (&'static str, Degradation);

/// All rows, from the log as it is.
pub const ENVELOPE_ROWS: [EnvelopeRow; 14] = [
    ("as-is", Degradation::None),
    ("people-15", Degradation::People(0.15)),
    ("people-30", Degradation::People(0.3)),
    ("walkers-4", Degradation::Walkers(4)),
    ("view-90", Degradation::View(FRAC_PI_4)),
    ("range-5.6-noise-3", Degradation::Range { range_m: 5.6, share: 0.03 }),
    ("range-4", Degradation::Range { range_m: 4.0, share: 0.0 }),
    ("beams-4", Degradation::Beams(4)),
    ("beams-8", Degradation::Beams(8)),
    ("scans-2", Degradation::Scans(2)),
    ("scans-4", Degradation::Scans(4)),
    ("scans-8", Degradation::Scans(8)),
    ("no-return-30", Degradation::NoReturn(0.3)),
    ("noise-5cm", Degradation::Noise(0.05)),
];

impl Degradation {
    /// Scans from one that is kept to the next.
    pub(super) fn every(self) -> usize {
        if let Self::Scans(every) = self { every.max(1) } else { 1 }
    }
}

/// The log made harder; the same `seed` makes the same of it.
///
/// * `first` — the first scan that is kept, where not all are
pub fn degrade(scans: &[LogScan], degradation: Degradation, seed: u64, first: usize) -> Vec<LogScan> {
    let mut company = Vec::new();
    let harder = |(number, scan): (usize, &LogScan)| {
        let mut rng = RandomStream::new(seed, number as u32, 0);
        let mut scan = scan.clone();
        match degradation {
            Degradation::None | Degradation::Scans(_) => {}
            Degradation::People(share) => crowd(&mut scan.beams, share, &mut rng),
            Degradation::Walkers(walkers) => walk(&mut scan, &mut company, walkers, &mut rng),
            Degradation::View(half_rad) => scan.beams.retain(|beam| beam.bearing_rad.abs() <= half_rad + 1e-4),
            Degradation::Range { range_m, share } => shorten(&mut scan, range_m, share, &mut rng),
            Degradation::Beams(every) => scan.beams = scan.beams.into_iter().step_by(every.max(1)).collect(),
            Degradation::NoReturn(share) => {
                let drops = |_: &&mut Beam| uniform(&mut rng) < share;
                scan.beams.iter_mut().filter(drops).for_each(|beam| beam.echo = Echo::Miss);
            }
            Degradation::Noise(sigma_m) => {
                let limit_m = scan.range_max_m;
                change_hits(&mut scan.beams, limit_m, |range_m| range_m + sigma_m * normal(&mut rng));
            }
        }
        scan
    };
    scans.iter().enumerate().skip(first).step_by(degradation.every()).map(harder).collect()
}

fn between(rng: &mut RandomStream, from: f32, to: f32) -> f32 {
    from + (to - from) * uniform(rng)
}

/// Gives hits another range; beyond `limit_m` nothing is seen.
fn change_hits(beams: &mut [Beam], limit_m: f32, mut change: impl FnMut(f32) -> f32) {
    for beam in beams {
        if let Echo::Hit(range_m) = beam.echo {
            beam.echo = Echo::from_range(change(range_m).max(0.01), limit_m);
        }
    }
}

fn shorten(scan: &mut LogScan, range_m: f32, share: f32, rng: &mut RandomStream) {
    scan.range_max_m = scan.range_max_m.min(range_m);
    let limit_m = scan.range_max_m;
    change_hits(&mut scan.beams, limit_m, |range_m| range_m * (1.0 + between(rng, -share, share)));
}

/// True if something at `range_m` hides what `beam` saw.
fn is_before(range_m: f32, beam: &Beam) -> bool {
    match beam.echo {
        Echo::Hit(seen_m) => seen_m > range_m,
        Echo::Miss => true,
        Echo::Invalid => false,
    }
}

fn crowd(beams: &mut [Beam], share: f32, rng: &mut RandomStream) {
    let mut left = (share * beams.len() as f32) as usize;
    while left > 0 {
        let width = between(rng, 3.0, 11.0) as usize;
        let start = between(rng, 0.0, beams.len() as f32) as usize;
        let range_m = between(rng, 0.4, 3.0);
        for beam in beams.iter_mut().skip(start).take(width).filter(|beam| is_before(range_m, beam)) {
            beam.echo = Echo::Hit(range_m + LEG_NOISE_M * normal(rng));
        }
        left = left.saturating_sub(width);
    }
}

/// Somebody who walks along with the robot.
#[derive(Debug, Clone, Copy)]
struct Walker {
    since: Instant,
    until: Instant,
    bearing_rad: f32,
    range_m: f32,
    turn_radps: f32,
}

fn walk(scan: &mut LogScan, company: &mut Vec<Walker>, walkers: usize, rng: &mut RandomStream) {
    let since = scan.stamp;
    company.retain(|walker| walker.until > since);
    while company.len() < walkers {
        let stays = Duration::from_micros((1e6 * between(rng, COMPANY_S.0, COMPANY_S.1)) as i64);
        let until = Instant::from_micros(since.micros.saturating_add(stays.micros));
        let bearing_rad = between(rng, -1.5, 1.5);
        let range_m = between(rng, 1.0, 2.5);
        company.push(Walker { since, until, bearing_rad, range_m, turn_radps: between(rng, -0.1, 0.1) });
    }
    for walker in company {
        let at_rad = walker.bearing_rad + walker.turn_radps * since.since(walker.since).as_secs_f32();
        for aside_m in [-STRIDE_M, STRIDE_M] {
            let leg_rad = at_rad + aside_m.atan2(walker.range_m);
            hide(&mut scan.beams, leg_rad, walker.range_m.hypot(aside_m), rng);
        }
    }
}

/// A leg stands in the way.
fn hide(beams: &mut [Beam], leg_rad: f32, range_m: f32, rng: &mut RandomStream) {
    let half_rad = (LEG_M / range_m).min(1.0).asin();
    let aside = |beam: &Beam| ((beam.bearing_rad - leg_rad + PI).rem_euclid(2.0 * PI) - PI).abs();
    for beam in beams.iter_mut().filter(|beam| aside(beam) <= half_rad && is_before(range_m, beam)) {
        beam.echo = Echo::Hit((range_m - LEG_M + LEG_NOISE_M * normal(rng)).max(0.1));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A round hall of 10 m, 181 beams, four scans a second; every tenth beam sees nothing.
    fn hall() -> Vec<LogScan> {
        let beam = |index: usize| Beam {
            bearing_rad: (index as f32 - 90.0).to_radians(),
            offset: Duration::ZERO,
            echo: if index.is_multiple_of(10) { Echo::Miss } else { Echo::Hit(10.0) },
        };
        let scan = |number: u64| LogScan {
            stamp: Instant::from_micros(250_000 * number as i64),
            range_max_m: 30.0,
            beams: (0..181).map(beam).collect(),
            map_from_robot_odometry: None,
            robot_from_lrf: None,
            line: number + 1,
        };
        (0..40).map(scan).collect()
    }

    fn share(scans: &[LogScan], is: impl Fn(Echo) -> bool) -> f32 {
        let beams: Vec<Echo> = scans.iter().flat_map(|scan| &scan.beams).map(|beam| beam.echo).collect();
        beams.iter().filter(|echo| is(**echo)).count() as f32 / beams.len() as f32
    }

    #[test]
    fn each_row_makes_of_a_log_what_it_says() {
        let hall = hall();
        let near = |echo| matches!(echo, Echo::Hit(range) if range < 3.2);
        let of = |degradation| degrade(&hall, degradation, 1, 0);
        assert_eq!(of(Degradation::None), hall);
        let people = [0.15, 0.3].map(|part| share(&of(Degradation::People(part)), near));
        assert!((0.1..0.2).contains(&people[0]) && (0.2..0.35).contains(&people[1]), "{people:?}");
        let walkers = share(&of(Degradation::Walkers(4)), near);
        assert!((0.05..0.3).contains(&walkers), "{walkers}");
        let view = of(Degradation::View(FRAC_PI_4));
        assert_eq!((view[0].beams.len(), view[0].beams[0].bearing_rad.to_degrees().round()), (91, -45.0));
        let short = of(Degradation::Range { range_m: 5.6, share: 0.03 });
        assert_eq!((short[0].range_max_m, share(&short, |echo| echo == Echo::Miss)), (5.6, 1.0));
        assert_eq!(of(Degradation::Beams(4))[0].beams.len(), 46);
        let fewer = of(Degradation::Scans(8));
        assert_eq!((fewer.len(), fewer[1].line), (5, 9));
        assert_eq!(degrade(&hall, Degradation::Scans(8), 1, 3)[1].line, 12);
        let drops = share(&of(Degradation::NoReturn(0.3)), |echo| echo == Echo::Miss);
        assert!((drops - 0.37).abs() < 0.03, "{drops}");
        let noisy = of(Degradation::Noise(0.05));
        let off = |echo| matches!(echo, Echo::Hit(range) if (range - 10.0).abs() > 0.05);
        assert!((share(&noisy, off) - 0.9 * 0.317).abs() < 0.03, "one in three is farther off than one σ");
    }

    #[test]
    fn chance_is_that_of_the_seed() {
        let hall = hall();
        let with = |seed| degrade(&hall, Degradation::Walkers(4), seed, 0);
        assert!(with(1) == with(1) && with(1) != with(2));
    }
}
