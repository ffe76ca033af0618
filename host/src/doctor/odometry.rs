//! Odometry against matching: do the two tell of the same motion?
//!
//! Steps → the lag at which they fit best → pieces of half a metre or 20° → directions, lengths and turns compared. Matching is taken as
//! right: what differs is the odometry's fault, or that of where the laser is said to sit.

use lrfslam_core::geometry::Pose2;

use super::finding::{Finding, Mark, Stretch, percent, quantile};
use super::follow::Step;
use crate::plural::count;

/// A piece ends after so much way, m …
const PIECE_M: f32 = 0.5;
/// … or after such a turn, rad.
const PIECE_RAD: f32 = 0.35;
/// Pieces that are needed to say something.
const PIECES: usize = 8;
/// A piece that turns less than this is straight, rad.
const STRAIGHT_RAD: f32 = 0.1;
/// Lags that are tried, scans to either side.
const LAGS: i64 = 15;
/// A lag is believed if the two fit at least so well with it …
const FITS: f64 = 0.5;
/// … and so much better than without.
const FITS_BETTER: f64 = 0.08;
/// The laser is said to be turned from here on, rad.
const TURNED_RAD: f64 = 0.07;
/// Directions must agree with one another so well, 0 to 1.
const ONE_WAY: f64 = 0.8;
/// Lengths and turns may differ by this factor.
const SCALE: f64 = 1.15;
/// And are wrong from here on.
const SCALE_WRONG: f64 = 1.35;
/// Odometry that stands for so many scans …
const FROZEN_SCANS: usize = 10;
/// … in which the robot moves so far, m …
const FROZEN_M: f32 = 0.5;
/// … or turns so far, rad, is frozen.
const FROZEN_RAD: f32 = 0.5;
/// Matching may drift while the robot stands; so many of the beams change if it moves.
const STRAYED: f64 = 0.4;

/// A piece of the way, by both.
#[derive(Debug, Clone, Copy)]
struct Piece {
    from: Mark,
    to: Mark,
    matched: Pose2,
    odometry: Pose2,
}

/// Compares `steps`; `interval_s` is the usual time between scans, s.
pub(super) fn report(steps: &[Step], interval_s: f64, findings: &mut Vec<Finding>) {
    let with = steps.iter().filter(|step| step.odometry.is_some()).count();
    if with == 0 {
        findings.push(Finding::note("no-odometry", "no odometry: nothing to compare the scans with".to_owned()));
        return;
    }
    let moves = steps.iter().filter_map(|step| step.odometry).any(|step| step != Pose2::IDENTITY);
    let driven_m: f32 = steps.iter().filter_map(|step| step.matched).map(|step| step.position().norm()).sum();
    if !moves && driven_m > FROZEN_M {
        let found = format!("the odometry never moves, the scans do, over {driven_m:.1} m");
        let advice = "do without --odometry";
        findings.push(Finding::wrong("odometry-frozen", found, "it tells nothing").so(advice));
        return;
    }
    frozen(steps, findings);
    let lag = late(steps, interval_s, findings);
    let pieces = pieces(steps, lag);
    if pieces.len() < PIECES {
        findings.push(Finding::note("odometry", "the robot moves too little to compare odometry and scans".to_owned()));
        return;
    }
    let opposite = turns(&pieces, findings);
    directions(&pieces, findings);
    lengths(&pieces, findings);
    if !opposite {
        agreement(&pieces, findings);
    }
}

fn frozen(steps: &[Step], findings: &mut Vec<Finding>) {
    let stands = |step: &Step| step.odometry == Some(Pose2::IDENTITY);
    let mut found = Vec::new();
    for run in steps.chunk_by(|a, b| stands(a) == stands(b)) {
        let (Some(first), Some(last)) = (run.first(), run.last()) else { continue };
        let moved = run.iter().filter_map(|step| step.matched).fold(Pose2::IDENTITY, |sum, step| sum * step);
        let has_moved = moved.position().norm() > FROZEN_M || moved.heading.abs() > FROZEN_RAD;
        let has_strayed = run.iter().any(|step| step.strayed > STRAYED);
        if has_strayed && stands(first) && run.len() >= FROZEN_SCANS && has_moved {
            found.push((Stretch::new(first.mark, last.mark), moved));
        }
    }
    let Some((_, moved)) = found.first() else { return };
    let text = format!(
        "the odometry stands still {} while the scans move, the first time by {:.2} m and {:.0}°",
        count(found.len() as u64, "time"),
        moved.position().norm(),
        moved.heading.abs().to_degrees()
    );
    let means = "with --odometry the robot is looked for where it was";
    let finding =
        Finding::wrong("odometry-frozen", text, means).so("do without --odometry, or look at the wheels' encoders");
    findings.push(finding.at(found.into_iter().map(|(stretch, _)| stretch)));
}

/// How many scans the odometry is late, and how well it fits then.
fn late(steps: &[Step], interval_s: f64, findings: &mut Vec<Finding>) -> i64 {
    let turn = |step: Option<Pose2>| f64::from(step.map_or(0.0, |step| step.heading.clamp(-0.4, 0.4)));
    let fit = |lag: i64| {
        let (mut both, mut ours, mut theirs) = (0.0, 0.0, 0.0);
        for (index, step) in steps.iter().enumerate() {
            let other = usize::try_from(index as i64 + lag).ok().and_then(|other| steps.get(other));
            let (Some(_), Some(other)) = (step.matched, other) else { continue };
            let (a, b) = (turn(step.matched), turn(other.odometry));
            (both, ours, theirs) = (both + a * b, ours + a * a, theirs + b * b);
        }
        both / (ours * theirs).sqrt().max(1e-9)
    };
    let at_once = fit(0);
    let best = (-LAGS..=LAGS).map(|lag| (lag, fit(lag))).max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()));
    let Some((lag, fits)) = best.filter(|(lag, fits)| *lag != 0 && fits.abs() > FITS.max(at_once.abs() + FITS_BETTER))
    else {
        return 0;
    };
    let word = if lag > 0 { "late" } else { "early" };
    let found = format!(
        "the odometry is {} {word}, {:.2} s: its turns then fit those of the scans by {:.2} instead of {:.2} (1 is perfect)",
        count(lag.unsigned_abs(), "scan"),
        lag.unsigned_abs() as f64 * interval_s,
        fits.abs(),
        at_once.abs()
    );
    let means =
        "odometry and laser have clocks of their own, or one of them waits in a queue: every prediction is late";
    let of = if at_once.abs() < FITS { Finding::wrong } else { Finding::unusual };
    findings.push(of("odometry-late", found, means).so("do without --odometry, or stamp both by one clock"));
    lag
}

fn pieces(steps: &[Step], lag: i64) -> Vec<Piece> {
    let mut pieces = Vec::new();
    let mut open: Option<Piece> = None;
    for (index, step) in steps.iter().enumerate() {
        let other = usize::try_from(index as i64 + lag).ok().and_then(|other| steps.get(other));
        let both = step.matched.filter(|_| !step.is_undetermined).zip(other.and_then(|other| other.odometry));
        let Some((matched, odometry)) = both else {
            open = None;
            continue;
        };
        let start = Piece { from: step.mark, to: step.mark, matched: Pose2::IDENTITY, odometry: Pose2::IDENTITY };
        let piece = open.get_or_insert(start);
        piece.to = step.mark;
        piece.matched = piece.matched * matched;
        piece.odometry = piece.odometry * odometry;
        let has_moved = |pose: Pose2| pose.position().norm() > PIECE_M || pose.heading.abs() > PIECE_RAD;
        if has_moved(piece.matched) || has_moved(piece.odometry) {
            pieces.extend(open.take());
        }
    }
    pieces
}

/// True if the two turn in opposite directions, everywhere or from a moment on.
fn turns(pieces: &[Piece], findings: &mut Vec<Finding>) -> bool {
    let is_turn = |piece: &&Piece| piece.odometry.heading.abs().min(piece.matched.heading.abs()) > 2.0 * STRAIGHT_RAD;
    let turns: Vec<&Piece> = pieces.iter().filter(is_turn).collect();
    let is_opposite = |piece: &&Piece| piece.odometry.heading * piece.matched.heading < 0.0;
    let opposite = turns.iter().filter(|piece| is_opposite(piece)).count();
    let means = "the laser hangs upside down, its beams are numbered the other way, or the odometry has its sign wrong: a map of \
                 mirrored scans is a mirror image";
    let advice = "turn the order of the beams around if the laser is upside down; the map is right without --odometry if it is not";
    if turns.len() >= PIECES && opposite * 10 > turns.len() * 8 {
        let found = format!("the scans turn against the odometry in {opposite} of {} turns", turns.len());
        findings.push(Finding::wrong("turns-opposite", found, means).so(advice));
        return true;
    }
    // The moment at which most turns before it agree and most after it do not, or the other way round.
    let agreeing: i64 = turns.len() as i64 - opposite as i64;
    let (mut before, mut best) = (0_i64, (0_i64, 0));
    for (index, piece) in turns.iter().enumerate() {
        before += if is_opposite(piece) { -1 } else { 1 };
        let after = agreeing - opposite as i64 - before;
        if (before - after).abs() > best.0 {
            best = ((before - after).abs(), index);
        }
    }
    let (gain, last) = best;
    if opposite * 4 > turns.len() && opposite >= 4 && gain * 10 > turns.len() as i64 * 8 {
        let (from, to) = (turns[last].to, turns.get(last + 1).map_or(turns[last].to, |piece| piece.from));
        let found = "from one moment on the scans turn the other way, as seen by the odometry".to_owned();
        findings.push(Finding::wrong("turns-switch", found, means).so(advice).at([Stretch::new(from, to)]));
        return true;
    }
    if turns.len() >= PIECES {
        scale(
            &turns,
            |piece| f64::from(piece.matched.heading / piece.odometry.heading),
            ("turn-scale", "turns"),
            findings,
        );
    }
    false
}

/// Where the robot goes by matching, seen from where it goes by odometry.
fn directions(pieces: &[Piece], findings: &mut Vec<Finding>) {
    let straight = straight(pieces);
    let (mut along, mut across, mut all) = (0.0, 0.0, 0.0);
    for Piece { matched, odometry, .. } in &straight {
        along += f64::from(odometry.x * matched.x + odometry.y * matched.y);
        across += f64::from(odometry.x * matched.y - odometry.y * matched.x);
        all += f64::from(odometry.position().norm() * matched.position().norm());
    }
    let angle = across.atan2(along);
    if straight.len() < PIECES || along.hypot(across) < ONE_WAY * all || angle.abs() < TURNED_RAD {
        return;
    }
    let (degrees, set) = (angle.to_degrees(), -angle.to_degrees());
    let found = format!(
        "by the scans the robot drives {degrees:+.1}° aside of where it drives by odometry, over {} pieces",
        straight.len()
    );
    let means = "the laser is turned on the robot, and the path is that of a robot that drives sideways";
    let advice = match degrees.abs() > 150.0 {
        true => "the laser looks backwards: set mounting.heading_deg to 180 more, or the odometry counts backwards"
            .to_owned(),
        false => {
            format!("add {set:+.1} to mounting.heading_deg, with mounting.from_log=false if the log says otherwise")
        }
    };
    findings.push(Finding::wrong("laser-turned", found, means).so(advice));
}

fn straight(pieces: &[Piece]) -> Vec<Piece> {
    let is_straight = |Piece { matched, odometry, .. }: &&Piece| {
        let turns = matched.heading.abs().max(odometry.heading.abs());
        turns < STRAIGHT_RAD && matched.position().norm().min(odometry.position().norm()) > PIECE_M / 4.0
    };
    pieces.iter().filter(is_straight).copied().collect()
}

fn lengths(pieces: &[Piece], findings: &mut Vec<Finding>) {
    let straight = straight(pieces);
    let straight: Vec<&Piece> = straight.iter().collect();
    if straight.len() >= PIECES {
        let ratio = |piece: &Piece| f64::from(piece.matched.position().norm() / piece.odometry.position().norm());
        scale(&straight, ratio, ("odometry-scale", "ways"), findings);
    }
}

/// * `what` — name of the finding, and of what is measured
fn scale(pieces: &[&Piece], ratio: impl Fn(&Piece) -> f64, what: (&'static str, &str), findings: &mut Vec<Finding>) {
    let mut ratios: Vec<f64> = pieces.iter().map(|piece| ratio(piece)).collect();
    let Some(median) = quantile(&mut ratios, 0.5) else { return };
    let off = median.max(1.0 / median);
    let (kind, name) = what;
    if median <= 0.0 || off < SCALE {
        return;
    }
    let found =
        format!("{name} are {median:.2} times as large by the scans as by odometry, in the median of {}", pieces.len());
    let means = "the wheels' diameter or distance is wrong, or the angles of the beams are";
    let advice = "scale the odometry, or check log.field_of_view_deg; without --odometry only the beams' angles matter";
    let of = if off > SCALE_WRONG { Finding::wrong } else { Finding::unusual };
    findings.push(of(kind, found, means).so(advice));
}

/// How often the two tell the same.
fn agreement(pieces: &[Piece], findings: &mut Vec<Finding>) {
    let agrees = |piece: &&Piece| {
        let error = piece.odometry.between(piece.matched);
        let allowed_m = 0.05 + 0.15 * piece.matched.position().norm();
        error.position().norm() < allowed_m && error.heading.abs() < 0.05 + 0.15 * piece.matched.heading.abs()
    };
    let (agreeing, all) = (pieces.iter().filter(agrees).count() as f64, pieces.len() as f64);
    let found =
        format!("odometry and scans tell the same in {} of {} pieces of the way", percent(agreeing, all), pieces.len());
    findings.push(match agreeing < 0.5 * all {
        true => {
            let means = "one of the two is wrong more often than not";
            Finding::unusual("odometry-disagrees", found, means).so("do without --odometry")
        }
        false => Finding::note("odometry", found),
    });
}
