use super::*;
use LrfFamily::{Hokuyo, Ld06, Rplidar, SickLms2xx};
use lrfslam_lrf::driver::{BaudRates, Cause};

fn trouble(step: Step) -> Signs {
    let (cause, tried) = (Cause::NoReply, BaudRates::default());
    Signs { trouble: Some(Trouble { step, cause, sent: "", tried, retry_in: Duration::ZERO }), ..Signs::default() }
}

/// Turns with the second in which each began, and the second and the reason of the end.
type Course = (Vec<(i64, LrfFamily)>, i64, String);

/// A port that is open from the start; `signs` of the driver whose turn it is, ten times a second.
fn course(search: &mut Search<'_>, signs: impl Fn(LrfFamily, i64) -> Signs) -> Course {
    let mut turns = vec![(0, search.family())];
    search.opened(Instant::default());
    for tenth in 0..6000 {
        let signs = signs(search.family(), tenth);
        match search.judge(Instant::from_micros(tenth * 100_000), &signs) {
            Verdict::GoOn => {}
            Verdict::Next => turns.push((tenth / 10, search.family())),
            Verdict::GiveUp(why) => return (turns, tenth / 10, why.to_string()),
        }
    }
    (turns, 600, "goes on".to_owned())
}

fn silent(family: LrfFamily, any_family: bool, waits: bool) -> Course {
    let mut memories = Vec::new();
    let mut search = Search::new(&LrfOptions::new(family), any_family, waits, &mut memories);
    course(&mut search, |_, _| Signs::default())
}

#[test]
fn the_one_asked_for_has_its_time_and_the_others_a_look() {
    let (turns, end, why) = silent(Hokuyo, false, false);
    assert_eq!(turns, [(0, Hokuyo), (10, Ld06), (10, Rplidar), (18, SickLms2xx)]);
    assert!(end == 26 && why.starts_with("no Hokuyo answers, nor any other laser"), "{end} s: {why}");
    assert!(why.contains("nothing was heard"), "{why}");
    // It boots for 15 s, and is asked again.
    let (turns, end, _) = silent(SickLms2xx, false, false);
    assert_eq!((turns.first(), turns.last(), end), (Some(&(0, SickLms2xx)), Some(&(26, SickLms2xx)), 36));
    assert_eq!(silent(Ld06, false, true), (vec![(0, Ld06)], 600, "goes on".to_owned()));
}

#[test]
fn all_have_two_turns_and_more_while_it_is_waited() {
    let (turns, _, why) = silent(Hokuyo, true, false);
    let families: Vec<LrfFamily> = turns.iter().map(|(_, family)| *family).collect();
    assert_eq!(families, [LrfFamily::ALL, LrfFamily::ALL].concat());
    assert!(why.starts_with("no laser that this program knows answers: nothing was heard"), "{why}");
    assert!(silent(Hokuyo, true, true).0.len() > 20);
}

#[test]
fn one_that_has_tried_everything_gives_way() {
    let mut memories = Vec::new();
    let mut search = Search::new(&LrfOptions::new(Hokuyo), true, false, &mut memories);
    let (turns, end, _) = course(&mut search, |_, _| trouble(Step::Find));
    assert_eq!((turns.len(), end), (8, 0));
    let mut memories = Vec::new();
    let mut search = Search::new(&LrfOptions::new(Rplidar), false, false, &mut memories);
    let (turns, end, _) = course(&mut search, |_, _| trouble(Step::Find));
    assert_eq!((turns.len(), end), (4, 10), "but not the one that was asked for");
}

#[test]
fn bytes_that_say_nothing_are_told_with_their_rates() {
    let mut memories = Vec::new();
    let mut search = Search::new(&LrfOptions::new(Hokuyo), false, false, &mut memories);
    for (baud, count) in [(115_200, 1000), (9600, 3), (115_200, 240)] {
        search.hear(baud, count);
    }
    let (_, _, why) = course(&mut search, |_, _| Signs::default());
    assert!(why.contains("heard 1240 bytes at 115200 baud, 3 bytes at 9600 baud, none of it SCIP"), "{why}");
}

#[test]
fn another_laser_is_named() {
    let mut memories = Vec::new();
    let mut search = Search::new(&LrfOptions::new(Rplidar), false, false, &mut memories);
    let is_sick = |family, _| Signs { found: Some(9600).filter(|_| family == SickLms2xx), ..Signs::default() };
    let (_, _, why) = course(&mut search, is_sick);
    assert_eq!(why, "no RPLIDAR answers, but a SICK LMS2xx does at 9600 baud: try --lrf sick-lms2xx");
}

#[test]
fn one_that_answers_must_scan_and_is_then_kept_for_ever() {
    for (scans_at, expected) in [(i64::MAX, 25), (240, 600)] {
        let mut memories = Vec::new();
        let mut search = Search::new(&LrfOptions::new(Hokuyo), false, false, &mut memories);
        let (turns, end, why) = course(&mut search, |_, tenth| Signs {
            found: Some(115_200).filter(|_| tenth == 50),
            scanned: tenth == scans_at,
            ..trouble(Step::Start)
        });
        assert_eq!((turns.len(), end), (1, expected), "{why}");
        assert!(end == 600 || why.contains("no scan came in 20 s; starting scans: no reply"), "{why}");
    }
}

#[test]
fn a_port_that_cannot_be_opened_has_ten_seconds() {
    let give_up = |waits| {
        let mut memories = Vec::new();
        let mut search = Search::new(&LrfOptions::new(Hokuyo), false, waits, &mut memories);
        (0..600).find_map(|tenth| {
            let now = Instant::from_micros(tenth * 100_000);
            search.refused(now, "/dev/x: not there".to_owned());
            match search.judge(now, &Signs::default()) {
                Verdict::GiveUp(why) => Some((tenth / 10, why.to_string())),
                _ => None,
            }
        })
    };
    let words = "/dev/x: not there; gave up after 10 s (--wait waits for it)";
    assert_eq!((give_up(false), give_up(true)), (Some((10, words.to_owned())), None));
}
