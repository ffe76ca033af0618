//! What fingers, mouse and keys do to the live page, and what its buttons do to the run.

use std::fs;
use std::time::{Duration, Instant};

use crate::browser::{Browser, Page};
use crate::page::{HAS_ENDED, HAS_MAP, LATER, SOON, Watched};

/// A number of the view.
fn of_view(browser: &mut Browser, page: &Page, name: &str) -> f64 {
    browser.value(page, &format!("lrfslam.views()[0].{name}")).as_f64().unwrap_or_else(|| panic!("{name}"))
}

fn scans(browser: &mut Browser, page: &Page) -> u64 {
    browser.value(page, "lrfslam.robots()[0].status.scans").as_u64().unwrap()
}

#[test]
fn buttons_pause_save_and_stop_a_run() {
    let Some(mut browser) = Browser::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    let mut run = Watched::start(folder.path(), "0", 600, &[]);
    let page = browser.open(&run.url(), [1000, 700]);
    browser.wait(&page, HAS_MAP, SOON);
    // The space bar pauses, and so does the button.
    browser.press(&page, " ");
    browser.wait(&page, "lrfslam.robots()[0].status.is_paused", SOON);
    browser.wait(&page, "document.getElementById('pause').getAttribute('aria-pressed') === 'true'", SOON);
    std::thread::sleep(Duration::from_millis(500));
    let paused = scans(&mut browser, &page);
    std::thread::sleep(Duration::from_millis(1500));
    assert_eq!(scans(&mut browser, &page), paused, "a paused run takes no scan");
    assert!(paused < 600, "paused too late");
    browser.click_on(&page, "#pause");
    browser.wait(
        &page,
        &format!("!lrfslam.robots()[0].status.is_paused && lrfslam.robots()[0].status.scans > {paused}"),
        SOON,
    );
    // Saved now: there are results before the end, and they say so.
    let report = folder.path().join("watched/run.json");
    assert!(!report.exists());
    browser.press(&page, "s");
    let begun = Instant::now();
    while !fs::read_to_string(&report).is_ok_and(|text| text.contains("\"running\"")) {
        assert!(begun.elapsed() < SOON, "nothing is saved");
        std::thread::sleep(Duration::from_millis(20));
    }
    assert!(folder.path().join("watched/map.png").exists());
    // Stop asks first.
    browser.click_on(&page, "#stop");
    browser.wait(&page, "document.getElementById('ask').open", SOON);
    browser.click_on(&page, "dialog [value=no]");
    std::thread::sleep(Duration::from_millis(300));
    assert!(run.child.try_wait().unwrap().is_none(), "no is no");
    browser.click_on(&page, "#stop");
    browser.wait(&page, "document.getElementById('ask').open", SOON);
    browser.click_on(&page, "dialog [value=stop]");
    assert_eq!(run.child.wait().unwrap().code(), Some(130), "ended early");
    let text = fs::read_to_string(&report).unwrap();
    assert!(text.contains("\"ending\": \"interrupted\""), "{text}");
    browser.wait(&page, "document.getElementById('words').textContent.includes('the program has ended')", SOON);
    assert_eq!(browser.faults, Vec::<String>::new());
}

#[test]
fn fingers_and_keys_move_the_map_and_measure_in_it() {
    let Some(mut browser) = Browser::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    let run = Watched::start(folder.path(), "0", 60, &["--monitor-stay"]);
    let page = browser.open(&run.url(), [390, 760]);
    browser.wait(&page, HAS_ENDED, LATER);
    browser.wait(&page, HAS_MAP, SOON);
    one_finger_pans(&mut browser, &page);
    two_fingers_zoom_about_what_they_hold(&mut browser, &page);
    keys_do_what_the_guide_says(&mut browser, &page);
    two_taps_measure(&mut browser, &page);
    assert_eq!(browser.faults, Vec::<String>::new());
}

fn one_finger_pans(browser: &mut Browser, page: &Page) {
    browser.press(page, "0");
    browser.wait(page, "lrfslam.views()[0].fits", SOON);
    std::thread::sleep(Duration::from_millis(200));
    let [x, y, scale] = ["camera.x", "camera.y", "camera.scale"].map(|name| of_view(browser, page, name));
    browser.touch(page, "touchStart", &[[200.0, 300.0]]);
    (1..=8)
        .for_each(|k| browser.touch(page, "touchMove", &[[200.0 + 10.0 * f64::from(k), 300.0 - 5.0 * f64::from(k)]]));
    browser.touch(page, "touchEnd", &[]);
    let [to_x, to_y, same] = ["camera.x", "camera.y", "camera.scale"].map(|name| of_view(browser, page, name));
    // The first few pixels are no drag yet.
    let (moved_x, moved_y) = ((x - to_x) * scale, (y - to_y) * scale);
    assert!((moved_x - 80.0).abs() < 15.0 && (moved_y - 40.0).abs() < 10.0 && same == scale, "{moved_x} {moved_y}");
    assert_eq!(browser.value(page, "lrfslam.views()[0].fits || lrfslam.views()[0].follows"), false);
}

fn two_fingers_zoom_about_what_they_hold(browser: &mut Browser, page: &Page) {
    let scale = of_view(browser, page, "camera.scale");
    let held = browser.value(page, "lrfslam.views()[0].camera.point(200, 300)");
    browser.touch(page, "touchStart", &[[150.0, 300.0], [250.0, 300.0]]);
    (1..=10).for_each(|k| {
        let by = 5.0 * f64::from(k);
        browser.touch(page, "touchMove", &[[150.0 - by, 300.0], [250.0 + by, 300.0]]);
    });
    browser.touch(page, "touchEnd", &[]);
    let zoomed = of_view(browser, page, "camera.scale") / scale;
    assert!((zoomed - 2.0).abs() < 0.1, "{zoomed}");
    let place = browser.value(page, "lrfslam.views()[0].camera.point(200, 300)");
    for axis in 0..2 {
        let off = (held[axis].as_f64().unwrap() - place[axis].as_f64().unwrap()).abs();
        assert!(off * scale < 4.0, "what lies between the fingers stays there: {held} {place}");
    }
}

fn keys_do_what_the_guide_says(browser: &mut Browser, page: &Page) {
    for (key, held) in [
        ("f", "view.follows"),
        ("+", "true"),
        ("ArrowLeft", "!view.follows && !view.fits"),
        ("0", "view.fits"),
        ("-", "!view.fits"),
        ("g", "document.getElementById('panel').classList.contains('shown')"),
        ("g", "!document.getElementById('panel').classList.contains('shown')"),
        ("l", "document.documentElement.dataset.theme === 'dark'"),
        ("l", "document.documentElement.dataset.theme === 'light'"),
        ("m", "view.measures"),
        ("m", "!view.measures"),
        ("c", "!view.is3d"),
        ("Escape", "true"),
    ] {
        browser.press(page, key);
        let asked = format!("(() => {{ const view = lrfslam.views()[0]; return Boolean({held}) }})()");
        assert_eq!(browser.value(page, &asked), true, "{key}: {held}");
    }
    for (key, name, grows) in
        [("+", "camera.scale", true), ("-", "camera.scale", false), ("ArrowRight", "camera.x", true)]
    {
        let before = of_view(browser, page, name);
        browser.press(page, key);
        assert_eq!(of_view(browser, page, name) > before, grows, "{key}");
    }
}

fn two_taps_measure(browser: &mut Browser, page: &Page) {
    browser.press(page, "m");
    let scale = of_view(browser, page, "camera.scale");
    for place in [[120.0, 300.0], [270.0, 380.0]] {
        browser.touch(page, "touchStart", &[place]);
        browser.touch(page, "touchEnd", &[]);
    }
    let measured =
        "(() => { const [[ax, ay], [bx, by]] = lrfslam.views()[0].measured; return Math.hypot(bx - ax, by - ay) })()";
    let measured_m = browser.value(page, measured).as_f64().unwrap();
    assert!((measured_m - 170.0 / scale).abs() < 0.01, "{measured_m} m for 170 pixels of {scale} to a metre");
    // A third tap begins anew; a drag is no tap.
    browser.touch(page, "touchStart", &[[200.0, 300.0]]);
    browser.touch(page, "touchMove", &[[260.0, 300.0]]);
    browser.touch(page, "touchEnd", &[]);
    assert_eq!(browser.value(page, "lrfslam.views()[0].measured.length"), 2);
    browser.click(page, [200.0, 350.0]);
    assert_eq!(browser.value(page, "lrfslam.views()[0].measured.length"), 1);
    browser.press(page, "m");
    assert_eq!(browser.value(page, "lrfslam.views()[0].measured.length"), 0);
}
