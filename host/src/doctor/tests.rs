//! Logs made wrong on purpose, each with what is to be found in it; and clean ones, in which nothing is.

mod ranges;

use std::fmt::Write as _;
use std::io::Cursor;
use std::path::Path;
use std::sync::OnceLock;

use lrfslam_core::scan::{Beam, Echo};
use lrfslam_core::slam::SlamConfig;
use lrfslam_core::time::{Duration, Instant};

use super::*;
use crate::mapping::MemoryConfig;
use crate::results::report::Input;
use crate::runs::scans::read_scans;
use crate::scans::log::{LogOptions, LogReader};

/// The example, with the true path as its odometry.
fn floor() -> Vec<LogScan> {
    static FLOOR: OnceLock<Vec<LogScan>> = OnceLock::new();
    let read = || {
        let log = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/floor.log.gz");
        let mut scans = read_scans(&log, LogOptions::default()).unwrap();
        scans.truncate(420);
        scans
    };
    FLOOR.get_or_init(read).clone()
}

/// Numbers from 0 to 1, the same in every run.
struct Chance(u64);

impl Chance {
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 40) as f32 / (1_u64 << 24) as f32
    }
}

fn source(log: LogCounts) -> Source {
    let input = Input { name: "test".to_owned(), sha256: None, bytes: 0, format: None };
    Source::Log { input, log, range_max_m: 80.0 }
}

fn examined(scans: impl IntoIterator<Item = LogScan>, source: &Source) -> Diagnosis {
    let smear = SmearLimits { error_m: 0.05, error_rad: 5.0_f32.to_radians() };
    let memory = MemoryConfig { ndt_tiles: 8000, ..MemoryConfig::default() };
    let mut memory = FollowerMemory::new(&SlamConfig::default(), &memory);
    let mut doctor = Doctor::new(smear, &mut memory).unwrap();
    for scan in scans {
        doctor.add_scan(&scan, scan.robot_from_lrf.unwrap_or_default()).unwrap();
    }
    doctor.finish(source)
}

/// What is unusual or wrong with scans.
fn kinds(scans: Vec<LogScan>) -> Vec<&'static str> {
    let diagnosis = examined(scans, &source(LogCounts::default()));
    let told = diagnosis.findings.iter().filter(|finding| finding.severity > Severity::Note);
    told.map(|finding| finding.kind).collect()
}

/// The example with each scan changed by `change`, which is told its number.
fn with(mut change: impl FnMut(usize, &mut LogScan)) -> Vec<LogScan> {
    let mut scans = floor();
    scans.iter_mut().enumerate().for_each(|(number, scan)| change(number, scan));
    scans
}

fn set_odometry(scan: &mut LogScan, change: impl Fn(Pose2) -> Pose2) {
    scan.map_from_robot_odometry = scan.map_from_robot_odometry.map(change);
}

fn set_echoes(scan: &mut LogScan, mut change: impl FnMut(&Beam) -> Echo) {
    scan.beams.iter_mut().for_each(|beam| beam.echo = change(beam));
}

/// As a laser that hangs upside down sees it.
fn mirror(scan: &mut LogScan) {
    let echoes: Vec<Echo> = scan.beams.iter().rev().map(|beam| beam.echo).collect();
    scan.beams.iter_mut().zip(echoes).for_each(|(beam, echo)| beam.echo = echo);
}

#[track_caller]
fn assert_only(expected: &[&str], scans: Vec<LogScan>) {
    assert_eq!(kinds(scans), expected);
}

/// Where a fault has others in its wake.
#[track_caller]
fn assert_among(expected: &str, scans: Vec<LogScan>) {
    let kinds = kinds(scans);
    assert!(kinds.contains(&expected), "{kinds:?}");
}

#[test]
fn nothing_is_wrong_with_a_clean_log() {
    assert_only(&[], floor());
    assert_only(&[], with(|_, scan| scan.map_from_robot_odometry = None));
    let mut chance = Chance(1);
    assert_only(&[], with(|_, scan| scan.beams.retain(|_| chance.next() > 0.1)));
}

#[test]
fn a_short_log_is_no_fault() {
    for scans in 1..5 {
        assert_only(&[], floor().into_iter().take(scans).collect());
    }
}

#[test]
fn other_numbers_of_beams_in_a_few_scans() {
    assert_only(&["odd-beams"], with(|number, scan| scan.beams.truncate(if number == 77 { 100 } else { 181 })));
}

#[test]
fn beams_far_apart() {
    let every = |nth: usize| {
        with(|_, scan| {
            let kept: Vec<_> = scan.beams.iter().copied().step_by(nth).collect();
            scan.beams = kept;
        })
    };
    assert_only(&[], every(3));
    assert_among("few-beams", every(4));
    assert_among("few-beams", every(8));
}

#[test]
fn gaps_bursts_and_times_that_run_back_or_repeat() {
    let at = |millis: i64| Instant::from_micros(millis * 1000);
    let mut gap = floor();
    gap.drain(100..108);
    assert_among("gaps", gap);
    let back = with(|number, scan| scan.stamp = at(250 * number as i64 - if number % 20 == 0 { 700 } else { 0 }));
    assert_among("times-backward", back);
    assert_only(
        &["times-repeated"],
        with(|number, scan| scan.stamp = at(250 * (number as i64 - i64::from(number == 9)))),
    );
    let bursts = with(|number, scan| scan.stamp = at(1000 * (number as i64 / 4) + 20 * (number as i64 % 4)));
    assert_among("bursts", bursts);
    let unsteady = with(|number, scan| scan.stamp = at(250 * number as i64 + [0, 80, -80][number % 3]));
    assert_only(&["unsteady-rate"], unsteady);
}

#[test]
fn what_stands_in_the_view_or_hides_it() {
    let is_there = |beam: &Beam| (0.5..0.7).contains(&beam.bearing_rad);
    let mut chance = Chance(4);
    let mast = |beam: &Beam, chance: &mut Chance| match is_there(beam) {
        true => Echo::Hit(0.4 + 0.01 * chance.next()),
        false => beam.echo,
    };
    let blocked = with(|_, scan| set_echoes(scan, |beam| mast(beam, &mut chance)));
    assert_among("blocked-sector", blocked);
    let later =
        with(|number, scan| set_echoes(scan, |beam| if number > 150 { mast(beam, &mut chance) } else { beam.echo }));
    assert_among("blocked-sector", later);
    let dead = with(|_, scan| set_echoes(scan, |beam| if is_there(beam) { Echo::Invalid } else { beam.echo }));
    assert_only(&["dead-sector"], dead);
}

#[test]
fn a_laser_that_is_covered_or_sees_nothing() {
    let is_then = |number: usize| (200..215).contains(&number);
    let mut chance = Chance(5);
    let covered = with(|number, scan| {
        set_echoes(scan, |beam| if is_then(number) { Echo::Hit(0.05 + 0.02 * chance.next()) } else { beam.echo });
    });
    assert_among("covered", covered);
    let blind = with(|number, scan| set_echoes(scan, |beam| if is_then(number) { Echo::Miss } else { beam.echo }));
    assert_among("sees-nothing", blind);
}

#[test]
fn scans_that_repeat_while_the_robot_moves() {
    let scans = floor();
    let frozen = with(|number, scan| {
        if (100..125).contains(&number) {
            scan.beams.clone_from(&scans[99].beams);
        }
    });
    let without = frozen.iter().cloned().map(|scan| LogScan { map_from_robot_odometry: None, ..scan }).collect();
    let severity = |scans| {
        let diagnosis = examined(scans, &source(LogCounts::default()));
        diagnosis.findings.iter().find(|finding| finding.kind == "frozen-scans").map(|finding| finding.severity)
    };
    assert_eq!(severity(frozen), Some(Severity::Wrong));
    assert!(severity(without).is_some());
}

#[test]
fn a_laser_that_is_turned_on_the_robot() {
    let turned = |degrees: f32| {
        with(move |_, scan| scan.beams.iter_mut().for_each(|beam| beam.bearing_rad -= degrees.to_radians()))
    };
    for degrees in [12.0, -40.0, 180.0] {
        let diagnosis = examined(turned(degrees), &source(LogCounts::default()));
        let found = diagnosis.findings.iter().find(|finding| finding.kind == "laser-turned");
        let advice = &found.unwrap_or_else(|| panic!("{degrees}: {diagnosis:?}")).advice;
        let told: Option<f32> = advice.strip_prefix("add ").and_then(|rest| rest.split(' ').next()?.parse().ok());
        match told {
            Some(told) => assert!((told - degrees).abs() < 2.0, "{degrees}: {advice}"),
            None => assert!(degrees == 180.0 && advice.contains("backwards"), "{degrees}: {advice}"),
        }
    }
}

#[test]
fn a_laser_upside_down_from_the_start_or_from_a_moment_on() {
    assert_among("turns-opposite", with(|_, scan| mirror(scan)));
    let later = with(|number, scan| {
        if number >= 200 {
            mirror(scan)
        }
    });
    let kinds = kinds(later.clone());
    assert!(kinds.contains(&"turns-switch") || kinds.contains(&"mirrored"), "{kinds:?}");
    let without = later.into_iter().map(|scan| LogScan { map_from_robot_odometry: None, ..scan }).collect();
    assert_among("mirrored", without);
}

#[test]
fn motion_too_fast_for_the_rate() {
    let scans = floor().into_iter().step_by(8).collect();
    assert_among("too-fast", scans);
    let sweep = |number: usize, scan: &mut LogScan| {
        let beams = scan.beams.len() as i64;
        for (index, beam) in scan.beams.iter_mut().enumerate() {
            beam.offset = Duration::from_micros(250_000 / beams * (index as i64) + number as i64 % 2);
        }
    };
    assert_among("smeared", with(sweep));
}

#[test]
fn odometry_that_stands_or_never_moves() {
    let held = floor()[100].map_from_robot_odometry;
    assert_among(
        "odometry-frozen",
        with(|number, scan| {
            if (100..200).contains(&number) {
                scan.map_from_robot_odometry = held;
            }
        }),
    );
    assert_only(&["odometry-frozen"], with(|_, scan| set_odometry(scan, |_| Pose2::new(1.0, 2.0, 0.5))));
}

#[test]
fn odometry_with_its_sign_or_scale_wrong() {
    assert_among(
        "turns-opposite",
        with(|_, scan| set_odometry(scan, |pose| Pose2::new(pose.x, -pose.y, -pose.heading))),
    );
    let scaled = with(|_, scan| set_odometry(scan, |pose| Pose2::new(1.5 * pose.x, 1.5 * pose.y, pose.heading)));
    assert_among("odometry-scale", scaled);
    let mut own = Pose2::IDENTITY;
    let mut last = None;
    let turns = with(|_, scan| {
        let pose = scan.map_from_robot_odometry.unwrap();
        let step = last.replace(pose).map_or(Pose2::IDENTITY, |last: Pose2| last.between(pose));
        own = own * Pose2::new(step.x, step.y, 0.6 * step.heading);
        scan.map_from_robot_odometry = Some(own);
    });
    assert_among("turn-scale", turns);
}

#[test]
fn odometry_that_is_late_or_says_nothing_of_the_motion() {
    let poses: Vec<Option<Pose2>> = floor().iter().map(|scan| scan.map_from_robot_odometry).collect();
    let late = with(|number, scan| scan.map_from_robot_odometry = poses[number.saturating_sub(7)]);
    let diagnosis = examined(late, &source(LogCounts::default()));
    let found = diagnosis.findings.iter().find(|finding| finding.kind == "odometry-late").unwrap();
    assert!(found.found.starts_with("the odometry is 7 scans late, 1.75 s"), "{}", found.found);
    let mut chance = Chance(6);
    let mut own = Pose2::IDENTITY;
    let random = with(|_, scan| {
        own = own * Pose2::new(0.2 * chance.next(), 0.0, 0.2 * (chance.next() - 0.5));
        scan.map_from_robot_odometry = Some(own);
    });
    assert_among("odometry-disagrees", random);
}

/// The example as a CARMEN log of `FLASER` lines, with what `ranges` makes of a range, m, and where the laser sits, m ahead.
fn carmen(ranges: impl Fn(usize, f32) -> f32, ahead_m: impl Fn(usize) -> f32) -> String {
    let mut text = String::new();
    for (number, scan) in floor().iter().take(200).enumerate() {
        let pose = scan.map_from_robot_odometry.unwrap();
        let lrf = pose * Pose2::new(ahead_m(number), 0.0, 0.0);
        let _ = write!(text, "FLASER {}", scan.beams.len());
        for (index, beam) in scan.beams.iter().enumerate() {
            let range = if let Echo::Hit(range) = beam.echo { range } else { 81.9 };
            let _ = write!(text, " {}", ranges(index, range));
        }
        for Pose2 { x, y, heading } in [lrf, pose] {
            let _ = write!(text, " {x:.4} {y:.4} {heading:.5}");
        }
        let _ = writeln!(text, " {0:.3} host {0:.3}", scan.stamp.as_secs_f64());
    }
    text
}

/// What is unusual or wrong with the text of a log.
fn kinds_of(text: &str) -> Vec<&'static str> {
    let mut log = LogReader::from_reader("test", Cursor::new(text.to_owned()), LogOptions::default()).unwrap();
    let scans: Vec<LogScan> = log.by_ref().collect::<Result<_, _>>().unwrap();
    let diagnosis = examined(scans, &source(log.counts()));
    let told = diagnosis.findings.iter().filter(|finding| finding.severity > Severity::Note);
    told.map(|finding| finding.kind).collect()
}

#[test]
fn lines_that_are_damaged_or_cut() {
    let clean = carmen(|_, range| range, |_| 0.2);
    assert_eq!(kinds_of(&clean), [""; 0]);
    let damage =
        |(number, line): (usize, &str)| if number % 40 == 39 { line.replacen(" 1", " x", 1) } else { line.to_owned() };
    let damaged: Vec<String> = clean.lines().enumerate().map(damage).collect();
    assert_eq!(kinds_of(&(damaged.join("\n") + "\n"))[..1], ["damaged-lines"]);
    assert_eq!(kinds_of(&clean[..clean.len() - 40]), ["cut-log"]);
}

#[test]
fn lengths_in_another_unit() {
    for factor in [1000.0, 100.0, 0.001] {
        assert_eq!(kinds_of(&carmen(|_, range| factor * range, |_| 0.2))[0], "other-unit", "{factor}");
    }
}

#[test]
fn a_mounting_that_contradicts_itself_and_angles_that_nothing_tells() {
    let moved = carmen(|_, range| range, |number| if number < 100 { 0.2 } else { 0.35 });
    assert!(kinds_of(&moved).contains(&"mounting-contradictions"));
    let fewer: String = carmen(|_, range| range, |_| 0.2)
        .lines()
        .map(|line| {
            let words: Vec<&str> = line.split(' ').collect();
            format!(
                "FLASER 91 {} {}\n",
                words[2..183].iter().step_by(2).copied().collect::<Vec<_>>().join(" "),
                words[183..].join(" ")
            )
        })
        .collect();
    assert!(kinds_of(&fewer).contains(&"guessed-angles"));
}

#[test]
fn trouble_of_a_laser_is_told() {
    let laser = LaserCounts { damaged: 3, restarts: 1, incomplete: 4, overrun: 2, too_fast: 0 };
    let source = Source::Laser { port: "test".to_owned(), laser, recording: None };
    let diagnosis = examined(floor(), &source);
    let kinds: Vec<&str> = diagnosis.findings.iter().take(4).map(|finding| finding.kind).collect();
    assert_eq!(
        (kinds.as_slice(), diagnosis.severity()),
        (&["restarts", "damaged-scans", "incomplete-turns", "overrun"][..], Severity::Wrong)
    );
}

#[test]
fn findings_say_what_to_do_and_where() {
    let mut scans = floor();
    scans.drain(100..120);
    let diagnosis = examined(scans, &source(LogCounts::default()));
    assert_eq!(
        diagnosis.count(Severity::Wrong) + diagnosis.count(Severity::Unusual),
        diagnosis.findings.iter().filter(|f| !f.means.is_empty()).count()
    );
    let gaps = diagnosis.findings.iter().find(|finding| finding.kind == "gaps").unwrap();
    assert_eq!((gaps.at.len(), gaps.at[0].to_line - gaps.at[0].from_line), (1, 21));
    assert!(gaps.at[0].to_string().starts_with("lines 1"), "{}", gaps.at[0]);
}
