//! What the live page draws of what is rare: a loop that closes, a robot that was lost, a 3D map to turn. And that its numbers are those of
//! the same moment as its picture.

use std::time::{Duration as WallDuration, Instant as WallInstant};

use lrfslam_core::geometry::{Point2, Pose2};
use lrfslam_core::time::Instant;
use lrfslam_firmware_sim::scenario::Scenario;
use lrfslam_host::monitor::State;
use lrfslam_host::pose_f64::PoseF64;

use crate::browser::{Browser, Page};
use crate::fed::Fed;
use crate::page::{HAS_MAP, SOON};

fn seconds(s: i64) -> Instant {
    Instant::from_micros(s * 1_000_000)
}

/// A page with the first half minute of a drive, and a browser that sees it.
fn begun(fed: &mut Fed, browser: &mut Browser, size: [u32; 2]) -> (Page, Scenario) {
    let floor = Scenario::load("floor").unwrap();
    let start = floor.drive().pose(Instant::default());
    fed.begin_stretch(PoseF64::new(start.x, start.y, start.heading).to_f32(), 0);
    (0..30).for_each(|s| fed.add_scan(&floor, seconds(s)));
    let page = browser.open(&fed.server.url(), size);
    fed.give();
    browser.wait(&page, HAS_MAP, SOON);
    (page, floor)
}

/// Pixels of the picture for which an expression of `r`, `g`, `b` holds.
fn pixels(browser: &mut Browser, page: &Page, holds: &str) -> u64 {
    let count = format!(
        "(() => {{ const c = lrfslam.views()[0].canvas; const p = c.getContext('2d').getImageData(0, 0, c.width, c.height).data; \
         let n = 0; for (let k = 0; k < p.length; k += 4) {{ const [r, g, b] = [p[k], p[k + 1], p[k + 2]]; n += {holds} }} return n }})()"
    );
    browser.value(page, &count).as_u64().unwrap()
}

/// The colour of the piece apart, in the light.
const APART: &str = "Math.abs(r - 250) + Math.abs(g - 240) + Math.abs(b - 246) < 9";
/// Orange, as walls where they were are, while they fade.
const ORANGE: &str = "(r > 200 && b < r - 60 && g > b)";

#[test]
fn a_map_is_seen_within_two_seconds_of_the_first_scan() {
    let Some(mut browser) = Browser::start() else { return };
    let mut fed = Fed::start("a start");
    let page = browser.open(&fed.server.url(), [1000, 700]);
    browser.wait(&page, "document.getElementById('words').textContent.startsWith('waiting for the first scan')", SOON);
    let floor = Scenario::load("floor").unwrap();
    fed.begin_stretch(Pose2::IDENTITY, 0);
    let begun = WallInstant::now();
    fed.add_scan(&floor, Instant::default());
    fed.give();
    browser.wait(&page, HAS_MAP, SOON);
    let took = begun.elapsed();
    println!("a map was seen {:.2} s after the first scan", took.as_secs_f64());
    assert!(took < WallDuration::from_secs(2), "{took:?}");
    assert_eq!(browser.faults, Vec::<String>::new());
}

#[test]
fn walls_that_move_when_a_loop_closes_are_seen_where_they_were() {
    let Some(mut browser) = Browser::start() else { return };
    let mut fed = Fed::start("a loop");
    let (page, floor) = begun(&mut fed, &mut browser, [1000, 700]);
    let end = floor.drive().pose(seconds(30));
    fed.begin_stretch(PoseF64::new(end.x, end.y, end.heading).to_f32(), 0);
    (30..60).for_each(|s| fed.add_scan(&floor, seconds(s)));
    fed.give();
    browser.wait(&page, "lrfslam.robots()[0].status.scans === 60", SOON);
    assert_eq!(browser.value(&page, "lrfslam.robots()[0].map.ghosts.length"), 0);
    // The second half lies 0.6 m aside from now on.
    fed.stretches[1].map_from_start.y += 0.6;
    fed.closures.push([0, 1]);
    fed.give();
    browser.wait(&page, "lrfslam.robots()[0].map.ghosts.length > 3", SOON);
    browser.wait(
        &page,
        "lrfslam.robots()[0].closed && lrfslam.robots()[0].status.words[0].includes('1 loop closed')",
        SOON,
    );
    // Without the ring that marks the closure, which is as orange.
    browser.value(&page, "lrfslam.robots()[0].closed = null, new Promise(requestAnimationFrame)");
    let ghosts = pixels(&mut browser, &page, ORANGE);
    browser.wait(&page, "lrfslam.robots()[0].map.ghosts.length === 0", SOON);
    std::thread::sleep(WallDuration::from_millis(300));
    let after = pixels(&mut browser, &page, ORANGE);
    println!("{ghosts} pixels of walls where they were, {after} later");
    assert!(ghosts > after + 20, "{ghosts} {after}");
    assert_eq!(browser.faults, Vec::<String>::new());
}

#[test]
fn a_robot_that_was_lost_draws_its_piece_in_another_colour_and_says_so() {
    let Some(mut browser) = Browser::start() else { return };
    let mut fed = Fed::start("a lift");
    let (page, floor) = begun(&mut fed, &mut browser, [1000, 700]);
    fed.now.state = State::Lost;
    fed.now.counts.lost_scans = 4;
    fed.add_scan(&floor, seconds(30));
    fed.give();
    browser.wait(&page, "document.getElementById('words').textContent.startsWith('lost: the scan fits nowhere')", SOON);
    assert_eq!(browser.value(&page, "document.getElementById('mood').className"), "bad");
    assert!(browser.value(&page, "document.title").as_str().unwrap().contains("⚠"));
    // From there it maps a piece of its own.
    fed.now.state = State::Tracking;
    fed.now.undetermined = Some(Point2::new(1.0, 0.0));
    fed.now.counts.pieces_apart = 1;
    let before = pixels(&mut browser, &page, APART);
    fed.begin_stretch(Pose2::new(30.0, 2.0, 0.3), 1);
    (60..80).for_each(|s| fed.add_scan(&floor, seconds(s)));
    // Nor does what is seen now colour it.
    fed.now.hits.clear();
    fed.give();
    browser.wait(&page, "[...lrfslam.robots()[0].map.tiles.values()].some((tile) => tile.layer === 1)", SOON);
    browser.wait(&page, "lrfslam.robots()[0].status.is_apart", SOON);
    std::thread::sleep(WallDuration::from_millis(300));
    let after = pixels(&mut browser, &page, APART);
    assert!(after > before + 2000, "{before} {after} pixels of the piece apart");
    let said = browser.value(&page, "document.getElementById('words').textContent");
    for words in ["corridor: position along it is a guess", "was lost, and draws a new piece of map"] {
        assert!(said.as_str().unwrap().contains(words), "{said}");
    }
    assert!(
        browser.value(&page, "document.getElementById('numbers').innerText").as_str().unwrap().contains("pieces apart")
    );
    // It recognises a place: all is one map again.
    fed.stretches[1].piece = 0;
    fed.now.counts.pieces_apart = 0;
    fed.give();
    browser.wait(&page, "!lrfslam.robots()[0].status.is_apart", SOON);
    assert_eq!(browser.faults, Vec::<String>::new());
}

#[test]
fn a_finger_turns_the_3d_map_and_two_enlarge_it() {
    let Some(mut browser) = Browser::start() else { return };
    let mut fed = Fed::start("a tilted laser");
    let (page, _) = begun(&mut fed, &mut browser, [390, 760]);
    assert_eq!(browser.value(&page, "document.getElementById('cloud').hidden"), true);
    fed.feed.add_cloud((0..5000).map(|k| [(k % 50) as f32 * 0.1, (k / 50 % 10) as f32 * 0.1, (k / 500) as f32 * 0.2]));
    fed.give();
    browser.wait(&page, "lrfslam.robots()[0].cloud.length === 15000 && !document.getElementById('cloud').hidden", SOON);
    browser.press(&page, "c");
    browser.wait(&page, "lrfslam.views()[0].is3d", SOON);
    let picture = "new Promise((done) => setTimeout(() => done(lrfslam.views()[0].canvas.toDataURL()), 300))";
    let still = browser.value(&page, picture);
    let azimuth = browser.value(&page, "lrfslam.views()[0].cloud.azimuth").as_f64().unwrap();
    browser.touch(&page, "touchStart", &[[200.0, 400.0]]);
    (1..=10).for_each(|k| browser.touch(&page, "touchMove", &[[200.0 + 10.0 * f64::from(k), 400.0]]));
    browser.touch(&page, "touchEnd", &[]);
    let turned = browser.value(&page, "lrfslam.views()[0].cloud.azimuth").as_f64().unwrap();
    assert!((turned - azimuth).abs() > 0.4, "{azimuth} {turned}");
    let seen = browser.value(&page, picture);
    assert!(seen != still && seen.as_str().unwrap().len() > 5000, "another picture");
    browser.touch(&page, "touchStart", &[[150.0, 400.0], [250.0, 400.0]]);
    (1..=5).for_each(|k| {
        let by = 10.0 * f64::from(k);
        browser.touch(&page, "touchMove", &[[150.0 - by, 400.0], [250.0 + by, 400.0]]);
    });
    browser.touch(&page, "touchEnd", &[]);
    let zoom = browser.value(&page, "lrfslam.views()[0].cloud.zoom").as_f64().unwrap();
    assert!((1.7..2.3).contains(&zoom), "{zoom}");
    assert_eq!(browser.faults, Vec::<String>::new());
}

#[test]
fn numbers_are_those_of_the_picture() {
    let Some(mut browser) = Browser::start() else { return };
    let mut fed = Fed::start("a drive");
    let (page, floor) = begun(&mut fed, &mut browser, [1000, 700]);
    // A frame after a state has come, what is written beside the arrow is where it is.
    let watch = "(() => { window.off = []; window.seen = 0; const robot = lrfslam.robots()[0], take = robot.take.bind(robot); \
         robot.take = (message) => { take(message); const { revision } = robot; \
         const look = () => { if (robot.revision !== revision) return; seen++; \
         const written = document.querySelector('#numbers dd').textContent, [x, y] = robot.status.pose; \
         if (!written.startsWith(`${x.toFixed(2)}, ${y.toFixed(2)}`)) off.push([written, x, y]) }; \
         requestAnimationFrame(() => requestAnimationFrame(look)) } })()";
    browser.value(&page, watch);
    for s in 30..90 {
        fed.add_scan(&floor, seconds(s));
        fed.give();
    }
    browser.wait(&page, "lrfslam.robots()[0].status.scans === 90", SOON);
    let off = browser.value(&page, "JSON.stringify([off, seen])");
    println!("numbers that were not those of the picture, of how many frames: {off}");
    let off = browser.value(&page, "off.length").as_u64().unwrap();
    let seen = browser.value(&page, "seen").as_u64().unwrap();
    assert!(off == 0 && seen > 5, "{off} of {seen}");
}
