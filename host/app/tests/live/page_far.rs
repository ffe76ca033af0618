//! A kilometre of corridors on the live page: what a late viewer is sent, and how fluently it is drawn.
//!
//! `cargo test --release -p lrfslam --all-features --test live a_kilometre -- --ignored --nocapture`

use std::time::Duration;

use lrfslam_core::time::Instant;
use lrfslam_firmware_sim::scenario::Scenario;
use lrfslam_host::pose_f64::PoseF64;

use crate::browser::{Browser, Page};
use crate::fed::Fed;
use crate::page::{HAS_MAP, SOON};

const LATER: Duration = Duration::from_secs(300);
/// Metres of a row, and how many rows: they lie 5 m apart.
const ROW_M: i32 = 60;
const ROWS: i32 = 16;
/// Frames of which each is drawn from another place.
const FRAMES: usize = 150;
/// 30 frames a second, ms.
const FRAME_MS: f64 = 1000.0 / 30.0;

/// A corridor there and back and there again, 1 km and more of it, and a robot that drives all of it.
fn corridors() -> Scenario {
    let corners: Vec<String> = (0..ROWS)
        .flat_map(|row| if row % 2 == 0 { [(0, row), (ROW_M, row)] } else { [(ROW_M, row), (0, row)] })
        .map(|(x, row)| format!("[{x}, {}]", 5 * row))
        .collect();
    let way = corners.join(", ");
    let text = format!(
        "[[corridor]]\nway = [{way}]\nwidth_m = 2.4\n[robot]\nroute = [{way}]\nspeed_mps = 1.5\nacceleration_mps2 = 2\nturn_degps = 120\n"
    );
    Scenario::parse(&text, "corridors", std::path::Path::new("")).unwrap()
}

/// Median and the slowest of twenty, ms: from frame to frame, and until the picture of one is there. A pixel of each is read, so that none is
/// left out.
fn frame_times(browser: &mut Browser, page: &Page) -> [f64; 4] {
    let draw = format!(
        "new Promise((done) => {{ const view = lrfslam.views()[0], between = [], taken = []; let last = 0; \
         const pen = view.canvas.getContext('2d'); view.frameTimes.length = 0; \
         const step = (now) => {{ if (last) between.push(now - last); last = now; \
         const begun = performance.now(); pen.getImageData(0, 0, 1, 1); \
         taken.push(performance.now() - begun + (view.frameTimes.at(-1) ?? 0)); \
         view.pan(between.length % 2 ? 9 : -9, 5); \
         if (between.length < {FRAMES}) return requestAnimationFrame(step); \
         const of = (times) => {{ times.sort((a, b) => a - b); return [times[times.length >> 1], times[Math.floor(0.95 * times.length)]] }}; \
         done([...of(between), ...of(taken)]) }}; requestAnimationFrame(step) }})"
    );
    let times = browser.value(page, &draw);
    [0, 1, 2, 3].map(|k| times[k].as_f64().unwrap())
}

#[test]
#[ignore = "heavy: run by .ci/run"]
fn a_kilometre_of_corridors_is_sent_at_once_and_drawn_fluently() {
    let Some(mut browser) = Browser::start() else { return };
    let scenario = corridors();
    let drive = scenario.drive();
    let end = drive.end().expect("the route ends");
    let mut fed = Fed::start("a kilometre of corridors");
    let start = drive.pose(Instant::default());
    fed.begin_stretch(PoseF64::new(start.x, start.y, start.heading).to_f32(), 0);
    (0..end.micros / 200_000).for_each(|k| fed.add_scan(&scenario, Instant::from_micros(k * 200_000)));
    let first = browser.open(&fed.server.url(), [1280, 800]);
    fed.give();
    browser.wait(&first, HAS_MAP, LATER);
    browser.wait(&first, "lrfslam.robots()[0].status.way_m > 950", LATER);
    std::thread::sleep(Duration::from_secs(1));
    // Who comes late.
    let late = browser.open(&fed.server.url(), [1280, 800]);
    let took = browser.wait(&late, "lrfslam.robots()[0].status.way_m > 950 && lrfslam.views()[0].frames > 0", SOON);
    let about = "(() => { const [robot] = lrfslam.robots(); return [robot.received[0], robot.map.tiles.size, robot.pathLength, robot.status.way_m] })()";
    let about = browser.value(&late, about);
    let [bytes, tiles, points, way_m] = [0, 1, 2, 3].map(|k| about[k].as_f64().unwrap());
    println!(
        "{way_m:.0} m of way: {tiles} tiles, {points} points of the path; a late viewer is sent {:.0} kB and has its picture after {:.1} s",
        bytes / 1e3,
        took.as_secs_f64()
    );
    assert!(way_m > 1000.0 && bytes < 3e6, "{way_m} m, {bytes} bytes");
    for (name, look) in
        [("all of it", "fit()"), ("about the robot", "follow()"), ("1 m on 4 pixels", "camera.scale = 4")]
    {
        browser.value(&late, &format!("lrfslam.views()[0].{look}"));
        std::thread::sleep(Duration::from_millis(500));
        // The best of three: what else runs on the computer is not the page's.
        let times = (0..3).map(|_| frame_times(&mut browser, &late)).min_by(|a, b| a[0].total_cmp(&b[0])).unwrap();
        let [median, slow, drawing, slow_drawing] = times;
        println!(
            "{name}: a frame every {median:.1} ms, one of twenty later than {slow:.1} ms; drawing it takes {drawing:.1} and {slow_drawing:.1} ms"
        );
        assert!(median < FRAME_MS, "{name}: {median} ms");
    }
    if let Some(folder) = std::env::var_os("LRFSLAM_PICTURES") {
        browser.value(&late, "lrfslam.views()[0].fit()");
        std::thread::sleep(Duration::from_millis(500));
        std::fs::write(std::path::Path::new(&folder).join("kilometre.png"), browser.picture(&late)).unwrap();
    }
    assert_eq!(browser.faults, Vec::<String>::new());
}
